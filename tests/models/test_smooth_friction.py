"""The smoothed friction against the exact one: a bound that holds for any path, and the order of the error."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.friction import elements, follow
from models.smooth_friction import follow_smoothed, law, rounded_clip

FRICTION = elements([800e3, 300e3, 90e3], [2e-6, 9e-6, 95e-6])
RATIOS = (0.4, 0.2, 0.1, 0.05)


def paths(count: int, seed: int = 1) -> list[np.ndarray[tuple[int], np.dtype[np.float64]]]:
    rng = np.random.default_rng(seed)
    return [np.cumsum(rng.standard_normal(300)) * step for step in np.geomspace(0.2e-6, 10e-6, count)]


@given(
    steps=st.lists(st.floats(-5e-5, 5e-5), min_size=1, max_size=60),
    ratio=st.floats(0.01, 1.0),
    share=st.floats(-1.0, 1.0),
)
@settings(max_examples=60, deadline=None)
def test_the_difference_is_within_the_ratio_times_the_coulomb_force(
    steps: list[float], ratio: float, share: float
) -> None:
    path, start = np.cumsum([0.0, *steps]), share * np.array(FRICTION.limit)
    exact, _ = follow(FRICTION, path, start)
    smoothed = follow_smoothed(FRICTION, path, ratio, start)
    assert np.max(np.abs(smoothed - exact)) <= ratio * FRICTION.coulomb_force * (1 + 1e-12)


def test_the_difference_vanishes_with_the_width_and_at_least_in_proportion_to_it() -> None:
    worst = [
        max(np.max(np.abs(follow_smoothed(FRICTION, path, ratio) - follow(FRICTION, path)[0])) for path in paths(6))
        for ratio in RATIOS
    ]
    order = np.polyfit(np.log(RATIOS), np.log(worst), 1)[0]
    assert 0.95 < order < 2.1


def test_a_path_further_than_the_width_from_every_limit_is_exact() -> None:
    path = 1.7e-6 * np.sin(np.linspace(0, 9, 200)) * 0.5
    assert follow_smoothed(FRICTION, path, 0.1) == pytest.approx(follow(FRICTION, path)[0], abs=1e-12)


def test_full_slip_has_the_coulomb_force_exactly() -> None:
    path = np.linspace(0, 1e-3, 50)  # steps longer than every limit and width
    assert follow_smoothed(FRICTION, np.append(path, 1.5e-3), 0.2)[-1] == pytest.approx(
        FRICTION.coulomb_force, rel=1e-12
    )


def test_the_rounded_clip_has_two_continuous_derivatives() -> None:
    y = ca.SX.sym("y")
    clip = rounded_clip(y, ca.SX(1.0), ca.SX(0.25))
    slope = ca.jacobian(clip, y)
    both = ca.Function("both", [y], [slope, ca.jacobian(slope, y)])
    for corner in (0.75, 1.25, -0.75, -1.25):
        below, above = (np.array(both(corner + side)).ravel() for side in (-1e-7, 1e-7))
        assert below == pytest.approx(above, abs=1e-4)


def test_parameters_are_those_of_the_exact_law() -> None:
    state = np.array([1e-6, -4e-6, 20e-6])
    _, force = law(3)(state, 0.0, 0.01, FRICTION.stiffness, FRICTION.limit)
    assert float(force) == pytest.approx(np.dot(FRICTION.stiffness, state), rel=1e-12)


def test_a_clip_with_an_algebraic_tail_leaks_where_this_one_does_not() -> None:
    """The common sqrt saturation, beside: at rest in mid-stick it loses force step by step."""
    limit, width, z = 1.0, 0.05, 0.5
    for _ in range(2000):
        z = (np.hypot(z + limit, width) - np.hypot(z - limit, width)) / 2
    assert z < 0.45
    flat = np.zeros(2000)
    single = elements([1.0], [1.0])
    assert follow_smoothed(single, flat, 0.05, [0.5])[-1] == pytest.approx(0.5, abs=1e-12)
