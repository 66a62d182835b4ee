"""Motor, structure, scale and protocol: each effect does what its equation says."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.effects.base import Effect
from models.effects.catalogue import every
from models.machine import load
from models.records.record import feeding_sequence
from models.simulation.effect_kernel import Replayed, replay
from models.simulation.simulator import simulate
from tests.models.effects.paths import TS, make, steady, through
from tests.models.simulation.test_simulator import controlled, exact_scale

FRICTION = load().friction
COMMAND = 80 * np.sin(0.3 * np.arange(200)) * np.linspace(0, 1, 200)


def driven(*effects: Effect, dead_time: float = 0.0, parts: int = 4) -> Replayed:
    """Thrust for COMMAND along a slow stroke over 20 mm."""
    path = steady(0.2, COMMAND.size, parts)._replace(command=COMMAND)
    return replay(FRICTION, effects, path, dead_time)


def test_the_dead_time_keeps_the_impulse_of_a_command() -> None:
    """A command of one sample arrives with its area in each sample, L later, whatever part of a substep that is."""
    pulse = np.zeros(10)
    pulse[3] = 2.0
    for dead_time in (0.0, 5e-4, 7e-4, 1.03e-3):
        path = through(np.zeros(10), command=pulse)
        thrust = replay(FRICTION, (), path, dead_time).thrust
        edges = np.arange(11) * TS
        arrived = np.diff(np.clip(edges - 3 * TS - dead_time, 0, TS)) * 2.0 / TS
        assert thrust.mean(axis=1) == pytest.approx(arrived, abs=1e-9)


def test_before_the_first_command_stands_the_start_and_the_limit_holds() -> None:
    path = through(np.zeros(4), parts=1, command=[5.0, -7.0, 1.0, 1.0])
    assert replay(FRICTION, (), path, 2 * TS).thrust[:, 0].tolist() == [5, 5, 5, -7]
    limited = replay(FRICTION, (), path, 2 * TS, start=-1.0, thrust_limit=4.0)
    assert limited.thrust[:, 0].tolist() == [-1, -1, 4, -4]


@given(st.floats(0.5, 5), st.floats(2e-2, 6e-2), st.floats(0, 2 * math.pi))
def test_cogging_is_a_force_of_place_and_ripple_a_gain_of_place(amplitude: float, pitch: float, phase: float) -> None:
    path = steady(0.2, COMMAND.size)
    wave = np.sin(2 * math.pi * path.position / pitch + phase)
    assert driven(make("cogging", amplitude, pitch, phase)).force == pytest.approx(amplitude * wave)
    rippled = driven(make("thrust_ripple", 0.01 * amplitude, pitch, phase))
    assert rippled.thrust == pytest.approx(driven().thrust * (1 + 0.01 * amplitude * wave))


@given(st.floats(-3e5, 3e5), st.floats(-150, 150))
def test_a_spring_hardens_with_the_cube_of_the_way_and_a_voice_coil_weakens_with_its_square(
    hardening: float, fall: float
) -> None:
    x = steady(0.2, COMMAND.size).position
    assert driven(make("hardening_spring", hardening)).force == pytest.approx(-hardening * x**3)
    assert driven(make("thrust_fall_off", fall)).thrust == pytest.approx(driven().thrust * (1 - fall * x**2))


def test_an_effect_that_states_a_delay_delays_a_slow_command_by_it() -> None:
    stated = {name: kind.typical() for name, kind in every().items() if kind.delayed_by}
    assert list(stated) == ["current_loop_lag"]
    rising = steady(0.2, 200)._replace(command=np.linspace(0.0, 40.0, 200))
    for effect in stated.values():
        late = replay(FRICTION, (), rising, 0.0).thrust - replay(FRICTION, (effect,), rising, 0.0).thrust
        assert late[100:].mean() == pytest.approx(40.0 / (199 * TS) * effect.input_delay())


def test_asymmetry_and_saturation_of_the_thrust() -> None:
    u = driven().thrust
    assert driven(make("gain_asymmetry", -0.03)).thrust == pytest.approx(u * (1 - 0.03 * np.sign(u)))
    assert driven(make("thrust_saturation", 0.1)).thrust == pytest.approx(u * (1 - 0.1 * (u / 100) ** 2))


@given(st.floats(1e-4, 5e-4), st.integers(1, 8))
def test_the_current_follows_a_step_with_its_lag(time: float, parts: int) -> None:
    """Mean over each substep of 1 - exp(-t / tau): exact, however coarse the substeps."""
    path = through(np.zeros(12), parts=parts, command=np.repeat([0.0, 1.0], [2, 10]))
    thrust = replay(FRICTION, (make("current_loop_lag", time),), path, 0.0).thrust.ravel()[2 * parts :]
    edges = np.arange(10 * parts + 1) * TS / parts
    assert thrust == pytest.approx(np.diff(edges + time * np.exp(-edges / time)) / (TS / parts), rel=1e-9)


@given(st.floats(0.005, 0.1))
def test_jitter_holds_some_commands_a_sample_longer(part: float) -> None:
    command = np.arange(20_000.0)
    path = through(np.zeros(command.size), parts=1, command=command)
    late = command - replay(FRICTION, (make("timing_jitter", part),), path, 0.0).thrust[:, 0]
    assert set(late) == {0.0, 1.0}
    assert late.mean() == pytest.approx(part, abs=4 * math.sqrt(part / late.size))
    gaps = np.diff(np.flatnonzero(late))
    assert np.mean(gaps == 1) == pytest.approx(part, abs=4 * math.sqrt(part / gaps.size))  # one does not bring the next
    again = replay(FRICTION, (make("timing_jitter", part),), path, 0.0).thrust[:, 0]
    assert np.array_equal(command - again, late)


def test_deadband_and_converter() -> None:
    u = driven(parts=1).thrust
    dead = driven(make("amplifier_deadband", 0.4), parts=1).thrust
    assert dead == pytest.approx(np.sign(u) * np.maximum(np.abs(u) - 0.4, 0))
    for rise, at in ((0.0, 0.0), (1.0, 0.5)):
        stepped = driven(make("dac_quantisation", 0.05, rise), parts=1).thrust
        assert stepped / 0.05 - at == pytest.approx(np.round(stepped / 0.05 - at), abs=1e-9)
        assert np.max(np.abs(stepped - u)) <= 0.025 + 1e-12
        assert np.max(np.abs(stepped - u)) > 0.02
    cut = driven(make("dac_quantisation", 0.05, 2.0), parts=1).thrust
    assert cut == pytest.approx(0.05 * np.trunc(u / 0.05), abs=1e-12)


def test_cable_and_floor() -> None:
    path = steady(0.2, COMMAND.size)
    assert driven(make("cable_spring", 300.0)).force == pytest.approx(-300 * path.position)
    t = (np.arange(path.position.size) + 0.5) * TS / 4
    random_forces = driven(make("floor_vibration", 0.5, 12.0, 0.7)).force.ravel()
    assert random_forces == pytest.approx(0.5 * np.sin(2 * math.pi * 12 * t + 0.7))


def test_the_scale_side() -> None:
    path = steady(0.2, COMMAND.size)
    x, t = path.at_samples, np.arange(COMMAND.size) * TS
    assert driven(make("scale_drift", 2e-7)).reading == pytest.approx(2e-7 * t, abs=1e-15)
    wavy = driven(make("scale_periodic_error", 1e-7, 2e-5, 0.3)).reading
    assert wavy == pytest.approx(1e-7 * np.sin(2 * math.pi * x / 2e-5 + 0.3), abs=1e-15)
    assert driven(make("scale_gain_error", -1e-3)).reading == pytest.approx(-1e-3 * x, abs=1e-15)
    assert np.array_equal(driven(make("scale_drift", 2e-7)).thrust, driven().thrust)


def test_a_mode_of_an_effect_is_a_mode_of_the_plant() -> None:
    table = exact_scale(load())
    effect = make("additional_mode", 1e-3, 150.0, 0.02)
    plant = dataclasses.replace(table.plant, modes=table.plant.modes + effect.modes())
    controller, target = controlled(table), feeding_sequence(20e-6, 2, 0.05, TS)
    beside = simulate(dataclasses.replace(table, effects=(effect,)), controller, target)
    within = simulate(dataclasses.replace(table, plant=plant), controller, target)
    assert np.array_equal(beside.position, within.position)
    assert np.array_equal(beside.record.command, within.record.command)


def test_a_mismatched_controller_shows_in_its_own_log() -> None:
    """From the logged error the law's command follows; the logged one has the feedback's excess on top."""
    table = exact_scale(load())
    controller, target = controlled(table), feeding_sequence(20e-6, 2, 0.05, TS)

    def excess(*effects: Effect) -> float:
        record = simulate(dataclasses.replace(table, effects=effects), controller, target).record
        reference = np.concatenate([np.zeros(controller.reference_delay), record.reference])[: target.size]
        error, pid = reference - record.position, controller.pid
        keep = pid.derivative_filter / (pid.derivative_filter + TS)
        slope, feedback = 0.0, np.empty(target.size)
        for k in range(target.size):
            slope = keep * slope + (1 - keep) * (error[k] - error[k - 1] * (k > 0)) / TS
            feedback[k] = pid.kp * error[k] + pid.ki * TS * error[: k + 1].sum() + pid.kd * slope
        logged = record.command - record.feedforward
        return float(logged @ feedback / (feedback @ feedback)) - 1

    assert excess() == pytest.approx(0, abs=1e-9)
    assert excess(make("controller_mismatch", 0.04)) == pytest.approx(0.04, abs=1e-9)


def test_external_forces_at_the_start_are_held_by_the_integral() -> None:
    machine = dataclasses.replace(exact_scale(load()), effects=(make("cogging", 5.0, 0.03, 1.0),))
    resting = simulate(machine, controlled(machine), np.zeros(200))
    assert np.max(np.abs(resting.position)) < 1e-13
    assert resting.record.command == pytest.approx(np.full(200, -5 * math.sin(1)))


@pytest.mark.parametrize("loss", [0.0, 0.02, 0.27, 3.0])
def test_a_saturated_thrust_neither_falls_nor_turns(loss: float) -> None:
    """Of a drive that clips at 75 N the law of 0.27 at 100 N turned at 192 N: its file ran 77 m away."""
    u = np.linspace(-400.0, 400.0, 1601)
    path = steady(0.2, u.size)._replace(command=u)
    effect = make("thrust_saturation", loss)
    thrust = replay(FRICTION, (effect,), path, 0.0).thrust.ravel()
    assert np.all(np.diff(thrust) >= -1e-9)
    assert np.max(thrust) == pytest.approx(min(400.0, 200 / 3 / np.sqrt(3 * max(loss, 1e-9))), rel=1e-3)
    for rated in (50.0, 300.0):
        given = replay(FRICTION, (effect,), path._replace(command=np.full(u.size, rated)), 0.0).thrust[-1, -1]
        assert effect.at_rating(rated) == pytest.approx(1 - given / rated)
