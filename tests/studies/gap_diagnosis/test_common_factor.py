"""A thrust constant that is off is said where it explains all that moved."""

from __future__ import annotations

from dataclasses import replace

import pytest

from models.effects.friction_laws import ViscousFriction
from models.effects.structure import CableSpring
from models.machine import Machine, load
from models.variation import Variation, varied
from studies.gap_diagnosis.common_factor import common_factor, told

GIVEN = replace(load(), effects=(CableSpring(16580.0), ViscousFriction(5.0)))


def _moved(mass: float, friction: float, spring: float, drag: float) -> Machine:
    other = varied(GIVEN, Variation(mass=mass, friction_force=friction))
    return replace(other, effects=(CableSpring(16580.0 * (1 + spring)), ViscousFriction(5.0 * (1 + drag))))


def test_what_a_thrust_constant_scales_is_told_by_one_factor() -> None:
    """Of a joint whose constant was 8 % smaller, offset and gravity alone had been told."""
    found = common_factor(GIVEN, _moved(0.085, 0.12, 0.086, 0.087))  # friction has changed by itself, too
    assert found is not None
    assert found["factor"] == pytest.approx(1.0865, rel=1e-3)
    assert told(found) == [
        "Moving mass, cable spring and viscous friction are all 8.6 % larger, as they would be if the thrust constant "
        "were 8 % smaller: check the motor's constant and the scale of its current first."
    ]
    smaller = common_factor(GIVEN, _moved(-0.05, -0.05, -0.05, -0.05))
    assert "are all 5 % smaller, as they would be if the thrust constant were 5.3 % larger" in told(smaller)[0]


@pytest.mark.parametrize(
    "moved",
    [(0.085, 0.0, 0.0, 0.0), (0.01, 0.01, 0.01, 0.01), (0.085, 0.2, 0.086, 0.087), (0.085, -0.08, 0.086, 0.086)],
    ids=["the mass alone", "too little", "friction by far more", "friction the other way"],
)
def test_nothing_is_told_where_one_factor_does_not_explain_it(moved: tuple[float, float, float, float]) -> None:
    assert common_factor(GIVEN, _moved(*moved)) is None
    assert told(None) == []


def test_mass_and_friction_alone_are_too_few() -> None:
    given = load()
    assert common_factor(given, varied(given, Variation(mass=0.085, friction_force=0.085))) is None
