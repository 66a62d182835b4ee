"""Normal numbers that depend on each other, drawn within bounds.

Those that a bound is near to are drawn from their common distribution within the bounds, all others given these: what
is well known of them together stays so, where clipping one of two numbers whose sum is sure would spoil the sum.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

MAX_BOUND_STDS: Final = 6.0  # deviations: a bound that is farther off cuts off one draw in 1e9
GIBBS_ROUNDS: Final = 50  # of Gibbs' sampler, from the mean; one number is drawn exactly in the first


def normal_within(root: Array, low: Array, high: Array, count: int, rng: np.random.Generator) -> Array:
    """`count` draws (count, N) [1] of numbers with the covariance root @ root.T, mean 0 and deviations of about 1,
    where low <= each <= high (N,), within which 0 has to be.

    Gibbs' sampler for independent normal numbers y under the bounds of L y, with a triangular L (J. Geweke, Efficient
    simulation from the multivariate normal distribution subject to linear constraints, 1991).
    """
    near = (low > -MAX_BOUND_STDS) | (high < MAX_BOUND_STDS)
    order = np.concatenate([np.flatnonzero(near), np.flatnonzero(~near)])
    size = int(near.sum())
    triangle = np.asarray(np.linalg.qr(root[order].T, mode="r")).T  # of a root that may be nearly singular
    independent = rng.standard_normal((count, order.size))
    if size:
        box = low[order[:size]], high[order[:size]]
        independent[:, :size] = _constrained(triangle[:size, :size], *box, count, rng)
    found = np.empty_like(independent)
    found[:, order] = independent @ triangle.T
    return found


def _constrained(triangle: Array, low: Array, high: Array, count: int, rng: np.random.Generator) -> Array:
    """Independent normal numbers y (count, K) [1] for which low <= triangle @ y <= high (K,)."""
    y = np.zeros((count, low.size))
    reached = y @ triangle.T
    for _ in range(GIBBS_ROUNDS if low.size > 1 else 1):
        for i, column in enumerate(triangle.T):
            bound = column != 0.0
            others = reached[:, bound] - y[:, i : i + 1] * column[bound]
            ends = np.sort(np.stack([low[bound] - others, high[bound] - others]) / column[bound], axis=0)
            drawn = _normal_between(np.max(ends[0], axis=1), np.min(ends[1], axis=1), y[:, i], rng)
            reached += np.outer(drawn - y[:, i], column)
            y[:, i] = drawn
    return y


def _normal_between(low: Array, high: Array, now: Array, rng: np.random.Generator) -> Array:
    """A normal number between low and high each (count,) [1]; `now` where rounding leaves nothing between them."""
    ndtr, ndtri = scipy.special.ndtr, scipy.special.ndtri
    turned = np.where(low > 0, -1.0, 1.0)  # in the lower tail, where the probabilities keep their digits
    begin, end = np.where(low > 0, -high, low), np.where(low > 0, -low, high)
    chosen = turned * ndtri(rng.uniform(ndtr(begin), np.maximum(ndtr(end), ndtr(begin))))
    return np.where(np.isfinite(chosen) & (low < high), np.clip(chosen, low, np.maximum(low, high)), now)
