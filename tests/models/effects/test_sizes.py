"""No law has a size of its own: on a machine of other lengths and forces it does the same in these."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from models.effects.base import Effect, parameters
from models.effects.catalogue import every
from models.friction import elements
from models.machine import load
from models.simulation.effect_kernel import Path, replay
from tests.diagnosis.units import Change
from tests.models.effects.paths import TS

CHANGE = Change(force=40.0, length=3e-3)  # a stage of nanometres, driven hard
FRICTION = load().friction
OTHER = elements(np.array(FRICTION.stiffness) * CHANGE.factor("N/m"), CHANGE.length * np.array(FRICTION.limit))


def larger(effect: Effect) -> Effect:
    """As it is on the other machine; a loss that is stated at a thrust goes with its square."""
    made = {}
    for one in parameters(type(effect)):
        factor = CHANGE.force**-2 if (("thrust", -2),) in one.counted_in else CHANGE.factor(one.unit)
        made[one.name] = getattr(effect, one.name) * (1 if one.role == "switch" else factor)
    return replace(effect, **made)


def path(length: float, force: float) -> Path:
    """Strokes, creeping, rests and turns, with commands that change."""
    steps = [0.0, 2e-5, 2e-5, 3e-6, 1e-8, 2e-8, 0.0, 0.0, 1e-7, -4e-7, -3e-5, -2e-5, 0.0, 1e-6, 5e-8, 2e-4, -1e-9]
    rate = np.repeat(steps, 60)
    at = np.cumsum(rate)
    middles = at[:, None] + rate[:, None] * np.array([0.25, 0.75])
    command = force * np.round(7.0 * np.sin(np.arange(at.size) / 9.0), 2)
    return Path(TS, length * middles, length * np.repeat(rate[:, None], 2, axis=1) / TS, length * at, command)


@pytest.mark.parametrize("name", sorted(every().keys() - {"gravity"}))  # it goes with an angle, which has no size
def test_a_law_does_the_same_on_a_machine_of_other_lengths_and_forces(name: str) -> None:
    effect = every()[name].typical()
    one = replay(FRICTION, [effect], path(1.0, 1.0), 7e-4)
    same = replay(OTHER, [larger(effect)], path(CHANGE.length, CHANGE.force), 7e-4)
    for signal in ("thrust", "friction", "force"):
        expected = CHANGE.force * getattr(one, signal)
        assert getattr(same, signal) == pytest.approx(expected, rel=1e-6, abs=1e-9 * CHANGE.force), signal
    assert same.reading == pytest.approx(CHANGE.length * one.reading, rel=1e-6, abs=1e-15)
    assert [mode.frequency for mode in larger(effect).modes()] == [mode.frequency for mode in effect.modes()]
