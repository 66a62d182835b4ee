"""What is said of a model beside its names: the input delay is one quantity, and friction is larger one way."""

from __future__ import annotations

import pytest

from diagnosis.handover.stated import direction, input_delay
from models.effects.friction_laws import DirectionalFriction, ViscousFriction
from models.effects.motor import CurrentLoopLag
from models.records.record import Record
from tests.diagnosis.tables import nominal_with, recorded, short, table

MACHINE = table()


@pytest.fixture(scope="module")
def records() -> tuple[Record, ...]:
    return recorded(MACHINE, (short(MACHINE),), seed=1)


def test_the_input_delay_is_one_quantity(records: tuple[Record, ...]) -> None:
    dead, half = MACHINE.plant.dead_time, 0.5 * MACHINE.sample_time
    plain, lagging = (input_delay(nominal_with(MACHINE, effects, records)) for effects in ((), (CurrentLoopLag(2e-4),)))
    assert plain.to_json()["total_s"] == pytest.approx(dead + half)
    assert lagging.to_json()["total_s"] == pytest.approx(dead + 2e-4 + half)
    assert plain.delivered == lagging.delivered == pytest.approx(dead + half)
    assert 0 < plain.deviation < 2e-5


@pytest.mark.parametrize(
    ("law", "larger", "part"),
    [
        (DirectionalFriction(0.05, 2e-6, 0), "forwards", "the whole friction"),
        (DirectionalFriction(0.0, 2e-6, 0, -400.0), "backwards", "the drag"),
        (DirectionalFriction(-0.05, 2e-6, 0, 0.05 * 300.0), "backwards", "the contacts"),
    ],
)
def test_what_differs_by_direction_is_said(
    law: DirectionalFriction, larger: str, part: str, records: tuple[Record, ...]
) -> None:
    found = direction(nominal_with(MACHINE, (law, ViscousFriction(300.0)), records))
    assert found is not None
    assert (found.larger, found.part) == (larger, part)
    assert direction(nominal_with(MACHINE, (), records)) is None
