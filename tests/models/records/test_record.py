"""Motions of a target, and what settles when."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.records.record import Column, Record, cut, feeding_sequence, motions
from models.records.settling import dispersion, overshoot, settling_time


def test_the_sequence_of_figure_5() -> None:
    target = feeding_sequence(20e-6, 5, 0.5, 5e-4, repeats=2)
    assert target.size == 20 * 1000
    assert target[::1000] * 1e6 == pytest.approx([20, 40, 60, 80, 100, 80, 60, 40, 20, 0] * 2)
    found = motions(target)
    assert len(found) == 20
    assert [i for i, motion in enumerate(found) if motion.reversal] == [0, 5, 10, 15]
    assert {motion.stop - motion.start for motion in found} == {1000}
    assert [motion.direction for motion in found[:10]] == [1] * 5 + [-1] * 5


def test_a_record_in_which_nothing_moves_has_no_motions() -> None:
    nothing = np.zeros(100)
    assert cut(Record(1e-3, nothing, nothing, nothing, nothing, nothing)) == ()


def test_a_reference_that_rests_most_of_the_time_has_as_many_motions_as_its_target() -> None:
    """Of ten motions of 20 ms every 0.5 s, a log without a target had four hundred."""
    share = np.linspace(0, 1, 41)
    way = np.append(share**3 * (10 - 15 * share + 6 * share**2), np.ones(959))
    levels = 20e-6 * np.array([1, 2, 3, 4, 5, 4, 3, 2, 1, 0])
    before = np.append(0.0, levels[:-1])
    reference = np.concatenate([a + (b - a) * way for a, b in zip(before, levels, strict=True)])
    found = cut(Record(5e-4, *[reference] * 5))
    assert len(found) == 10
    assert [motion.reversal for motion in found] == [i in {0, 5} for i in range(10)]


def test_a_log_of_every_fourth_sample_is_filled_through_its_samples() -> None:
    """Splines have the error of their order between the samples, none at them; what is commanded does not overshoot."""
    time = 2.5e-4 * np.arange(4001, dtype=float)
    step = np.where(time < 0.5, 0.0, 1e-3)
    signals = (step, step, 2 * step, np.sin(30 * time), 1e-3 * np.sin(30 * time))
    record = Record(2.5e-4, *signals, columns=(Column("I", time),))
    log = record.thinned(4)
    assert (log.sample_time, log.position.size, log.columns[0].values.size) == (1e-3, 1001, 1001)
    filled = log.filled(4)
    assert (filled.sample_time, filled.every, filled.columns) == (2.5e-4, 4, ())
    assert filled.position.size == record.position.size
    assert filled.part(8, 80).every == 4
    for one, fine in (
        (log.position, filled.position),
        (log.command, filled.command),
        (log.reference, filled.reference),
    ):
        assert fine[::4] == pytest.approx(one, rel=1e-12, abs=1e-15)
    assert np.max(np.abs(filled.command - record.command)) < (30 * 1e-3) ** 4
    assert np.min(filled.reference) == 0
    assert np.max(filled.reference) == 1e-3
    assert set(filled.target) == {0.0, 1e-3}
    assert np.count_nonzero(np.diff(filled.target)) == 1


@pytest.mark.parametrize("shape", ["smooth", "speeds"])
def test_the_acceleration_of_a_smooth_reference_is_filled_in_as_well(shape: str) -> None:
    """A jerk-limited stroke: a curve of broken second derivative left a tenth of its acceleration, 0.18 N of 14 kg. A
    path whose speed steps is filled without leaving what lies between its samples."""
    share = np.clip(np.linspace(-1, 2, 1201), 0, 1)
    stroke = share - np.sin(2 * np.pi * share) / (2 * np.pi) if shape == "smooth" else share
    reference = 20e-6 * np.concatenate([stroke, 1 - stroke])
    record = Record(1.25e-4, *[reference] * 5)
    filled = record.thinned(4).filled(4)
    if shape == "smooth":
        made, given = (np.diff(one[: filled.reference.size], n=2) for one in (filled.reference, reference))
        assert np.std(made - given) < 0.01 * np.std(given)
    else:
        assert np.min(filled.reference) == 0
        assert np.max(filled.reference) == 20e-6


def test_settling_is_the_time_after_which_nothing_leaves_the_band() -> None:
    error = np.array([-20, -3, 1.9, 2.1, -1, 0, 2.0, 0]) * 1e-6
    assert settling_time(error, 2e-6, 1e-3) == pytest.approx(4e-3)
    assert settling_time(error[:4], 2e-6, 1e-3) == math.inf
    assert settling_time(error[4:], 2e-6, 1e-3) == 0


def test_overshoot_is_beyond_the_stroke() -> None:
    assert overshoot([0, 15, 21, 20], 20) == 1
    assert overshoot([0, 15, 19], 20) == 0


def test_dispersion_is_three_standard_deviations_over_the_motions() -> None:
    assert dispersion([[1.0, 5.0], [3.0, 5.0]]) == pytest.approx([3.0, 0.0])
