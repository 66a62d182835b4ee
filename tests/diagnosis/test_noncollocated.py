"""Friction at the motor while the scale is on the load: its law against a simulation of both, and its name."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.diagnose import diagnose
from diagnosis.verdict import Outcome
from models.effects.friction_laws import NoncollocatedFriction
from models.simulation.effect_kernel import Path, replay
from tests.diagnosis.two_inertias import HELD, STEPS, TS, machine, moves, record, run

STROKES = (50e-6, 50e-6, -50e-6, -20e-6, 20e-6, 100e-6, -100e-6, 30e-6, -80e-6, 200e-6, -200e-6, 50e-6)


def test_the_contacts_go_with_the_inertia_that_they_touch() -> None:
    """Along the load's way, the law with c = 1/w^2 gives the friction that acted on the motor."""
    _, reference = moves(STROKES)
    ran = run(np.gradient(np.gradient(reference, TS), TS), reference, on_motor=True)
    position, speed = (signal.reshape(-1, STEPS) for signal in (ran.position, ran.speed))
    path = Path(TS, position, speed, position[:, 0], ran.command)
    left = []
    for advance in (0.0, 0.5 / HELD**2, 1 / HELD**2):
        friction = replay(machine().friction, (NoncollocatedFriction(advance),), path, 0.0).friction
        left.append(np.sqrt(np.mean((friction.ravel() - ran.friction) ** 2)))
    assert left[0] > 0.05  # N (rms), of friction of 1.5 N
    assert left[1] > 0.3 * left[0]
    assert left[2] < 0.1 * left[0]  # the damping beside the spring is not in the law


@pytest.mark.parametrize("on_motor", [True, False])
def test_where_the_friction_acts_is_named_with_its_frequency(on_motor: bool) -> None:
    found = diagnose(machine(), [record(on_motor, 1, STROKES)])
    if on_motor:
        assert (found.outcome, found.effects) == (Outcome.ATTRIBUTED, ("noncollocated_friction",))
        assert found.how_far.closure > 0.95
        (law,) = found.told.candidate.added_effects
        assert law.strength() == pytest.approx(1 / HELD**2, rel=0.05)
    else:  # on the load it moves the mode as no thrust at the motor does: modes beside the law make up for that
        assert found.outcome in {Outcome.ATTRIBUTED, Outcome.AMBIGUOUS}
        assert set(found.effects) == {"noncollocated_friction", "additional_mode"}
