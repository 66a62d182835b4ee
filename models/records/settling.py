"""What a motion achieved: settling time, overshoot and the dispersion over motions, as the paper measures them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def settling_time(error: ArrayLike, tolerance: float, sample_time: float) -> float:
    """Time [s] from the step at error[0] until |error| (n,) stays within `tolerance` [m] to the end; inf for never.

    The first sample after which every sample is within: late by less than a sample.
    """
    outside = np.flatnonzero(np.abs(np.asarray(error)) > tolerance)
    if outside.size == 0:
        return 0.0
    if outside[-1] == np.size(error) - 1:
        return float("inf")
    return float((outside[-1] + 1) * sample_time)


def overshoot(travelled: ArrayLike, stroke: float) -> float:
    """How far [m] the distance travelled towards the target, (n,) [m], goes beyond the stroke [m]; at least 0."""
    return max(0.0, float(np.max(np.asarray(travelled) - stroke)))


def dispersion(errors: ArrayLike) -> Array:
    """3 sigma (n,) [m] over motions, at each time, of their errors (motions, n) [m]; section V.B of the paper.

    sigma is the standard deviation over these motions (divisor: their number), as the paper does not say otherwise.
    """
    spread: Array = 3 * np.std(np.asarray(errors, float), axis=0)
    return spread
