"""The interval of a share: its ends by the binomial tails that define them."""

from __future__ import annotations

import pytest
from scipy.stats import binom

from studies.binomial import interval


@pytest.mark.parametrize(("hits", "tries"), [(1, 7), (42, 108), (6, 7)])
def test_under_either_end_as_many_hits_or_more_are_as_rare_as_stated(hits: int, tries: int) -> None:
    low, high = interval(hits, tries)
    assert binom.sf(hits - 1, tries, low) == pytest.approx(0.025)
    assert binom.cdf(hits, tries, high) == pytest.approx(0.025)


@pytest.mark.parametrize(("tries", "low"), [(200, 0.9817), (1000, 0.9963)])
def test_where_all_hit_the_lower_end_is_a_power(tries: int, low: float) -> None:
    assert interval(tries, tries) == pytest.approx((low, 1.0), abs=5e-5)
    assert interval(tries, tries)[0] ** tries == pytest.approx(0.025)
    assert interval(0, tries) == pytest.approx((0.0, 1 - interval(tries, tries)[0]))


def test_without_a_try_any_share_is_possible() -> None:
    assert interval(0, 0) == (0.0, 1.0)
