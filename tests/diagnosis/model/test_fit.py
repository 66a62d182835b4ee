"""The fit of effects: when a law has left its prior range."""

from __future__ import annotations

from diagnosis.model.fit import at_bounds
from models.effects.motor import Cogging, DacQuantisation
from models.effects.priors import USUAL


def test_a_step_beyond_its_prior_range_is_no_bent_law() -> None:
    """Many steps determine their size; a shape held only by its bound indicates another law."""
    assert not at_bounds(DacQuantisation(0.15, 1), USUAL)
    assert not at_bounds(Cogging(1.0, 0.05, 0.3), USUAL)
    assert at_bounds(Cogging(1.0, 0.09, 0.3), USUAL)
