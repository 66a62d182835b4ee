"""What is proposed where nothing has a name: an experiment over the coordinate that tells, and none twice."""

from __future__ import annotations

import pytest

from diagnosis.experiments.propose import along, virtual
from models.machine import load

MACHINE = load()


@pytest.mark.parametrize(("coordinate", "says"), [("position", "long strokes"), ("velocity", "a speed ladder")])
def test_what_was_run_is_not_asked_for_again(coordinate: str, says: str) -> None:
    """A rail's joint: the same long strokes had been asked for with their own record on the table."""
    first = along(coordinate, MACHINE)
    assert f"Run, two times over, {says}" in first.sentence
    _, record = virtual(MACHINE, first.schedule)
    second = along(coordinate, MACHINE, [record])
    assert says not in second.sentence
    assert "the records have the motions that vary" in second.sentence
    assert "Run one stroke" in second.sentence
    assert along(coordinate, MACHINE, [virtual(MACHINE, second.schedule)[1]]).sentence == first.sentence


def test_without_a_coordinate_it_is_asked_whether_the_force_repeats() -> None:
    assert "and no single coordinate explains the residual. Run one stroke" in along(None, MACHINE).sentence
