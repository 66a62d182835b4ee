"""What a benchmark says besides times: every contender solves the same loop, and each has its row."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models.controller import references
from models.simulation.exact import respond
from models.simulation.kernel import run_one
from models.simulation.simulator import simulate, simulate_many
from tests.benchmark import __main__ as command
from tests.benchmark import others, outcome, rows
from tests.benchmark.job import Job, default_job, prepared, variations
from tests.benchmark.twin import NoTwinError, build
from tests.models.feedback.axis import FILTERS, axis


@pytest.fixture(scope="module")
def job() -> Job:
    return default_job()


@pytest.fixture(scope="module")
def short(job: Job) -> Job:
    """A motion and its reversal in 40 ms, with an exact scale."""
    return job.reversal(pause=0.02)


@pytest.fixture(scope="module")
def truth(short: Job) -> rows.Array:
    return respond(short.machine, short.controller, short.target)[0]


def test_the_job_is_that_of_fig_5(job: Job) -> None:
    assert job.duration == pytest.approx(15.0)
    assert job.target.size == 30_000
    assert references(job.controller, job.target).compensation.any()


@pytest.mark.parametrize("dead_time", [1.0e-3, 1.13e-3], ids=["whole", "within a sample"])
def test_the_c_twin_agrees_with_the_simulator(short: Job, dead_time: float) -> None:
    """To the rounding of contracted operations: the loop is stable and forgets it."""
    try:
        twin = build()
    except NoTwinError as reason:
        pytest.skip(str(reason))
    plant = replace(short.machine.plant, dead_time=dead_time)
    varied = replace(short, machine=replace(short.machine, plant=plant))
    (loop, ours), (_, theirs) = prepared(varied, 10), prepared(varied, 10)
    run_one(loop, ours)
    twin(loop, theirs)
    assert np.max(np.abs(ours.position - theirs.position)) < 1e-12
    assert np.max(np.abs(ours.friction - theirs.friction)) < 1e-6
    assert np.max(np.abs(ours.command - theirs.command)) < 1e-5


def test_the_c_twin_agrees_with_the_simulator_under_a_cascade_at_the_rating() -> None:
    try:
        twin = build()
    except NoTwinError as reason:
        pytest.skip(str(reason))
    machine, target = axis(filters=FILTERS, anti_windup=1e-3), np.repeat([2e-4, 0.0], 150)
    controller, bent = machine.feedback_only(), 0.4 * np.array(machine.friction.limit)
    ours = simulate(machine, controller, target, initial_friction=bent)
    loop, theirs = prepared(Job(machine, controller, target), 10, bent)
    twin(loop, theirs, controller.law)
    assert np.max(np.abs(ours.record.command)) == machine.drive.rated_thrust
    assert np.max(np.abs(ours.position - theirs.position)) < 1e-12
    assert np.max(np.abs(ours.friction - theirs.friction)) < 1e-6
    assert np.max(np.abs(ours.record.command - theirs.command)) < 1e-5


@pytest.mark.parametrize("ki", [0.0, 7e7])
def test_kernel_lanes_twin_and_oracle_hold_the_same_at_the_start(short: Job, ki: float) -> None:
    """Presheared friction and a constant force, which an integral holds and a PID without one does not."""
    try:
        twin = build()
    except NoTwinError as reason:
        pytest.skip(str(reason))
    machine = replace(short.machine, drive=replace(short.machine.drive, offset=5.0))
    controller = replace(short.controller, pid=replace(short.controller.pid, ki=ki))
    loaded, bent = replace(short, machine=machine, controller=controller), 0.5 * np.array(machine.friction.limit)
    (loop, ours), (_, theirs) = prepared(loaded, 10, bent), prepared(loaded, 10, bent)
    run_one(loop, ours)
    twin(loop, theirs)
    lane = simulate_many([machine] * 2, [controller] * 2, short.target, initial_friction=bent)[1]
    exact, _ = respond(machine, controller, short.target, initial_friction=bent)
    moved = np.max(np.abs(ours.position[:3])) > 1e-9  # before a command could act behind the dead time
    assert moved == (ki == 0)
    assert np.max(np.abs(ours.position - theirs.position)) < 1e-12
    assert np.array_equal(ours.position, lane.position)
    assert np.max(np.abs(ours.position - exact)) < 1e-8


def test_the_c_twin_refuses_what_it_lacks(short: Job) -> None:
    try:
        twin = build()
    except NoTwinError as reason:
        pytest.skip(str(reason))
    friction = replace(short.machine.friction, damping=tuple(1.0 for _ in short.machine.friction.damping))
    with pytest.raises(ValueError, match="without damping"):
        twin(*prepared(replace(short, machine=replace(short.machine, friction=friction)), 10))


def test_a_missing_compiler_has_a_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(NoTwinError, match="compiler"):
        build()


def test_more_machines_than_lanes_equal_one_by_one(short: Job) -> None:
    """Two blocks of lanes, the second one with lanes to spare."""
    machines = variations(short.machine, 37)
    together = simulate_many(machines, [short.controller] * 37, short.target)
    for machine, response in zip(machines, together, strict=True):
        alone = simulate(machine, short.controller, short.target)
        assert np.array_equal(alone.position, response.position)
        assert np.array_equal(alone.record.command, response.record.command)
        assert np.array_equal(alone.elements, response.elements)


def test_errors_of_solve_ivp_shrink_with_its_tolerance(short: Job, truth: rows.Array) -> None:
    errors = [np.max(np.abs(others.with_scipy(short, "RK45", tol) - truth)) for tol in (1e-3, 1e-5, 1e-7)]
    assert errors[0] < 1e-8
    assert errors[1] < errors[0]
    assert errors[2] < 0.1 * errors[0]


def test_errors_of_python_control(short: Job, truth: rows.Array) -> None:
    sampled = [np.max(np.abs(others.with_control(short, tol) - truth)) for tol in (1e-3, 1e-5)]
    assert sampled[1] < sampled[0] < 1e-8
    continuous = np.max(np.abs(others.with_control_continuous(short, 1e-3) - truth))
    assert continuous < 5e-6  # another loop, but not a wrong one


def test_quick_run_writes_its_files_and_has_every_row(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    tiny = replace(rows.QUICK, duration=0.05, piece=0.005, rounds=2, substeps=(10, 20), tolerances=(1e-3,), batch=4)
    monkeypatch.setattr(command, "QUICK", tiny)
    assert command.main(["--quick", "--output", str(tmp_path)]) == 0
    printed = capsys.readouterr()
    results = json.loads((tmp_path / "benchmark.json").read_text(encoding="utf-8"))
    families = {row["family"] for row in results["rows"]} | set(results["skipped"])
    assert families == {rows.SIMULATOR, rows.HOT, rows.TWIN, rows.BATCHED, *rows.SLOW}
    for family in families:
        assert family in printed.out
    for row in results["rows"]:
        assert 0 < row["error_m"] < 1e-5
        assert row["seconds_per_simulated_second"] > 0
    assert (tmp_path / "benchmark.svg").read_text(encoding="utf-8").startswith("<?xml")
    assert "round 2 of 2" in printed.err


def test_a_missed_target_is_said(job: Job) -> None:
    def row(family: str, label: str, ratio: float, error: float) -> rows.Row:
        return rows.Row(family, label, 1e-3 * ratio, ratio, error, True, "", (1e-3,))

    measured = [
        row(rows.SIMULATOR, "10 substeps", 1.0, 1e-10),
        row(rows.HOT, "", 0.7, 1e-10),
        row(rows.BATCHED, "", 0.6, 1e-10),
        row(rows.SCIPY, "tight", 500.0, 1e-12),
        row(rows.SCIPY, "loose", 500.0, 1e-9),
    ]
    text = outcome.verdicts(outcome.targets(measured)).splitlines()
    assert [line.split()[0] for line in text] == ["not", "MISSED", "MISSED", "reached"]
    assert "skipped" in outcome.table(measured, job.duration, "no C compiler is on the PATH")
