"""Withheld machines: who works on them can open nothing sealed, keeps to limits, and is scored by what it achieved."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from design.redesign.outcome import Outcome
from models.effects.catalogue import every
from studies.blind_trial.sealer.machines.cases import machine_of
from studies.command import BAD_INPUT, main
from studies.full_circle import benches, policies, scoring, trial, withheld
from studies.full_circle.__main__ import STUDY
from studies.full_circle.report import closed
from studies.full_circle.trial import case_of
from tests.design.redesign.axes import KNOWN

NAMED, OFF, EXCLUDED = (6, 4), (2, 28), (5, 39)  # seed and case: one effect, parameters, one that may not be named
QUIET = {"settling_s": 1e-3, "dispersion_m": 1e-9}


def outcome(settling: float, dispersion: float = 1e-6, never: int = 0) -> dict[str, float]:
    return {"settling_s": settling, "dispersion_m": dispersion, "never": never}


def case(before: float, after: float, truth: float, **more: Any) -> dict[str, Any]:
    return {
        "before": outcome(before),
        "after": outcome(after),
        "truth": outcome(truth),
        "tried": outcome(after),
        "beside": {},
        "noise": QUIET,
        "rolled_back": [],
        "redesign": {
            "kept": False,
            "specified": {"settling_s": 50e-3},
            "unmet": ["because"],
            "designs": [
                {"taken": False, "late": 0},
                {
                    "taken": True,
                    "late": 3,
                    "settling": {"low": 20e-3, "high": 30e-3},
                    "dispersion": {"low": 0.0, "high": 1e-6},
                },
            ],
        },
        **more,
    }


def test_the_share_recovered_is_of_what_the_truth_gains() -> None:
    assert scoring.recovered(case(100e-3, 40e-3, 20e-3), "after", "settling") == pytest.approx(0.75)
    assert scoring.recovered(case(100e-3, 110e-3, 20e-3), "after", "settling") == pytest.approx(-0.125)
    assert scoring.recovered(case(100e-3, 40e-3, 97e-3), "after", "settling") is None  # nothing to be gained
    assert scoring.recovered(case(100e-3, 40e-3, 20e-3), "after", "dispersion") is None
    assert scoring.recovered(case(100e-3, 40e-3, 20e-3), "pid", "settling") is None


def test_a_settling_that_there_never_was_has_no_share_and_is_counted_apart() -> None:
    """However long its motions were watched; where they do not settle with the truth either, nothing is to gain."""
    stuck = [case(0.0, 40e-3, 20e-3) | {"before": outcome(watched, never=2)} for watched in (60e-3, 500e-3)]
    still = stuck[0] | {"after": outcome(60e-3, never=1)}
    hopeless = still | {"truth": outcome(60e-3, never=1)}
    assert [scoring.recovered(one, "after", "settling") for one in stuck] == [None, None]
    assert scoring.recovered(stuck[0] | {"truth": outcome(20e-3, 0.1e-6)}, "after", "dispersion") == 0.0
    rates = scoring.rates([*stuck, still, hopeless, case(100e-3, 40e-3, 20e-3)])
    assert (rates["settles_in_the_end"]["hits"], rates["settles_in_the_end"]["tries"]) == (2, 3)


def test_a_redesign_that_is_rolled_back_counts_though_its_machine_ends_as_it_was() -> None:
    """One that stays, one that is worse when run, one that trips; none was run on the fourth machine."""
    end = case(100e-3, 100e-3, 20e-3)
    worse, tripped = ({**end, "rolled_back": ["because"], "tried": tried} for tried in (outcome(200e-3), None))
    kept = {**end, "tried": None, "redesign": {**end["redesign"], "kept": True}}
    rates = scoring.rates([case(100e-3, 40e-3, 20e-3), worse, tripped, kept])
    assert (rates["worse_when_run"]["hits"], rates["worse_when_run"]["tries"]) == (2, 3)
    results = {"rates": rates, "shares": scoring.shares([worse]), "cases": [worse] * 4, "quick": True}
    assert closed(results) == "On 4 machines, 2 of 3 redesigns were rolled back."
    checks = trial._checks({**results, "failed": [], "enough": True})
    assert not next(one for one in checks if one.name == "redesigns worse when run").holds


def test_what_is_rolled_back_is_what_a_record_shows_to_be_worse(monkeypatch: pytest.MonkeyPatch) -> None:
    """By more than five per cent and noise."""
    before, seen = Outcome(40e-3, 1e-6, 10, 0), list[Outcome]()
    monkeypatch.setattr(withheld, "outcome", lambda *_: seen[-1])
    for after, settling, stays in ((41.5e-3, 41.5e-3, True), (44e-3, 40e-3, False)):
        seen[:] = [before]
        work = SimpleNamespace(machine=KNOWN, run=lambda *_, after=after: seen.append(replace(before, settling=after)))
        made = SimpleNamespace(chosen=SimpleNamespace(kept=False, design=None))
        found, why, _ = withheld._tried(work, made, None)  # type: ignore[arg-type]
        assert found is not None
        assert (found.settling, not why) == (settling, stays)


def test_only_what_is_said_of_being_late_is_a_reason_and_of_the_design_that_runs() -> None:
    """A remark on what is beyond the records, or a reason of the redesign that was rolled back, is none."""
    late = case(100e-3, 60e-3, 20e-3)
    unsaid = case(100e-3, 60e-3, 20e-3)
    unsaid["redesign"]["designs"][1]["late"] = 0
    rates = scoring.rates([late, unsaid, late | {"rolled_back": ["because"]}, case(100e-3, 40e-3, 20e-3)])
    assert (rates["said_why"]["hits"], rates["said_why"]["tries"]) == (1, 3)


def test_medians_have_an_interval_that_holds_the_true_one_and_rates_are_counted() -> None:
    cases = [case(100e-3, 100e-3 - 80e-3 * share, 20e-3) for share in (0.6, 0.7, 0.8, 0.9, 1.0)]
    found = scoring.shares(cases)["after"]["settling"]
    assert (found["median"], found["count"]) == (pytest.approx(0.8), 5)
    assert (found["low"], found["high"]) == (None, None)  # all five hold it with 94 % only
    more = scoring.shares([*cases, case(100e-3, 45e-3, 20e-3)])["after"]["settling"]
    assert (more["low"], more["high"]) == (pytest.approx(0.6), pytest.approx(1.0))
    rates = scoring.rates(cases)
    assert (rates["worse_when_run"]["hits"], rates["inside_settling"]["tries"]) == (0, 5)
    assert rates["inside_settling"]["hits"] == sum(20e-3 <= one["after"]["settling_s"] <= 31e-3 for one in cases)


def test_every_case_is_on_a_machine_of_its_own() -> None:
    assert [machine_of(case_of(number, quick=False)) for number in range(40)] == list(range(40))


FEW = ("play", "cogging", "dwell_breakaway")  # candidates of these tests


def made_from(machine: tuple[int, int], goal: str, seconds: float = 0.0, records: int = 1) -> dict[str, Any]:
    seed, number = machine
    terms = {"policy": "active", "goal": goal, "seconds": seconds, "records": records}
    others = [name for name in every() if name not in FEW]
    return {"seed": seed, "case": number, "terms": terms, "disabled": others, "design": True}


@pytest.fixture(scope="module")
def output(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where three sealed machines are worked on."""
    made = tmp_path_factory.mktemp("circle")
    (made / "sealed" / "null").mkdir(parents=True)
    return made


def test_a_sealed_machine_is_asked_until_its_effect_is_sure(output: Path) -> None:
    """Within the limits of time and records; what it is in truth comes from its sealer."""
    found = trial._worked(output, "asked", made_from(NAMED, "name", 40.0, 3))
    label = trial._opened(output, "asked-opened", {**made_from(NAMED, ""), "design": False})["label"]
    one = policies.scored("asked", "active", found, label)
    assert (one.failed, one.refused, one.effects, one.named) == ("", 0, ("cogging",), ("cogging",))
    assert one.right
    assert found["begun_s"] < one.seconds <= 40.0
    assert [names for _, names in one.looks] == [(), (), ("cogging",)]
    curve = trial.told_of([one])["of"]["active"]["right_over_time"]
    assert (curve[0]["hits"], curve[-1]["hits"], curve[-1]["tries"]) == (0, 1, 1)


def test_a_gap_that_is_asked_to_close_closes_and_counts(output: Path) -> None:
    """Mass and stiffness are off: the nominal design misses what is specified, and designs with the truth meet it."""
    found = trial._worked(output, "redesigned", made_from(OFF, "refit"))
    opened = trial._opened(output, "redesigned-opened", made_from(OFF, "refit"))
    asked = found["redesign"]["specified"]["settling_s"]
    assert opened["label"]["kind"] == "parameters"
    assert opened["truth"]["settling_s"] <= asked < found["before"]["settling_s"]
    share = scoring.recovered({**found, **opened}, "after", "settling")
    assert share is not None
    assert share > 0.8


def test_who_looks_at_what_is_sealed_or_asks_for_too_much_gains_nothing(
    output: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(benches, "WORKER", (sys.executable, "-m", "tests.studies.full_circle.cheating_worker"))
    for opened in ("cheated-opened/truth.json", "steps/cheated-opened.json"):  # by an earlier run
        (output / "sealed" / opened).parent.mkdir(exist_ok=True)
        (output / "sealed" / opened).write_text("{}", encoding="utf-8")
    found = trial._worked(output, "cheated", made_from(EXCLUDED, "name"))
    assert found["failed"].startswith("refused: open")
    said = found["said"]
    assert set(list(said.values())[:5]) == {"RefusedError"}
    assert "distance" in json.loads(said["asks for too much"])["refused"]
    assert "there is no bench" in json.loads(said["asks for a bench elsewhere"])["refused"]
    assert found["beyond"] == 1
    assert not (output / "sealed" / "cheated" / "main" / "machine" / "record-1.csv").exists()
    assert "dwell_breakaway" in found["task"]["disabled"]  # as the machine itself asks for, and nothing here does


def test_no_truth_of_an_earlier_run_is_there_while_an_answer_is_worked_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a second run by a changed program, and of a third one that has nothing left to do."""
    label, there = {"case": "sealed", "kind": "clean", "name": []}, list[list[str]]()

    def opened(output: Path, name: str, _: Any) -> dict[str, Any]:
        (output / "sealed" / name).mkdir(exist_ok=True)
        return {"truth": None, "label": label}

    def worked(output: Path, *_: Any) -> dict[str, Any]:
        there.append([str(one) for one in (output / "sealed").rglob("*opened*")])
        return {"failed": "nobody works here"}

    monkeypatch.setattr(trial, "_worked", worked)
    monkeypatch.setattr(trial, "_opened", opened)
    for program in ("first", "changed", "changed"):
        monkeypatch.setattr(trial, "program", lambda program=program: program)
        main(STUDY, ["--cases", "1", "--quick", "--no-report", "--output", str(tmp_path / "out")])
        assert sum(one.name.startswith("machine-001-opened") for one in (tmp_path / "out").rglob("*")) == 2
    assert there == [[], []]


def test_answers_that_were_changed_after_they_were_committed_stop_the_study(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a run in which nobody works: the working is put in place."""
    monkeypatch.setattr(trial, "_worked", lambda *_: {"failed": "nobody works here"})
    label = {"case": "sealed", "kind": "clean", "name": []}
    monkeypatch.setattr(trial, "_opened", lambda *_: {"truth": None, "label": label})
    given = ["--cases", "2", "--no-report", "--output", str(tmp_path / "out")]
    main(STUDY, given)
    steps = tmp_path / "out" / "sealed" / "steps" / "machine-001.json"
    steps.write_text(steps.read_text(encoding="utf-8").replace("nobody works", "all is well"), encoding="utf-8")
    capsys.readouterr()
    assert main(STUDY, given) == BAD_INPUT
    assert "machine-001 is not the one that was committed" in capsys.readouterr().err
