"""Swings at rest: a loop made unstable is seen at its own frequency; noise, decay, drift and excitation are not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.optimize import brentq

from design.loop import dominant_pole
from diagnosis.records.at_rest import LEAST_PERIODS, is_quiet, swing_at_rest
from models.controller import PID
from models.friction import Friction
from models.machine import Machine, load
from models.records.record import Record
from models.simulation.simulator import simulate

Array = NDArray[np.float64]
MACHINE = load()
NOISE = MACHINE.scale.noisy().reading_deviation
RESTS, LONG = 8, 1000  # rests of a record, samples of each


def record(added: Array, machine: Machine = MACHINE) -> Record:
    """Steps of 20 um with `added` (RESTS * LONG,) [m] to each position."""
    reference = np.repeat(20e-6 * (np.arange(RESTS) % 2), LONG)
    still = np.zeros(reference.size)
    noise = np.random.default_rng(3).normal(0.0, machine.scale.noisy().reading_deviation, reference.size)
    return Record(machine.sample_time, reference, reference, still, still, reference + added + noise)


def swing(frequency: float, amplitude: float) -> Array:
    return np.asarray(amplitude * np.sin(2 * math.pi * frequency * MACHINE.sample_time * np.arange(RESTS * LONG)))


@settings(max_examples=40, deadline=None)
@given(frequency=st.floats(60.0, 800.0), amplitude=st.floats(20 * NOISE, 1e-4))
def test_a_swing_is_seen_with_its_frequency_and_amplitude(frequency: float, amplitude: float) -> None:
    found = swing_at_rest(record(swing(frequency, max(amplitude, 0.3e-6))), MACHINE)
    assert found is not None
    assert found.frequency == pytest.approx(frequency, abs=0.1 / (LONG / 2 * MACHINE.sample_time))
    assert found.amplitude == pytest.approx(max(amplitude, 0.3e-6), rel=0.1)
    assert (found.rests, found.of) == (RESTS, RESTS)


def dying() -> Array:
    """A vibration after each motion, whose amplitude goes by a factor e in a quarter of the rest."""
    at = np.tile(np.arange(LONG), RESTS) * MACHINE.sample_time
    return np.asarray(5e-6 * np.exp(-4 * at / (LONG * MACHINE.sample_time)) * np.sin(2 * math.pi * 200 * at))


def wide() -> Array:
    """A random force through nothing: as much energy, in no line."""
    return np.random.default_rng(5).normal(0.0, 3e-6, RESTS * LONG)


def slow() -> Array:
    """Fewer periods than tell a swing from a drift, or from hunting."""
    return swing((LEAST_PERIODS - 2) / (LONG / 2 * MACHINE.sample_time), 3e-6)


def few() -> Array:
    """In one rest of eight."""
    return np.asarray(np.where(np.arange(RESTS * LONG) < LONG, swing(200.0, 3e-6), 0.0))


@pytest.mark.parametrize("added", [np.zeros(RESTS * LONG), dying(), wide(), slow(), few(), swing(200.0, 2 * NOISE)])
def test_what_is_no_swing_is_not_told(added: Array) -> None:
    assert swing_at_rest(record(added), MACHINE) is None


def test_a_swing_that_the_specification_does_not_notice_is_not_told() -> None:
    fine = replace(MACHINE, scale=replace(MACHINE.scale, resolution=1e-10, noise=1e-10))
    small = record(swing(200.0, 0.05 * fine.specification.tolerance), fine)
    assert swing_at_rest(small, fine) is None
    narrow = replace(fine, specification=replace(fine.specification, tolerance=0.1 * fine.specification.tolerance))
    assert swing_at_rest(small, narrow) is not None


def test_a_record_is_quiet_only_where_it_has_rests_that_would_show_a_swing() -> None:
    still, swinging = record(np.zeros(RESTS * LONG)), record(swing(200.0, 3e-6))
    assert is_quiet(still, MACHINE)
    assert not is_quiet(swinging, MACHINE)
    moving = replace(still, reference=still.reference + 1e-9 * np.arange(RESTS * LONG))
    assert not is_quiet(moving, MACHINE)


def test_what_is_excited_is_not_at_rest() -> None:
    plain = record(swing(200.0, 3e-6))
    driven = replace(plain, feedforward=swing(200.0, 10.0), command=swing(200.0, 10.0))
    assert swing_at_rest(plain, MACHINE) is not None
    assert swing_at_rest(driven, MACHINE) is None


def test_a_loop_that_is_not_stable_swings_at_its_own_frequency() -> None:
    """The table without friction, whose gains make its loop unstable, is held by the drive's rating: by the describing
    function of that, it swings where the loop with less gain is on the verge. With its own gains it does not."""
    free = Friction((1.0,), (1e-6,), (0.0,))
    table = replace(MACHINE, friction=free, drive=replace(MACHINE.drive, rated_thrust=20.0, offset=0.0))

    def pole(factor: float) -> complex:
        return dominant_pole(table.plant, pid(factor), table.sample_time)

    def pid(factor: float) -> PID:
        own = table.control.pid
        return replace(own, kp=factor * own.kp, ki=factor * own.ki, kd=factor * own.kd)

    verge = brentq(lambda factor: abs(pole(factor)) - 1, 1.5, 6.0)
    wild = replace(table, control=replace(table.control, pid=pid(6.0)))
    reference = np.repeat(20e-6 * (np.arange(RESTS) % 2), LONG)
    found = swing_at_rest(simulate(wild, wild.feedback_only(), reference).record, wild)
    assert found is not None
    swings = abs(float(np.angle(pole(verge)))) / (2 * math.pi * table.sample_time)
    assert found.frequency == pytest.approx(swings, rel=0.05)
    assert swing_at_rest(simulate(table, table.feedback_only(), reference).record, table) is None
