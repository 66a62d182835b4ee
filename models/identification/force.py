"""Friction from a record by inverse dynamics: u = M a + c v + offset + sum K_i z_i(x), the elements of eqs. (3)-(8).

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
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from models.friction import deflections, elements
from models.identification.estimate import STRONG, Estimate, newey_west
from models.identification.force_fit import DAMPING, SURE, ForceFit
from models.records.record import Record

Array = NDArray[np.float64]

# The path's low-pass over the force's, and two beside it that show how much the choice matters.
SMOOTHING: Final = (5.6, 4.8, 6.6)
SLOW_BAND: Final = 20.0  # Hz, of the low-pass for friction in a slow record
LOOPS: Final = 40.0  # times the frequency of a slow record's loops: its pass band at least
FEWEST: Final = 40  # samples, below which a zero-phase filter has no room
WIDEST: Final = 0.9  # of half the sampling rate: the widest low-pass
GRID: Final = 60  # limits at which an element more is tried
MOST_ELEMENTS: Final = 20
LEAST_SHARE: Final = 0.002  # of the slip force: an element that carries less stands for what the model leaves out
SPACING: Final = 1.25  # least ratio of two neighbouring limits
# Samples kept over which errors hang together: a turning point that the scale misses by part of a step is an error of
# every element until it slips. With 4 the longest limit came out a quarter too sure; 32 changes nothing.
TOGETHER: Final = 16
AT_A_TIME: Final = 10_000_000  # numbers of columns that are filtered together; a filter makes several copies of them
STEPS: Final = 4.0  # of the reading: the shortest limit looked at
COARSE: Final = 4e-7  # m: the shortest one where the reading is so coarse
AT_END: Final = 0.95  # of the longest limit looked at: an element from there on may be longer
LONGER: Final = 2.0  # times as long as the search went, such an element is taken to be
PASS: Final = 0.02  # of the path's span: the shortest way between two reversals
ALIKE: Final = 0.1  # of their way: by less, passes from one reversal to the next are the same one again
LAGS: Final = ("delay", DAMPING)  # parameters beside the limits [s]
LAG_RANGE: Final = (np.array([-5.0, -5.0]), np.array([5.0, 100.0]))  # sample times
LAG_ORIGIN: Final = 10.0  # sample times; steps of 1e-3 from there on are as long near no lag as elsewhere


@dataclass(frozen=True)
class Terms:
    """What acts beside the elements. mass [kg]: known and taken off; None: identified. drag [N s/m]: viscous friction
    that is known and taken off. Others: identified or absent.

    by_direction: viscous friction of its own for each direction; bent: a part c' v^2 beside c v, so that it may grow
    less than in proportion; delay: the position answers a delay after the command (known_delay [s] beside it, with its
    standard deviation). damped: damping of the elements is sought, and taken only if BIC falls by ten.
    """

    mass: float | None = None
    drag: float = 0.0
    viscous: bool = False
    by_direction: bool = False
    bent: bool = False
    delay: bool = False
    known_delay: float = 0.0
    known_delay_std: float = 0.0
    damped: bool = False

    @property
    def lags(self) -> NDArray[np.bool_]:
        """Which of LAGS are identified (2,)."""
        return np.array([self.delay, self.damped])


@dataclass(frozen=True)
class _Data:
    """Filtered signals at all samples, and which of them are kept; step [m]: the finest of the reading; pass_band:
    sections of the low-pass, at_rest: their state at a constant 1; beside: what `_beside` gives at the known delay."""

    sample_time: float
    path: Array
    force: Array
    step: float
    keep: NDArray[np.int64]
    fitted: NDArray[np.bool_]
    pass_band: Array
    at_rest: Array
    terms: Terms
    beside: tuple[Array, Array] | None = None


def usable_band(usual: float, sample_time: float) -> float:
    """The low-pass's pass band [Hz] of a record sampled every sample_time [s]: the usual one, or on a slow record the
    widest with which the path's low-pass, that is SMOOTHING times as wide, stays below half the rate."""
    return min(usual, 0.5 * WIDEST / sample_time / max(SMOOTHING))


def slow_band(record: Record) -> float:
    """The low-pass's pass band [Hz] for friction in a slow record: SLOW_BAND, or so many times the frequency of its
    loops where they are faster, as the band smears the curve behind a reversal over a way that grows with the speed."""
    size = np.abs(np.fft.rfft(record.position - np.mean(record.position)))[1:]
    loops = (int(np.argmax(size)) + 1) / (record.position.size * record.sample_time)
    return usable_band(max(SLOW_BAND, LOOPS * loops), record.sample_time)


def identify(
    record: Record, terms: Terms, *, pass_band: float, fit_until: float = math.inf, most: int = MOST_ELEMENTS
) -> ForceFit:
    """Elements and the wanted terms from a record; see the module's head.

    pass_band [Hz] of the low-pass; fit_until [s]: later samples are kept for judging. The elements' state is unknown
    until the path has turned after its first span, so the fit begins there.
    Raises ValueError for a record that can't show friction.
    """
    plain = _fitted(record, replace(terms, damped=False), pass_band, fit_until, most)
    if not terms.damped:
        return plain
    damped = _fitted(record, terms, pass_band, fit_until, most)
    lag = damped.estimate.value(DAMPING), damped.estimate.deviation(DAMPING)
    freed = _lag_beside_the_scale(_prepared(record, terms, pass_band, fit_until), damped)
    least = min((lag, freed), key=lambda one: one[0] / one[1])
    before, after = (fit.criterion[len(fit.friction.limit)] for fit in (plain, damped))
    if after > before - STRONG or least[0] <= SURE * least[1]:
        return replace(plain, lag=least)
    covariance, where = damped.estimate.covariance.copy(), damped.estimate.names.index(DAMPING)
    covariance[where, where] += (lag[0] - freed[0]) ** 2
    lag = lag[0], float(np.sqrt(covariance[where, where]))
    return replace(damped, estimate=replace(damped.estimate, covariance=covariance), lag=lag)


def _fitted(record: Record, terms: Terms, pass_band: float, fit_until: float, most: int) -> ForceFit:
    """Elements by BIC with all that `terms` name."""
    data = _prepared(record, terms, pass_band, fit_until)
    limits, lags = np.zeros(0), np.zeros(2)
    best = _solved(data, limits, lags)
    criterion = [best[2]]
    grid = np.geomspace(*_range(data), GRID)
    candidates = _columns(data, grid, lags)[0][:, -GRID:]
    while limits.size < most:
        if np.any(lags):
            candidates = _columns(data, grid, lags)[0][:, -GRID:]
        wider = _with_element(data, limits, lags, grid, candidates)
        if wider is None:
            break
        trial, shift = _refined(data, wider, lags)
        solved = _solved(data, trial, shift)
        criterion.append(solved[2])
        slip = solved[0][solved[0].size - trial.size :] * trial
        if np.any(slip < LEAST_SHARE * np.sum(slip)) or criterion[-1] > min(criterion[:-1]) - STRONG:
            break
        limits, lags, best = trial, shift, solved
    if limits.size == 0:
        raise ValueError("no friction element takes anything away from the force; check signs, or record a reversal")
    found = _answer(data, limits, lags, tuple(criterion))
    apart = []
    for smoothing in SMOOTHING[1:]:
        other = _prepared(record, terms, pass_band, fit_until, smoothing)
        shown = _refined(other, limits, lags)
        apart.append(_values(other, *shown))
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
    return replace(found, estimate=replace(found.estimate, covariance=covariance), remembered=remembered, short=short)


def _remembered(data: _Data, found: ForceFit) -> tuple[float, bool]:
    """The constant force [N] that elements may carry from before the record, by the share of the samples over which
    they do, and whether the path is too short for the longest one.

    The states are those of full slip at the first extreme. An element that is longer than half the way to there may
    have had another one, until the path has come back by twice its limit. One at the end of the search never shows,
    and counts as LONGER times as long.
    """
    start, path = _memory_ends(data.path), data.path
    way, kept = abs(path[start] - path[0]), data.keep[data.fitted]
    back = np.maximum.accumulate(np.abs(path[start:] - path[start]))
    total, limit = 0.0, np.array(found.friction.limit)
    short = bool(limit[-1] > AT_END * _range(data)[1])
    for i, (k, x) in enumerate(zip(found.friction.stiffness, limit, strict=True)):
        known = start + int(np.searchsorted(back, 2 * x))
        share = 1.0 if short and i == limit.size - 1 else float(np.mean(kept < known))
        total += k * max(2 * x - way, LONGER * x if short and i == limit.size - 1 else 0.0) * share
    return total, short


def _prepared(
    record: Record, terms: Terms, pass_band: float, fit_until: float, smoothing: float = SMOOTHING[0]
) -> _Data:
    ts = record.sample_time
    if np.ptp(record.position) == 0 or np.ptp(record.command) == 0:
        raise ValueError("position or command is constant: the record shows no friction; record slow reversals")
    if record.position.size < FEWEST:
        raise ValueError(f"{record.position.size} samples are too few to show friction; record two slow loops or more")
    low = scipy.signal.cheby1(8, 0.05, min(pass_band * 2 * ts, WIDEST), output="sos")
    smooth = scipy.signal.butter(4, min(smoothing * pass_band * 2 * ts, WIDEST), output="sos")
    path = scipy.signal.sosfiltfilt(smooth, record.position)
    stride = max(int(0.4 / (pass_band * ts)), 1)
    edge = min(round(4.0 / (pass_band * ts)), record.position.size // 10)
    start = max(_memory_ends(path), edge)
    keep = np.arange(start, record.position.size - edge, stride)
    if keep.size < 40:
        raise ValueError("too little is left after the first reversal; record two slow loops or more")
    force = np.asarray(record.command, float)
    data = _Data(
        ts,
        path,
        force,
        _finest_step(record.position),
        keep,
        keep * ts <= fit_until,
        low,
        scipy.signal.sosfilt_zi(low),
        terms,
    )
    return replace(data, beside=_beside(data, 0.0))


def _memory_ends(path: Array) -> int:
    """The first extreme of the path: what happened before it, large elements may still remember."""
    away = np.abs(path - 0.5 * (np.max(path) + np.min(path)))
    return int(np.argmax(away >= np.max(away) - 0.02 * np.ptp(path)))


def _range(data: _Data) -> tuple[float, float]:
    """Least and largest limit [m] looked at: from what the scale and the path show on, up to 0.45 of the path's
    span."""
    span = float(np.ptp(data.path))
    return max(2e-3 * min(span, 2e-4), min(STEPS * data.step, COARSE)), 0.45 * min(span, 5e-2)


def _finest_step(position: Array) -> float:
    """The finest step of a reading (n,) [m] that moves, beyond what rounding makes of one."""
    steps = np.abs(np.diff(position))
    return float(np.min(steps[steps > 1e-9 * np.max(steps)]))


def _states(limits: Array, path: Array, lead: float) -> Array:
    """f_i / K_i (samples, N) [m], from full slip on at the first extreme (the record came from there).

    lead: tau in samples. Below zero, which no friction has but noise may want, dz/dt stands for dx/dt: the law itself
    would let slipping elements sway with the speed, which no record shows, and so hold tau at zero too surely.
    """
    start = _memory_ends(path)
    direction = np.sign(path[start] - np.mean(path))
    z = np.tile(direction * limits, (path.size, 1))  # before it as at it: the low-pass must not see a step
    z[start:] = deflections(limits, path[start:], direction * limits)
    if lead > 0:
        z[start:] = np.clip(z[start:] + lead * np.gradient(path)[start:, None], -limits, limits)
    elif lead < 0:
        z += lead * np.gradient(z, axis=0)
    return z


def _shifted(data: _Data, delay: float) -> Array:
    total = delay + data.terms.known_delay
    if total == 0:
        return data.path
    time = np.arange(data.path.size) * data.sample_time
    return np.asarray(scipy.interpolate.CubicSpline(time, data.path)(np.clip(time + total, 0, time[-1])))


def _beside(data: _Data, delay: float) -> tuple[Array, Array]:
    """(path as the command's time has it, columns beside the elements and the force (n, c + 1), filtered)."""
    terms, ts = data.terms, data.sample_time
    path = _shifted(data, delay)
    speed = np.gradient(path, ts)
    acceleration = np.gradient(speed, ts)
    force = data.force - (terms.mass or 0.0) * acceleration - terms.drag * speed
    columns = [] if terms.mass is not None else [acceleration]
    ways = [np.maximum(speed, 0), np.minimum(speed, 0)] if terms.by_direction else [speed]
    if terms.viscous:
        columns += ways
    if terms.bent:
        columns += [way * np.abs(way) for way in ways]
    return path, _filtered(data, np.column_stack([*columns, np.ones(path.size), force]))


def _columns(data: _Data, limits: Array, lags: Array) -> tuple[Array, Array]:
    """(columns (n, p), force (n,)) at the samples kept, filtered; the elements' columns are the last."""
    known = data.beside if lags[0] == 0 else None
    path, fixed = known or _beside(data, float(lags[0]))
    lead, width = lags[1] / data.sample_time, max(AT_A_TIME // path.size, 1)
    states = [_filtered(data, _states(limits[i : i + width], path, lead)) for i in range(0, max(limits.size, 1), width)]
    return np.hstack([fixed[:, :-1], *states]), fixed[:, -1]


def _remembering(data: _Data, count: int) -> Callable[[Array, Array], tuple[Array, Array]]:
    """`_columns` of a refinement of so many elements, with the same digits, which keeps what it made last: slopes by
    differences change one element at a time, and filtering is most of the work."""

    @lru_cache(maxsize=2)
    def beside(delay: float) -> tuple[Array, Array]:
        return (data.beside if delay == 0 else None) or _beside(data, delay)

    @lru_cache(maxsize=2 * count + 1)
    def element(limit: float, delay: float, lead: float) -> Array:
        return _filtered(data, _states(np.array([limit]), beside(delay)[0], lead / data.sample_time))

    def columns(limits: Array, lags: Array) -> tuple[Array, Array]:
        fixed = beside(float(lags[0]))[1]
        return np.hstack([fixed[:, :-1], *(element(float(limit), *map(float, lags)) for limit in limits)]), fixed[:, -1]

    return columns


def _filtered(data: _Data, columns: Array) -> Array:
    """Columns (samples, c) through the pass band, at the samples kept (n, c)."""
    width = max(AT_A_TIME // len(columns), 1)
    parts = [columns[:, i : i + width] for i in range(0, max(columns.shape[1], 1), width)]
    return np.hstack([_there_and_back(data.pass_band, data.at_rest, part)[data.keep] for part in parts])


def _there_and_back(sections: Array, at_rest: Array, columns: Array) -> Array:
    """`sosfiltfilt` (samples, c) by a filter without zero coefficients at its ends, to the last digit, whose state
    (sections, 2) at a constant 1 is known: SciPy finds it anew in every call, which takes longer than to filter."""
    edge = 3 * (2 * len(sections) + 1)
    first, last = columns[:1], columns[-1:]
    whole = np.concatenate([2 * first - columns[edge:0:-1], columns, 2 * last - columns[-2 : -edge - 2 : -1]])
    for _ in range(2):
        whole = scipy.signal.sosfilt(sections, whole, axis=0, zi=at_rest[:, :, None] * whole[0])[0][::-1]
    return np.asarray(whole[edge:-edge])


def _solved(
    data: _Data, limits: Array, lags: Array, made: tuple[Array, Array] | None = None
) -> tuple[Array, Array, float]:
    """(linear parameters, residual at the fitted samples, BIC); made: the `_columns`, where they are at hand."""
    columns, force = made or _columns(data, limits, lags)
    columns, force = columns[data.fitted], force[data.fitted]
    scale = np.maximum(np.max(np.abs(columns), axis=0), 1e-300)
    weights = np.linalg.lstsq(columns / scale, force, rcond=None)[0] / scale
    residual = force - columns @ weights
    n, free = residual.size, weights.size + limits.size + np.count_nonzero(data.terms.lags)
    return weights, residual, n * math.log(float(residual @ residual) / n) + free * math.log(n)


def _with_element(data: _Data, limits: Array, lags: Array, grid: Array, candidates: Array) -> Array | None:
    """The limits and one more, where with non-negative stiffnesses it takes away most; None if nowhere.

    candidates (n, GRID): the columns of elements with the grid's limits.
    """
    apart = np.array([bool(np.all(np.abs(np.log(x / limits)) > math.log(SPACING))) for x in grid])
    if not np.any(apart):
        return None
    columns, force = _columns(data, limits, lags)
    columns, force, tried = columns[data.fitted], force[data.fitted], candidates[np.ix_(data.fitted, apart)]
    basis, _ = np.linalg.qr(columns)
    left = force - basis @ (basis.T @ force)
    tried = tried - basis @ (basis.T @ tried)
    load = tried.T @ left
    gained = np.where(load > 0, load**2 / np.maximum(np.sum(tried**2, axis=0), 1e-300), 0.0)
    if not np.any(gained > 0):
        return None
    return np.sort(np.append(limits, grid[apart][int(np.argmax(gained))]))


def _refined(data: _Data, limits: Array, lags: Array) -> tuple[Array, Array]:
    """Limits and LAGS [s] by least squares on what the linear part leaves."""
    ts, count, free = data.sample_time, limits.size, data.terms.lags

    def split(theta: Array) -> tuple[Array, Array]:
        shift = np.zeros(2)
        shift[free] = (theta[count:] - LAG_ORIGIN) * ts
        return np.exp(theta[:count]), shift

    low, high = np.log(_range(data)[0] / 2), np.log(_range(data)[1] * 1.05)
    bounds = tuple(
        np.append(np.full(count, end), lag[free] + LAG_ORIGIN) for end, lag in zip((low, high), LAG_RANGE, strict=True)
    )
    start = np.clip(np.append(np.log(limits), lags[free] / ts + LAG_ORIGIN), *bounds)
    columns = _remembering(data, count)

    def left(theta: Array) -> Array:
        limits, lags = split(theta)
        return _solved(data, limits, lags, columns(limits, lags))[1]

    found = scipy.optimize.least_squares(
        left, start, bounds=bounds, diff_step=1e-3, max_nfev=15, x_scale="jac",
    )  # fmt: skip
    limits, lags = split(found.x)
    return np.sort(limits), lags


def _answer(data: _Data, limits: Array, lags: Array, criterion: tuple[float, ...]) -> ForceFit:
    weights, residual, _ = _solved(data, limits, lags)
    columns, force = _columns(data, limits, lags)
    count = limits.size
    stiffness = weights[weights.size - count :]
    whole = _slopes(data, limits, lags, weights)[data.fitted]
    scale = np.maximum(np.max(np.abs(whole), axis=0), 1e-300)
    covariance = newey_west(whole / scale, residual, TOGETHER)
    covariance = covariance / np.outer(scale, scale)
    names, units = _names(data.terms, count)
    values = _values(data, limits, lags)
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
    )


def _slopes(data: _Data, limits: Array, lags: Array, weights: Array) -> Array:
    """Of the modelled force less the record's (n, p), by all parameters in the order of `_names`; weights: the linear
    ones."""
    columns, _ = _columns(data, limits, lags)
    count, jacobian = limits.size, list[Array]()
    for step in np.eye(2)[data.terms.lags] * 1e-2 * data.sample_time:
        ahead, behind = (_columns(data, limits, lags + s * step) for s in (1, -1))
        change = (ahead[0] @ weights - ahead[1]) - (behind[0] @ weights - behind[1])
        jacobian.append((change / (2 * np.sum(step)))[:, None])
    jacobian.append(columns)
    for i in range(count):
        moved = [limits * np.where(np.arange(count) == i, 1 + s * 2e-3, 1.0) for s in (1, -1)]
        more, less = (_columns(data, other, lags)[0] @ weights for other in moved)
        jacobian.append(((more - less) / (4e-3 * limits[i]))[:, None])
    return np.hstack(jacobian)


def _lag_beside_the_scale(data: _Data, found: ForceFit) -> tuple[float, float]:
    """Tau and its standard deviation [s] by one step from a fit, with a gain of the reading of its own for every pass.

    Over one pass, a periodic error of the scale is a gain (and an offset, which no force shows); passes of other places
    or lengths have other ones. Those at other speeds look like damping where the gains are not free.
    """
    stiffness, limits = np.array(found.friction.stiffness), np.array(found.friction.limit)
    lags = found.estimate.values[: np.count_nonzero(data.terms.lags)]
    shift = np.zeros(2)
    shift[data.terms.lags] = lags
    weights, left, _ = _solved(data, limits, shift)
    path = _beside(data, float(shift[0]))[0]
    yielding = (np.abs(_states(limits, path, shift[1] / data.sample_time)) < limits) @ stiffness  # N/m
    number, way = _passes(path)
    gains = (yielding * way)[:, None] * (number[:, None] == np.arange(number.max() + 1))
    slopes = np.hstack([_slopes(data, limits, shift, weights), _filtered(data, gains)])[data.fitted]
    size = np.max(np.abs(slopes), axis=0)
    slopes = slopes[:, size > 0] / size[size > 0]
    step = np.linalg.lstsq(slopes, left, rcond=None)[0]
    covariance = newey_west(slopes, left - slopes @ step, TOGETHER)
    where = found.estimate.names.index(DAMPING)
    return float(shift[1] + step[where] / size[where]), float(np.sqrt(covariance[where, where]) / size[where])


def _passes(path: Array) -> tuple[NDArray[np.int64], Array]:
    """Of every sample (n,) which pass it belongs to, from one reversal to the next, and how far it is from the one
    before [m]. Passes that begin and end at the same places are one."""
    least = PASS * np.ptp(path)
    ends = np.sort(np.concatenate([scipy.signal.find_peaks(sign * path, prominence=least)[0] for sign in (1, -1)]))
    ends = np.unique(np.concatenate([[0], ends, [path.size - 1]]))
    number, way, known = np.zeros(path.size, np.int64), np.zeros(path.size), list[tuple[float, float]]()
    for begin, end in pairwise(ends):
        here = path[begin], path[end]
        close = ALIKE * abs(here[1] - here[0])
        same = [i for i, one in enumerate(known) if np.max(np.abs(np.subtract(one, here))) < close]
        number[begin : end + 1] = same[0] if same else len(known)
        way[begin : end + 1] = path[begin : end + 1] - here[0]
        known += [] if same else [here]
    return number, way


def _values(data: _Data, limits: Array, lags: Array) -> Array:
    """All parameters (p,) in the order of `_names`."""
    return np.concatenate([lags[data.terms.lags], _solved(data, limits, lags)[0], limits])


def _names(terms: Terms, count: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    ways = ("forwards", "backwards") if terms.by_direction else ("",)
    pairs = [(name, "s") for name, wanted in zip(LAGS, terms.lags, strict=True) if wanted]
    pairs += [] if terms.mass is not None else [("mass", "kg")]
    pairs += [(f"viscous friction {way}".strip(), "N s/m") for way in ways] if terms.viscous else []
    pairs += [(f"bend of the viscous friction {way}".strip(), "N s2/m2") for way in ways] if terms.bent else []
    pairs += [("offset", "N"), *((f"element {i + 1} stiffness", "N/m") for i in range(count))]
    pairs += [(f"element {i + 1} limit", "m") for i in range(count)]
    return tuple(name for name, _ in pairs), tuple(unit for _, unit in pairs)
