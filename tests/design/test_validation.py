"""The judge of a design: its figures by their definitions, by the scale's reading, and of many machines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from design.controller import default_controller
from design.validation import BATCH, assess, last_errors, sequence, validate, validate_many
from models.machine import Machine, load
from models.records.settling import dispersion, settling_time
from models.simulation.simulator import Response, simulate, simulate_many


@pytest.fixture(scope="module")
def machine() -> Machine:
    return load()


@pytest.mark.parametrize("reading", ["position", "scale"])
def test_the_outcome_is_that_of_the_definitions(machine: Machine, reading: str) -> None:
    """Error, settling time, 3 sigma and thrust, taken directly from the simulated signals of the last period."""
    law = default_controller(machine).without_compensation()
    by_scale = reading == "scale"
    judged = validate(machine, law, periods=3, reading="scale" if by_scale else "position")
    period, ts = sequence(machine, periods=1), machine.sample_time
    last = simulate(machine, law, sequence(machine, periods=3)).last(period.size)
    position = last.record.position if by_scale else last.position
    errors = position.reshape(10, -1) - period.reshape(10, -1)
    times = [settling_time(error, 2e-6 + 1e-12, ts) for error in errors]
    assert [one.settling_time for one in judged.achieved] == times
    assert [one.motion.reversal for one in judged.achieved] == [i in {0, 5} for i in range(10)]
    assert judged.reversal.settling_time == times[0]
    assert [one.settling_time for one in judged.inching] == times[1:5]
    assert judged.slowest.settling_time == max(times)
    assert judged.settling_within(5e-6) == max(settling_time(error, 5e-6, ts) for error in errors)
    assert judged.worst_dispersion == pytest.approx(np.max(dispersion(errors[:5])[50:]))
    assert judged.dispersion_after(30e-3) == pytest.approx(np.max(dispersion(errors[:5])[60:]))
    assert judged.peak_thrust == np.max(np.abs(last.record.command))


def test_the_errors_of_the_last_period_are_those_that_are_judged(machine: Machine) -> None:
    target = sequence(machine, periods=3)
    response = simulate(machine, default_controller(machine), target)
    judged = assess(machine, response, periods=3).achieved
    for error, one in zip(last_errors(response.position, target, 3), judged, strict=True):
        np.testing.assert_array_equal(error, one.error)


def test_a_reading_that_is_just_at_the_tolerance_is_within_it(machine: Machine) -> None:
    """Readings are multiples of the resolution, rounded: one that is 20 steps of 0.1 um off is not exactly 2 um off."""
    law = default_controller(machine)
    target = sequence(machine, periods=2)
    response = simulate(machine, law, target)
    reading = target + 2e-6 * (1 + 1e-12)
    shown = replace(response, record=replace(response.record, position=reading))
    assert assess(machine, shown, periods=2, reading="scale").slowest.settling_time == 0.0
    beyond = replace(response, record=replace(response.record, position=target + 2.1e-6))
    assert assess(machine, beyond, periods=2, reading="scale").slowest.settling_time == np.inf


def test_rest_before_the_sequence_changes_nothing_without_a_clock(machine: Machine) -> None:
    law = default_controller(machine)
    at_once, later = (validate(machine, law, periods=2, lead=lead) for lead in (0, 123))
    assert later.worst_dispersion == pytest.approx(at_once.worst_dispersion, rel=1e-9)
    assert [one.motion for one in later.achieved] == [one.motion for one in at_once.achieved]


def test_one_period_alone_is_refused(machine: Machine) -> None:
    with pytest.raises(ValueError, match="give at least 2 periods, not 1"):
        validate(machine, default_controller(machine), periods=1)


def test_many_machines_in_batches_are_judged_as_each_alone(machine: Machine) -> None:
    """More machines than go side by side, of short intervals so that it does not take long."""
    short = replace(machine, specification=replace(machine.specification, interval=0.03, motions=2))
    several = [replace(short, plant=replace(short.plant, dead_time=(1.0 + 0.005 * i) * 1e-3)) for i in range(BATCH + 2)]
    laws = [default_controller(one) for one in several]
    together = validate_many(several, laws, periods=2)
    assert len(together) == BATCH + 2
    for i in (0, BATCH - 1, BATCH, BATCH + 1):
        alone = validate_many(several[i : i + 1], laws[i], periods=2)[0]
        assert np.array_equal(alone.response.position, together[i].response.position)
        assert alone.slowest.settling_time == together[i].slowest.settling_time
    assert validate_many([], laws[0]) == ()


def test_blocks_bound_the_memory_and_change_no_digit(machine: Machine, monkeypatch: pytest.MonkeyPatch) -> None:
    """Few machines go side by side where the sequence is long; what is kept of each is its last period alone."""
    short = replace(machine, specification=replace(machine.specification, interval=0.03, motions=2))
    law, many = default_controller(short), [short] * 5
    together = validate_many(many, law, periods=2)
    monkeypatch.setattr("design.validation.MAX_BLOCK_SAMPLES", 2 * sequence(short, periods=2).size)
    sizes: list[int] = []

    def counted(machines: Sequence[Machine], *given: Any, **more: Any) -> tuple[Response, ...]:
        sizes.append(len(machines))
        return simulate_many(machines, *given, **more)

    monkeypatch.setattr("design.validation.simulate_many", counted)
    for one, alike in zip(together, validate_many(many, law, periods=2), strict=True):
        assert np.array_equal(one.response.position, alike.response.position)
        assert np.array_equal(one.dispersion, alike.dispersion)
        for signal in (alike.response.position, alike.response.friction, alike.response.record.command):
            assert signal.base is None
            assert signal.size == sequence(short, periods=1).size
    assert sizes == [2, 2, 1]
