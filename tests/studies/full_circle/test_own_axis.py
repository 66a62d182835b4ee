"""The circle on a small simulated axis: from its own strokes to a verified design, one command each time."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from design.deadbeat import DesignError
from design.redesign.outcome import judged_target, outcome
from design.redesign.prediction import resampled
from diagnosis.experiments.schedules import suite, to_csv
from models.controller import References, load
from models.machine import Machine
from models.machine_file import to_toml
from models.records.record import Record
from models.simulation.simulator import simulate
from studies.command import BAD_INPUT, CHECK_MISSED, DONE, main
from studies.full_circle import asked, folder_of_records, looked, own_axis, redesigning, verification
from studies.full_circle.__main__ import STUDY
from studies.full_circle.folder_of_records import loaded
from studies.full_circle.options import CircleOptions
from studies.full_circle.redesigning import old_design, references_of, table
from studies.full_circle.steps import Steps
from studies.options import BadInputError
from studies.sticking import found_in
from studies.study import Progress
from tests.design.machines import far_side
from tests.design.redesign.axes import KNOWN, TRUE

HEADER = "time_s,target_m,reference_m,feedforward_N,command_N,position_m"


def axis_runs(references: Path, record: Path, seed: int, controller: Path | None = None, worse: float = 1.0) -> None:
    """The axis follows a table, with the PID of a controller file or its own; worse: its friction, times as much."""
    rows = np.loadtxt(references, delimiter=",", skiprows=1)
    friction = replace(TRUE.friction, stiffness=tuple(worse * one for one in TRUE.friction.stiffness))
    axis, law = replace(TRUE, friction=friction), KNOWN.feedback_only()
    if controller is not None:
        law = replace(load(controller), n_ff=(1.0,), d_ff=(0.0,), friction_compensation=None, effect_compensation=None)
    given = References(rows[:, 2], rows[:, 3], np.zeros(len(rows)))
    made = simulate(axis, law, rows[:, 1], given=given, seed=seed).record
    time = np.arange(made.position.size) * made.sample_time
    signals = [time, made.target, made.reference, made.feedforward, made.command, made.position]
    np.savetxt(record, np.column_stack(signals), delimiter=",", header=HEADER, comments="", fmt="%.10g")


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the machine file, the records so far, and what the first command made of them."""
    base = tmp_path_factory.mktemp("axis")
    (base / "records").mkdir()
    (base / "my.toml").write_text(to_toml(KNOWN), encoding="utf-8")
    known = references_of(KNOWN, old_design(KNOWN), own_loop=True)
    (base / "strokes.csv").write_text(table(judged_target(KNOWN), known, KNOWN.sample_time), encoding="utf-8")
    axis_runs(base / "strokes.csv", base / "records" / "strokes of May.csv", 3)
    assert circle(base)[0] == DONE
    return base


def command(base: Path) -> list[str]:
    given = ["--machine", str(base / "my.toml"), "--records", str(base / "records"), "--output", str(base / "out")]
    return [*given, "--no-report"]


def slow_loops(base: Path) -> None:
    """A record of slow loops, which the axis is identified from."""
    t = np.arange(round(6.0 / KNOWN.sample_time)) * KNOWN.sample_time
    wide = 2.5 * max(KNOWN.friction.limit)
    slow = np.column_stack([t, 0 * t, wide * np.sin(np.pi * t / 3), 0 * t])
    np.savetxt(base / "slow.csv", slow, delimiter=",", header="time_s,target_m,reference_m,feedforward_N", comments="")
    axis_runs(base / "slow.csv", base / "records" / "slow.csv", 5)


def circle(base: Path, *more: str) -> tuple[int, dict[str, Any]]:
    """The status of the command, and its results."""
    status = main(STUDY, [*command(base), *more])
    return status, json.loads((base / "out" / "results.json").read_text(encoding="utf-8"))["results"]


def copied(begun: Path, tmp_path: Path) -> Path:
    shutil.copytree(begun, tmp_path / "axis")
    return tmp_path / "axis"


def test_the_first_command_says_what_is_off_and_asks_for_the_proof_of_a_design(begun: Path) -> None:
    results = json.loads((begun / "out" / "results.json").read_text(encoding="utf-8"))["results"]
    assert results["diagnosis"]["verdict"]["outcome"] == "parameters"
    assert set(results["diagnosis"]["verdict"]["effects"]) >= {"payload_mass", "friction_level"}
    assert not results["redesign"]["kept"]
    assert results["redesign"]["gains"]["settling"]["low"] > 0
    assert [one["file"] for one in results["next"]] == ["run_redesign.csv"]
    assert results["verified"]["state"] == "asked"
    assert results["verified"]["before"]["settling_s"] > KNOWN.specification.settling_time


def test_a_record_that_contradicts_the_prediction_is_warned_of_and_this_one_does_not(begun: Path) -> None:
    results = json.loads((begun / "out" / "results.json").read_text(encoding="utf-8"))["results"]
    assert results["verified"]["contradicts"] == []
    assert "sticking" not in results
    assert not [row for row in own_axis._summary(results) if "WARNING" in row[0]]
    results["verified"]["contradicts"] = ["predicted: settles in 20 ms to 22 ms; measured: settles in 15 ms"]
    assert results["redesign"]["left"] is None
    results["redesign"]["left"] = {"force_N": 4.1, "moves_m": 1.1e-6}
    results |= found_in(far_side(KNOWN))
    told = dict(own_axis._summary(results))
    assert told["WARNING, the design in place"].startswith("predicted: settles in 20 ms to 22 ms; measured: settles in")
    assert "unstable" in told["WARNING, while the friction sticks"]
    assert told["  with a force in these runs"].startswith("4.1 N (rms) that no model explains")
    assert "moves the axis by 1.1 µm (rms)" in told["  with a force in these runs"]


@pytest.mark.parametrize(("met", "heading"), [(None, "not met"), (True, "expected before that record")])
def test_what_a_design_is_made_of_is_not_told_as_something_that_is_not_met(
    begun: Path, met: bool | None, heading: str
) -> None:
    """Over a sentence that a cascade stays in place stood "not met", and with its record "expected before"."""
    results = json.loads((begun / "out" / "results.json").read_text(encoding="utf-8"))["results"]
    stays, late = "the feedback stays as it is: a cascade is in place", "settling within 30 ms is not met in every run"
    results["redesign"] |= {"unmet": [stays, late], "notes": [stays]}
    results["verified"]["met"] = met
    rows = own_axis._summary(results)
    assert ("note on the design", stays) in rows
    assert (heading, late) in rows


def test_a_redesign_tells_what_was_not_designed_apart_from_what_to_expect(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any, **__: Any) -> None:
        raise DesignError("no reference is fast enough")

    monkeypatch.setattr(redesigning, "designed", refuse)
    shown = redesigning.to_json(redesigning.redesigned(KNOWN, KNOWN, [KNOWN] * 2, 0, lambda *_: None, pid=False))
    assert len(shown["notes"]) == 2  # on the design in place and on the new one
    assert all(note.endswith("no reference is fast enough") for note in shown["notes"])
    (late,) = (text for text in shown["unmet"] if text not in shown["notes"])
    assert late.startswith("settling within")


def test_its_record_closes_the_circle_and_nothing_is_computed_again(
    begun: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The record's name says nothing, and its log began earlier than the table."""
    base = copied(begun, tmp_path)
    out = base / "out"
    axis_runs(out / "run_redesign.csv", base / "new.csv", 7, out / "controller.json")
    rows = np.loadtxt(base / "new.csv", delimiter=",", skiprows=1)
    early = np.vstack([np.repeat(rows[:1], 40, axis=0), rows])
    early[:, 0] = np.arange(len(early)) * KNOWN.sample_time
    np.savetxt(base / "records" / "x.csv", early, delimiter=",", header=HEADER, comments="", fmt="%.10g")
    status, results = circle(base)
    told = capsys.readouterr().err
    assert status == DONE
    assert [told.count(f"{step}: nothing it is made from has changed") for step in ("diagnose", "redesign")] == [1, 1]
    verified = results["verified"]
    assert (verified["state"], verified["worse"], results["next"]) == ("holds", [], [])
    assert verified["after"]["settling_s"] <= KNOWN.specification.settling_time < verified["before"]["settling_s"]
    assert verified["inside"]["settling"]
    assert verified["met"]


def test_a_redesign_that_is_better_but_late_is_missed_and_asks_for_another_record(begun: Path, tmp_path: Path) -> None:
    """On its way to rest the axis is off by more than the tolerance, until ten samples after the specified time."""
    base, wanted = copied(begun, tmp_path), KNOWN.specification
    out, record = base / "out", base / "records" / "new.csv"
    axis_runs(out / "run_redesign.csv", record, 7, out / "controller.json")
    rows = np.loadtxt(record, delimiter=",", skiprows=1)
    late = round(wanted.settling_time / KNOWN.sample_time) + 10
    for step in np.flatnonzero(np.diff(rows[:, 1])) + 1:
        rows[step : step + late, 5] += 2 * wanted.tolerance
    np.savetxt(record, rows, delimiter=",", header=HEADER, comments="", fmt="%.10g")
    status, results = circle(base)
    assert status == CHECK_MISSED
    verified = results["verified"]
    assert (verified["state"], verified["met"]) == ("missed", False)
    assert wanted.settling_time < verified["after"]["settling_s"] < verified["before"]["settling_s"]
    (further,) = results["next"]
    assert further["file"] in {"next_experiment.csv", "suite.csv"}
    assert "specification" in further["why"]
    assert load(out / "controller.json") != old_design(KNOWN).controller


def test_a_table_whose_record_is_too_long_comes_with_the_option_that_takes_it(begun: Path, tmp_path: Path) -> None:
    base = copied(begun, tmp_path)
    (base / "records" / "strokes of May.csv").unlink()
    slow_loops(base)
    _, results = circle(base, "--quick", "--most-samples", "5000")
    (asked_for,) = (one for one in results["next"] if one["file"] == "suite.csv")
    most = int(re.findall(r"--most-samples (\d+)", asked_for["why"])[0])
    assert most >= len((base / "out" / "suite.csv").read_text(encoding="utf-8").splitlines()) - 1


def test_no_stop_is_left_before_the_remark_on_a_reason() -> None:
    assert own_axis.with_remark("It is the same every time.", "give more") == "It is the same every time; give more"
    assert own_axis.with_remark("It is the same every time.", "") == "It is the same every time."


def test_a_record_of_an_experiment_that_was_asked_for_is_diagnosed(begun: Path) -> None:
    """Whatever its kind, and known by its table, so that it is not asked for again."""
    text = (begun / "strokes.csv").read_text(encoding="utf-8")
    options = CircleOptions(machine=begun / "my.toml", records=begun / "records")
    for kind, role in (("suite", "diagnose"), ("next_experiment", "diagnose"), ("current", "current")):
        (one,) = loaded(KNOWN, options, (asked.asked(kind, text),), Progress())
        assert one.table is not None
        assert (one.role, one.table.kind) == (role, kind)
        assert (one.run is not None) == (role == "current")


def test_a_record_of_a_slower_log_is_known_by_its_table_and_one_that_is_too_slow_is_refused(
    begun: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    base = copied(begun, tmp_path)
    (file,) = (base / "records").glob("strokes*.csv")
    head, *rows = file.read_text(encoding="utf-8").splitlines(keepends=True)
    options = CircleOptions(machine=base / "my.toml", records=base / "records")
    table = asked.asked("current", (base / "strokes.csv").read_text(encoding="utf-8"))
    file.write_text("".join([head, *rows[::2]]), encoding="utf-8")
    (one,) = loaded(KNOWN, options, (table,), Progress())
    assert (one.role, one.run is not None) == ("current", True)
    assert isinstance(one.loaded.content, Record)
    assert one.loaded.content.every == 2
    assert one.loaded.content.sample_time == pytest.approx(KNOWN.sample_time)
    monkeypatch.setattr(folder_of_records, "recognised", lambda *_: "motions")
    file.write_text("".join([head, *rows[::20]]), encoding="utf-8")
    with pytest.raises(BadInputError, match=r"one of 20 of the machine's controller; .* or move .* out of --records"):
        loaded(KNOWN, options, (table,), Progress())


def test_a_log_without_a_feedforward_is_no_run_of_one_of_two_designs_with_its_reference(
    begun: Path, tmp_path: Path
) -> None:
    """The redesign compensates for another friction: its reference is that of the design in place. The finding says
    what to do, the record is not judged, and with its feedforward it is known; so it is before there is a redesign."""
    base = copied(begun, tmp_path)
    options = CircleOptions(machine=base / "my.toml", records=base / "records")
    found = replace(KNOWN, friction=replace(KNOWN.friction, limit=tuple(1.1 * one for one in KNOWN.friction.limit)))
    tables = {"current": redesigning.current_table(KNOWN), "redesign": redesigning.current_table(found)}
    both, redesign = ([asked.asked(kind, tables[kind]) for kind in kinds] for kinds in (tables, ("redesign",)))
    (file,) = (base / "records").glob("strokes*.csv")
    for kept in (both, redesign):  # whether or not the design in place was asked for
        (one,) = loaded(KNOWN, options, kept, Progress())
        assert not one.unclear
        assert folder_of_records.UNCLEAR not in one.loaded.findings
    rows = np.loadtxt(file, delimiter=",", skiprows=1)
    rows[:, 3] = 0.0
    np.savetxt(file, rows, delimiter=",", header=HEADER, comments="", fmt="%.10g")
    for kept in (both, redesign):
        (one,) = loaded(KNOWN, options, kept, Progress())
        assert (one.role, one.table, one.loaded.findings[-1]) == ("diagnose", None, folder_of_records.UNCLEAR)
        (judged,) = verification.tried(KNOWN, (one,), tables)
        assert judged.design == "unclear"
    (one,) = loaded(KNOWN, options, both[:1], Progress())
    assert one.role == "current"


def test_a_run_may_depart_from_its_table_by_a_hundredth_of_a_stroke_however_many_there_are() -> None:
    """A ramp over 30 ms in place of x_T* departs by a third of a stroke."""
    for count in (5, 100):
        machine = replace(KNOWN, specification=replace(KNOWN.specification, motions=count))
        one = asked.asked("redesign", redesigning.current_table(machine))
        still, wide = 0 * one.target, round(30e-3 / machine.sample_time)
        ramps = np.convolve(one.target, np.ones(wide) / wide)[: one.target.size]
        off = 0.009 * machine.specification.stroke * np.sin(np.arange(one.target.size))
        for reference, ran in ((ramps, False), (one.reference + np.where(one.reference > 0, off, 0), True)):
            record = Record(machine.sample_time, one.target, reference, still, still, one.target)
            assert (asked.ran(record, (one,)) is not None) == ran


def test_a_table_that_differs_by_less_than_its_runs_may_is_the_same(begun: Path) -> None:
    """A record beside it that moves the redesign by a thousandth does not make its run that of an earlier one."""
    options = CircleOptions(machine=begun / "my.toml", records=begun / "records")
    known = references_of(KNOWN, old_design(KNOWN), own_loop=True)

    def of(factor: float) -> str:
        changed = replace(known, feedforward=factor * known.feedforward, compensation=factor * known.compensation)
        return table(judged_target(KNOWN), changed, KNOWN.sample_time)

    for factor, design in ((1.001, "redesign"), (1.02, "earlier")):
        given = loaded(KNOWN, options, (asked.asked("redesign", of(1.0)),), Progress())
        (judged,) = verification.tried(KNOWN, given, {"current": of(3.0), "redesign": of(factor)})
        assert judged.design == design


def test_the_force_that_is_told_is_the_one_that_acts_whatever_the_offsets_of_its_records() -> None:
    """Two records of one noise, whose offsets differ by twenty times its size, and are left out of what acts."""
    records = [0.1 * np.random.default_rng(k).standard_normal(8000) + offset for k, offset in enumerate((1.0, -1.0))]
    acting = [np.mean(resampled(records, 4000, seed) ** 2) for seed in range(50)]
    told = redesigning._left(records, old_design(KNOWN), KNOWN, 1)
    assert told is not None
    assert told.force == pytest.approx(np.sqrt(np.mean(acting)), rel=0.02)
    assert redesigning._left([], old_design(KNOWN), KNOWN, 1) is None


def test_a_suite_leaves_room_for_the_records_that_are_there(begun: Path, tmp_path: Path) -> None:
    """It is shorter by then, and with its record the samples are within the limit."""
    base = copied(begun, tmp_path)
    redesign = json.loads((base / "out" / "steps" / "redesign.json").read_text(encoding="utf-8"))["found"]
    options = CircleOptions(machine=base / "my.toml", records=base / "records", most_samples=60_000)
    given = loaded(KNOWN, options, (), Progress())
    circled = own_axis.Circle(KNOWN, options, given, Steps(base / "steps", ""), Progress())
    late = {"met": False, "before": {}, "state": "missed"}
    found = {"next_experiment": None, "verdict": {"outcome": "parameters"}, "improved": ""}
    files, (further,) = own_axis._next(circled, found, redesign, late)
    held = sum(one.loaded.content.position.size for one in given if isinstance(one.loaded.content, Record))
    assert further["file"] == "suite.csv"
    assert held + files["suite.csv"].count("\n") - 1 <= options.most_samples
    assert "--most-samples" not in further["why"]


def test_an_experiment_that_was_run_is_not_asked_for_again_where_it_left_all_open(begun: Path) -> None:
    """The suite comes in its place, as long as no record of that is there."""
    options = CircleOptions(machine=begun / "my.toml", records=begun / "records")
    ran, another = (begun / "strokes.csv").read_text(encoding="utf-8"), to_csv(suite(KNOWN, 20_000), KNOWN.sample_time)
    given = loaded(KNOWN, options, (asked.asked("next_experiment", ran),), Progress())
    circled = own_axis.Circle(KNOWN, options, given, Steps(begun / "nowhere", ""), Progress())
    verdict = {"outcome": "none_of_these", "next_experiment": "run it"}
    shown: dict[str, list[Any]] = {"unmet": [], "designs": []}
    verified = {"met": True}

    def next_of(table: str, circle: own_axis.Circle) -> tuple[str, str, str] | None:
        return own_axis._experiment(circle, {"next_experiment": table, "verdict": verdict}, shown, verified)

    assert next_of(another, circled) == ("next_experiment.csv", another, "run it")
    asked_again = next_of(ran, circled)
    assert asked_again is not None
    assert (asked_again[0], asked_again[2]) == ("suite.csv", own_axis.STILL_OPEN)
    of_suite = tuple(replace(one, table=asked.asked("suite", ran)) for one in given)
    assert next_of(ran, replace(circled, given=of_suite)) is None


def test_a_further_record_comes_after_those_that_were_looked_at_whatever_its_name(
    begun: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So that the diagnosis says what it confirms; the look at all of them is kept for the next one."""
    base = copied(begun, tmp_path)
    axis_runs(base / "strokes.csv", base / "records" / "a later one.csv", 4)
    circled = own_axis.Circle(
        KNOWN,
        CircleOptions(machine=base / "my.toml", records=base / "records"),
        loaded(KNOWN, CircleOptions(machine=base / "my.toml", records=base / "records"), (), Progress()),
        Steps(base / "out" / "steps", ""),
        Progress(),
    )
    seen = []

    def done(_steps: Steps, _name: str, used: dict[str, Any], _work: Any) -> tuple[dict[str, Any], bool]:
        seen.append(used["looked"])
        return {"improved": to_toml(KNOWN), "answer": {"outcome": ""}}, True

    monkeypatch.setattr(Steps, "done", done)
    first, later = (one.loaded.sha256 for one in reversed(circled.given))
    for _ in range(2):  # as it is the second time, too
        own_axis._diagnosed(circled, KNOWN)
    assert seen == [[(first,)]] * 2
    assert looked.order(base / "out" / "steps", (later, first, "another")) == ((first, later, "another"), (1, 2))


def test_only_looks_within_one_another_count(tmp_path: Path) -> None:
    """One whose record is gone, or that another one did not go on from, is not among them; nor is a damaged file."""
    for hashes in (("b",), ("gone",), ("a", "b"), ("c", "d", "gone"), ("b", "a", "c")):
        looked.keep(tmp_path, hashes)
    assert looked.order(tmp_path, ("a", "b", "c", "d")) == (("b", "a", "c", "d"), (1, 2, 3))
    assert looked.order(tmp_path, ("a", "b", "c")) == (("b", "a", "c"), (1, 2))
    (tmp_path / looked.FILE).write_text("{", encoding="utf-8")
    assert looked.order(tmp_path, ("a", "b")) == (("a", "b"), ())


def test_more_samples_than_the_option_says_are_refused(
    begun: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    base = copied(begun, tmp_path)
    (base / "out" / "steps" / "diagnose.json").unlink()
    assert main(STUDY, [*command(base), "--most-samples", "100"]) == BAD_INPUT
    assert "or give --most-samples" in capsys.readouterr().err


def test_a_design_that_turns_out_worse_is_taken_back(begun: Path, tmp_path: Path) -> None:
    """The axis has changed since: its friction is half as much."""
    base = copied(begun, tmp_path)
    out = base / "out"
    axis_runs(out / "run_redesign.csv", base / "records" / "new.csv", 7, out / "controller.json", worse=0.3)
    status, results = circle(base)
    assert status == CHECK_MISSED
    assert results["verified"]["state"] == "rolled back"
    assert results["verified"]["worse"]
    in_place, *_ = results["redesign"]["designs"]
    (why,) = (text for text in results["redesign"]["unmet"] if text.startswith("settling within"))
    assert f"{in_place['late']} of {results['redesign']['runs']} are late" in why
    assert load(out / "controller.json") == old_design(KNOWN).controller


def test_a_folder_that_holds_only_what_is_identified_from_asks_for_more(begun: Path, tmp_path: Path) -> None:
    base = copied(begun, tmp_path)
    (base / "records" / "strokes of May.csv").unlink()
    slow_loops(base)
    status, results = circle(base, "--quick")
    assert status == DONE
    assert [one["role"] for one in results["records"]] == ["identify"]
    assert results["diagnosis"] is None
    assert results["identified"]["estimates"]
    assert results["identified"]["warnings"] == []
    assert {"suite.csv", "run_current.csv"} <= {one["file"] for one in results["next"]}
    for one in results["next"]:
        assert (base / "out" / one["file"]).is_file()


def test_a_spoiled_step_is_made_again(begun: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    base = copied(begun, tmp_path)
    (base / "out" / "steps" / "redesign.json").write_text("{half", encoding="utf-8")
    _, results = circle(base)
    told = capsys.readouterr().err
    assert "diagnose: nothing it is made from has changed" in told
    assert "redesign: done" in told
    assert results == json.loads((begun / "out" / "results.json").read_text(encoding="utf-8"))["results"]


def test_a_bad_record_is_one_line_and_leaves_all_as_it_was(
    begun: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    base = copied(begun, tmp_path)
    before = (base / "out" / "results.json").read_bytes()
    shutil.copy(base / "strokes.csv", base / "records" / "no position.csv")
    assert main(STUDY, ["--machine", str(base / "my.toml"), "--records", str(base / "records"), "--no-report",
                        "--output", str(base / "out")]) == BAD_INPUT  # fmt: skip
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error:")]
    assert len(said) == 1
    assert "no position.csv" in said[0]
    assert (base / "out" / "results.json").read_bytes() == before


def test_a_record_is_known_by_the_table_that_it_followed() -> None:
    machine: Machine = KNOWN
    text = table(
        judged_target(machine), references_of(machine, old_design(machine), own_loop=True), machine.sample_time
    )
    one = asked.asked("current", text)
    other = replace(one, key="other", reference=one.reference * 1.02)
    run = simulate(machine, machine.feedback_only(), one.target,
                   given=References(one.reference, one.feedforward, 0 * one.target)).record  # fmt: skip
    found = asked.ran(run, (other, one))
    assert found is not None
    assert found[0] is one
    unnamed = replace(run, target=run.reference, feedforward=0 * run.feedforward)  # a log without them
    again = asked.ran(unnamed, (other, one))
    assert again is not None
    np.testing.assert_array_equal(again[1].target, one.target)
    away = 3e-3  # m: the axis stands there when the run begins, which the table has as 0
    elsewhere = replace(unnamed, position=run.position + away, reference=run.reference + away)
    there = asked.ran(elsewhere, (other, one))
    assert there is not None
    here, moved = (outcome(found[1], machine) for found in (again, there))
    assert here is not None
    assert moved is not None
    assert (moved.motions, moved.never) == (here.motions, here.never)
    assert moved.settling == here.settling
    assert moved.dispersion == pytest.approx(here.dispersion, abs=1e-12)
    assert asked.ran(replace(run, reference=1.5 * run.reference), (other, one)) is None
    assert asked.ran(run.part(0, 3000), (other, one)) is None
