"""The zero-phase low-pass of the fits of friction elements."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cheby1, sosfilt_zi, sosfiltfilt

from models.identification.force import FEWEST, _there_and_back


@pytest.mark.parametrize("band", [0.01, 0.2, 0.7])
@pytest.mark.parametrize("shape", [(FEWEST, 1), (5000, 3)])
def test_the_low_pass_is_scipy_s_to_the_last_digit(band: float, shape: tuple[int, int]) -> None:
    sections = cheby1(8, 0.05, band, output="sos")
    walk = np.cumsum(np.random.default_rng(1).standard_normal(shape), axis=0)
    found = _there_and_back(sections, sosfilt_zi(sections), walk)
    assert np.array_equal(found, sosfiltfilt(sections, walk, axis=0))
