"""What a record achieved: as the judge of designs says of the same run, for motions of the specified stroke."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.controller import default_controller
from design.redesign.outcome import judged_target, outcome
from design.validation import validate
from models.records.record import Record, feeding_sequence
from models.simulation.simulator import simulate
from tests.design.redesign.axes import KNOWN

CONTROLLER = default_controller(KNOWN)
LEAD = round(KNOWN.specification.settling_time / KNOWN.sample_time)


def record_of(target: np.ndarray) -> Record:
    return simulate(KNOWN, CONTROLLER, target, seed=3).record


def test_a_record_is_judged_as_a_validation_judges_the_same_run() -> None:
    judged = validate(KNOWN, CONTROLLER, periods=2, reading="scale", lead=LEAD, seed=3)
    found = outcome(record_of(judged_target(KNOWN)), KNOWN)
    assert found is not None
    assert found.settling == judged.slowest.settling_time
    assert found.dispersion == pytest.approx(judged.worst_dispersion, rel=1e-12)
    assert (found.motions, found.never) == (10, 0)


def test_of_one_period_the_first_motion_does_not_count() -> None:
    wanted = KNOWN.specification
    target = feeding_sequence(wanted.stroke, wanted.motions, wanted.interval, KNOWN.sample_time)
    found = outcome(record_of(np.concatenate([np.zeros(LEAD), target])), KNOWN)
    assert found is not None
    assert found.motions == 9


def test_a_motion_that_never_settles_counts_as_long_as_it_lasts() -> None:
    record = record_of(judged_target(KNOWN))
    off = record.position.copy()
    off[-round(0.15 / KNOWN.sample_time) :] += 2 * KNOWN.specification.tolerance
    found = outcome(replace(record, position=off), KNOWN)
    assert found is not None
    assert found.never == 1
    assert found.settling == pytest.approx(KNOWN.specification.interval)


def test_the_dispersion_is_three_sigma_of_what_is_added_to_the_positive_motions() -> None:
    """Known errors in place of a run: the motion up to level j is off by j units."""
    target = judged_target(KNOWN)
    unit = 1e-8
    record = Record(KNOWN.sample_time, target, target, 0 * target, 0 * target, target + unit * target / 20e-6)
    found = outcome(record, KNOWN)
    assert found is not None
    assert found.dispersion == pytest.approx(3 * unit * np.std([1, 2, 3, 4, 5]), rel=1e-6)
    assert found.settling == 0.0


def test_motions_of_another_stroke_have_no_outcome() -> None:
    wanted, ts = KNOWN.specification, KNOWN.sample_time
    other = np.concatenate([np.zeros(LEAD), feeding_sequence(1.5 * wanted.stroke, 5, wanted.interval, ts, 2)])
    assert outcome(record_of(other), KNOWN) is None
    hasty = np.concatenate([np.zeros(LEAD), feeding_sequence(wanted.stroke, 5, 0.8 * wanted.settling_time, ts, 2)])
    assert outcome(record_of(hasty), KNOWN) is None
    mixed = np.concatenate([judged_target(KNOWN), other, other])
    assert outcome(record_of(mixed), KNOWN) is None
