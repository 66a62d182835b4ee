"""The loop that the optimiser sees against the simulator, and what is designed on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.deadbeat import DesignError, synthesise
from design.trajectory.compensator import compensate, motion_profile, rest_states
from design.trajectory.history_aware import Limits
from design.trajectory.lifted import feedforward_only, lift
from design.trajectory.robust import RobustTask, build_robust, solve_robust
from design.trajectory.scenarios import Feedback, Scenario, respond
from models.controller import Controller, References, references
from models.friction import elements, follow
from models.machine import Machine, load
from models.plant import Plant
from models.records.record import feeding_sequence
from models.simulation.simulator import simulate

STROKE, TS = 20e-6, 5e-4


@pytest.fixture(scope="module")
def machine() -> Machine:
    """The default table with a dead time of two samples, so that the simulator can take one step a sample."""
    table = load()
    exact = replace(table.scale, resolution=0.0, noise=0.0)
    return replace(table, plant=replace(table.plant, dead_time=1e-3), scale=exact)


def controller(machine: Machine) -> Controller:
    deadbeat = synthesise(machine.plant, TS, 20e-3, STROKE)
    return Controller(TS, machine.control.pid, 2, deadbeat.n_ff, deadbeat.d_ff)


@pytest.mark.parametrize("dead_time", [0.3e-3, 1e-3, 1.2e-3])
def test_the_lifted_loop_is_the_simulator_without_friction(machine: Machine, dead_time: float) -> None:
    plant = Plant(dead_time, 1.0, machine.plant.modes)
    free = replace(machine, plant=plant, friction=elements([1e-12], [1.0]))
    target, law = np.full(80, STROKE), controller(machine)
    known = references(law, target)
    lifted = lift(plant, TS, 80, law.pid, 2)
    inputs = np.concatenate([known.feedforward, known.position, np.zeros(80)])
    response = simulate(free, law, target)
    assert (lifted.position @ inputs)[:80] == pytest.approx(response.position, abs=1e-12 * STROKE)
    assert lifted.command @ inputs == pytest.approx(response.record.command, abs=1e-9)


def test_the_loop_with_exact_elements_is_the_simulator_with_one_step_a_sample(machine: Machine) -> None:
    start = -0.7 * np.array(machine.friction.limit)
    target, law = np.full(80, STROKE), controller(machine)
    known = references(law, target)
    loop = Feedback(TS, law.pid, 2, 41, 80)
    scenario = Scenario(machine.plant, machine.friction, 0)
    position = respond(scenario, loop, start, known.feedforward, known.position).position
    response = simulate(machine, law, target, substeps=1, initial_friction=start)
    assert position[:80] == pytest.approx(response.position, abs=1e-9 * STROKE)


def test_the_smoothed_loop_comes_to_the_exact_one_at_least_in_proportion_to_the_width(machine: Machine) -> None:
    law = controller(machine)
    known = references(law, np.full(80, STROKE))
    loop, scenario = Feedback(TS, law.pid, 2, 41, 80), Scenario(machine.plant, machine.friction, 0)
    start = -np.array(machine.friction.limit)
    exact = respond(scenario, loop, start, known.feedforward, known.position).position
    ratios = (0.2, 0.1, 0.05, 0.025)
    worst = [
        np.max(np.abs(respond(scenario, loop, start, known.feedforward, known.position, ratio).position - exact))
        for ratio in ratios
    ]
    assert np.polyfit(np.log(ratios), np.log(worst), 1)[0] > 0.9


def test_a_history_aware_motion_follows_its_reference_behind_a_reversal_too(machine: Machine) -> None:
    """Against the deadbeat alone, beside it, whose reversal is micrometres off."""
    deadbeat = synthesise(machine.plant, TS, 22e-3, STROKE)
    target = feeding_sequence(STROKE, 2, 0.2, TS, 2)
    given = compensate(motion_profile(machine.plant, TS, deadbeat.thrust, STROKE), machine.friction, target)
    bare = Controller(TS, machine.control.pid, 2, (1.0,), (0.0,))
    off = [
        simulate(machine, bare, target, given=known).position[2:] - known.position[:-2]
        for known in (given, References(given.position, given.feedforward, np.zeros(target.size)))
    ]
    assert np.max(np.abs(off[0])) < 0.05e-6
    assert np.max(np.abs(off[1])) > 1e-6


def test_the_states_at_rest_carry_the_force_that_the_path_gives(machine: Machine) -> None:
    path = feeding_sequence(STROKE, 3, 0.1, TS, 2)
    states = rest_states(machine.friction, path, path)
    steps = np.flatnonzero(np.diff(path, prepend=0.0))
    force = follow(machine.friction, path)[0]
    assert states @ np.array(machine.friction.stiffness) == pytest.approx(force[steps], abs=1e-9)


def test_one_for_all_predicts_what_the_simulator_does_and_beats_its_beginning(machine: Machine) -> None:
    deadbeat = synthesise(machine.plant, TS, 22e-3, STROKE)
    starts = [-np.array(machine.friction.limit), 0.8 * np.array(machine.friction.limit)]
    scenarios = tuple(Scenario(machine.plant, machine.friction, h) for h in range(2))
    loop = Feedback(TS, machine.control.pid, 2, 47, 70)
    task = RobustTask(machine.plant, scenarios, loop, TS, 44, STROKE)
    found = solve_robust(build_robust(task), starts, deadbeat.thrust, Limits(thrust=150.0), ratios=(0.3, 0.05))
    assert found.solution.converged
    law = found.controller(TS, machine.control.pid, 2)
    worst = []
    for design in (law, Controller(TS, law.pid, 2, deadbeat.n_ff, deadbeat.d_ff)):
        errors = [
            simulate(machine, design, np.full(70, STROKE), initial_friction=start).position[47:] - STROKE
            for start in starts
        ]
        worst.append(float(np.max(np.abs(errors))))
    assert worst[0] == pytest.approx(float(np.max(np.abs(found.error))), rel=0.15)
    assert worst[0] < 0.5 * worst[1]


def test_a_common_task_that_looks_at_nothing_is_said(machine: Machine) -> None:
    loop = Feedback(TS, machine.control.pid, 2, 30, 40)
    with pytest.raises(DesignError, match="look further"):
        build_robust(RobustTask(machine.plant, (), loop, TS, 44, STROKE))


def test_the_path_of_a_feedforward_ends_on_the_target(machine: Machine) -> None:
    deadbeat = synthesise(machine.plant, TS, 20e-3, STROKE)
    lifted = feedforward_only(machine.plant, TS, deadbeat.thrust.size)
    assert lifted.on_thrust(lifted.position) @ deadbeat.thrust == pytest.approx(deadbeat.position, abs=1e-9 * STROKE)
    assert lifted.on_thrust(lifted.state) @ deadbeat.thrust == pytest.approx([STROKE, 0, 0, 0, 0, 0], abs=1e-9 * STROKE)
