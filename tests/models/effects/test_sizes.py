"""No law has a size of its own: on a machine of other lengths and forces it does the same in these."""

from __future__ import annotations

from dataclasses import replace
from math import prod

import numpy as np
import pytest

from models.effects.base import Effect, parameters
from models.effects.catalogue import every
from models.friction import elements
from models.machine import load
from models.simulation.effect_kernel import Path, replay
from tests.models.effects.paths import TS

LENGTH, FORCE = 3e-3, 40.0  # a stage of nanometres, driven hard
SIZES = {"m": LENGTH, "N": FORCE, "s": 1.0, "kg": FORCE / LENGTH, "Hz": 1.0, "1": 1.0}
FRICTION = load().friction
OTHER = elements(np.array(FRICTION.stiffness) * FORCE / LENGTH, LENGTH * np.array(FRICTION.limit))


def times(unit: str) -> float:
    """By what a number of this unit is larger on the other machine."""
    above, *below = unit.split("/")
    return prod(map(_power, above.split())) / prod(_power(one) for part in below for one in part.split())


def _power(name: str) -> float:
    base, _, exponent = name.partition("^")
    return SIZES[base] ** int(exponent or 1)


def larger(effect: Effect) -> Effect:
    """As it is on the other machine; a loss that is stated at a thrust goes with its square."""
    made = {}
    for one in parameters(type(effect)):
        factor = FORCE**-2.0 if (("thrust", -2),) in one.counted_in else times(one.unit)
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
    same = replay(OTHER, [larger(effect)], path(LENGTH, FORCE), 7e-4)
    for signal in ("thrust", "friction", "force"):
        expected = FORCE * getattr(one, signal)
        assert getattr(same, signal) == pytest.approx(expected, rel=1e-6, abs=1e-9 * FORCE), signal
    assert same.reading == pytest.approx(LENGTH * one.reading, rel=1e-6, abs=1e-15)
    assert [mode.frequency for mode in larger(effect).modes()] == [mode.frequency for mode in effect.modes()]
