"""The margin of a settling time, beside a search over tolerances."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from models.records.settling import JUMP, settling_margin, settling_time

TS = 5e-4
NANOMETRES = st.lists(st.integers(-4000, 4000).map(lambda number: 1e-9 * number), min_size=1, max_size=60)


def another(error: list[float], tolerance: float, change: float) -> bool:
    """Whether a tolerance that is wider by `change` [m] gives another settling time, not merely one near by."""
    time, other = settling_time(error, tolerance, TS), settling_time(error, tolerance + change, TS)
    if math.isinf(time) or math.isinf(other):
        return time != other
    return abs(time - other) > TS / 2 and abs(time - other) >= JUMP * time * (1 - 1e-9)


def test_an_error_that_just_leaves_the_band_says_by_how_much() -> None:
    """A swing that ends at sample 41 and a later one of 2.024 um, which ends at sample 54: 27 ms or 20.5 ms."""
    error = np.zeros(200)
    error[:41], error[50:54] = 5e-6, -2.024e-6
    found = settling_margin(error, 2e-6, TS)
    assert settling_time(error, 2e-6, TS) == pytest.approx(27e-3)
    assert [found.less, found.earlier] == pytest.approx([24e-9, 20.5e-3])
    assert (found.nearest, found.otherwise) == (found.less, found.earlier)
    assert [found.more, found.later] == pytest.approx([2e-6, math.inf])


@given(
    error=NANOMETRES,
    tolerance=st.floats(1e-7, 3e-6),
    part=st.floats(0.01, 0.99),
)
def test_within_the_margin_the_settling_time_is_the_same(error: list[float], tolerance: float, part: float) -> None:
    assume(all(abs(abs(one) - tolerance) > 1e-12 for one in error))  # at the band's edge itself, rounding decides
    found = settling_margin(error, tolerance, TS)
    for change, margin in ((1, found.less), (-1, found.more)):
        if math.isfinite(margin):
            assert not another(error, tolerance, change * part * margin)
        else:
            assert not another(error, tolerance, change * 1e-5 if change > 0 else -part * tolerance)


@given(error=NANOMETRES, tolerance=st.floats(1e-7, 3e-6))
def test_beyond_the_margin_it_is_the_one_that_is_said(error: list[float], tolerance: float) -> None:
    found = settling_margin(error, tolerance, TS)
    if math.isfinite(found.less):
        assert settling_time(error, tolerance + found.less + 1e-15, TS) == pytest.approx(found.earlier)
    if math.isfinite(found.more):
        assert settling_time(error, tolerance - found.more - 1e-15, TS) == pytest.approx(found.later)


def test_what_is_no_number_has_not_settled() -> None:
    error = np.zeros(100)
    error[50:] = np.nan
    assert settling_time(error, 1e-6, 1e-3) == math.inf
    assert settling_time(np.where(np.arange(100) == 50, np.nan, 0.0), 1e-6, 1e-3) == pytest.approx(51e-3)
    assert settling_margin(error, 1e-6, 1e-3).less == math.inf  # however wide the band
