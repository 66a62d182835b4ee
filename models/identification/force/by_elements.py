"""Friction from a record by inverse dynamics: u = M a + c v + k x + offset + sum K_i z_i(x), the elements of eqs.
(3)-(8), u less what known effects make of it (stated.py).

At given limits X_i everything is linear in the force; the limits, and a delay if wanted, are found by least squares on
what the linear part leaves (variable projection; Golub and Pereyra, 1973). Elements are added one after the other, each
where it takes away most, as long as BIC falls by ten and each carries 0.2 % of the slip force. Position and force go
through the same zero-phase low-pass, then as few samples are kept as the pass band needs. The path has a wider low-pass
of its own: a narrow one rounds the reversals, without one noise moves the elements. The covariance holds half of what a
third of an octave of its cut-off changes. Damping is sought as one time tau = D_i / K_i of all elements: then f_i = K_i
min(max(z_i + tau dx/dt, -X_i), X_i) stays linear in K_i, and tau is found with the limits. To first order a deflection
with tau dz_i/dt added is the deflection at t + tau, so that an error of a known delay counts as an error of tau. An
error of the scale that differs from pass to pass looks like damping, too, as passes differ in speed: damping counts
only where it is sure beside such errors.
Symbols as in models.friction; n samples kept, p parameters.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from models.friction import elements
from models.identification.estimate import STRONG, Estimate, newey_west
from models.identification.force.fit import DAMPING, SIGNIFICANT_STDS, ForceFit
from models.identification.force.linear import (
    beside_elements,
    element_states,
    kept_columns,
    linear_columns,
    linear_solution,
    parameter_names,
    parameter_values,
    prepared,
    slopes,
)
from models.identification.force.signals import SMOOTHING, Signals, Terms, filtered, limit_range, memory_ends, passes
from models.identification.unusable import UnusableError
from models.quantity import show
from models.records.record import Record

Array = NDArray[np.float64]

GRID_LIMITS: Final = 60  # limits at which an element more is tried
MOST_ELEMENTS: Final = 20
LEAST_SHARE: Final = 0.002  # of the slip force: an element that carries less stands for what the model leaves out
SPACING: Final = 1.25  # least ratio of two neighbouring limits
# Samples kept over which errors hang together: a turning point that the scale misses by part of a step is an error of
# every element until it slips. With 4 the longest limit came out a quarter too sure; 32 changes nothing.
TOGETHER: Final = 16
AT_END: Final = 0.95  # of the longest limit looked at: an element from there on may be longer
LONGER: Final = 2.0  # times as long as the search went, such an element is taken to be
TAU_RANGE: Final = (-5.0, 100.0)  # sample times
DELAY_RANGE: Final = 5.0  # sample times to either side of the likely delay, and
DELAY_PERIODS: Final = 0.25  # of the pass band's highest frequency, where that is longer
LAG_ORIGIN: Final = 5.0  # sample times below the least lag; steps of 1e-3 from there on are about as long everywhere


def identify(
    record: Record, terms: Terms, *, pass_band: float, fit_until: float = math.inf, most: int = MOST_ELEMENTS
) -> ForceFit:
    """Elements and the wanted terms from a record; see the module's head.

    pass_band [Hz] of the low-pass; fit_until [s]: later samples are kept for judging. The elements' state is unknown
    until the path has turned after its first span, so the fit begins there.
    Raises ValueError for a record that can't show friction, an UnusableError for one that shows none, or whose delay is
    farther from the likely one than was sought.
    """
    plain = _fitted(record, replace(terms, damped=False), pass_band, fit_until, most)
    if not terms.damped:
        return plain
    damped = _fitted(record, terms, pass_band, fit_until, most)
    lag = damped.estimate.value(DAMPING), damped.estimate.deviation(DAMPING)
    freed = _lag_beside_the_scale(prepared(record, terms, pass_band, fit_until), damped)
    both = lag[0], math.hypot(lag[1], lag[0] - freed[0])  # as far as the two are apart
    least = min((lag, freed, both), key=lambda one: one[0] / one[1])
    before, after = (fit.criterion[len(fit.friction.limit)] for fit in (plain, damped))
    if after > before - STRONG or least[0] <= SIGNIFICANT_STDS * least[1]:
        return replace(plain, lag=min((lag, freed), key=lambda one: one[0] / one[1]))
    covariance, where = damped.estimate.covariance.copy(), damped.estimate.names.index(DAMPING)
    covariance[where, where] += (lag[0] - freed[0]) ** 2
    lag = lag[0], float(np.sqrt(covariance[where, where]))
    return replace(damped, estimate=replace(damped.estimate, covariance=covariance), lag=lag)


def _fitted(record: Record, terms: Terms, pass_band: float, fit_until: float, most: int) -> ForceFit:
    """Elements by BIC with all that `terms` name."""
    data = prepared(record, terms, pass_band, fit_until)
    limits, lags = np.zeros(0), np.array([terms.likely_delay if terms.delay else 0.0, 0.0])
    best = linear_solution(data, limits, lags)
    criterion = [best[2]]
    grid = np.geomspace(*limit_range(data), GRID_LIMITS)
    candidates = linear_columns(data, grid, lags)[0][:, -GRID_LIMITS:]
    while limits.size < most:
        if np.any(lags):
            candidates = linear_columns(data, grid, lags)[0][:, -GRID_LIMITS:]
        wider = _with_element(data, limits, lags, grid, candidates)
        if wider is None:
            break
        trial, shift = _refined(data, wider, lags)
        solved = linear_solution(data, trial, shift)
        criterion.append(solved[2])
        slip = solved[0][solved[0].size - trial.size :] * trial
        if np.any(slip < LEAST_SHARE * np.sum(slip)) or criterion[-1] > min(criterion[:-1]) - STRONG:
            break
        limits, lags, best = trial, shift, solved
    if limits.size == 0:
        raise UnusableError(
            "no friction element takes anything away from the force, as on an axis without friction; else check signs, "
            "or record a reversal"
        )
    _check_delay(data, float(lags[0]))
    found = _answer(data, limits, lags, tuple(criterion))
    apart = []
    for smoothing in SMOOTHING[1:]:
        other = prepared(record, terms, pass_band, fit_until, smoothing)
        shown = _refined(other, limits, lags)
        apart.append(parameter_values(other, *shown))
    systematic = 0.5 * (apart[0] - apart[1])
    covariance = found.estimate.covariance + np.outer(systematic, systematic)
    if terms.damped:
        where = found.estimate.names.index(DAMPING)
        covariance[where, where] += terms.known_delay_std**2
    remembered, short = _remembered(data, found)
    offset = found.estimate.names.index("offset")
    covariance[offset, offset] += remembered**2 / 3  # equally likely anywhere within
    if short:  # no reversal has shown where the longest element ends
        covariance[-1, -1] += float(limits[-1]) ** 2 / 3
    estimate, least = replace(found.estimate, covariance=covariance), limit_range(data)[0]
    least = least if limits[0] <= least else 0.0
    return replace(found, estimate=estimate, remembered=remembered, short=short, least=least, pass_band=pass_band)


def _check_delay(data: Signals, delay: float) -> None:
    """Raises UnusableError for a delay [s] at the end of what was sought."""
    likely, reach = data.terms.likely_delay, _delay_reach(data)
    if data.terms.delay and abs(delay - likely) > AT_END * reach:
        raise UnusableError(
            f"its motion comes {show(delay, 's', 3)} after the command, or more: sought was up to "
            f"{show(reach, 's', 3)} to either side of {show(likely, 's', 3)}, which the dead time of the machine file "
            "makes with the hold; "
            "correct it, or the time of the columns"
        )


def _delay_reach(data: Signals) -> float:
    """How far from the likely delay it is sought [s]: the low-pass leaves nothing that turns round faster."""
    return max(DELAY_RANGE * data.sample_time, DELAY_PERIODS / data.highest)


def _remembered(data: Signals, found: ForceFit) -> tuple[float, bool]:
    """The constant force [N] that elements may carry from before the record, by the share of the samples over which
    they do, and whether the path is too short for the longest one.

    The states are those of full slip at the first extreme. An element that is longer than half the way to there may
    have had another one, until the path has come back by twice its limit. One at the end of the search never shows,
    and counts as LONGER times as long.
    """
    start, path = memory_ends(data.path), data.path
    way, kept = abs(path[start] - path[0]), data.keep[data.fitted]
    back = np.maximum.accumulate(np.abs(path[start:] - path[start]))
    total, limit = 0.0, np.array(found.friction.limit)
    short = bool(limit[-1] > AT_END * limit_range(data)[1])
    for i, (k, x) in enumerate(zip(found.friction.stiffness, limit, strict=True)):
        known = start + int(np.searchsorted(back, 2 * x))
        share = 1.0 if short and i == limit.size - 1 else float(np.mean(kept < known))
        total += k * max(2 * x - way, LONGER * x if short and i == limit.size - 1 else 0.0) * share
    return total, short


def _with_element(data: Signals, limits: Array, lags: Array, grid: Array, candidates: Array) -> Array | None:
    """The limits and one more, where with non-negative stiffnesses it takes away most; None if nowhere.

    candidates (n, GRID_LIMITS): the columns of elements with the grid's limits.
    """
    apart = np.array([bool(np.all(np.abs(np.log(x / limits)) > math.log(SPACING))) for x in grid])
    if not np.any(apart):
        return None
    columns, force = linear_columns(data, limits, lags)
    columns, force, tried = columns[data.fitted], force[data.fitted], candidates[np.ix_(data.fitted, apart)]
    basis, _ = np.linalg.qr(columns)
    left = force - basis @ (basis.T @ force)
    tried = tried - basis @ (basis.T @ tried)
    load = tried.T @ left
    gained = np.where(load > 0, load**2 / np.maximum(np.sum(tried**2, axis=0), 1e-300), 0.0)
    if not np.any(gained > 0):
        return None
    return np.sort(np.append(limits, grid[apart][int(np.argmax(gained))]))


def _refined(data: Signals, limits: Array, lags: Array) -> tuple[Array, Array]:
    """Limits and LAGS [s] by least squares on what the linear part leaves."""
    ts, count, free, likely = data.sample_time, limits.size, data.terms.lags, data.terms.likely_delay / data.sample_time
    reach = _delay_reach(data) / ts
    least, most = np.array([[likely - reach, TAU_RANGE[0]], [likely + reach, TAU_RANGE[1]]])[:, free]
    origin = LAG_ORIGIN - least

    def split(theta: Array) -> tuple[Array, Array]:
        shift = np.zeros(2)
        shift[free] = (theta[count:] - origin) * ts
        return np.exp(theta[:count]), shift

    low, high = np.log(limit_range(data)[0] / 2), np.log(limit_range(data)[1] * 1.05)
    bounds = tuple(np.append(np.full(count, end), lag + origin) for end, lag in ((low, least), (high, most)))
    start = np.clip(np.append(np.log(limits), lags[free] / ts + origin), *bounds)
    columns = kept_columns(data, count)
    size = math.sqrt(float(np.mean(linear_solution(data, limits, lags)[1] ** 2)))  # the search ends at absolute slopes

    def left(theta: Array) -> Array:
        limits, lags = split(theta)
        return linear_solution(data, limits, lags, columns(limits, lags))[1] / max(size, 1e-300)

    found = scipy.optimize.least_squares(
        left, start, bounds=bounds, diff_step=1e-3, max_nfev=15, x_scale="jac",
    )  # fmt: skip
    limits, lags = split(found.x)
    return np.sort(limits), lags


def _answer(data: Signals, limits: Array, lags: Array, criterion: tuple[float, ...]) -> ForceFit:
    weights, residual, _ = linear_solution(data, limits, lags)
    columns, force = linear_columns(data, limits, lags)
    count = limits.size
    stiffness = weights[weights.size - count :]
    whole = slopes(data, limits, lags, weights)[data.fitted]
    scale = np.maximum(np.max(np.abs(whole), axis=0), 1e-300)
    covariance = newey_west(whole / scale, residual, TOGETHER)
    covariance = covariance / np.outer(scale, scale)
    names, units = parameter_names(data.terms, count)
    values = parameter_values(data, limits, lags)
    modelled = columns @ weights
    return ForceFit(
        elements(stiffness, limits, max(float(lags[1]), 0.0) * stiffness),
        Estimate(names, units, values, covariance),
        criterion,
        np.asarray(data.keep * data.sample_time, float),
        data.path[data.keep],
        force,
        modelled,
        columns[:, columns.shape[1] - count :] @ stiffness,
        data.fitted,
        effects=data.terms.effects,
    )


def _lag_beside_the_scale(data: Signals, found: ForceFit) -> tuple[float, float]:
    """Tau and its standard deviation [s] by one step from a fit, with a gain of the reading of its own for every pass.
    A step out of the range says that the gains leave it open: then it is the fit's, with a deviation as wide as that.

    Over one pass, a periodic error of the scale is a gain (and an offset, which no force shows); passes of other places
    or lengths have other ones. Those at other speeds look like damping where the gains are not free.
    """
    stiffness, limits = np.array(found.friction.stiffness), np.array(found.friction.limit)
    lags = found.estimate.values[: np.count_nonzero(data.terms.lags)]
    shift = np.zeros(2)
    shift[data.terms.lags] = lags
    weights, left, _ = linear_solution(data, limits, shift)
    path = beside_elements(data, float(shift[0]))[0]
    yielding = (np.abs(element_states(limits, path, shift[1] / data.sample_time)) < limits) @ stiffness  # N/m
    number, way = passes(path)
    gains = (yielding * way)[:, None] * (number[:, None] == np.arange(number.max() + 1))
    whole = np.hstack([slopes(data, limits, shift, weights), filtered(data, gains)])[data.fitted]
    size = np.max(np.abs(whole), axis=0)
    whole = whole[:, size > 0] / size[size > 0]
    step = np.linalg.lstsq(whole, left, rcond=None)[0]
    covariance = newey_west(whole, left - whole @ step, TOGETHER)
    where = found.estimate.names.index(DAMPING)
    freed, std = float(shift[1] + step[where] / size[where]), float(np.sqrt(covariance[where, where]) / size[where])
    least, most = (end * data.sample_time for end in TAU_RANGE)
    return (freed, std) if least <= freed <= most else (float(shift[1]), most)
