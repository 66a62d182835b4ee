"""A check: what holds, and that whole samples are not late by their rounding."""

from __future__ import annotations

import math

import pytest

from models.quantity import parse
from studies.study import Check


@pytest.mark.parametrize("samples", range(1, 200, 7))
@pytest.mark.parametrize("sample_time", ["50 us", "125 us", "1 ms"])
def test_what_settles_exactly_in_time_holds(samples: int, sample_time: str) -> None:
    """Six samples of 50 us are 0.3 ms and the least part of a second more."""
    ts = parse(sample_time, "s")
    limit = parse(f"{samples * round(ts * 1e6)} us", "s")
    assert Check("settling", samples * ts, "s", limit, "test").holds
    assert not Check("settling", (samples + 0.01) * ts, "s", limit, "test").holds
    assert Check("bandwidth", limit, "s", samples * ts, "test", ">=").holds


def test_what_is_not_a_number_does_not_hold() -> None:
    for sense in ("<=", ">="):
        assert not Check("settling", math.nan, "s", 1.0, "test", sense).holds
