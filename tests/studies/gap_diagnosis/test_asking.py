"""--machine-process: what is run on the machine, what is kept, and that only confirmed names are given."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import positioning as pos
from diagnosis.experiments.active import Asked, Budget, Settings, Step
from diagnosis.experiments.e_process import EProcess
from diagnosis.experiments.look import Found
from diagnosis.experiments.policy import Stop
from diagnosis.experiments.within_limits import Bounds, experiments
from diagnosis.verdict import Outcome
from models.machine import DEFAULT, Machine, load
from models.records.record import Record
from studies.command import BAD_INPUT, DONE, parser_of
from studies.gap_diagnosis import __main__ as command
from studies.gap_diagnosis import answer, asking
from studies.gap_diagnosis.course import confirmed, copies, course, ended, told
from studies.identify_machine import own_records
from studies.options import BadInputError
from tests.studies.gap_diagnosis.test_study import write
from tests.studies.stand_in_axis import LIMITS

AXIS = f"{sys.executable} -m tests.studies.stand_in_axis"
FOUND = Found(Outcome.ATTRIBUTED, ("cogging",), (), {"cogging": 200.0})
ROUGHNESS = {
    "white_force_N": {"taken": 1.0, "usual": 1.0, "records": [1.0], "interpolated": False},
    "chi_square_per_sample": {"re_fitted": [1.0], "with_effects": [1.0]},
}
VERDICT = {"outcome": "attributed", "effects": ["cogging"], "partly": [], "equivalent": []}


@pytest.fixture
def script(monkeypatch: pytest.MonkeyPatch) -> list[Budget]:
    """In place of a diagnosis: two experiments are run, and a name is confirmed. The budgets that were given."""
    budgets: list[Budget] = []

    def ask(machine: Machine, run: Any, budget: Budget, _settings: Settings, **_: Any) -> Asked:
        budgets.append(budget)
        menu = experiments(machine, budget.bounds)
        records = [run(one.schedule) for one in menu[:2]]
        steps = tuple(Step("moves", "to begin", 1.5, None, FOUND, EProcess(9.0, {"cogging": 9.0})) for _ in records)
        made = tuple(one for one in records if isinstance(one, Record))
        names = ("cogging",) if made else ()
        return Asked(Stop.NAMED, "cogging: confirmed", names, steps, made, None, ("play",))

    monkeypatch.setattr(asking, "ask", ask)
    return budgets


@pytest.fixture
def studied(monkeypatch: pytest.MonkeyPatch) -> list[argparse.Namespace]:
    """What the study is asked, instead of running it."""
    seen: list[argparse.Namespace] = []

    def drafted(given: argparse.Namespace) -> int:
        seen.append(given)
        return DONE

    monkeypatch.setattr(command, "_drafted", drafted)
    return seen


def asked(way: str, output: Path, *more: str) -> int:
    return command.main(["--machine-process", f"{AXIS} '{way}'", "--output", str(output), "--no-report", *more])


def test_the_records_are_kept_and_diagnosed_like_any_others(
    script: list[Budget], studied: list[argparse.Namespace], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert asked("clean", tmp_path / "out", "--machine", str(DEFAULT), "--seed", "3") == DONE
    (whole,) = studied
    work = tmp_path / "out-machine"
    files = [work / "machine" / "run1.csv", work / "machine" / "run2.csv"]
    once = [*map(str, files), "--machine", str(DEFAULT), "--output", str(tmp_path / "out"), "--no-report"]
    once += ["--seed", "3", "--looks", str(work / "looks.json"), "--trust-records"]
    assert vars(whole) == vars(parser_of(command.STUDY).parse_args(once)) | {"continue_": None, "draft_effect": None}
    assert json.loads((work / "looks.json").read_text(encoding="utf-8"))["effects"] == ["cogging"]
    said = capsys.readouterr().out
    assert "2. 1.5 s (to begin): moves -> attributed: cogging, e-value 8.1e+03" in said
    assert "Named cogging after 3 s of machine time" in said
    (budget,) = script
    assert budget.bounds == Bounds(LIMITS["distance_m"], LIMITS["speed_m_per_s"], LIMITS["feedforward_N"])
    assert (budget.seconds, budget.records) == (LIMITS["machine_time_s"], LIMITS["records"])


def test_the_time_and_the_samples_bound_the_budget(
    script: list[Budget], studied: list[argparse.Namespace], tmp_path: Path
) -> None:
    asked("clean", tmp_path / "one", "--machine", str(DEFAULT), "--seconds", "12 s")
    asked("clean", tmp_path / "two", "--machine", str(DEFAULT), "--most-samples", "10000")
    assert [one.seconds for one in script] == [12.0, 5.0]
    assert studied[0].seconds is None


@pytest.mark.parametrize(
    ("way", "more", "said"),
    [
        ("clean", (), "writes no nominal.json; give --machine FILE"),
        ("ends at once", ("--machine", str(DEFAULT)), "it said: no axis here"),
        ("refuses", ("--machine", str(DEFAULT)), "no record was made"),
        ("clean", ("--machine", str(DEFAULT), "--continue", "."), "give the earlier records as RECORD"),
        ("clean", ("--machine", str(DEFAULT), "--seconds", "0 s"), "--seconds"),
        ("clean", ("--machine", str(DEFAULT), "--draft-effect", "no such folder/law.py"), "--draft-effect"),
    ],
)
@pytest.mark.usefixtures("script")
def test_what_cannot_be_is_one_line(
    studied: list[argparse.Namespace],
    way: str,
    more: tuple[str, ...],
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """And leaves nothing behind, but for what a machine was asked."""
    assert asked(way, tmp_path / "out", *more) == BAD_INPUT
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error:")]
    assert said in line
    assert not studied
    assert (tmp_path / "out-machine").exists() == (way == "refuses")


@pytest.mark.usefixtures("script")
def test_it_does_not_begin_with_a_log_of_every_second_sample(
    studied: list[argparse.Namespace], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Which may be refused for its commands in the middle of the course, when the machine has moved."""
    log = write(own_records.motions(load(), 1).thinned(2), tmp_path / "log.csv")
    assert asked("clean", tmp_path / "out", str(log), "--machine", str(DEFAULT), "--trust-records") == BAD_INPUT
    assert "begins with records that hold all samples of the controller" in capsys.readouterr().err
    assert not studied


@pytest.mark.usefixtures("script", "studied")
def test_records_of_an_earlier_run_are_never_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "out-machine").mkdir()
    assert asked("clean", tmp_path / "out", "--machine", str(DEFAULT), "--overwrite") == BAD_INPUT
    assert "holds what a machine made before" in capsys.readouterr().err


def looks(outcome: str, effects: list[str], logarithm: float) -> dict[str, Any]:
    after = {"outcome": "attributed", "names": ["cogging"], "alike": []}
    one = {"seconds": 2.0, "asked": "moves", "why": "so", "failed": "", "before": None, "after": after}
    last = {**one, "log10_e_value": logarithm, "log10_e_values": {"cogging": logarithm}}
    return {
        "outcome": outcome,
        "effects": effects,
        "reason": "the machine's time is spent",
        "looks": [last],
        "seconds": 2.0,
        "needed": 50.0,
    }


def test_a_name_that_no_record_confirmed_is_not_given() -> None:
    assert confirmed(VERDICT, None) == VERDICT
    sure = confirmed(VERDICT, looks("named", ["cogging"], 3.0))
    assert (sure["outcome"], sure["confirmed"]) == ("attributed", True)
    unsure = confirmed(VERDICT, looks("cannot_tell", [], 0.3))
    assert (unsure["outcome"], unsure["effects"], unsure["partly"]) == ("none_of_these", [], ["cogging"])
    one_of_two = confirmed({**VERDICT, "effects": ["cogging", "play"]}, looks("named", ["cogging"], 3.0))
    assert (one_of_two["outcome"], one_of_two["confirmed"]) == ("attributed", False)


def test_a_name_that_no_record_confirmed_is_in_no_file(quick: Path, tmp_path: Path) -> None:
    """Neither in what is said nor in what is handed over; the same run without looks names it."""
    before = json.loads((quick / "results.json").read_text(encoding="utf-8"))["results"]
    (name,) = before["verdict"]["effects"]
    assert before["adopted"] == [name]
    assert f"[effects.{name}]" in (quick / "improved.toml").read_text(encoding="utf-8")
    file = tmp_path / "looks.json"
    file.write_text(json.dumps(looks("cannot_tell", [], 0.3)), encoding="utf-8")
    whole = pos.studies.gap_diagnosis(quick=True, looks=file)
    found = whole.results
    assert f"[effects.{name}]" not in whole.files["improved.toml"]
    assert (found["verdict"]["partly"], found["verdict"]["confirmed"]) == ([name], False)
    assert found["adopted"] == []
    assert found["how_far"]["adopted_file"] != "with effects"
    assert "and not in improved.toml" in found["answer"]["how_far"]


def test_a_set_of_alike_names_needs_that_something_is_there() -> None:
    alike = {**VERDICT, "outcome": "ambiguous", "equivalent": [["cogging", "thrust_ripple"]]}
    assert confirmed(alike, looks("cannot_tell", [], 3.0))["outcome"] == "ambiguous"
    assert confirmed(alike, looks("cannot_tell", [], 1.0))["outcome"] == "none_of_these"
    assert confirmed(alike, {**looks("cannot_tell", [], 3.0), "looks": []})["outcome"] == "none_of_these"
    nothing = {**VERDICT, "outcome": "nothing_to_explain", "effects": []}
    assert confirmed(nothing, looks("cannot_tell", [], 0.0)) == nothing


def test_what_is_unsure_is_told_so() -> None:
    content = looks("cannot_tell", [], 0.3)
    verdict = {**confirmed(VERDICT, content), "form": {}, "direction": None}
    results: dict[str, Any] = {
        "verdict": verdict,
        "asked": content,
        "where": {"details": {"controller": []}},
        "learned": None,
    }
    assert answer._outcome(results) == "No name is sure; it looks like cogging"
    told_of = " ".join(answer._which({**results, **ROUGHNESS}))
    assert "no independent record has confirmed it: the machine's time is spent" in told_of


def test_the_course_is_told_and_its_file_checked(tmp_path: Path) -> None:
    content = looks("cannot_tell", [], 7.0)
    content["looks"].append({**content["looks"][0], "failed": "tripped"})
    assert told(content).splitlines() == [
        "1. 2 s (so): moves -> attributed: cogging, e-value over a million",
        "2. 2 s (so): moves -> not run: tripped",
        "Cannot tell after 2 s of machine time: the machine's time is spent.",
    ]
    assert ended(content).startswith("Cannot tell")
    file = tmp_path / "looks.json"
    file.write_text(json.dumps(content), encoding="utf-8")
    assert course(file) == content
    assert course(None) is None
    unwhole = [json.dumps({**content, name: None}) for name in ("effects", "needed", "seconds", "reason")]
    unlooked = json.dumps({**content, "looks": [{"seconds": 2.0}]})
    for text in ("{", "[]", '{"looks": 3, "outcome": "named"}', *unwhole, unlooked):
        file.write_text(text, encoding="utf-8")
        with pytest.raises(BadInputError, match=r"looks\.json"):
            course(file)


def test_copies_have_names_of_their_own(tmp_path: Path) -> None:
    for folder in "ab":
        (tmp_path / folder).mkdir()
        np.savetxt(tmp_path / folder / "run.csv", [1.0])
    (tmp_path / "looks.json").write_text("{}", encoding="utf-8")
    found = copies([tmp_path / "a" / "run.csv", tmp_path / "b" / "run.csv"], tmp_path / "looks.json")
    assert sorted(found) == ["asked/1-run.csv", "asked/2-run.csv", "asked/looks.json"]
