"""The closure's terms: of the unknown force, and of the position where that does not surely show a gap."""

import numpy as np
import pytest

from diagnosis.handover.gate import Sums
from diagnosis.handover.hand_over import closure_terms
from diagnosis.how_far import Gap

MOTIONS = 40


def _left(force: float, position: float) -> Sums:
    """What a file leaves of motions of a hundred samples each: root mean squares [N] and [m]."""
    scatter, ones = np.random.default_rng(0).uniform(0.8, 1.2, MOTIONS), np.full(MOTIONS, 100.0)
    scatter /= scatter.mean()
    return Sums(force**2 * ones * scatter, position**2 * ones * scatter, ones, 0.0 * ones, 0.0 * ones)


def _files(*left: tuple[float, float]) -> tuple[Sums, Sums, Sums]:
    first, then, last = (_left(*one) for one in left)
    return first, then, last


FLOOR = Gap(1.0, 1e-8, None)


def test_a_gap_in_force_is_closed_in_force() -> None:
    terms, interval = closure_terms(_files((9.0, 5e-7), (3.0, 2e-8), (2.0, 2e-8)), FLOOR)
    assert (terms.measure, terms.to_json()["unit"]) == ("force", "N")
    assert terms.closure() == pytest.approx((9 - 4) / (9 - 1))
    assert interval[0] <= terms.closure() <= interval[1]
    assert terms.closure(terms.delivered) == pytest.approx((81 - 4) / (81 - 1))


def test_where_the_force_is_within_its_floor_the_position_tells() -> None:
    """A mode that is missing hardly shows in a slow unknown force."""
    terms, interval = closure_terms(_files((0.99, 5e-7), (0.98, 5e-8), (0.97, 2e-8)), FLOOR)
    assert (terms.measure, terms.to_json()["unit"]) == ("position", "m")
    assert terms.closure() == pytest.approx((25 - 4) / (25 - 1))
    assert 0.8 < interval[0] <= interval[1] < 0.95


def test_where_the_force_is_not_surely_above_its_floor_the_position_tells() -> None:
    """A mode that is missing left 7.8 mN above a floor of 7.5, and 7.4 nm above 6.3."""
    terms, _ = closure_terms(_files((9.0, 5e-7), (1.01, 5e-8), (1.02, 2e-8)), FLOOR)
    assert terms.measure == "position"
    terms, _ = closure_terms(_files((9.0, 5e-7), (1.1, 5e-8), (1.02, 2e-8)), FLOOR)
    assert terms.measure == "force"
    terms, _ = closure_terms(_files((9.0, 5e-7), (1.01, 1.01e-8), (1.02, 1.0e-8)), FLOOR)
    assert terms.measure == "force"  # as neither is surely
    terms, _ = closure_terms(_files((9.0, 5e-7), (1.01, 5e-8), (1.02, 2e-8)), FLOOR, rough=True)
    assert terms.measure == "force"


def test_what_acts_at_random_adds_to_the_force_alone() -> None:
    terms, _ = closure_terms(_files((0.99, 5e-7), (0.98, 5e-8), (0.97, 2e-8)), FLOOR, random=0.5)
    assert terms.measure == "force"


def test_nothing_closes_a_gap_that_neither_shows() -> None:
    terms, interval = closure_terms(_files((0.99, 9e-9), (0.98, 8e-9), (0.97, 7e-9)), FLOOR)
    assert not terms.shows
    assert terms.closure() == 0.0
    assert interval[0] <= 0.0 <= interval[1]
