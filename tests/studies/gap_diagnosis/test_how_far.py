"""What is said of the files of a diagnosis: which is handed over, what it lacks, and what stands at its bounds."""

from __future__ import annotations

import copy
from typing import Any

from studies.gap_diagnosis.answer import sentences
from studies.gap_diagnosis.how_far import elsewhere


def test_what_is_told_of_a_record_that_was_held_out(results: dict[str, Any]) -> None:
    def file(name: str, force: float, position: float) -> dict[str, Any]:
        return {"file": name, "force_N": [force], "position_m": [position], "settling_s": [None]}

    far = results["how_far"]
    for position, says in ((1e-6, "the gap shrinks there"), (3e-6, "the gap is larger there in position error")):
        files = [file("as delivered", 2.0, 2e-6), file(far["adopted_file"], 1.5, position)]
        (told,) = elsewhere({**far, "hold_out": {"records": ["b.csv"], "files": files}})
        assert says in told
    assert elsewhere({**far, "hold_out": None}) == []
    files = [file("as delivered", 2.0, 2e-6), file("with effects", 1.9, 77.0)]
    apart = {"records": ["b.csv"], "files": files, "refused": "with effects"}
    told, then = elsewhere({**far, "adopted_file": "as delivered", "hold_out": apart})
    assert "the gap is larger there in position error with the machine with effects: " in told
    assert then == "So improved.toml is the machine as delivered."


def test_harm_and_bounds_are_told_on_the_first_page(results: dict[str, Any]) -> None:
    harm = {"file": "with effects", "measure": "position", "unit": "m", "than": "as delivered"}
    bound = {"part": "nominal", "name": "payload_mass", "value": 40.0, "unit": "deviations of its tolerance"}
    far = {
        **results["how_far"],
        "adopted_file": "as delivered",
        "harms": [{**harm, "before": 2.3e-6, "after": 8.2e-6}],
        "at_bounds": [bound],
    }
    told = sentences({**results, "how_far": far})["how_far"]
    assert (
        "the machine with effects leaves a position error of 8.2 µm, and the machine as delivered one of 2.3 µm" in told
    )
    assert "improved.toml is the machine as delivered." in told
    assert "Payload mass is at the limit of twice the usual range: the model is incomplete." in told


def test_a_file_with_some_of_the_effects_says_which(results: dict[str, Any]) -> None:
    harm = {"file": "with effects", "measure": "settling", "unit": "s", "than": "re-fitted", "before": 2e-3}
    far = {
        **results["how_far"],
        "adopted_file": "with some of the effects",
        "without": ["cable_spring"],
        "harms": [{**harm, "after": 3e-3}],
        "files": [
            {**results["how_far"]["files"][0], "file": name}
            for name in ("as delivered", "re-fitted", "with some of the effects", "with effects")
        ],
    }
    verdict = {**results["verdict"], "outcome": "attributed", "effects": ["cable_spring", "cogging"]}
    told = sentences({**results, "how_far": far, "verdict": verdict, "adopted": ["cogging"]})["how_far"]
    assert "the machine with effects leaves an error of the settling times of 3 ms" in told
    assert "So improved.toml has the effects but cable spring, without which it does no harm." in told
    doubted = {**results, "how_far": {**far, "harms": []}, "verdict": verdict, "adopted": ["cogging"]}
    assert "So improved.toml has the effects but cable spring" in sentences(doubted)["how_far"]


def test_a_sine_that_stands_for_a_random_force_is_told(results: dict[str, Any]) -> None:
    said = "What shakes at random is in improved.toml as sines as strong as it is, with an arbitrary phase"
    assert said not in sentences(results)["how_far"]
    assert said in sentences({**results, "at_random": True})["how_far"]


def test_a_bound_of_a_law_that_is_named_says_nothing_of_the_rest(results: dict[str, Any]) -> None:
    bound = {"part": "cogging", "name": "period", "value": 0.1, "unit": "m"}
    verdict = {**results["verdict"], "outcome": "attributed", "effects": ["cogging"]}
    far = {**results["how_far"], "at_bounds": [bound]}
    named = sentences({**results, "verdict": verdict, "how_far": far})["how_far"]
    assert "The period of cogging is at the limit of twice the usual range: these records do not determine" in named
    beside = {**far, "at_bounds": [bound, {**bound, "part": "nominal", "name": "payload_mass"}]}
    assert "the model is incomplete" in sentences({**results, "verdict": verdict, "how_far": beside})["how_far"]
    unnamed = {**verdict, "outcome": "none_of_these", "effects": [], "partly": ["cogging"]}
    assert "the model is incomplete" in sentences({**results, "verdict": unnamed, "how_far": far})["how_far"]


def test_a_log_that_is_late_tells_its_change_and_claims_no_closure(results: dict[str, Any]) -> None:
    """Of a reference logged late the page had said that a controller mismatch "closes 0 % (0 to 0 %) of the gap"."""
    whole = copy.deepcopy(results)
    whole["verdict"] |= {"outcome": "attributed", "effects": ["controller_mismatch"], "partly": [], "equivalent": []}
    whole["how_far"]["stages"] = whole["how_far"]["stages"][:2]
    (replay,) = whole["where"]["details"]["controller"]
    replay |= {"replays": False, "would_fit": "the reference logged 3 samples late", "would_leave_N": 7e-6}
    replay |= {"tolerance_N": 6e-4, "rms_N": 53.0}
    told = sentences(whole)
    assert told["which"].startswith(
        "It is controller mismatch. With the reference logged 3 samples late, the stated controller makes the "
        "commands: correct the log, or the file, by that."
    )
    assert told["how_far"].startswith(
        "What is named is not part of improved.toml; re-fitting the nominal values takes the gap from"
    )
    assert "closes" not in told["how_far"]
    assert "under the commands as they were logged" in told["how_far"]
    kept = {**whole, "how_far": {**whole["how_far"], "adopted_file": "as delivered", "harms": []}}
    assert "as they were logged" not in sentences(kept)["how_far"]
    assert "as they were logged" not in sentences(results)["how_far"]
    for other in ({"would_leave_N": 1.0}, {"would_fit": None}):
        replay |= other
        assert "the stated controller makes" not in sentences(whole)["which"]


def test_a_mode_that_the_records_alone_have_elsewhere_is_told(results: dict[str, Any]) -> None:
    """A user's belt had lost 40 % of its stiffness, and no sentence named the mode."""
    far = {**results["how_far"], "modes_kept": 65.2, "frequency_alone_Hz": [37.39, 31.25]}
    told = sentences({**results, "how_far": far})["how_far"]
    assert "by 65 of its stated deviations (37.39 Hz becomes 31.25 Hz), and does not surely leave" in told
    assert "such as a belt or a coupling may have changed, a sweep tells (identify_machine)." in told
    told = sentences({**results, "how_far": {**far, "frequency_alone_Hz": [37.39, 37.4]}})["how_far"]
    assert "by 65 of its stated deviations, and does not" in told
    assert "a sweep tells" not in told
