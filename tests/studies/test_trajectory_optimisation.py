"""The trajectory study as its user meets it, and its judge against hand-made cases."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from design.controller import feedback_alone, usable_thrust
from design.deadbeat import DesignError, synthesise
from design.trajectory.compensator import compensate, motion_profile
from design.trajectory.history_aware import Built, Limits, Trajectory
from design.trajectory.schemes import (
    Wanted,
    histories,
    history_aware,
    most_samples,
    profile_of,
    quickest,
    rest_time,
)
from design.validation import sequence
from models.controller import Controller, load
from models.machine import load as load_machine
from models.records.record import motions
from models.records.settling import settling_time
from models.simulation.simulator import simulate
from models.variation import drawn
from reports import text
from studies.command import DONE
from studies.perturbed import RANGE, TOGETHER, perturbations
from studies.trajectory_optimisation.compute import deadbeat_beside
from studies.trajectory_optimisation.outcomes import Aim, judge
from studies.trajectory_optimisation.report import tell
from studies.trajectory_optimisation.tradeoff import failed_iterate


@pytest.fixture(scope="module")
def folder(quick_run: Callable[[str], tuple[Path, int]]) -> Path:
    """What one quick run wrote; tests/studies/test_improved_machine.py runs it with another objective."""
    output, status = quick_run("trajectory_optimisation")
    assert status == DONE
    return output


def read(folder: Path, name: str) -> Any:
    return json.loads((folder / name).read_text(encoding="utf-8"))


def test_everything_is_written(folder: Path) -> None:
    names = {file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file()}
    assert names >= {"report.html", "report.pdf", "results.json", "manifest.json", "controller.json", "machine.toml"}
    assert "This is a quick run" in (folder / "report.html").read_text(encoding="utf-8")


def test_every_scheme_is_judged_on_the_same_tables(folder: Path) -> None:
    results = read(folder, "results.json")["results"]
    rows = {row["key"]: row for row in results["rows"]}
    assert list(rows) == ["deadbeat", "paper", "paper_learning", "common", "peak", "aware", "learning"]
    assert rows["learning"]["ensemble"]["dispersion_m"] < 0.5 * rows["paper"]["ensemble"]["dispersion_m"]
    assert rows["common"]["central"]["settling_s"] < rows["deadbeat"]["central"]["settling_s"]
    assert rows["aware"]["central"]["dispersion_m"] < rows["paper"]["central"]["dispersion_m"]
    assert [row["key"] for row in results["fresh"]["rows"]] == list(rows)
    assert results["fresh"]["rows"] != results["rows"]
    members = results["members"]
    assert [row["key"] for row in members["rows"]] == list(rows)
    paper, own = members["own"]
    assert own["ensemble"]["dispersion_m"] < 0.5 * paper["ensemble"]["dispersion_m"]
    assert own["yield"]["thrust"] == 1.0
    for key in ("force_N", "response_m"):
        values = results["certificate"][key]
        assert all(later < earlier for earlier, later in pairwise(values))
    assert results["failed"]["converged"] is False
    assert results["failed"]["advice"]
    assert not any("seconds" in key for key in results)


def filled(whole: dict[str, Any]) -> str:
    """The page of the report on results."""
    report = tell(whole)
    return text.fill(report.template, whole, {one.name: one.caption for one in report.figures}, report.filters)


def test_where_the_learning_rfm_does_better_nothing_is_said_to_gain(folder: Path) -> None:
    whole = read(folder, "results.json")
    assert "thus gain a factor of" in filled(whole)
    rows = {row["key"]: row["ensemble"] for row in whole["results"]["rows"]}
    rows["learning"]["dispersion_m"] = 3 * rows["paper_learning"]["dispersion_m"]
    whole["checks"][0]["holds"] = False
    page = filled(whole)
    assert "lose here, a factor of 3.0." in page
    assert "One trajectory serves every history" not in page
    whole["results"]["failed"] = None
    assert "infeasible" not in filled(whole)


def test_figures_and_tables_of_a_nanometre_axis_show_its_tolerance(folder: Path) -> None:
    """Strokes of 200 nm within 5 nm by 100 µs: a hundredth of the home table's strokes, and a 250th of its times."""
    whole = read(folder, "results.json")
    spec, wanted, shown = whole["machine"]["specification"], whole["results"]["wanted"], whole["results"]["shown"]
    spec |= {"stroke_m": 200e-9, "tolerance_m": 5e-9, "settling_time_s": 100e-6}
    wanted |= {"stroke_m": 200e-9, "tolerance_m": 1.25e-9, "settling_time_s": 80e-6}
    whole["results"]["shown_time_s"] = (np.array(whole["results"]["shown_time_s"]) / 250).tolist()
    for one in shown.values():
        one |= {key: (np.array(one[key]) / 100).tolist() for key in ("error_m", "position_m", "dispersions_m")}
    for row in whole["results"]["rows"]:
        row["ensemble"] |= {"settling_s": 98.5e-6, "dispersion_m": 4.25e-9}
    page = filled(whole)
    assert "| 98.5 |" in page
    assert "| 4.25 |" in page
    assert "slowest motion [µs], dispersion of the positive motions [nm]" in page
    drawn = {
        figure.name: figure.draw(whole) for figure in tell(whole).figures if figure.name in {"envelope", "responses"}
    }
    (envelope,) = drawn["envelope"].axes
    low, high = envelope.get_ylim()
    assert low < 1.25  # nm
    assert 200 < high < 1000
    assert drawn["responses"].axes[0].get_xlim() == pytest.approx((0, 160))  # µs


def test_the_controller_file_keeps_its_keys_and_is_loaded_back(folder: Path) -> None:
    content = read(folder, "controller.json")
    law = load(folder / "controller.json")
    wanted = {"sample_time_s", "stroke_m", "settling_time_s", "n_ff", "d_ff", "reference_delay_samples", "pid"}
    assert set(content) >= wanted | {"friction_compensation", "trajectory"}
    assert np.cumsum(law.n_ff) * content["stroke_m"] == pytest.approx(content["trajectory"]["position_m"], abs=1e-15)
    assert np.cumsum(law.d_ff) * content["stroke_m"] == pytest.approx(content["trajectory"]["net_thrust_N"], abs=1e-9)
    assert sum(law.n_ff) == pytest.approx(1.0)
    machine = load_machine()
    response = simulate(machine, law, sequence(machine, content["stroke_m"]))
    period = sequence(machine, content["stroke_m"], 1)
    last = response.last(period.size)
    for one in motions(period)[1:]:
        error = last.position[one.start : one.stop] - one.target
        assert settling_time(error, machine.specification.tolerance, machine.sample_time) <= 0.025


def test_tables_are_seeded_within_their_ranges_and_side_by_side_equal_alone() -> None:
    machine = load_machine()
    some, again, other = (drawn(machine, RANGE, 30, seed) for seed in (1, 1, 2))
    assert some == again
    assert some != other
    level = [table.friction.coulomb_force / machine.friction.coulomb_force for table in some]
    assert 1 - RANGE.friction_force <= min(level) < 0.85
    assert 1.15 < max(level) <= 1 + RANGE.friction_force
    assert all(table.plant.modes[0].frequency == 0 for table in some)
    law = Controller(machine.sample_time, machine.control.pid, 2, (1.0,), (0.0,))
    aim = Aim(1e-6, 0.5e-6, 20e-3)
    few = [replace(table, specification=replace(table.specification, interval=0.1)) for table in some[:3]]
    assert judge(few, law, aim)[1].settling == judge(few[1:2], law, aim)[0].settling


def test_histories_change_with_a_rounding_as_little_as_it_is() -> None:
    """What another processor rounds otherwise must not make another design: no step of the scale, 1e-7 m, in it."""
    machine = load_machine()
    thrust = synthesise(machine.plant, machine.sample_time, 20e-3, 20e-6).thrust
    target = sequence(machine, 20e-6)
    states = []
    for change in (0.0, 1e-7, -1e-7):
        motion = motion_profile(machine.plant, machine.sample_time, thrust * (1 + change), 20e-6)
        states.append(histories(machine, feedback_alone(machine), 20e-6, compensate(motion, machine.friction, target)))
    assert np.max(np.abs(states[1] - states[0])) < 1e-10
    assert np.max(np.abs(states[2] - states[0])) < 1e-10


@pytest.mark.parametrize("dead_time", [0.52e-3, 0.95e-3, 1.0e-3, 1.3e-3])
def test_the_feedback_waits_as_the_trajectory_needs_it_at_any_dead_time(dead_time: float) -> None:
    machine = load_machine()
    machine = replace(machine, plant=replace(machine.plant, dead_time=dead_time))
    wanted = Wanted(20e-6, 0.5e-6, 25e-3, Limits())
    count, tried = quickest(machine, wanted, 50, least=50)
    scheme = history_aware(machine, profile_of(machine, tried[count]))
    given = scheme.references(machine.friction, sequence(machine, wanted.stroke))
    judged = judge([machine], scheme.controller, Aim(20e-6, 0.5e-6, 25e-3), given)[0]
    after = round((rest_time(machine, count)) / machine.sample_time) + 1
    assert np.max(np.abs(judged.error[:, after:])) < 2 * machine.scale.resolution


def test_motions_shorter_than_the_figures_are_shown_whole() -> None:
    """Between motions 45 ms apart lie fewer samples than 2.4 settling times of 25 ms have."""
    machine = load_machine()
    machine = replace(machine, specification=replace(machine.specification, interval=45e-3))
    law = Controller(machine.sample_time, machine.control.pid, 2, (1.0,), (0.0,))
    judged = judge([machine], law, Aim(1e-6, 0.5e-6, 20e-3))[0]
    assert judged.error.shape == judged.position.shape == judged.command.shape == (10, 90)


def test_what_one_search_solved_is_not_solved_again_by_another(monkeypatch: pytest.MonkeyPatch) -> None:
    """A limit of the thrust only says which motions will do: with a lower one, the search asks for longer ones."""
    machine = load_machine()
    wanted = Wanted(20e-6, 0.5e-6, 25e-3, Limits())
    count, tried = quickest(machine, wanted, 50, least=50)
    asked: list[int] = []

    def solved(built: Built, *_: object) -> Trajectory:
        asked.append(built.task.samples)
        return replace(tried[count], thrust=0.9 * tried[count].thrust, hold=0.9 * tried[count].hold)

    monkeypatch.setattr("design.trajectory.schemes.solve", solved)
    assert quickest(machine, wanted, 50, least=50, known=tried) == (count, tried)
    assert asked == []
    lower = replace(wanted, limits=Limits(0.95 * tried[count].peak))
    longer, both = quickest(machine, lower, 50, least=50, known=tried)
    assert longer > count
    assert asked == [one for one in both if one not in tried]


@pytest.mark.parametrize(("dead_time", "samples"), [(0.0, 6), (1e-3, 7)])
def test_the_shortest_motion_has_a_sample_for_each_condition_at_its_end(dead_time: float, samples: int) -> None:
    """Two of each of three modes and, where the last thrust acts until after the motion, that it is 0."""
    machine = load_machine()
    control, plant = replace(machine.control, sample_time=4e-3), replace(machine.plant, dead_time=dead_time)
    machine = replace(machine, control=control, plant=plant)
    wanted = Wanted(20e-6, 0.5e-6, 28e-3, Limits(thrust=1e9))
    count, _ = quickest(machine, wanted, 8)
    assert count == samples
    assert failed_iterate(machine, wanted, count) is None
    failed = failed_iterate(machine, replace(wanted, limits=Limits(thrust=20.0)), 9)
    assert failed is not None
    assert failed["advice"]


def test_no_motion_is_longer_than_half_the_time_from_one_to_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    """However little thrust there is: one that goes on when the next begins would not be put out whole."""
    machine = load_machine()
    machine = replace(machine, specification=replace(machine.specification, interval=60e-3))
    found = quickest(machine, Wanted(20e-6, 0.5e-6, 25e-3, Limits()), 50, least=50)[1][50]
    asked: list[int] = []

    def solved(built: Built, *_: object) -> Trajectory:
        asked.append(built.task.samples)
        return found

    monkeypatch.setattr("design.trajectory.schemes.solve", solved)
    with pytest.raises(DesignError, match=r"no motion of up to .* keeps within 1 N; allow more"):
        quickest(machine, Wanted(20e-6, 0.5e-6, 20e-3, Limits(thrust=1.0)), 38)
    assert max(asked) == most_samples(machine) == 58
    assert rest_time(machine, 58) <= 30e-3 < rest_time(machine, 59)


def test_tables_are_off_in_nothing_that_their_machine_lacks() -> None:
    """A rigid axis without dead time, whose scale has the noise already that others are given."""
    whole = load_machine()
    rigid = replace(whole, plant=replace(whole.plant, modes=whole.plant.modes[:1], dead_time=0.0))
    rigid = replace(rigid, scale=rigid.scale.noisy())
    friction, start = "friction's force and length", "friction's state at the start"
    assert list(perturbations(rigid)) == [friction, "mass", "constant force", start, TOGETHER]
    assert len(perturbations(whole)) == 9


def test_the_deadbeat_beside_them_keeps_to_the_thrust_where_the_specified_time_does_not_allow_it() -> None:
    """A stroke of 1 mm in 20 ms would take 4.6 kN, and the simulated table would leave the hall."""
    machine = load_machine()
    within = usable_thrust(machine)
    usual, long = (deadbeat_beside(machine, stroke) for stroke in (20e-6, 1e-3))
    assert usual.settling_time == machine.specification.reference_settling_time
    assert 2 * usual.settling_time <= long.settling_time < 2.5 * usual.settling_time
    assert np.abs(long.thrust).max() <= within * (1 + 1e-6)


def test_the_finer_accuracy_is_a_quarter_of_the_specified_one(folder: Path) -> None:
    whole = read(folder, "results.json")
    assert whole["results"]["wanted"]["tolerance_m"] == 0.25 * whole["machine"]["specification"]["tolerance_m"]
