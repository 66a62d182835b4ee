"""What is proposed where nothing has a name: an experiment over the coordinate that tells, and none twice."""

from __future__ import annotations

import pytest

from diagnosis.experiments.propose import Proposal, along, virtual
from models.machine import load
from models.records.record import Record

MACHINE = load()


def _asked(coordinate: str | None, records: list[Record]) -> Proposal:
    found = along(coordinate, MACHINE, records)
    assert found is not None
    return found


@pytest.mark.parametrize(("coordinate", "says"), [("position", "long strokes"), ("velocity", "a speed ladder")])
def test_what_was_run_is_not_asked_for_again(coordinate: str, says: str) -> None:
    """A rail's joint: the same long strokes had been asked for with their own record on the table."""
    first = _asked(coordinate, [])
    assert f"Run, two times over, {says}" in first.sentence
    _, record = virtual(MACHINE, first.schedule)
    second = _asked(coordinate, [record])
    assert says not in second.sentence
    assert ", and the records have the motions that vary it. Run one stroke" in second.sentence
    _, repeated = virtual(MACHINE, second.schedule)
    assert _asked(coordinate, [repeated]).sentence == first.sentence
    assert along(coordinate, MACHINE, [record, repeated]) is None


@pytest.mark.parametrize(
    ("coordinate", "says"), [("time", "a hold"), ("dwell", "a dwell sweep"), ("acceleration", "a multisine")]
)
def test_what_a_kind_of_motion_does_not_tell_is_asked_for(coordinate: str, says: str) -> None:
    """The rests, or the excitation, of motions of one kind may all be alike."""
    first = _asked(coordinate, [])
    assert f"Run, two times over, {says}" in first.sentence
    _, record = virtual(MACHINE, first.schedule)
    assert _asked(coordinate, [record]).sentence == first.sentence


def test_without_a_coordinate_it_is_asked_whether_the_force_repeats() -> None:
    assert "and no single coordinate explains the residual. Run one stroke" in _asked(None, []).sentence
