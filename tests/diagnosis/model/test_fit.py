"""The fit of effects: when a law has left its prior range."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from diagnosis.model.fit import parameters_at_bounds, solve_box_constrained
from models.effects.motor import Cogging, DacQuantisation
from models.effects.priors import USUAL


def test_a_step_beyond_its_prior_range_is_no_bent_law() -> None:
    """Many steps determine their size; a shape held only by its bound indicates another law."""
    assert not parameters_at_bounds(DacQuantisation(0.15, 1), USUAL)
    assert not parameters_at_bounds(Cogging(1.0, 0.05, 0.3), USUAL)
    assert parameters_at_bounds(Cogging(1.0, 0.09, 0.3), USUAL)


@given(st.integers(0, 10_000), st.integers(1, 12))
def test_a_step_within_a_box_is_the_least_of_all_in_it(seed: int, size: int) -> None:
    """By the conditions of Karush, Kuhn and Tucker, which are sufficient here: no slope along a free coordinate, and at
    a bound none that leads back inside."""
    draw = np.random.default_rng(seed)
    root = draw.standard_normal((size + 2, size))
    normal, onto = root.T @ root + 0.01 * np.eye(size), 3 * draw.standard_normal(size)
    low, high = -draw.exponential(1.0, size), draw.exponential(1.0, size)
    low[draw.random(size) < 0.2] = 0.0
    high[draw.random(size) < 0.2] = 0.0
    step = solve_box_constrained(normal, onto, low, high)
    slope, near = normal @ step - onto, 1e-9
    assert np.all((step >= low - near) & (step <= high + near))
    assert np.all(slope[step > low + near] < 1e-6)
    assert np.all(slope[step < high - near] > -1e-6)
