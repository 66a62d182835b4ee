"""The elements that several slow records show together: one branch, fitted to those of all by their covariances.

The record that knows the slip force best gives the number of elements and theta = log (K_1 .., X_1 ..), which its
covariance S holds; each other record gives the force C_r(s) that friction climbs behind a reversal, with the covariance
V_r, at one distance s before, between and beyond the kinks of that branch, as far as its path goes. Least squares of

    (theta - theta_1)' S^-1 (theta - theta_1) + sum_r (C(s; theta) - C_r)' V_r^-1 (C(s; theta) - C_r)

by Gauss and Newton, in the form that inverts neither S nor V_r alone (the iterated update of a Kalman filter; Bell and
Cathey, 1993). V_r also holds LEAST_SHARE of the slip force, below which elements are left out. Where records scatter
beyond their deviations, the result's are wider by the root of the reduced chi-square (Birge, 1932), of the branch or of
the slip forces, whichever is larger.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.friction import elements
from models.identification.estimate import combined
from models.identification.force.by_elements import LEAST_SHARE
from models.identification.force.fit import ForceFit
from models.identification.joint.agreement import vagueness

Array = NDArray[np.float64]

PASSES: Final = 20
BEYOND: Final = 1.5  # of the last kink's distance: there all elements slip
MAX_LOG_STEP: Final = 1.0  # of theta in a pass: a factor of e


def one_branch(fits: Sequence[ForceFit]) -> ForceFit:
    """The fit that knows the slip force best, with the elements [N/m, m] and deviations of all fits together.

    The only fit as it is. Its forces over time stay those of its own record.
    """
    best = min(fits, key=vagueness)
    others = [fit for fit in fits if fit is not best]
    if not others:
        return best
    count = len(best.friction.limit)
    start = np.log([*best.friction.stiffness, *best.friction.limit])
    block = best.estimate.covariance[-2 * count :, -2 * count :] / np.outer(np.exp(start), np.exp(start))
    distances = [_distances(best, fit) for fit in others]
    climbed = np.concatenate([fit.curve(s)[0] for fit, s in zip(others, distances, strict=True)])
    spread = _block_diagonal([_curve_covariance(fit, s) for fit, s in zip(others, distances, strict=True)])
    where, theta = np.concatenate(distances), start
    for _ in range(PASSES):
        force, slopes = _branch(theta, where)
        gain = np.linalg.solve(slopes @ block @ slopes.T + spread, slopes @ block).T
        moved = start + gain @ (climbed - force - slopes @ (start - theta)) - theta
        theta = theta + moved / max(1.0, float(np.max(np.abs(moved))) / MAX_LOG_STEP)
        if np.max(np.abs(moved)) < 1e-9:
            break
    force, slopes = _branch(theta, where)
    innovation = climbed - force - slopes @ (start - theta)
    total = slopes @ block @ slopes.T + spread
    wider = max(_scatter(fits), float(innovation @ np.linalg.solve(total, innovation)) / where.size)
    left = wider * (block - np.linalg.solve(total, slopes @ block).T @ slopes @ block)
    return _with_elements(best, theta, left)


def _scatter(fits: Sequence[ForceFit]) -> float:
    """The reduced chi-square of the slip forces, at least 1: a difference in them alone is not to vanish among the
    distances at which records agree."""
    slips = [fit.slip_force() for fit in fits]
    return float(combined(slips)[1] ** 2 * sum(1 / std**2 for _, std in slips))


def _distances(best: ForceFit, other: ForceFit) -> Array:
    """Distances (d,) [m] behind a reversal: before, between and beyond the kinks, as far as the other's path goes."""
    kinks = 2 * np.sort(best.friction.limit)
    all_of_them = np.concatenate([[0.5 * kinks[0]], np.sqrt(kinks[1:] * kinks[:-1]), [BEYOND * kinks[-1]]])
    return np.unique(np.minimum(all_of_them, np.ptp(other.path)))


def _branch(theta: Array, distance: Array) -> tuple[Array, Array]:
    """Force climbed (d,) [N] at distances (d,) [m] behind a reversal from full slip, its slopes (d, 2N) by theta."""
    stiffness, limit = np.split(np.exp(theta), 2)
    s = distance[:, None]
    climbed = stiffness * np.minimum(s, 2 * limit)
    return np.sum(climbed, axis=1), np.hstack([climbed, np.where(s > 2 * limit, climbed, 0.0)])


def _curve_covariance(fit: ForceFit, distance: Array) -> Array:
    """Covariance (d, d) [N2] of the force that a record's friction climbs over distances (d,) [m]."""
    values = np.array([*fit.friction.stiffness, *fit.friction.limit])
    slopes = _branch(np.log(values), distance)[1] / values
    floor = (LEAST_SHARE * fit.slip_force()[0]) ** 2 * np.eye(distance.size)
    return np.asarray(slopes @ fit.estimate.covariance[-values.size :, -values.size :] @ slopes.T + floor)


def _block_diagonal(blocks: Sequence[Array]) -> Array:
    whole, row = np.zeros((sum(len(block) for block in blocks),) * 2), 0
    for block in blocks:
        whole[row : row + len(block), row : row + len(block)] = block
        row += len(block)
    return whole


def _with_elements(fit: ForceFit, theta: Array, relative: Array) -> ForceFit:
    """A fit with the elements of theta and their relative covariance (2N, 2N), apart from its other parameters."""
    values = np.exp(theta)
    stiffness, limit = np.split(values, 2)
    order = np.argsort(limit)
    order = np.concatenate([order, order + limit.size])
    values, relative = values[order], relative[np.ix_(order, order)]
    first = fit.estimate.values.size - values.size
    covariance = fit.estimate.covariance.copy()
    covariance[first:, :], covariance[:, first:] = 0.0, 0.0
    covariance[first:, first:] = relative * np.outer(values, values)
    estimate = replace(fit.estimate, values=np.append(fit.estimate.values[:first], values), covariance=covariance)
    stiffness, limit = np.split(values, 2)
    lag = max(fit.lag[0], 0.0) if fit.lag and fit.damped else 0.0
    return replace(fit, friction=elements(stiffness, limit, lag * stiffness), estimate=estimate)
