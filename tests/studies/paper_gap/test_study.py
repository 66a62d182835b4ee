"""The study as a whole, and which candidates each experiment discriminates."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from design.controller import default_controller
from diagnosis.experiments.schedules import Schedule
from models.controller import Controller, References
from models.machine import DEFAULT, load
from models.records.files import read
from models.simulation.simulator import simulate
from reports import text
from studies.command import BAD_INPUT, main
from studies.paper_gap.__main__ import STUDY
from studies.paper_gap.candidates import every
from studies.paper_gap.decide import decide, gap
from studies.paper_gap.experiments import depart, measure, menu
from studies.paper_gap.explore import BEYOND, Case, Draw
from studies.paper_gap.observables import Departure, Plan
from studies.paper_gap.pattern import Outcome
from studies.paper_gap.report import tell
from studies.paper_gap.shown import responses


@pytest.fixture(scope="module")
def results(quick_run: Callable[[str], tuple[Path, int]]) -> Any:
    """The results of one quick run."""
    folder, _ = quick_run("paper_gap")
    return json.loads((folder / "results.json").read_text(encoding="utf-8"))["results"]


def test_every_candidate_has_a_row_and_a_verdict_that_its_draws_bear_out(results: Any) -> None:
    rows = {row["name"]: row for row in results["candidates"]}
    assert set(rows) == set(every())
    for row in rows.values():
        shown = [way for way, found in row["ways"].items() if found["shown"]]
        assert (row["verdict"] == "never") == (not shown)
        for found in row["ways"].values():
            assert (found["closest_m"] == 0) == (found["shown"] > 0)
            assert (found["sizes"] is None) == (found["shown"] == 0)


def test_where_every_candidate_shows_the_pattern_none_is_said_not_to(
    quick_run: Callable[[str], tuple[Path, int]],
) -> None:
    folder, _ = quick_run("paper_gap")
    whole = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    report = tell(whole)
    captions = {one.name: one.caption for one in report.figures}
    assert "did not show the pattern" in text.fill(report.template, whole, captions, report.filters)
    for row in whole["results"]["candidates"]:
        row["verdict"] = "alone" if row["verdict"] == "never" else row["verdict"]
    assert "did not show the pattern" not in text.fill(report.template, whole, captions, report.filters)


def test_settling_times_come_with_what_they_hang_on_and_their_scatter(results: Any) -> None:
    """Of the first table without and with compensation, and of the candidate that comes first."""
    rows, runs = results["settling"]["rows"], results["settling"]["runs"]
    assert runs["runs"] >= 4
    names = list(dict.fromkeys(row["case"] for row in rows))
    assert names[:2] == ["without compensation", "with compensation"]
    assert len(names) == 3
    assert all(row["nearest_m"] > 0 for row in rows)
    assert all(row["median_s"] <= row["quantile_s"] <= row["largest_s"] for row in rows)
    compensated = next(row for row in rows if row["case"] == names[1])
    assert compensated["single_s"] == pytest.approx(results["nominal"][0]["reversal_settling_s"], abs=2e-3)


def test_the_experiments_have_the_machine_s_own_sizes() -> None:
    """A tenth of the home table's strokes, in twice its time."""
    machine = load()
    wanted = replace(machine.specification, stroke=2e-6, settling_time=50e-3, reference_settling_time=40e-3)
    rests, ladder, times, hold, slow = menu(replace(machine, specification=wanted))
    assert "after rests of 0.12, 0.24, 0.5, 1, 2 and 3 s" in rests.words
    assert "motions of 0.5, 1, 1.5 and 2 µm whose reference rests after 40 ms" in ladder.words
    assert "after 40, 44, 48, 52 and 60 ms" in times.words
    assert "500 ms apart" in times.words
    assert "nothing moves for 20 s" in hold.words
    assert slow.words == "a stroke of 200 µm there and back at 50 µm/s"
    reading = np.arange(200.0)
    plan = Plan(Schedule("one rung", reading, References(reading, reading, reading)), ((100, 1, 0.04),) * 4)
    assert Departure(plan, 1e-3, 0.05, reading, reading).of_moves() == pytest.approx(np.full((1, 4), 159.5))


def test_motions_that_follow_each_other_quickly_are_shown_whole() -> None:
    """100 samples of 0.5 ms between them, where 0.1 s would be shown."""
    (shown,) = responses([(load(), default_controller(load()))], [np.zeros((5, 100))], {})
    assert len(shown["time_s"]) == 100


def test_no_table_shows_the_pattern_by_itself(results: Any) -> None:
    assert all(row["distance_m"] > 0 for row in results["nominal"])
    assert len(results["nominal"]) == results["tables"]


def test_what_is_said_to_show_the_pattern_meets_its_conditions(results: Any) -> None:
    pattern = results["pattern"]
    for one in results["again"]:
        met = (
            one["seen"]["reversal_error_m"] <= pattern["tolerance"] * (1 + 1e-6)
            and one["seen"]["inching_error_m"] > pattern["tolerance"] * (1 + 1e-6)
            and abs(one["seen"]["dispersion_m"] - pattern["dispersion"]) <= pattern["margin"] * (1 + 1e-6)
        )
        assert met == one["shows"], one["name"]


def test_the_experiments_are_references_that_a_table_can_follow(
    results: Any, quick_run: Callable[[str], tuple[Path, int]]
) -> None:
    folder, _ = quick_run("paper_gap")
    machine = load()
    control = machine.control
    law = Controller(machine.sample_time, control.pid, control.reference_delay, (1.0,), (0.0,))
    files = ["next_experiment.csv"]
    if results["decided"]["second"] != results["decided"]["first"]:
        files.append("second_experiment.csv")
    assert sorted(file.name for file in folder.glob("*.csv")) == files
    for file in files:
        columns = read(folder / file)
        target, position, force = (columns[name] for name in ("target_m", "reference_m", "feedforward_N"))
        assert np.allclose(np.diff(columns["time_s"]), machine.sample_time)
        run = simulate(machine, law, target, given=References(position, force, np.zeros(force.size)))
        assert np.max(np.abs(run.record.command)) < machine.drive.rated_thrust
        assert abs(run.record.position[-1] - target[-1]) < machine.specification.tolerance


def size(name: str, values: tuple[float, ...], way: str = "alone") -> Draw:
    """A size of a candidate on the first table."""
    return Draw(Case(name, way), 0, (0.0,), values, Outcome(0, (0,), 0, 0, 0), 0.0, False)


def test_experiments_read_what_the_law_says() -> None:
    """A saturation acts with the thrust, so it is gone at long settling times; nothing added reads as nothing."""
    machine = load()
    table = machine, default_controller(machine)
    times = next(one for one in menu(machine) if one.name == "a ladder of settling times")
    lost = depart(times, table, size("thrust_saturation", (0.2,), BEYOND)).of_moves()
    assert lost.shape == (5, 4)
    assert np.max(np.abs(lost[0, 1:])) > 5 * np.max(np.abs(lost[-1, 1:]))
    nothing = measure(times, table, size("friction_level", (0.0,)))
    assert nothing == [0.0] * len(times.observables)


def test_a_slow_stroke_shows_the_level_of_friction() -> None:
    machine = load()
    table = machine, default_controller(machine)
    slow = next(one for one in menu(machine) if one.name == "a slow stroke")
    odd = measure(slow, table, size("friction_level", (0.1,)))[0]
    force = odd * machine.scale.resolution * machine.control.pid.kp
    assert force == pytest.approx(0.1 * machine.friction.coulomb_force, rel=0.05)


def test_a_hold_shows_no_viscous_friction() -> None:
    machine = load()
    table = machine, default_controller(machine)
    hold = next(one for one in menu(machine) if one.name == "a hold")
    slow, still = measure(hold, table, size("viscous_friction", (50.0,)))
    assert abs(slow) < 1
    assert abs(still) < 1


def test_the_gap_between_ranges() -> None:
    first, second = np.array([[0.0, 1.0], [1.0, 5.0]]), np.array([[3.0, 4.0], [4.0, 9.0]])
    assert list(gap(first, second)) == [2.0, 0.0]
    assert list(gap(second, first)) == [2.0, 0.0]


def test_the_experiment_that_tells_most_is_first_and_the_second_adds_most() -> None:
    """Three candidates, five experiments with known readings: the third discriminates two pairs, the first one."""
    experiments = menu(load())
    reading = {"a": {2: 10.0}, "b": {0: 9.0}, "c": {}}
    measured = {
        name: [[[at.get(i, 0.0)] * len(one.observables) for i, one in enumerate(experiments)]]
        for name, at in reading.items()
    }
    found = decide(experiments, measured)
    assert found["pairs"] == 3
    assert {found["first"], found["second"]} == {0, 2}
    assert found["told_by_first"] == 2
    assert found["added_by_second"] == 1
    assert found["left"] == []
    same = decide(experiments, {"a": measured["c"], "b": measured["c"]})
    assert same["told_by_first"] == 0
    assert same["left"] == [["a", "b"]]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--tables", "0"], "must be a whole number from 1 on"),
        (["--margin", "3 um"], "must be between 0 and the published"),
        (["--margin", "1 kg"], "--margin"),
        (["--ensemble", "nowhere.toml"], "--ensemble"),
    ],
)
def test_bad_input_is_said(options: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "out"
    assert main(STUDY, ["--quick", "--output", str(output), *options]) == BAD_INPUT
    assert says in capsys.readouterr().err
    assert not output.exists()


def test_a_machine_without_published_outcomes_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = DEFAULT.read_text(encoding="utf-8").partition("[published]")[0]
    (tmp_path / "own.toml").write_text(text, encoding="utf-8")
    assert main(STUDY, ["--machine", str(tmp_path / "own.toml"), "--output", str(tmp_path / "out")]) == BAD_INPUT
    assert "no [published] outcomes" in capsys.readouterr().err
