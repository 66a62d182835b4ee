"""P_l(s) of eq. (1) from a measured frequency response: modes, gains, damping and dead time, with uncertainties.

Weighted least squares on the complex response. Starting values: rigid body and dead time from the trend, then one mode
after the other where it takes away most of what is left, among a grid of frequencies and damping ratios; a mode more is
taken as long as BIC falls by ten. Symbols: k gain, f frequency [Hz], zeta damping, L dead time [s], T sample time [s].
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from models.identification.estimate import STRONG, Estimate
from models.identification.response import FrequencyResponse
from models.plant import Mode, Plant, delay_split

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

DAMPINGS: Final = (0.003, 0.01, 0.03, 0.1)  # of the grid of starting values
GRID_LINES: Final = 500  # of which a grid of starting values looks, of a record with thousands
MOST_MODES: Final = 6
HEAVY: Final = 0.2  # damping ratio that no structure has: such a mode stands for friction


@dataclass(frozen=True)
class Fit:
    """P_l, its parameters' estimate, which lines (n,) were used, BIC by number of modes, reduced chi-square."""

    plant: Plant
    estimate: Estimate
    used: NDArray[np.bool_]
    criterion: tuple[float, ...]
    chi_square: float


def fit(measured: FrequencyResponse, *, most_modes: int = MOST_MODES) -> Fit:
    """P_l from a frequency response (thrust constant 1); see the module's head.

    Low lines that rolling friction bends are left out: the lowest line used is raised by third octaves until the lowest
    octave left fits as well as the rest (its reduced chi-square at most 3 times that of the rest, or 1) and every mode
    is one of the structure: above that line, damped by less than 0.2, its gain below the rigid body's. A record that
    rolled throughout (`measured.rolling`) has no such lines.
    Raises ValueError for fewer than 12 lines [Hz], or where the whole response is bent.
    """
    f = measured.frequency
    if f.size < 12:
        raise ValueError(f"{f.size} lines are too few to fit modes; measure 12 at least")
    if measured.rolling:
        return _fit(measured, np.ones(f.size, bool), most_modes)
    lowest = float(f[0])
    while np.sum(f >= lowest) >= 12 and lowest < f[-1] / 4:
        found = _fit(measured, f >= lowest, most_modes)
        if _fits_low(measured, found, lowest):
            return found
        lowest *= 2 ** (1 / 3)
    raise ValueError(
        f"no line below {f[-1] / 4:.3g} Hz agrees with a rigid body and modes: friction bends the whole response; "
        "excite while the axis rolls, or with strokes well beyond the presliding region"
    )


def model(plant: Plant, frequency: Array, sample_time: float) -> Complex:
    """P_l (n,) [m/N] at frequencies [Hz]: behind a zero-order hold at the samples, or continuous for sample_time 0."""
    total = np.zeros(frequency.size, complex)
    for mode in plant.modes:
        total += mode.gain * _unit(frequency, mode.frequency, mode.damping, plant.dead_time, sample_time)
    return np.asarray(plant.thrust_constant * total, complex)


def _unit(frequency: Array, natural: float, damping: float, dead_time: float, sample_time: float) -> Complex:
    """One mode of gain 1, in closed form (no matrix exponential, so independent of models.plant)."""
    s = 2j * math.pi * frequency
    w = 2 * math.pi * natural
    if sample_time == 0:
        return np.asarray(np.exp(-s * dead_time) / (s**2 + 2 * damping * w * s + w**2))
    whole, rest = delay_split(dead_time, sample_time)
    z, late = np.exp(s * sample_time), sample_time - rest
    if w == 0:
        speed = late + rest / z
        place = 0.5 * late**2 + rest * (0.5 * rest + late) / z
        return np.asarray(z**-whole * (place / (z - 1) + sample_time * speed / (z - 1) ** 2))
    root = math.sqrt(max(1 - damping**2, 1e-12))
    total = np.zeros(frequency.size, complex)
    for sign in (1, -1):  # 1 / ((s - p)(s - conj p)) in partial fractions
        p = w * complex(-damping, sign * root)
        residue = 1 / (2j * sign * w * root)
        newer = (np.exp(p * late) - 1) / p
        older = np.exp(p * late) * (np.exp(p * rest) - 1) / p
        total += residue * (newer + older / z) / (z - np.exp(p * sample_time))
    return np.asarray(z**-whole * total)


@dataclass(frozen=True)
class _Lines:
    """What is fitted: P (n,) [m/N] at f (n,) [Hz] with weights (n,), the sample time [s], and U (n,) or None."""

    f: Array
    p: Complex
    weight: Array
    ts: float
    command: Complex | None


def _fit(measured: FrequencyResponse, used: NDArray[np.bool_], most_modes: int) -> Fit:
    f, p = measured.frequency[used], measured.response[used]
    known = bool(np.all(np.isfinite(measured.variance)))
    weight = np.sqrt(2 / measured.variance[used]) if known else 1 / np.abs(p)
    command = None if measured.command is None else measured.command[used]
    lines = _Lines(f, p, weight, measured.sample_time, command)
    theta = _refined(_trend(lines), lines)
    best, criterion = theta, [_bic(theta, lines, known=known)]
    for _ in range(most_modes):
        theta = _refined(_with_mode(theta, lines), lines)
        criterion.append(_bic(theta, lines, known=known))
        if criterion[-1] > min(criterion[:-1]) - STRONG or _is_tone(theta, lines):
            break
        best = theta
    residual, jacobian = _residual(best, lines), _jacobian(best, lines)
    chi_square = float(residual @ residual) / max(residual.size - best.size, 1)
    inverse = np.asarray(np.linalg.pinv(jacobian.T @ jacobian), float)
    covariance = inverse * (max(1.0, chi_square) if known else chi_square)
    return Fit(_plant(best), _estimate(best, covariance), used, tuple(criterion), chi_square)


def _is_tone(theta: Array, lines: _Lines) -> bool:
    """Whether a mode is narrower than the lines of a single record are apart: a disturbing tone looks like that."""
    width = np.exp(theta[3::3] + theta[4::3])  # zeta f
    return lines.command is not None and bool(np.any(width < np.min(np.diff(lines.f))))


def _plant(theta: Array) -> Plant:
    """theta: log k_0, L in ms, then (k_i / k_0, log f_i, log zeta_i) for each mode; modes by rising frequency."""
    rigid = math.exp(theta[0])
    triples = sorted(theta[2:].reshape(-1, 3).tolist(), key=lambda triple: triple[1])
    modes = [Mode(rigid * k, math.exp(f), math.exp(zeta)) for k, f, zeta in triples]
    return Plant(float(theta[1]) * 1e-3, 1.0, (Mode(rigid, 0.0, 0.0), *modes))


def _residual(theta: Array, lines: _Lines) -> Array:
    """Weighted errors (2n,) [1], less what the ends of a single record explain, whatever their sizes (projection)."""
    plant = _plant(theta)
    error = _stacked((model(plant, lines.f, lines.ts) - lines.p) * lines.weight)
    if lines.command is None:
        return error
    ends = _ends(plant, lines, lines.weight / lines.command)
    # of unit columns, so that the normal equations are good enough, and quick
    return np.asarray(error - ends @ np.linalg.solve(ends.T @ ends, ends.T @ error))


def _ends(plant: Plant, lines: _Lines, scale: Complex) -> Array:
    """What each mode's state, unlike at the record's two ends, adds to the weighted errors (2n, 2m) [1].

    scale (n,): the weights over U. At the lines of n samples z^n = 1, so a free response is
    (a + b (z - 1)) / ((z - p)(z - conj p)) (Pintelon and Schoukens, System Identification, 2012, 6.3.2).
    """
    z, columns = np.exp(2j * math.pi * lines.f * lines.ts), []
    for mode in plant.modes:
        w = 2 * math.pi * mode.frequency * lines.ts
        pole = np.exp(w * complex(-mode.damping, math.sqrt(1 - mode.damping**2)))
        shape = scale / ((z - pole) * (z - pole.conjugate()))
        columns += [_stacked(shape), _stacked((z - 1) * shape)]
    return np.column_stack([column / np.linalg.norm(column) for column in columns])


def _stacked(values: Complex) -> Array:
    return np.concatenate([values.real, values.imag])


def _jacobian(theta: Array, lines: _Lines) -> Array:
    columns = []
    for i in range(theta.size):
        step = np.zeros(theta.size)
        step[i] = 1e-5
        ahead, behind = (_residual(theta + sign * step, lines) for sign in (1, -1))
        columns.append((ahead - behind) / 2e-5)
    return np.column_stack(columns)


def _refined(start: Array, lines: _Lines) -> Array:
    count = (start.size - 2) // 3
    low = np.array([-60.0, 0.0, *[-50.0, math.log(lines.f[0] / 2), math.log(1e-4)] * count])
    high = np.array([60.0, 50.0, *[50.0, math.log(2 * lines.f[-1]), math.log(0.7)] * count])
    inside = np.clip(start, low + 1e-9, high - 1e-9)
    found = least_squares(
        _residual, inside, jac=_jacobian, bounds=(low, high), x_scale="jac", args=(lines,), max_nfev=60
    )
    return np.asarray(found.x)


def _trend(lines: _Lines) -> Array:
    """log k_0 and L of a rigid body from magnitude and phase slope, robustly by medians."""
    f, p, ts = lines.f, lines.p, lines.ts
    s2 = -((2 * math.pi * f) ** 2)
    gain = float(np.median(np.abs(p * s2)))
    phase = np.unwrap(np.angle(p * s2))
    phase -= 2 * math.pi * round(float(np.median(phase[: max(phase.size // 5, 1)])) / (2 * math.pi))
    slope = float(np.median(-phase[f > np.median(f)] / (2 * math.pi * f[f > np.median(f)])))
    return np.array([math.log(gain), max(slope - ts / 2, 0.0) * 1e3])


def _with_mode(theta: Array, lines: _Lines) -> Array:
    """theta and one mode more: of a grid the one that, with its best gain, leaves least."""
    every = slice(None, None, max(lines.f.size // GRID_LINES, 1))
    plant, f, weight, ts = _plant(theta), lines.f[every], lines.weight[every], lines.ts
    left = _residual(theta, lines).reshape(2, -1)[:, every].ravel()
    rigid = _unit(f, 0.0, 0.0, plant.dead_time, ts) * weight
    first = _stacked(rigid)
    rigid_power, rigid_load = float(first @ first), float(-first @ left)
    best, found = math.inf, (0.0, float(f[0]), 0.01)
    for natural in np.geomspace(1.2 * f[0], 0.95 * f[-1], 240):
        for damping in DAMPINGS:
            shape = _unit(f, float(natural), damping, plant.dead_time, ts) * weight
            second = _stacked(shape)
            cross, own, load = float(first @ second), float(second @ second), float(-second @ left)
            determinant = rigid_power * own - cross**2
            if determinant < 1e-12 * rigid_power * own:
                continue
            gains = np.array([own * rigid_load - cross * load, rigid_power * load - cross * rigid_load]) / determinant
            gained = -float(gains @ (rigid_load, load))
            if gained < best:
                best, found = gained, (float(gains[1]), float(natural), damping)
    gain, natural, damping = found
    return np.concatenate([theta, [gain / math.exp(theta[0]), math.log(natural), math.log(damping)]])


def _bic(theta: Array, lines: _Lines, *, known: bool) -> float:
    """Bayes's information criterion; for an unknown variance with the one that the fit leaves."""
    residual = _residual(theta, lines)
    n, cost = residual.size, float(residual @ residual)
    return (cost if known else n * math.log(cost / n)) + theta.size * math.log(n)


def _fits_low(measured: FrequencyResponse, found: Fit, lowest: float) -> bool:
    """Whether the lowest octave used is as the fit says: see `fit`."""
    f, used = measured.frequency, found.used
    error = np.abs(model(found.plant, f, measured.sample_time) - measured.response) ** 2
    known = bool(np.all(np.isfinite(measured.variance)))
    size = error / (measured.variance if known else np.abs(measured.response) ** 2)
    low = used & (f < 2 * lowest)
    rest = float(np.median(size[used & ~low])) / math.log(2)  # the mean of an exponential variable from its median
    level = max(1.0, rest) if known else max(rest, 1e-6)
    rigid, *modes = found.plant.modes
    structural = all(
        mode.frequency > 1.1 * lowest and mode.damping < HEAVY and abs(mode.gain) < rigid.gain for mode in modes
    )
    return structural and bool(np.mean(size[low]) < 3 * level)


def _estimate(theta: Array, covariance: Array) -> Estimate:
    """The parameters as a machine file has them, by linear propagation."""
    order = [0, 1, *(2 + 3 * i + j for i in np.argsort(theta[3::3]) for j in range(3))]
    theta, covariance = theta[order], covariance[np.ix_(order, order)]
    rigid = math.exp(theta[0])
    names, units, values = ["rigid body gain", "dead time"], ["1/kg", "s"], [rigid, theta[1] * 1e-3]
    slopes = np.zeros((theta.size, theta.size))
    slopes[0, 0], slopes[1, 1] = rigid, 1e-3
    for i, (k, f, zeta) in enumerate(theta[2:].reshape(-1, 3)):
        row = 2 + 3 * i
        names += [f"mode {i + 1} gain", f"mode {i + 1} frequency", f"mode {i + 1} damping"]
        units += ["1/kg", "Hz", "1"]
        values += [rigid * k, math.exp(f), math.exp(zeta)]
        slopes[row, 0], slopes[row, row] = rigid * k, rigid
        slopes[row + 1, row + 1], slopes[row + 2, row + 2] = math.exp(f), math.exp(zeta)
    return Estimate(tuple(names), tuple(units), np.array(values), slopes @ covariance @ slopes.T)
