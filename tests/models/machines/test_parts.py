"""What follows from a machine's parts: how far a reading of the scale is off."""

from __future__ import annotations

import numpy as np
import pytest

from models.machines.parts import Scale


@pytest.mark.parametrize("noise", [0.0, 20e-9])
def test_a_reading_is_off_by_noise_and_rounding(noise: float) -> None:
    scale, rng = Scale(1e-7, noise), np.random.default_rng(1)
    true = rng.uniform(-1e-4, 1e-4, 200_000)
    read = scale.resolution * np.round((true + noise * rng.standard_normal(true.size)) / scale.resolution)
    assert scale.reading_deviation == pytest.approx(np.std(read - true), rel=0.01)
