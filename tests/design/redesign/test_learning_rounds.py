"""Iterative learning takes the errors off motions that repeat, within the thrust that it is given."""

from __future__ import annotations

import numpy as np

from design.redesign.designs import designed, in_place
from design.redesign.learning_rounds import ROUNDS, corrected
from design.redesign.outcome import judged_target
from models.controller import References
from models.records.record import Record
from models.simulation.simulator import simulate
from tests.design.redesign.axes import KNOWN, TRUE

TARGET = judged_target(KNOWN)
LIMIT = 140.0


def run(feedforward: np.ndarray, reference: np.ndarray, seed: int) -> Record:
    given = References(reference, feedforward, np.zeros(reference.size))
    return simulate(TRUE, TRUE.feedback_only(), TARGET, given=given, seed=seed).record


def off(record: Record) -> float:
    late = KNOWN.control.reference_delay
    return float(np.sqrt(np.mean((record.position[late:] - record.reference[: record.reference.size - late]) ** 2)))


def test_ten_rounds_on_an_axis_that_is_known_wrongly_leave_a_third_of_the_error() -> None:
    known = in_place(designed(KNOWN, "old"), KNOWN, TARGET)
    record = run(known.feedforward + known.compensation, known.position, 0)
    before = off(record)
    for number in range(ROUNDS):
        force = corrected(record, KNOWN, LIMIT)
        assert np.max(np.abs(force)) <= LIMIT
        record = run(force, known.position, 1 + number)
    assert off(record) < before / 3
