"""Every effect in the closed loop: nothing where it is off, seen where it is on, second order, the same in a replay."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path as File
from typing import Final

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from models.controller import Controller, references
from models.effects.base import Effect
from models.effects.catalogue import every, in_order
from models.effects.motor import Cogging
from models.effects.scale import ScalePeriodicError
from models.feedback.law import arrays
from models.friction import elements
from models.machine import Machine, load
from models.plant import Plant, matrices, transition
from models.records.record import feeding_sequence
from models.simulation import simulator
from models.simulation.effect_kernel import Path, replay, run_effects
from models.simulation.hooks import pack
from models.simulation.simulator import Response, simulate, simulate_many
from tests.models.effects.laws import laws
from tests.models.effects.paths import TS, Array
from tests.models.feedback.axis import FILTERS, axis
from tests.models.simulation.test_simulator import controlled, exact_scale, variation

ROOT = File(__file__).parents[3]
EVERY: Final = every()
LAWS: Final = laws()
TABLE: Final = exact_scale(load())
CONTROLLER: Final = controlled(TABLE)
TARGET: Final = feeding_sequence(20e-6, 2, 0.05, TS)
SIGNALS: Final = ("position", "friction", "elements")
# What no 20 um sequence of 0.2 s shows much of at its typical size; [N] in the command.
FAINT: Final[Mapping[str, float]] = {
    "dac_quantisation": 5e-3,
    "friction_drift": 2e-3,
    "cable_spring": 2e-3,
    "scale_drift": 2e-3,
    "thrust_fall_off": 1e-6,  # these go with the square of the way
    "hardening_spring": 1e-9,
}
# In the length of a substep, where it is less: the acceleration is known a substep late.
ORDER: Final[Mapping[str, float]] = {"noncollocated_friction": 1.0}


def with_effects(machine: Machine, *effects: Effect) -> Machine:
    return replace(machine, effects=effects)


def bits(response: Response) -> tuple[bytes, ...]:
    record = response.record
    return tuple(s.tobytes() for s in (*(getattr(response, n) for n in SIGNALS), record.command, record.position))


@pytest.mark.parametrize("name", LAWS)
def test_an_amplitude_of_zero_is_the_nominal_loop_bit_for_bit(name: str) -> None:
    off = with_effects(TABLE, LAWS[name].off())
    assert bits(simulate(off, CONTROLLER, TARGET)) == bits(simulate(TABLE, CONTROLLER, TARGET))


@pytest.mark.parametrize("index", range(4))
def test_the_loop_without_hooks_is_the_loop_without_effects(index: int) -> None:
    """Damped elements, a dead time within a sample, a noisy scale and a strained start among them."""
    machine = variation(index)
    strained = 0.4 * np.array(machine.friction.limit)
    nominal = simulate(machine, CONTROLLER, TARGET, seed=2, initial_friction=strained)
    loop, run = simulator._prepare(machine, CONTROLLER, references(CONTROLLER, TARGET), 10, 2, strained)
    run_effects(loop, run, pack((), len(machine.friction.limit)), arrays(None), 0.0, 0)
    assert np.array_equal(run.position, nominal.position)
    assert np.array_equal(run.friction, nominal.friction)
    assert np.array_equal(run.command, nominal.record.command)
    assert np.array_equal(run.z, nominal.elements)


@pytest.mark.parametrize("name", LAWS)
def test_every_effect_shows_in_the_command(name: str) -> None:
    nominal = simulate(TABLE, CONTROLLER, TARGET).record.command
    acting = simulate(with_effects(TABLE, LAWS[name]), CONTROLLER, TARGET).record.command
    assert np.max(np.abs(acting - nominal)) > FAINT.get(LAWS[name].name, 1e-2)


@pytest.mark.parametrize("name", LAWS)
def test_every_effect_is_second_order(name: str) -> None:
    machine = with_effects(TABLE, LAWS[name])
    truth = simulate(machine, CONTROLLER, TARGET, substeps=320).position
    coarse, fine = (
        np.max(np.abs(simulate(machine, CONTROLLER, TARGET, substeps=count).position - truth)) for count in (5, 40)
    )
    assert fine < 1e-8  # a tenth of the scale's resolution
    if LAWS[name].name != "dac_quantisation":  # a command beside the edge of a step falls to this side or to that
        assert fine < coarse / 8 ** ORDER.get(LAWS[name].name, 1.6)


def test_a_run_that_begins_elsewhere_meets_the_forces_and_the_scale_of_that_place() -> None:
    """As if both had been moved the other way; without effects nothing depends on the place."""
    origin, shown = -1.3e-2, simulate(TABLE, CONTROLLER, TARGET)
    plain = simulate(TABLE, CONTROLLER, TARGET + origin, origin=origin)
    assert plain.position - origin == pytest.approx(shown.position, abs=1e-12)
    assert plain.record.position - plain.position == pytest.approx(shown.record.position - shown.position, abs=1e-12)
    cogging, scale = Cogging(2.0, 4e-2, 0.3), ScalePeriodicError(1e-7, 2.5e-5, 0.2)
    here = with_effects(TABLE, cogging, scale)
    turns = [2 * np.pi * origin / length for length in (cogging.pitch, scale.period)]
    moved = with_effects(TABLE, replace(cogging, phase=0.3 + turns[0]), replace(scale, phase=0.2 + turns[1]))
    there = simulate(here, CONTROLLER, TARGET + origin, origin=origin)
    same = simulate(moved, CONTROLLER, TARGET)
    assert np.max(np.abs(there.position - origin - same.position)) < 1e-12
    assert np.max(np.abs(there.record.command - same.record.command)) < 1e-6 * np.max(np.abs(same.record.command))
    assert np.max(np.abs(same.position - simulate(here, CONTROLLER, TARGET).position)) > 1e-9


def test_many_machines_with_and_without_effects() -> None:
    machines = [variation(0), with_effects(variation(1), EVERY["stribeck"].typical()), variation(2)]
    controllers = [controlled(machine) for machine in machines]
    together = simulate_many(machines, controllers, TARGET, seed=3)
    for machine, controller, response in zip(machines, controllers, together, strict=True):
        assert bits(simulate(machine, controller, TARGET, seed=3)) == bits(response)


@pytest.mark.parametrize("dead_time", [1e-3, 1.3e-3])
@pytest.mark.parametrize("damping", [0.0, 20.0])
@pytest.mark.parametrize("law", [0, 1, 2])
def test_a_replay_along_the_simulated_path_gives_the_simulated_friction(
    dead_time: float, damping: float, law: int
) -> None:
    """Open loop, sampled finely enough that the path between the samples is known; every friction effect at once, those
    of several laws by this one or their last."""
    of_name: dict[str, list[Effect]] = {}
    for effect in LAWS.values():
        of_name.setdefault(effect.name, []).append(effect)
    chosen = [ones[min(law, len(ones) - 1)] for ones in of_name.values()]
    effects = in_order([effect for effect in chosen if effect.family in {"friction", "motor"}])
    friction = elements(TABLE.friction.stiffness, TABLE.friction.limit, damping)
    fine, parts = 5e-5, 2
    control = replace(TABLE.control, sample_time=fine, pid=replace(TABLE.control.pid, kp=0.0, ki=0.0, kd=0.0))
    plant = replace(TABLE.plant, dead_time=dead_time)
    machine = replace(TABLE, friction=friction, control=control, plant=plant, effects=effects)
    t = np.arange(4000) * fine
    amplitude, _, phase = EVERY["cogging"].typical().values()
    held = -amplitude * np.sin(phase)  # there is no integral to do so
    thrust = held + 22 * np.sin(2 * np.pi * 15 * t) * np.minimum(t / 0.02, 1)
    response = simulate(machine, Controller(fine, control.pid, 0, (0.0,), (1.0,)), thrust, substeps=10)
    spline = CubicSpline(t, response.position)
    middle = t[:, None] + (np.arange(parts) + 0.5) * fine / parts
    path = Path(fine, spline(middle), spline(middle, 1), response.position, response.record.command)
    replayed = replay(friction, effects, path, dead_time, thrust_limit=150.0, start=0.0)
    between = 0.5 * (replayed.friction[:-1, -1] + replayed.friction[1:, 0])
    assert np.ptp(response.position) > 1e-4
    assert np.max(np.abs(between - response.friction[1:])) < 3e-4 * np.ptp(response.friction)
    net = replayed.thrust - replayed.friction + replayed.force
    assert np.max(np.abs(moved(plant, net, fine) - response.position)) < 1e-3 * np.ptp(response.position)


@pytest.mark.parametrize("parts", [2, 3, 5])
@pytest.mark.parametrize("late", [0.0, 0.2, 0.5, 0.77, 1.0])
def test_a_thrust_that_changes_within_a_sample_keeps_its_impulse_and_its_moment(parts: int, late: float) -> None:
    """The line between the middles of substeps has both, whatever part of the sample the change comes after."""
    before, after, ts = 3.0, -5.0, 1e-3
    command = np.array([before, before, after, after])
    path = Path(ts, np.zeros((4, parts)), np.zeros((4, parts)), np.zeros(4), command)
    sent = replay(TABLE.friction, [], path, late * ts, start=before).sent
    changing = sent[2]
    place = (np.arange(parts) + 0.5) / parts - 0.5
    moment = late * before * (late - 1) / 2 + (1 - late) * after * late / 2  # of the thrust, about the sample's middle
    assert np.mean(changing) == pytest.approx(late * before + (1 - late) * after)
    slope = np.sum(place * changing) / np.sum(place**2)
    assert slope / 12 == pytest.approx(moment, abs=1e-12)
    assert sent[:2] == pytest.approx(np.full((2, parts), before))


def moved(plant: Plant, net: Array, sample_time: float) -> Array:
    """Where the plant's modes are at each sample (n,) [m], from rest, under forces (n, M) [N] held over substeps."""
    phi, gamma = transition(*matrices(plant)[:2], sample_time / net.shape[1])
    state, position = np.zeros(len(phi)), np.empty(len(net))
    for k, forces in enumerate(net):
        position[k] = state[0::2].sum()
        for force in forces:
            state = phi @ state + gamma[:, 0] * force
    return position


def fingerprint() -> str:
    """A hash of what a loop and a replay with every effect put out, and a loop under a cascade with filters at the
    rating, to ten digits: exp and sin may round otherwise."""
    machine = with_effects(TABLE, *(kind.typical() for kind in EVERY.values()))
    response = simulate(machine, CONTROLLER, TARGET[:60], substeps=4)
    path = Path(TS, np.outer(response.position, [1, 1.1]), np.ones((60, 2)), response.position, response.record.command)
    replayed = replay(machine.friction, machine.effects, path, 0.7e-3)
    other = axis(filters=FILTERS, anti_windup=1e-3)
    limited = simulate(other, other.feedback_only(), np.full(60, 2e-4), substeps=4)
    assert np.max(np.abs(limited.record.command)) == other.drive.rated_thrust
    digest = hashlib.sha256()
    for signal in (
        limited.position,
        limited.record.command,
        response.position,
        response.record.command,
        replayed.thrust,
        replayed.friction,
        replayed.force,
    ):
        digest.update(",".join(f"{number:.9e}" for number in signal.ravel()).encode())
    return digest.hexdigest()


def test_compiled_and_uncompiled_agree() -> None:
    program = "from tests.models.simulation.test_effect_kernel import fingerprint; print(fingerprint())"
    uncompiled = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert uncompiled.stdout.strip() == fingerprint()
