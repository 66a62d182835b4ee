"""A replay with the friction known: what acts on the thrust needs no element to move."""

from __future__ import annotations

import numpy as np
import pytest

from models.effects.catalogue import every
from models.effects.kernel import replay, rubs
from models.machine import load
from tests.models.effects.paths import through

FRICTION = load().friction
POINTS = np.cumsum(np.random.default_rng(0).uniform(-3e-6, 3e-6, 300))
PATH = through(POINTS, command=5e6 * POINTS)


@pytest.mark.parametrize("name", sorted(every()))
def test_what_does_not_rub_is_the_same_with_the_friction_known(name: str) -> None:
    effect, bare = every()[name].typical(), replay(FRICTION, (), PATH, 1e-3)
    if rubs(effect):
        with pytest.raises(ValueError, match="rubbing"):
            replay(FRICTION, [effect], PATH, 1e-3, rubbing=bare.friction)
        return
    whole = replay(FRICTION, [effect], PATH, 1e-3)
    quick = replay(FRICTION, [effect], PATH, 1e-3, rubbing=bare.friction)
    for signal in ("thrust", "friction", "force", "reading"):
        assert np.array_equal(getattr(whole, signal), getattr(quick, signal))
