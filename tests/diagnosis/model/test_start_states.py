"""The starts of the friction's elements: what any moves can have left, and that the search finds it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from diagnosis.model.start_states import START_POINTS, best_starts
from models.friction import deflections

LIMIT = np.geomspace(1e-6, 1e-4, 8)
MOVES = st.lists(st.floats(-3e-4, 3e-4), min_size=1, max_size=6)


def _left_by(moves: list[float]) -> NDArray[np.float64]:
    """Displacements (N,) [m] after an unrecorded full stroke and these moves [m]."""
    path = np.concatenate([[0.0, 1e-3], 1e-3 + np.cumsum(moves)])
    return np.asarray(deflections(LIMIT, path)[-1])


@given(MOVES)
def test_no_moves_leave_two_elements_further_apart_than_their_limits(moves: list[float]) -> None:
    z = _left_by(moves)
    apart = np.abs(z[:, None] - z)
    assert np.all(apart <= np.abs(LIMIT[:, None] - LIMIT) + 1e-12)


@given(MOVES)
def test_the_search_finds_what_moves_left(moves: list[float]) -> None:
    """An element's force is seen by itself here, so the best start is the true one, but for the slopes' grid."""
    z, count = _left_by(moves), LIMIT.size
    grid = np.linspace(-1, 1, START_POINTS[0])
    columns = np.concatenate([place * np.eye(count) for place in grid], axis=1)  # one element's displacement each
    e = -z / LIMIT
    found = best_starts(LIMIT, columns.T @ columns, columns.T @ e)
    assert np.abs(found - z).max() / LIMIT.max() < 0.13
    assert np.linalg.norm(found / LIMIT - z / LIMIT) < 0.35


@given(st.floats(2e-6, 9e-5), st.sampled_from([-1.0, 1.0]))
def test_a_last_move_of_any_length_is_found_to_many_digits(move: float, sign: float) -> None:
    """Where a scale resolves the friction finely, a start off by a hundredth leaves a hundred times the noise."""
    z, count = sign * _left_by([-move]), LIMIT.size
    columns = np.concatenate([place * np.eye(count) for place in np.linspace(-1, 1, START_POINTS[0])], axis=1)
    found = best_starts(LIMIT, columns.T @ columns, columns.T @ (-z / LIMIT))
    assert np.abs(found - z).max() / LIMIT.max() < 4e-3


def test_limits_may_come_in_any_order() -> None:
    order = np.array([3, 0, 7, 1, 6, 2, 5, 4])
    limit, z = LIMIT[order], _left_by([-6e-5, 1e-5])[order]
    columns = np.concatenate([place * np.eye(limit.size) for place in np.linspace(-1, 1, START_POINTS[0])], axis=1)
    found = best_starts(limit, columns.T @ columns, columns.T @ (-z / limit))
    assert np.linalg.norm(found / limit - z / limit) < 0.35


def _search_error(points: int, seed: int) -> float:
    """Error of the found starts in largest limits, where only the contacts' sum is seen while they move: the fourth is
    as stiff as the third and the fifth together."""
    limit, stiffness = 1e-6 * np.array([1, 3, 6, 10, 15, 22]), np.array([1.0, 0.6, 0.5, 1.0, 0.5, 0.3])
    rng = np.random.default_rng(seed)
    before = np.concatenate([[0.0, 1e-3], 1e-3 + np.cumsum(rng.uniform(-4e-5, 4e-5, 3))])
    z = deflections(limit, before)[-1]
    moves = rng.choice([-1, 1], 4) * rng.uniform(2e-6, 3e-5, 4)
    path = np.cumsum(np.append(0.0, np.repeat(moves / 60, 60)))
    base = deflections(limit, path, np.zeros(6))
    columns = np.concatenate(
        [-(deflections(limit, path, place * limit) - base) * stiffness for place in np.linspace(-1, 1, points)], axis=1
    )
    e = (deflections(limit, path, z) - base) @ stiffness
    return float(np.abs(best_starts(limit, columns.T @ columns, columns.T @ e) - z).max() / limit.max())


@pytest.mark.parametrize("seed", [228, 322, 634, 1172, 1556, 2501, 2829, 2854])
def test_contacts_whose_sum_is_a_third_do_not_change_places_with_it(seed: int) -> None:
    """With the fewest points they do in these cases, as their slips between two points are interpolated."""
    assert _search_error(START_POINTS[1], seed) < 0.01
    assert _search_error(START_POINTS[0], seed) > 0.05
