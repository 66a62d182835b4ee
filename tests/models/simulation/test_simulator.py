"""The simulator: second order against the oracle, the same bits compiled or not, alone or side by side."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from design.deadbeat import DesignError, synthesise
from design.feasibility import require_designable
from design.friction_compensation import simplify
from design.pid.rules import slow_rule
from models.controller import Controller
from models.effects.friction_laws import ViscousFriction
from models.friction import elements
from models.machine import Machine, load
from models.plant import Mode, matrices, sampled, transition
from models.records.record import feeding_sequence
from models.simulation.exact import respond
from models.simulation.simulator import simulate, simulate_many, substeps_needed

ROOT = Path(__file__).parents[3]
TS = 5e-4


def exact_scale(machine: Machine) -> Machine:
    """The machine with a scale that neither rounds nor is noisy: the oracle's rounding would hide the order."""
    return replace(machine, scale=replace(machine.scale, resolution=0.0, noise=0.0))


def controlled(machine: Machine) -> Controller:
    """The default design for this machine."""
    control = machine.control
    deadbeat = synthesise(machine.plant, machine.sample_time, 20e-3, 20e-6)
    rfm = simplify(machine.friction, 5)
    return Controller(machine.sample_time, control.pid, control.reference_delay, deadbeat.n_ff, deadbeat.d_ff, rfm)


def variation(index: int) -> Machine:
    """Machines that differ in all that a variation may: masses, damping, delay within the sample, friction, offset."""
    table = load()
    scale = 1 + 0.02 * index
    modes = tuple(replace(mode, gain=mode.gain * scale) for mode in table.plant.modes)
    plant = replace(table.plant, modes=modes, dead_time=1e-3 + (index % 3) * 1e-4)
    friction = elements(np.array(table.friction.stiffness) * scale, table.friction.limit, 20.0 * (index % 2))
    drive = replace(table.drive, offset=0.7 * (index // 2))
    scale_ = replace(table.scale, noise=3e-8 * (index % 2))
    return replace(table, drive=drive, plant=plant, friction=friction, scale=scale_)


TARGET = feeding_sequence(20e-6, 2, 0.025, TS, repeats=2)


@pytest.mark.parametrize(
    ("dead_time", "damping", "offset", "sign"),
    [(1e-3, 0.0, 0.0, 1), (1.13e-3, 0.0, 0.0, 1), (1e-3, 150.0, 0.0, 1), (1e-3, 0.0, -4.0, 1), (1e-3, 0.0, 0.0, -1)],
    ids=["whole", "within a sample", "damped", "offset", "anti-phase"],
)
def test_second_order_against_the_oracle(dead_time: float, damping: float, offset: float, sign: int) -> None:
    """`sign` is that of the last mode's gain: a table that moves against the thrust in it."""
    table = exact_scale(load())
    *others, last = table.plant.modes
    plant = replace(table.plant, dead_time=dead_time, modes=(*others, replace(last, gain=sign * last.gain)))
    friction = replace(table.friction, damping=(damping,) * 10)
    drive = replace(table.drive, offset=offset)
    machine = replace(table, drive=drive, plant=plant, friction=friction)
    controller = controlled(machine)
    truth, friction_force = respond(machine, controller, TARGET)
    substeps = np.array([4, 8, 16, 32, 64])
    errors = []
    for count in substeps:
        response = simulate(machine, controller, TARGET, substeps=int(count))
        errors.append(np.max(np.abs(response.position - truth)))
    order = -np.polyfit(np.log(substeps), np.log(errors), 1)[0]
    assert order > 1.8
    assert errors[1] < 2e-9  # metres, at 8 substeps: far below the scale's 0.1 um
    assert response.friction == pytest.approx(friction_force, abs=1e-4)


def stiff(mass: float, sample_time: float, stiffness: float, force: float) -> Machine:
    """A mass [kg] on contacts of the table's shape, of this stiffness [N/m] and force [N] in all, at rest by itself."""
    table = exact_scale(load())
    own = table.friction
    factor = stiffness / sum(own.stiffness)
    shorter = force / (factor * own.coulomb_force)
    friction = elements(np.array(own.stiffness) * factor, np.array(own.limit) * shorter, 0.0)
    drive = replace(table.drive, rated_thrust=10 * force)
    plant = replace(table.plant, modes=(Mode(1 / (mass * table.plant.thrust_constant), 0.0, 0.0),), dead_time=0.0)
    bare = replace(table, plant=plant, friction=friction, drive=drive, published=None)
    control = replace(bare.control, sample_time=sample_time)
    slow = slow_rule(replace(bare, control=control))
    return replace(bare, control=replace(control, pid=slow))


@pytest.mark.parametrize(
    "axis",
    [(0.3, 1e-3, 2e7, 8.0), (0.3, 4e-3, 1.8e7, 5.4), (0.3, 16e-3, 3e6, 12.0), (300.0, 5e-5, 1e8, 60.0)],
    ids=["light", "slow", "slower", "heavy"],
)
def test_stiff_contacts_get_the_substeps_that_they_need(axis: tuple[float, float, float, float]) -> None:
    """Ten of 4 ms were unstable on them: 33 m of 20 µm, without a word."""
    machine = stiff(*axis)
    target, controller = feeding_sequence(20e-6, 2, 0.1, machine.sample_time), machine.feedback_only()
    truth, _ = respond(machine, controller, target)
    count = substeps_needed(machine)
    found = [simulate(machine, controller, target, substeps=each).position for each in (None, count, 2 * count)]
    assert np.array_equal(found[0], found[1])  # by default
    off, half = (float(np.max(np.abs(one - truth))) for one in found[1:])
    assert off < 1e-3 * 20e-6
    assert half < 0.35 * off


def test_as_few_substeps_as_the_contacts_allow() -> None:
    assert substeps_needed(load()) == 10
    assert substeps_needed(stiff(0.3, 4e-3, 1.8e7, 5.4)) == 320
    assert substeps_needed(_damped(2e4)) == 40


def test_contacts_that_no_step_follows_are_refused() -> None:
    for machine, name in ((stiff(1e-3, 16e-3, 1e12, 8.0), "stiffness"), (_damped(1e9), "damping")):
        with pytest.raises(ValueError, match=f"friction.{name}: .* is too quick to simulate at"):
            simulate(machine, machine.feedback_only(), TARGET)
        with pytest.raises(DesignError, match=f"friction.{name}: .* is too quick to simulate at"):
            require_designable(machine)


def _damped(damping: float) -> Machine:
    """The table whose contacts have a damping [N s/m] each."""
    table = load()
    return replace(table, friction=elements(table.friction.stiffness, table.friction.limit, damping))


def test_the_naive_method_is_first_order_and_far_worse() -> None:
    """Friction taken at the start of a substep, as one would write it first: pinned beside the good one, open loop."""
    table = exact_scale(load())
    machine = replace(table, plant=replace(table.plant, dead_time=2 * TS))
    thrust = 12.0 * np.sign(np.sin(np.arange(200) * 0.3))
    controller = Controller(TS, replace(machine.control.pid, kp=0.0, ki=0.0, kd=0.0), 0, (0.0,), (1.0,))
    truth, _ = respond(machine, controller, thrust)
    substeps = np.array([8, 16, 32, 64])
    naive = [np.max(np.abs(_naive(machine, thrust, int(count)) - truth)) for count in substeps]
    ours = [np.max(np.abs(simulate(machine, controller, thrust, substeps=int(c)).position - truth)) for c in substeps]
    order_naive, order = (-np.polyfit(np.log(substeps), np.log(errors), 1)[0] for errors in (naive, ours))
    assert order_naive == pytest.approx(1, abs=0.15)
    assert order == pytest.approx(2, abs=0.3)
    assert naive[0] > 20 * ours[0]


def _naive(machine: Machine, thrust: np.ndarray, substeps: int) -> np.ndarray:
    phi, gamma = transition(*matrices(machine.plant)[:2], TS / substeps)
    stiffness, limit = np.array(machine.friction.stiffness), np.array(machine.friction.limit)
    state, z, at, positions = np.zeros(len(phi)), np.zeros(len(limit)), 0.0, []
    for k in range(thrust.size):
        positions.append(state[0::2].sum())
        held = thrust[k - 2] if k >= 2 else 0.0
        for _ in range(substeps):
            x = state[0::2].sum()
            z, at = np.clip(z + x - at, -limit, limit), x
            state = phi @ state + gamma[:, 0] * (held - stiffness @ z)
    return np.array(positions)


def test_without_friction_it_is_the_linear_sampled_loop() -> None:
    """Plant, dead time and PID alone: the same response from the exact sampled model and difference equations."""
    table = exact_scale(load())
    machine = replace(table, friction=elements([1e-9], [1.0]), drive=replace(table.drive, rated_thrust=1e9))
    controller = replace(controlled(table), friction_compensation=None, n_ff=(1.0,), d_ff=(0.0,))
    target = np.concatenate([np.full(100, 1e-5), np.full(200, -3e-6)])
    response = simulate(machine, controller, target, substeps=1)
    assert response.position == pytest.approx(_linear(machine, target), abs=1e-15)


def _linear(machine: Machine, target: np.ndarray) -> np.ndarray:
    model, pid = sampled(machine.plant, TS), machine.control.pid
    a = pid.derivative_filter / (pid.derivative_filter + TS)
    delayed = np.concatenate([np.full(2, target[0]), target[:-2]])
    state, error, positions = np.zeros(model.nstates), np.zeros(target.size), np.zeros(target.size)
    for k in range(target.size):
        positions[k] = (model.C @ state).item()
        error[k] = delayed[k] - positions[k]
        u = pid.kp * error[: k + 1] + lfilter([pid.ki * TS], [1, -1], error[: k + 1])
        u += lfilter(pid.kd * (1 - a) / TS * np.array([1, -1]), [1, -a], error[: k + 1])
        state = model.A @ state + np.asarray(model.B)[:, 0] * u[-1]
    return positions


def test_side_by_side_equals_one_by_one_bit_for_bit() -> None:
    machines = [variation(index) for index in range(7)]
    controllers = [controlled(machine) for machine in machines]
    together = simulate_many(machines, controllers, TARGET, seed=3)
    for machine, controller, response in zip(machines, controllers, together, strict=True):
        alone = simulate(machine, controller, TARGET, seed=3)
        assert np.array_equal(alone.position, response.position)
        assert np.array_equal(alone.friction, response.friction)
        assert np.array_equal(alone.record.command, response.record.command)
        assert np.array_equal(alone.record.position, response.record.position)


def fingerprint() -> str:
    """A hash of every bit that two variations, alone and side by side, put out."""
    machines = [variation(1), variation(2)]
    controllers = [controlled(machine) for machine in machines]
    short = TARGET[:60]
    responses = [
        simulate(machines[0], controllers[0], short, seed=1),
        *simulate_many(machines, controllers, short, seed=1),
    ]
    digest = hashlib.sha256()
    for response in responses:
        for signal in (response.position, response.friction, response.record.command, response.record.position):
            digest.update(signal.tobytes())
    return digest.hexdigest()


def test_compiled_and_uncompiled_agree_bit_for_bit() -> None:
    program = "from tests.models.simulation.test_simulator import fingerprint; print(fingerprint())"
    uncompiled = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert uncompiled.stdout.strip() == fingerprint()


def test_a_machine_in_balance_stays_at_rest() -> None:
    machine = load()
    strained = 0.4 * np.array(machine.friction.limit)
    response = simulate(machine, controlled(machine), np.zeros(200), initial_friction=strained)
    assert np.max(np.abs(response.position)) < 1e-15
    assert response.record.command == pytest.approx(np.full(200, strained @ machine.friction.stiffness))


def test_the_drive_gives_no_more_than_its_rated_thrust() -> None:
    """Ten times the stroke asks for ten times the thrust; the modelled drive gives what it can, and the table lags."""
    machine = exact_scale(load())
    controller = controlled(machine)
    strong = replace(machine, drive=replace(machine.drive, rated_thrust=1e5))
    target = np.full(20, 2e-4)
    limited, free = simulate(machine, controller, target), simulate(strong, controller, target)
    assert np.max(np.abs(free.record.command)) > 500
    truth, _ = respond(machine, controller, target)
    assert limited.position == pytest.approx(truth, abs=1e-9)
    assert np.max(np.abs(limited.position - free.position)) > 1e-6


def test_an_offset_is_held_by_the_integral_and_shows_in_the_command_alone() -> None:
    machine = exact_scale(load())
    pulled = replace(machine, drive=replace(machine.drive, offset=-3.0))
    controller = controlled(machine)
    without, held = simulate(machine, controller, TARGET), simulate(pulled, controller, TARGET)
    assert held.position == pytest.approx(without.position, abs=1e-14)
    assert held.record.command == pytest.approx(without.record.command - 3.0, abs=1e-7)


def test_without_an_integral_the_table_gives_way_to_an_offset() -> None:
    """By offset / k_p where friction is too small to hold any of it."""
    table = exact_scale(load())
    rigid = replace(table.plant, modes=table.plant.modes[:1])
    drive = replace(table.drive, offset=-3.0)
    machine = replace(table, plant=rigid, friction=elements([1e-9], [1.0]), drive=drive)
    controller = controlled(table)
    controller = replace(controller, pid=replace(controller.pid, ki=0.0))
    expected = 3.0 / controller.pid.kp
    assert simulate(machine, controller, np.zeros(2000)).position[-1] == pytest.approx(expected, rel=1e-6)
    assert respond(machine, controller, np.zeros(2000))[0][-1] == pytest.approx(expected, rel=1e-6)


def test_without_an_integral_nothing_holds_the_friction_of_the_start() -> None:
    """Bent contacts push the table off until they and k_p agree; their force at the start is no offset."""
    machine = exact_scale(load())
    controller = controlled(machine)
    held, free = controller, replace(controller, pid=replace(controller.pid, ki=0.0))
    bent = 0.5 * np.array(machine.friction.limit)
    nothing = np.zeros(4000)
    assert np.max(np.abs(simulate(machine, held, nothing, initial_friction=bent).position)) < 1e-12
    alone = simulate(machine, free, nothing, initial_friction=bent)
    assert alone.record.command[0] == 0.0
    assert alone.position[-1] < -1e-8
    assert free.pid.kp * alone.position[-1] == pytest.approx(-alone.friction[-1], rel=1e-3)
    truth, force = respond(machine, free, nothing[:400], initial_friction=bent)
    assert alone.position[:400] == pytest.approx(truth, abs=1e-9)
    assert alone.friction[:400] == pytest.approx(force, abs=1e-2)
    lanes = simulate_many([machine, machine], [held, free], nothing, initial_friction=bent)
    assert np.array_equal(lanes[1].position, alone.position)
    effect = replace(machine, effects=(ViscousFriction(1e-9),))
    assert simulate(effect, free, nothing[:400], initial_friction=bent).position == pytest.approx(truth, abs=1e-9)


def test_the_scale_rounds_and_its_noise_follows_the_seed() -> None:
    machine = replace(load(), scale=replace(load().scale, noise=3e-8))
    controller = controlled(machine)
    first, again, other = (simulate(machine, controller, TARGET, seed=seed) for seed in (5, 5, 6))
    steps = first.record.position / machine.scale.resolution
    assert steps == pytest.approx(np.round(steps), abs=1e-6)
    assert np.array_equal(first.record.position, again.record.position)
    assert not np.array_equal(first.record.position, other.record.position)
    assert np.max(np.abs(first.record.position - first.position)) < 0.5e-7 + 6 * 3e-8


def test_two_time_bases_do_not_mix() -> None:
    machine = load()
    other = replace(controlled(machine), sample_time=2.5e-4)
    with pytest.raises(ValueError, match="design the controller for this machine's sample time"):
        simulate(machine, other, TARGET)
