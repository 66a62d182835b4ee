"""A law is called with the arrays that it is compiled for, or not at all."""

from __future__ import annotations

import numpy as np
import pytest
from numba.core.errors import TypingError

from models.compiled import compiled
from models.effects.friction_laws import ViscousFriction
from models.simulation.hooks import FRICTION, Array, Hooks, act, pack


@compiled
def _acts(hooks: Hooks, now: Array, contact: Array) -> float:
    return act(FRICTION, 0.0, hooks, now, contact)


def test_arrays_of_another_layout_are_refused() -> None:
    """A law would take its numbers as if they stood side by side."""
    hooks, contact = pack([ViscousFriction(2.0)], 1), np.zeros((3, 1))
    now = np.arange(16.0)
    assert _acts(hooks, now[:8].copy(), contact) == 2.0 * now[2]
    with pytest.raises(TypingError, match="a law takes"):
        _acts(hooks, now[::2], contact)
