"""What the first page of a report tells of the results of a diagnosis, sentence by sentence."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import pytest

from diagnosis.records.at_rest import Swing
from models.effects.motor import Cogging, ThrustSaturation
from reports import text
from studies.gap_diagnosis import report
from studies.gap_diagnosis.answer import front, sentences
from studies.gap_diagnosis.how_far import _carried_over


def test_the_answer_is_made_of_the_results(results: dict[str, Any]) -> None:
    assert sentences(results) == results["answer"]
    assert all(text.endswith(".") for part, text in results["answer"].items() if part != "outcome")
    assert front(results) == results["front"]


def test_the_first_page_says_all_but_what_its_figure_shows(results: dict[str, Any]) -> None:
    """In short and as remarks, each once: a figure of the gap stands in for the sentence of all its measures."""
    short, told = results["front"], results["answer"]
    for part in ("which", "how_far"):
        assert told[part].startswith(short[part])
    assert short["where"] == told["where"]
    said = " ".join([told["which"], told["how_far"]])
    for one in [short["which"], short["how_far"], *short["remarks"]]:
        assert said.count(one) == 1
        said = said.replace(one, "")
    assert re.fullmatch(r"\s*Over all motions the gap goes from ((?!\. ).)*\.\s*", said)


def test_a_loss_that_is_stated_at_another_thrust_is_told_at_the_rating(results: dict[str, Any]) -> None:
    """A loss of 0.000375 at 100 N is 15 % at the 2000 N of a machine tool."""
    part = ThrustSaturation(0.000375).at_rating(2000.0)
    assert part == pytest.approx(0.15)
    assert Cogging(1.0, 30e-3, 0.0).at_rating(2000.0) == 0.0
    verdict = {**results["verdict"], "outcome": "attributed", "effects": ["thrust_saturation"]}
    rows = [{"effect": "thrust_saturation", "part": part, "rated_N": 2000.0}]
    told = sentences({**results, "verdict": verdict, "at_rating": rows})["which"]
    assert " At the rated 2000 N, thrust saturation takes 15 % of the thrust." in told
    other = {**verdict, "effects": ["cogging"]}
    assert "At the rated" not in sentences({**results, "verdict": other, "at_rating": rows})["which"]


def test_what_it_resembles_is_told_first_where_nothing_has_a_name(results: dict[str, Any]) -> None:
    verdict = {**results["verdict"], "outcome": "none_of_these", "effects": [], "partly": ["cogging"]}
    told = front({**results, "verdict": verdict, "not_looked_for": ["gravity"]})
    assert "In part it resembles cogging (" in told["which"]
    assert "Not tried, as the machine file has no [priors.NAME] for it: gravity." in told["remarks"]


@pytest.mark.parametrize(
    ("topics", "chosen"),
    [
        (["size", "energy", "coordinate", "floor"], [0, 2]),
        (["controller", "size", "energy", "no_coordinate", "side"], [0, 1, 2]),
        (["unchecked", "size", "coordinate"], [1, 2]),
        (["size", "floor"], [0, 1]),
    ],
)
def test_the_first_page_chooses_what_was_found_by_its_topic(
    topics: list[str], chosen: list[int], results: dict[str, Any]
) -> None:
    texts = [f"Sentence {i}." for i in range(len(topics))]
    where = {**results["where"], "topics": topics, "statements": texts}
    assert sentences({**results, "where": where})["where"] == " ".join(texts[i] for i in chosen)


@pytest.mark.parametrize(
    ("outcome", "effects", "equivalent", "says"),
    [
        ("nothing_to_explain", [], [], "explains the records as it is"),
        ("parameters", ["payload_mass", "dead_time"], [], "Nominal values are off, payload mass by "),
        ("none_of_these", [], [], "the cause is not in the catalogue"),
        ("ambiguous", ["cogging"], [["cogging", "cable_spring"]], "cannot distinguish from it: cable spring"),
        ("ambiguous", ["current_loop_lag"], [["current_loop_lag", "dead_time"]], "from it: another dead time"),
        ("attributed", ["friction_relaxation"], [], "It is friction relaxation"),
    ],
)
def test_every_outcome_has_its_sentences(
    outcome: str, effects: list[str], equivalent: list[list[str]], says: str, results: dict[str, Any]
) -> None:
    verdict = {**results["verdict"], "outcome": outcome, "effects": effects, "equivalent": equivalent}
    told = sentences({**results, "verdict": verdict})
    assert says in told["which"]
    assert told["outcome"]
    assert told["how_far"].endswith(".")


def test_where_the_weights_do_not_hold_it_is_said_by_which_noise_the_limits_go(results: dict[str, Any]) -> None:
    weighed = {"walk_N_per_sample": 0.289, "chi_square_per_sample": [1.84, 1.82]}
    where = {**results["where"], "details": {**results["where"]["details"], "weighed": weighed}}
    far = {**results, "where": where, "chi_square_per_sample": {"with_effects": [1160.0, 1470.0]}}
    assert (
        "so that the stated deviations are too small; detection limits take what is left for a force that walks at "
        "random by 0.29 N a sample, beside which chi-square per sample is 1.8 and 1.8."
    ) in sentences(far)["which"]
    assert results["where"]["details"]["weighed"]["walk_N_per_sample"] is None


def test_what_was_not_tried_is_said_where_nothing_explains_the_records(results: dict[str, Any]) -> None:
    assert results["not_looked_for"] == ["velocity_strengthening"]  # not gravity, which no linear axis has
    verdict = {**results["verdict"], "outcome": "none_of_these", "effects": []}
    told = sentences({**results, "verdict": verdict})["which"]
    assert "Not tried, as the machine file has no [priors.NAME] for it: velocity strengthening." in told
    tried = sentences({**results, "verdict": verdict, "not_looked_for": []})["which"]
    assert "Not tried" not in tried


def test_the_input_delay_has_as_many_digits_as_its_deviation(results: dict[str, Any]) -> None:
    delay = {"total_s": 1.0429e-3, "std_s": 7.6e-7, "delivered_s": 1.04e-3}
    told = sentences({**results, "verdict": {**results["verdict"], "input_delay": delay}})["which"]
    assert "is 1.04290 ± 0.00076 ms instead of 1.04000 ms" in told
    wide = {**delay, "std_s": 1e-6, "total_s": 1.06e-3}
    told = sentences({**results, "verdict": {**results["verdict"], "input_delay": wide}})["which"]
    assert "is 1.0600 ± 0.001 ms instead of 1.0400 ms" in told


def test_a_delay_of_a_model_that_is_incomplete_is_not_said(results: dict[str, Any]) -> None:
    verdict = {**results["verdict"], "input_delay": {"total_s": 0.71e-3, "std_s": 25e-6, "delivered_s": 1.04e-3}}
    said = "The input delay"
    assert said in sentences({**results, "verdict": verdict})["which"]
    rough = {**results["chi_square_per_sample"], "with_effects": [14.0]}
    assert said not in sentences({**results, "verdict": verdict, "chi_square_per_sample": rough})["which"]
    bound = [{"part": "nominal", "name": "presliding_limit", "value": 6.0, "unit": "deviations of its tolerance"}]
    far = {**results["how_far"], "at_bounds": bound}
    assert said not in sentences({**results, "verdict": verdict, "how_far": far})["which"]


def test_values_that_an_incomplete_model_moved_far_are_said(results: dict[str, Any]) -> None:
    """The lag of an axis, known to 0.9 us, stood in for the hysteresis of its cable."""
    assert results["overrun"] == []  # the default table's file states no deviations
    row = {"name": "effects.current_loop_lag.time", "unit": "s", "before": 249.8e-6, "std": 0.88e-6, "now": 2e-6}
    moved = {**results, "overrun": [row]}
    complete = sentences(moved)["how_far"]  # a load that was changed, say
    assert "stand in for" not in complete
    assert (
        "1 value in improved.toml differs from the file's by at least 10 of its stated deviations: effects: "
        in complete
    )
    rough = {**results["chi_square_per_sample"], "with_effects": [14.0]}
    told = sentences({**moved, "chi_square_per_sample": rough})["how_far"]
    assert "stated deviations, and may stand in for what the model lacks" in told
    assert "effects: current loop lag time 249.8 µs ± 880 ns before and 2 µs now" in told
    verdict = {**results["verdict"], "outcome": "none_of_these", "effects": []}
    assert "and may stand in for what the model lacks" in sentences({**moved, "verdict": verdict})["how_far"]
    many = sentences({**results, "overrun": [row] * 5})["how_far"]
    assert "5 values in improved.toml differ" in many
    assert many.endswith("before and 2 µs now and 2 more.")


def test_values_that_the_re_fit_would_move_where_nothing_is_wrong_are_told(results: dict[str, Any]) -> None:
    """A drawn machine whose scale of 87 nm is coarser than its contacts: 30 % of its mass had been "off"."""
    verdict = {**results["verdict"], "outcome": "none_of_these", "effects": [], "partly": []}
    biased = [{"name": "friction_level", "tolerances": -5.4}, {"name": "payload_mass", "tolerances": -4.2}]
    force = {"usual": 1.8, "taken": 1.8, "by_record": [1.8], "interpolated": False, "biased": biased}
    told = sentences({**results, "verdict": verdict, "white_force_N": force})["which"]
    assert "moves values by some of their tolerances (friction level by -5.4 and payload mass by -4.2)" in told
    assert "values count as wrong by what they are off beyond that" in told
    assert "rougher than its model" not in told
    far = {**results["how_far"], "adopted_file": "as delivered", "harms": []}
    kept = sentences({**results, "verdict": verdict, "white_force_N": force, "how_far": far})["how_far"]
    assert "The re-fit is not believed. So improved.toml is the machine as delivered." in kept


def test_a_departing_controller_comes_before_a_lack_of_names(results: dict[str, Any]) -> None:
    details = {**results["where"]["details"], "controller": [{"replays": False, "command_late_samples": 0}]}
    verdict = {**results["verdict"], "outcome": "none_of_these", "effects": []}
    told = sentences({**results, "verdict": verdict, "where": {**results["where"], "details": details}})
    assert "Correct the log or the controller first" in told["which"]


def test_a_drive_at_its_end_is_told_first(results: dict[str, Any]) -> None:
    """A user's axis swung at 48 Hz, its command at the rating in 24 % of the samples, and no page said so."""
    assert all(one["at_rating"] == 0 for one in results["records"])
    assert "rated thrust in" not in sentences(results)["where"]
    records = [{**one, "at_rating": 0.238} for one in results["records"]]
    swinging = {**results, "records": records}
    said = f"The command stands at the rated thrust in 24 % of {records[0]['name']}"
    assert said in sentences(swinging)["where"]
    assert said in front(swinging)["where"]


def test_a_limit_of_the_drive_below_its_rating_is_told_first(results: dict[str, Any]) -> None:
    """A torque limit of 22 %, logged at one of 8 samples, so that no replay shows it."""
    assert all(one["kept_below_rating_N"] is None for one in results["records"])
    records = [{**one, "kept_below_rating_N": 331.76} for one in results["records"]]
    limited = {**results, "records": records}
    said = f"The commands of {records[0]['name']} stop at 331.8 N either way, below the rated thrust; where the drive"
    assert said in sentences(limited)["where"]
    assert said in front(limited)["where"]


def test_an_axis_that_swings_at_rest_is_told_first(results: dict[str, Any]) -> None:
    """A user's limit cycle of 3 um at 70 Hz, which no page named, beside a name for what it left."""
    assert all(one["swings"] == "" for one in results["records"])
    records = [{**one, "swings": str(Swing(69.83, 3.07e-6, 30, 31))} for one in results["records"]]
    said = (
        f"The axis of {records[0]['name']} swings at 69.8 Hz while its reference stands still, by 3.1 µm to each side"
    )
    for told in (sentences({**results, "records": records}), front({**results, "records": records})):
        assert said in told["where"]


def test_where_no_effect_was_tried_no_closure_is_claimed(results: dict[str, Any]) -> None:
    verdict = {**results["verdict"], "outcome": "none_of_these", "effects": []}
    far = {**results["how_far"], "stages": results["how_far"]["stages"][:2]}
    told = sentences({**results, "verdict": verdict, "how_far": far})
    assert told["how_far"].startswith("No effect reduces the gap by enough to go into the model")
    assert "%" not in told["how_far"]


def test_what_never_repeats_is_not_called_out_of_catalogue(results: dict[str, Any]) -> None:
    """An air bearing whose thrust is noisy, with 8 % more mass than its file says: the re-fit leaves the floor."""
    verdict = {**results["verdict"], "outcome": "none_of_these", "effects": [], "partly": []}
    gap = {"force_N": 0.0185, "position_m": 5e-9, "settling_s": None}
    far = {**results["how_far"], "floor_source": "repeats", "gap_refitted": gap, "floor": {**gap, "force_N": 0.0188}}
    shifts = [{**row, "moved": -5.13 if row["name"] == "payload_mass" else 0.1} for row in results["shifts"]]
    shifts = [{**row, "std": [0.015]} if row["name"] == "payload_mass" else row for row in shifts]
    given = {**results, "verdict": verdict, "how_far": far, "shifts": shifts}
    told = sentences(given)["which"]
    assert told.startswith(
        "Nominal values are off, payload mass by -7.4 %. What is left of the re-fitted model differs"
    )
    assert "not in the catalogue" not in told
    others = [{**far, "gap_refitted": {**gap, "force_N": size}} for size in (0.05, 0.002)]
    for still in ({**far, "floor_source": "simulated"}, *others):
        assert "the cause is not in the catalogue" in sentences({**given, "how_far": still})["which"]


def test_weights_that_hold_for_no_record_are_said_in_whatever_order(results: dict[str, Any]) -> None:
    for left in ([8.9, 0.12], [0.12, 8.9]):
        told = sentences(
            {**results, "chi_square_per_sample": {**results["chi_square_per_sample"], "with_effects": left}}
        )
        assert "are too small for some and too large for others" in told["which"]


def test_how_far_a_part_of_an_explanation_goes_is_said(results: dict[str, Any]) -> None:
    verdict = {**results["verdict"], "outcome": "none_of_these", "effects": [], "partly": ["cogging"]}
    gap = {"position_m": 1e-6, "settling_s": None}
    far = {
        **results["how_far"],
        "stages": [{**gap, "added": name, "force_N": 1.0} for name in ("as delivered", "re-fitted", "cogging")],
        "gap_refitted": {**gap, "force_N": 2.0},
        "gap_after": {**gap, "force_N": 1.234, "position_m": 3e-7},
    }
    told = sentences({**results, "verdict": verdict, "how_far": far})["how_far"]
    assert "which is not the whole answer and not in improved.toml. Over all motions the gap goes from 2 N to" in told
    assert "1.23 N of unknown force, from 1 µm to 0.3 µm of position" in told


def test_a_curve_of_more_friction_elements_than_the_file_has_is_said(results: dict[str, Any]) -> None:
    finer = {**results, "friction_elements": {"file": 7, "fitted": 14}}
    told = sentences(finer)["which"]
    assert told == sentences(results)["which"] + (
        " The records show the friction's curve between the 7 elements of the machine file; it is fitted with 14."
    )
    verdict = {**results["verdict"], "outcome": "none_of_these", "effects": [], "partly": []}
    assert (
        "or is what so few elements leave of the friction's curve" in sentences({**finer, "verdict": verdict})["which"]
    )


def test_of_an_effect_that_is_in_the_model_twice_both_members_are_said(results: dict[str, Any]) -> None:
    def member(size: float, pitch: float) -> dict[str, Any]:
        values = {"amplitude": (size, "N", "amplitude"), "pitch": (pitch, "m", "shape"), "phase": (1.0, "1", "phase")}
        return {name: {"value": v, "unit": u, "std": None, "role": r} for name, (v, u, r) in values.items()}

    row = {**results["which"][0], "effect": "cogging", "parameters": member(2.0, 0.03)}
    verdict = {**results["verdict"], "outcome": "attributed", "effects": ["cogging"]}
    told = sentences({**results, "verdict": verdict, "which": [{**row, "further_members": [member(1.0, 0.02)]}]})
    assert "It is cogging (amplitude 2 N, pitch 30 mm; and amplitude 1 N, pitch 20 mm)." in told["which"]
    told = sentences({**results, "verdict": verdict, "which": [{**row, "further_members": []}]})
    assert "It is cogging (amplitude 2 N, pitch 30 mm)." in told["which"]


@pytest.mark.parametrize(
    ("names", "interval", "says"),
    [
        (["cogging", "play"], [0.6, 0.8], "; 20 to 40 % of the gap remain unexplained. Over all motions"),
        (["cogging", "play"], [0.6, 0.95], ""),  # perhaps all of it has one
        (["cogging"], [0.3, 0.6], ""),  # one is named so where nothing more is missing
        (["controller_mismatch", "play"], [0.0, 0.0], ""),
        (["cogging", "timing_jitter"], [0.6, 0.8], ""),
    ],
)
def test_what_surely_has_no_name_beside_names_is_said(
    names: list[str], interval: list[float], says: str, results: dict[str, Any]
) -> None:
    verdict = {**results["verdict"], "outcome": "attributed", "effects": names}
    told = sentences({**results, "verdict": verdict, "how_far": {**results["how_far"], "closure_interval": interval}})
    assert ("unexplained" in told["how_far"]) == bool(says)
    assert says in told["how_far"]


def test_what_stands_in_for_a_floor_is_said_where_nothing_repeats(results: dict[str, Any]) -> None:
    """The quick run's moves are all different."""
    text = results["where"]["statements"][-1]
    assert text.startswith("No motion is repeated, so repeats give no noise floor; the innovations put it at ")
    assert results["where"]["details"]["floor"]["repeats"] is None


def test_a_bound_where_no_effect_is_missing_does_not_make_the_model_incomplete(results: dict[str, Any]) -> None:
    """Both stood on one page of a healthy axis."""
    bound = {"part": "nominal", "name": "presliding_stiffness", "value": 4.0, "unit": "1"}
    verdict = {**results["verdict"], "outcome": "parameters", "effects": ["payload_mass"]}
    far = {**results["how_far"], "gap_refitted": results["how_far"]["floor"], "at_bounds": [bound]}
    told = sentences({**results, "verdict": verdict, "how_far": far})
    assert "no effect is missing" in told["which"]
    assert "the model is incomplete" not in told["how_far"]
    assert "twice the usual range: farther off than that, or not determined by these records." in told["how_far"]


def test_a_re_fit_that_leaves_no_more_than_the_floor_has_no_closure(results: dict[str, Any]) -> None:
    far = results["how_far"]
    terms = {**far["closure_terms"], "floor": 2 * far["closure_terms"]["refitted"]}
    told = sentences({**results, "how_far": {**far, "closure_terms": terms}})["how_far"]
    assert "no closure of that gap can be told" in told
    assert "closes" not in told
    assert "closes" in sentences(results)["how_far"]
    moved = {**terms, "measure": "position", "unit": "m", "refitted": 5e-8, "floor": 1e-8}
    told = sentences({**results, "how_far": {**far, "closure_terms": moved}})["how_far"]
    assert "of the gap in position (in force it is not sure) between the re-fitted model and the noise floor" in told


def test_a_nominal_value_that_is_off_is_told_with_its_size(results: dict[str, Any]) -> None:
    rows = {
        "payload_mass": {"moved": -2.0, "std": [0.015, 0.015], "unit": "1", "values": 1},
        "dead_time": {"moved": 0.5, "std": [2e-5, 2e-5], "unit": "s", "values": 1},
        "presliding_stiffness": {"moved": 3.0, "std": [0.01, 0.03], "unit": "1", "values": 8},
    }
    verdict = {**results["verdict"], "outcome": "parameters", "effects": list(rows)}
    shifts = [{"name": name, **row} for name, row in rows.items()]
    told = sentences({**results, "verdict": verdict, "shifts": shifts})["which"]
    assert "off, payload mass by -3 %, dead time by 10 µs and presliding stiffness by up to 9.4 %; re-fitted" in told
    told = sentences({**results, "verdict": verdict, "shifts": [*shifts[:2], {**shifts[2], "in_all": -0.031}]})["which"]
    assert "and presliding stiffness by -3.1 % in all (single contacts by up to 9.4 %); re-fitted" in told
    rows["payload_mass"]["moved"] = math.log1p(72) / 0.015
    shifts = [{"name": name, **row} for name, row in rows.items()]
    assert "payload mass by 72 times," in sentences({**results, "verdict": verdict, "shifts": shifts})["which"]


@pytest.mark.parametrize(("rival", "said"), [("dead_time", True), ("cable_spring", False)])
def test_the_input_delay_is_told_where_a_dead_time_is_a_rival(rival: str, said: bool, results: dict[str, Any]) -> None:
    """Elsewhere it may stand in for what the model lacks."""
    equivalent = [["current_loop_lag", rival]]
    delay = {**results["verdict"]["input_delay"], "total_s": 1e-3, "std_s": 1e-6, "delivered_s": 0.7e-3}
    more = {"outcome": "ambiguous", "effects": ["current_loop_lag"], "equivalent": equivalent, "input_delay": delay}
    told = sentences({**results, "verdict": {**results["verdict"], **more}})["which"]
    assert ("is 1.0000 ± 0.001 ms instead of 0.7000 ms" in told) == said


@pytest.mark.parametrize(("least", "small"), [(0.5, False), (1.5, True)])
def test_a_shift_that_is_sure_below_the_noise_floor_is_said_to_be_small(
    least: float, small: bool, results: dict[str, Any]
) -> None:
    """On a healthy axis, what is left of an identification's errors."""
    delivered = results["how_far"]["gap_as_delivered"]
    far = {**results["how_far"], "floor": {**results["how_far"]["floor"], "force_N": least * delivered["force_N"]}}
    verdict = {**results["verdict"], "outcome": "parameters", "effects": ["presliding_stiffness"]}
    told = sentences({**results, "verdict": verdict, "how_far": far})["how_far"]
    assert ("what is off is sure, and small" in told) == small


@pytest.mark.parametrize("still", [False, True])
def test_the_figure_of_gains_says_what_they_are_beside(still: bool, quick: Path, results: dict[str, Any]) -> None:
    whole = json.loads((quick / "results.json").read_text())
    whole["results"] = {**results, "verdict": {**results["verdict"], "beside_still_force": still}}
    captions = {figure.name: str(figure.caption) for figure in report.tell(whole).figures}
    assert ("beside a white unknown force" in captions["gains"]) == still


@pytest.mark.parametrize(("every", "said"), [(1, True), (3, False)])
def test_the_report_says_why_a_controller_was_not_replayed(every: int, said: bool, quick: Path) -> None:
    """Of a log of one of three samples that is said with the record."""
    whole = json.loads((quick / "results.json").read_text())
    for one in whole["results"]["where"]["details"]["controller"]:
        one |= {"checked": False, "every": every, "why_not": "it has no reference"}
    told = report.tell(whole)
    captions = {figure.name: figure.caption for figure in told.figures}
    page = text.fill(told.template, whole, captions, told.filters)
    assert ("cannot tell whether the stated controller made it, because it has no reference." in page) == said
    assert not re.search(r"{[#%{](?!tbl|fig|sec)", page)
    assert "replayed on the logged error" not in page


def test_a_name_that_no_record_has_confirmed_is_marked_and_the_way_on_is_said(results: dict[str, Any]) -> None:
    names = ["friction_relaxation", "cogging"]
    asked = {"needed": 50.0, "looks": [{"log10_e_values": {"cogging": 0.5}}]}
    next_ = {"outcome": "attributed", "effects": names, "next_experiment": "Run it."}
    verdict = {**results["verdict"], **next_, "confirmed": False, "unconfirmed": ["cogging"]}
    told = sentences({**results, "verdict": verdict, "asked": asked})
    assert told["outcome"] == "Attributed to friction relaxation and cogging (cogging unconfirmed)"
    assert told["which"].endswith(
        " Cogging comes up after the first look, and no record that did not choose it has confirmed it yet "
        "(e-value 3.2, 50 needed): run next_experiment.csv and go on with it (--continue)."
    )
    alone = {**verdict, "effects": ["cogging"], "next_experiment": ""}
    told = sentences({**results, "verdict": alone, "asked": asked})
    assert told["outcome"] == "Attributed to cogging (unconfirmed)"
    assert "make another record and go on with it" in told["which"]


@pytest.mark.parametrize(
    ("left", "outcome", "doubted"),
    [(0.71, "attributed", True), (0.3, "attributed", False), (0.71, "none_of_these", False)],
)
def test_a_name_that_explains_no_other_record_is_doubted(
    left: float, outcome: str, doubted: bool, results: dict[str, Any]
) -> None:
    """A flexure that hardens had been a saturation, by a fit that left as much of the other record as the file did."""
    gaps = {"as delivered": 0.7, "re-fitted": 0.72, "with effects": left}
    rows = [{"file": name, "elsewhere": {"force_N": force, "position_m": 1e-6}} for name, force in gaps.items()]
    transfer = {"matrices": rows, "by_record": []}
    told = _carried_over(transfer, named=outcome == "attributed")
    assert any("does not carry over" in sentence for sentence in told) is doubted
    verdict = {**results["verdict"], "outcome": outcome, "effects": ["cogging"][: outcome == "attributed"]}
    how_far = {**results["how_far"], "transfer": transfer}
    assert (
        "does not carry over" in sentences({**results, "verdict": verdict, "how_far": how_far})["how_far"]
    ) is doubted


def test_values_that_leave_a_force_far_above_the_floor_are_not_all_that_is_off(results: dict[str, Any]) -> None:
    """A slow wind in the only record, which the filter follows: the page said that no effect is missing, and the file
    with the re-fitted values left 2.4 N of the next day's record, as delivered 1.8 N."""
    verdict = {**results["verdict"], "outcome": "parameters", "effects": ["payload_mass"]}
    gap = {**results["how_far"]["floor"], "force_N": 0.0233}
    far = {**results["how_far"], "floor": gap, "gap_refitted": {**gap, "force_N": 1.162}}
    told = sentences({**results, "verdict": verdict, "how_far": far})["which"]
    assert "no effect is missing" not in told
    assert (
        "re-fitted, they leave a slow force of 1.2 N that no effect was found for (the noise floor is 0.023 N): values "
        "may stand in for it, and other records be predicted worse than as delivered." in told
    )
