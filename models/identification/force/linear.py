"""What is linear in the force at given limits and lags: the columns of the elements and of what acts beside them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from models.friction import deflections
from models.identification.force.fit import DAMPING, SPRING
from models.identification.force.signals import (
    AT_A_TIME,
    MAX_NYQUIST_SHARE,
    SMOOTHING,
    Signals,
    Terms,
    filtered,
    finest_step,
    memory_ends,
)
from models.identification.force.stated import left_for_friction
from models.records.record import Record

Array = NDArray[np.float64]

FEWEST: Final = 40  # samples, below which a zero-phase filter has no room
MIN_FITTED_SHARE: Final = 0.25  # of the samples kept, that an earlier part of a record must have to be fitted alone
LAGS: Final = ("delay", DAMPING)  # parameters beside the limits [s]


def prepared(
    record: Record, terms: Terms, pass_band: float, fit_until: float, smoothing: float = SMOOTHING[0]
) -> Signals:
    """The signals of a record through the pass band [Hz], fitted up to fit_until [s], or where hardly any sample is
    kept before, to half of them; smoothing [1]: the path's low-pass over it. Raises ValueError for a record that can't
    show friction."""
    ts = record.sample_time
    if np.ptp(record.position) == 0 or np.ptp(record.command) == 0:
        raise ValueError("position or command is constant: the record shows no friction; record slow reversals")
    if record.position.size < FEWEST:
        raise ValueError(f"{record.position.size} samples are too few to show friction; record two slow loops or more")
    low = scipy.signal.cheby1(8, 0.05, min(pass_band * 2 * ts, MAX_NYQUIST_SHARE), output="sos")
    smooth = scipy.signal.butter(4, min(smoothing * pass_band * 2 * ts, MAX_NYQUIST_SHARE), output="sos")
    path = scipy.signal.sosfiltfilt(smooth, record.position)
    stride = max(int(0.4 / (pass_band * ts)), 1)
    edge = min(round(4.0 / (pass_band * ts)), record.position.size // 10)
    start = max(memory_ends(path), edge)
    keep = np.arange(start, record.position.size - edge, stride)
    if keep.size < 40:
        raise ValueError("too little is left after the first reversal; record two slow loops or more")
    fitted = keep * ts <= fit_until
    if np.count_nonzero(fitted) < MIN_FITTED_SHARE * keep.size:  # strokes that grow: their memory ends late
        fitted = np.arange(keep.size) < keep.size // 2
    force = np.asarray(record.command, float)
    data = Signals(
        ts,
        path,
        force,
        finest_step(record.position),
        keep,
        fitted,
        low,
        scipy.signal.sosfilt_zi(low),
        pass_band,
        terms,
    )
    return replace(data, beside=beside_elements(data, 0.0))


def element_states(limits: Array, path: Array, lead: float) -> Array:
    """f_i / K_i (samples, N) [m], from full slip on at the first extreme (the record came from there).

    lead: tau in samples. Below zero, which no friction has but noise may want, dz/dt stands for dx/dt: the law itself
    would let slipping elements sway with the speed, which no record shows, and so hold tau at zero too surely.
    """
    start = memory_ends(path)
    direction = np.sign(path[start] - np.mean(path))
    z = np.tile(direction * limits, (path.size, 1))  # before it as at it: the low-pass must not see a step
    z[start:] = deflections(limits, path[start:], direction * limits)
    if lead > 0:
        z[start:] = np.clip(z[start:] + lead * np.gradient(path)[start:, None], -limits, limits)
    elif lead < 0:
        z += lead * np.gradient(z, axis=0)
    return z


def _shifted(data: Signals, delay: float) -> Array:
    total = delay + data.terms.known_delay
    if total == 0:
        return data.path
    time = np.arange(data.path.size) * data.sample_time
    return np.asarray(scipy.interpolate.CubicSpline(time, data.path)(np.clip(time + total, 0, time[-1])))


def beside_elements(data: Signals, delay: float) -> tuple[Array, Array]:
    """(path [m] as the command's time has it, columns [SI] beside the elements and the force (n, c + 1), filtered)."""
    terms, ts = data.terms, data.sample_time
    path = _shifted(data, delay)
    speed = np.gradient(path, ts)
    acceleration = np.gradient(speed, ts)
    acting = left_for_friction(terms.effects, path, speed, data.force, ts)
    force = acting - (terms.mass or 0.0) * acceleration - terms.drag * speed
    columns = [] if terms.mass is not None else [acceleration]
    ways = [np.maximum(speed, 0), np.minimum(speed, 0)] if terms.by_direction else [speed]
    if terms.viscous:
        columns += ways
    if terms.bent:
        columns += [way * np.abs(way) for way in ways]
    columns += [path] if terms.spring else []
    return path, filtered(data, np.column_stack([*columns, np.ones(path.size), force]))


def linear_columns(data: Signals, limits: Array, lags: Array) -> tuple[Array, Array]:
    """(columns (n, p) [SI], force (n,) [N]) at the samples kept, filtered; the elements' columns are the last."""
    known = data.beside if lags[0] == 0 else None
    path, fixed = known or beside_elements(data, float(lags[0]))
    lead, width = lags[1] / data.sample_time, max(AT_A_TIME // path.size, 1)
    moved = [
        filtered(data, element_states(limits[i : i + width], path, lead)) for i in range(0, max(limits.size, 1), width)
    ]
    return np.hstack([fixed[:, :-1], *moved]), fixed[:, -1]


def kept_columns(data: Signals, count: int) -> Callable[[Array, Array], tuple[Array, Array]]:
    """`linear_columns` of a refinement of so many elements, with the same digits, which keeps what it made last: slopes
    by differences change one element at a time, and filtering is most of the work. Limits in [m], lags in [s]."""

    @lru_cache(maxsize=2)
    def fixed_at(delay: float) -> tuple[Array, Array]:
        return (data.beside if delay == 0 else None) or beside_elements(data, delay)

    @lru_cache(maxsize=2 * count + 1)
    def element(limit: float, delay: float, lead: float) -> Array:
        return filtered(data, element_states(np.array([limit]), fixed_at(delay)[0], lead / data.sample_time))

    def columns(limits: Array, lags: Array) -> tuple[Array, Array]:
        fixed = fixed_at(float(lags[0]))[1]
        return np.hstack([fixed[:, :-1], *(element(float(limit), *map(float, lags)) for limit in limits)]), fixed[:, -1]

    return columns


def linear_solution(
    data: Signals, limits: Array, lags: Array, made: tuple[Array, Array] | None = None
) -> tuple[Array, Array, float]:
    """(linear parameters, residual [N] at the fitted samples, BIC); made: the `linear_columns`, where at hand."""
    columns, force = made or linear_columns(data, limits, lags)
    columns, force = columns[data.fitted], force[data.fitted]
    scale = np.maximum(np.max(np.abs(columns), axis=0), 1e-300)
    weights = np.linalg.lstsq(columns / scale, force, rcond=None)[0] / scale
    residual = force - columns @ weights
    n, free = residual.size, weights.size + limits.size + np.count_nonzero(data.terms.lags)
    return weights, residual, n * math.log(float(residual @ residual) / n) + free * math.log(n)


def slopes(data: Signals, limits: Array, lags: Array, weights: Array) -> Array:
    """Slopes (n, p) [SI] of the modelled force less the record's, by all parameters in the order of `parameter_names`;
    weights: the linear ones."""
    columns, _ = linear_columns(data, limits, lags)
    count, jacobian = limits.size, list[Array]()
    for step in np.eye(2)[data.terms.lags] * 1e-2 * data.sample_time:
        ahead, behind = (linear_columns(data, limits, lags + s * step) for s in (1, -1))
        change = (ahead[0] @ weights - ahead[1]) - (behind[0] @ weights - behind[1])
        jacobian.append((change / (2 * np.sum(step)))[:, None])
    jacobian.append(columns)
    for i in range(count):
        moved = [limits * np.where(np.arange(count) == i, 1 + s * 2e-3, 1.0) for s in (1, -1)]
        more, less = (linear_columns(data, other, lags)[0] @ weights for other in moved)
        jacobian.append(((more - less) / (4e-3 * limits[i]))[:, None])
    return np.hstack(jacobian)


def parameter_values(data: Signals, limits: Array, lags: Array) -> Array:
    """All parameters [SI] (p,) in the order of `parameter_names`."""
    return np.concatenate([lags[data.terms.lags], linear_solution(data, limits, lags)[0], limits])


def parameter_names(terms: Terms, count: int) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names of all parameters with so many elements, and their units."""
    ways = ("forwards", "backwards") if terms.by_direction else ("",)
    pairs = [(name, "s") for name, wanted in zip(LAGS, terms.lags, strict=True) if wanted]
    pairs += [] if terms.mass is not None else [("mass", "kg")]
    pairs += [(f"viscous friction {way}".strip(), "N s/m") for way in ways] if terms.viscous else []
    pairs += [(f"bend of the viscous friction {way}".strip(), "N s2/m2") for way in ways] if terms.bent else []
    pairs += [(SPRING, "N/m")] if terms.spring else []
    pairs += [("offset", "N"), *((f"element {i + 1} stiffness", "N/m") for i in range(count))]
    pairs += [(f"element {i + 1} limit", "m") for i in range(count)]
    return tuple(name for name, _ in pairs), tuple(unit for _, unit in pairs)
