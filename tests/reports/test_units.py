"""The units of tables and axes leave numbers that are read without counting their digits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from reports.units import force_unit, length_unit, time_unit


@pytest.mark.parametrize(
    ("of", "largest", "least", "most"),
    [
        (force_unit, np.geomspace(1.1e-9, 0.99e-3, 60), 1, 1000),
        (length_unit, np.geomspace(1e-9, 9.9, 60), 0.1, 10_000),
        (time_unit, np.geomspace(1e-6, 9990, 60), 1, 10_000),
    ],
)
def test_at_most_four_digits_stand_before_the_point(
    of: Callable[[float], tuple[float, str]], largest: list[float], least: float, most: float
) -> None:
    sizes = {"n": 1e9, "µ": 1e6, "m": 1e3}
    for one in largest:
        factor, unit = of(one)
        assert factor == (sizes[unit[0]] if len(unit) == 2 else 1.0)
        assert least <= factor * one < most


def test_nothing_has_the_usual_unit() -> None:
    assert [of(0.0)[1] for of in (force_unit, length_unit, time_unit)] == ["N", "µm", "ms"]
