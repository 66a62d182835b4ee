"""Normal numbers within bounds: as scipy's where there is one, with their sums as sure as they are, never outside."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import truncnorm

from models.machines.normal_within import normal_within

COUNT = 4000
CLOSE = 4 / np.sqrt(COUNT)  # four deviations of a mean of numbers with the deviation 1
WIDE = np.full(2, np.inf)


def _root(correlation: float) -> NDArray[np.float64]:
    return np.linalg.cholesky(np.array([[1.0, correlation], [correlation, 1.0]]))


@pytest.mark.parametrize(("low", "high"), [(-0.1, np.inf), (-np.inf, 0.5), (0.0, 3.0), (-2.0, 1.0)])
def test_one_bounded_number_is_a_truncated_normal_one_and_its_partner_keeps_their_sum(low: float, high: float) -> None:
    correlation = -0.9999
    box = np.array([low, -np.inf]), np.array([high, np.inf])
    found = normal_within(_root(correlation), *box, COUNT, np.random.default_rng(1))
    wanted = truncnorm(low, high)
    assert np.all((low <= found[:, 0]) & (found[:, 0] <= high))
    np.testing.assert_allclose(np.mean(found[:, 0]), wanted.mean(), atol=CLOSE)
    np.testing.assert_allclose(np.std(found[:, 0]), wanted.std(), rtol=CLOSE)
    np.testing.assert_allclose(np.mean(found[:, 1]), correlation * wanted.mean(), atol=CLOSE)
    # What is left of the second beside the first does not depend on the bounds.
    left = found[:, 1] - correlation * found[:, 0]
    np.testing.assert_allclose(np.std(left), np.sqrt(1 - correlation**2), rtol=CLOSE)


def test_far_bounds_leave_the_covariance_as_it_is() -> None:
    rng = np.random.default_rng(2)
    root = rng.standard_normal((5, 5))
    root /= np.linalg.norm(root, axis=1)[:, None]
    found = normal_within(root, np.full(5, -9.0), np.full(5, np.inf), COUNT, rng)
    np.testing.assert_allclose(np.cov(found.T), root @ root.T, atol=2 * CLOSE)


def test_many_bounded_numbers_have_the_distribution_of_those_that_rejection_leaves() -> None:
    rng = np.random.default_rng(3)
    size = 6
    covariance = np.asarray(1.01 * np.eye(size) - np.ones((size, size)) / size)  # a sum that is far surer than each
    covariance /= covariance[0, 0]
    root = np.asarray(np.linalg.cholesky(covariance), float)
    low, high = np.full(size, -1.0), np.full(size, 2.0)
    tried = rng.standard_normal((40 * COUNT, size)) @ root.T
    kept = tried[np.all((low <= tried) & (tried <= high), axis=1)]
    found = normal_within(root, low, high, COUNT, rng)
    assert np.all((low <= found) & (found <= high))
    close = 4 * np.sqrt(1 / COUNT + 1 / len(kept))
    np.testing.assert_allclose(np.mean(found, axis=0), np.mean(kept, axis=0), atol=close)
    np.testing.assert_allclose(np.std(found, axis=0), np.std(kept, axis=0), rtol=close)
    np.testing.assert_allclose(np.std(found.sum(1)), np.std(kept.sum(1)), rtol=close)


def test_numbers_that_begin_in_a_corner_of_their_bounds_stay_within() -> None:
    found = normal_within(_root(0.9), np.array([0.0, -np.inf]), np.array([np.inf, 0.0]), 500, np.random.default_rng(4))
    assert np.all(found[:, 0] >= 0)
    assert np.all(found[:, 1] <= 0)
    assert np.all(np.std(found, axis=0) > 0.1)


def test_a_number_without_room_stays() -> None:
    found = normal_within(_root(0.0), np.array([0.0, -np.inf]), np.array([0.0, np.inf]), 10, np.random.default_rng(5))
    assert np.all(found[:, 0] == 0)
