"""What a motion achieved: settling time, overshoot and the dispersion over motions, as the paper measures them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

JUMP: Final = 0.1  # of a settling time: what differs by less is not another one


def settling_time(error: ArrayLike, tolerance: float, sample_time: float) -> float:
    """Time [s] from the step at error[0] until |error| (n,) stays within `tolerance` [m] to the end; inf for never.

    The first sample after which every sample is within: late by less than a sample.
    """
    outside = np.flatnonzero(~(np.abs(np.asarray(error, float)) <= tolerance))  # what is no number is outside, too
    if outside.size == 0:
        return 0.0
    if outside[-1] == np.size(error) - 1:
        return float("inf")
    return float((outside[-1] + 1) * sample_time)


@dataclass(frozen=True)
class Margin:
    """How near a settling time is to another one that differs by more than JUMP of it.

    An error that were smaller by `less` [m] would settle after `earlier` [s], one larger by `more` [m] after `later`
    [s]. Lengths are infinite where there is no such time.
    """

    less: float
    earlier: float
    more: float
    later: float

    @property
    def nearest(self) -> float:
        """How much [m] the error has to change for another settling time."""
        return min(self.less, self.more)

    @property
    def otherwise(self) -> float:
        """The settling time [s] on the other side of the nearer edge."""
        return self.earlier if self.less <= self.more else self.later


def settling_margin(error: ArrayLike, tolerance: float, sample_time: float) -> Margin:
    """What the settling time of `settling_time` hangs on; error (n,) [m], tolerance [m], sample_time [s].

    An oscillating error leaves the band once more or not for a nanometre, and settles a period later or earlier: the
    settling time jumps as a function of the tolerance, and says little without the distance to the next jump.
    """
    size = np.nan_to_num(np.abs(np.asarray(error, float)), nan=math.inf)
    count, left = size.size, np.maximum.accumulate(size[::-1])[::-1]  # the largest |error| from each sample on
    settled = int(np.sum(left > tolerance))  # samples; `left` does not rise
    step = max(math.ceil(JUMP * settled), 1)
    less, earlier, more, later = math.inf, 0.0, math.inf, math.inf
    if settled > 0:
        back = step if settled < count else 1  # from never, any time is another one
        band = left[max(settled - back, 0)]
        less, earlier = float(band) - tolerance, int(np.sum(left > band)) * sample_time
    if settled + step <= count:
        reached = left[settled + step - 1]
        beyond = int(np.sum(left >= reached))
        more, later = tolerance - float(reached), beyond * sample_time if beyond < count else math.inf
    return Margin(less, earlier, more, later)


def overshoot(travelled: ArrayLike, stroke: float) -> float:
    """How far [m] the distance travelled towards the target, (n,) [m], goes beyond the stroke [m]; at least 0."""
    return max(0.0, float(np.max(np.asarray(travelled) - stroke)))


def dispersion(errors: ArrayLike) -> Array:
    """3 sigma (n,) [m] over motions, at each time, of their errors (motions, n) [m]; section V.B of the paper.

    sigma is the standard deviation over these motions (divisor: their number), as the paper does not say otherwise.
    """
    spread: Array = 3 * np.std(np.asarray(errors, float), axis=0)
    return spread
