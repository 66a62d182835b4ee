"""Weighted least squares of one structure, so many modes with or without lag and drag, on one frequency response or on
several of one machine together.

theta: log k_0, L and, where the structure has them, tau, both over 1 / w of the highest line, the drag's rate c k_0
over w of the highest line, and the square of the spring's frequency, k k_0, over w^2 of the lowest; then (k_i / k_0,
log f_i, log zeta_i) for each mode. N lines in all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
import scipy

from models.identification.modal.problem import Lines, Problem, Structure
from models.identification.modal.transfer import (
    Array,
    Complex,
    Parts,
    continuous,
    expansion,
    expansions,
    fractions,
    sampled,
    units,
)
from models.plant import Mode, Plant

DAMPINGS: Final = (0.003, 0.01, 0.03, 0.1)  # of the grid of starting values
LEAST_DAMPING: Final = 1e-4  # bounds of the search; what ends there is not a mode
MOST_DAMPING: Final = 0.7
GRID_FREQUENCIES: Final = 240  # frequencies at which one mode more is tried
MAX_COMPARED_LINES: Final = 600  # lines on which orders are compared, of a record with thousands
COARSE: Final = 300  # lines on which a start is sought
WIDE: Final = 5.0  # of the logarithm of the rigid body's gain from its start
MIN_COLUMN_RATIO: Final = 1e-9  # relative size below which a combination of columns is none but rounding
DIED_OUT: Final = 12.0  # time constants after which what a pole leaves is below 1e-5
DERIVATIVE_STEP: Final = 1e-6  # of theta, of the numerical derivatives: a hundredth of the sharpest mode's width
MIN_RELATIVE_PART: Final = 2e-5  # of what theta has of a lag and a spring, and of a drag over the band: less is none
STIFFEST: Final = 4.0  # times the inertia at the lowest line: a stiffer one makes the rigid body a mode in the band
# Times the spring that is known, and its inverse: within lies the one that the lines show.
MAX_SPRING_RATIO: Final = 3.0


@dataclass(frozen=True)
class Expansion:
    """P plants with a lag, a drag and a spring in partial fractions: poles (P, J) [1/s], weights (P, J) [1/kg], dead
    times (P,) [s]; sprung: whether a spring holds them, so that the pole at 0 is none of their own."""

    pole: Complex
    weight: Complex
    dead_time: Array
    sprung: bool = False


@dataclass(frozen=True)
class Beside:
    """What acts beside the modes: lag tau [s], drag c [N s/m], spring to ground k [N/m]."""

    lag: float = 0.0
    drag: float = 0.0
    spring: float = 0.0


def decoded(theta: Array, structure: Structure, problem: Problem) -> tuple[Plant, Beside]:
    """The plant [SI] that theta stands for, its modes in theta's order, and what acts beside them."""
    parts, dead_time = _parts(theta[None], structure, problem)
    rigid = float(parts.rigid[0])
    modes = [
        Mode(gain, w / (2 * math.pi), zeta)
        for gain, w, zeta in zip(parts.gain[0].tolist(), parts.w[0].tolist(), parts.zeta[0].tolist(), strict=True)
    ]
    beside = Beside(float(parts.lag[0]), float(parts.drag[0]), float(parts.spring[0]))
    return Plant(float(dead_time[0]), 1.0, (Mode(rigid, 0.0, 0.0), *modes)), beside


def _parts(thetas: Array, structure: Structure, problem: Problem) -> tuple[Parts, Array]:
    """What thetas (P, p) stand for, and the dead times (P,) [s]."""
    rigid, unit, none = np.exp(thetas[:, 0]), sizes(problem), np.zeros(len(thetas))
    values = {part: thetas[:, structure.index(part)] * unit[part] for part in structure.parts}
    gain, log_f, log_zeta = np.moveaxis(thetas[:, structure.before :].reshape(len(thetas), -1, 3), 2, 0)
    beside = values.get("lag", none), values.get("drag", none) / rigid
    spring = values["spring"] / rigid if "spring" in values else none + problem.spring
    modes = rigid[:, None] * gain, 2 * math.pi * np.exp(log_f), np.exp(log_zeta)
    return Parts(rigid, *modes, *beside, spring), thetas[:, 1] * problem.unit


def _terms(thetas: Array, structure: Structure, problem: Problem) -> Expansion:
    """The expansions of thetas (P, p)."""
    parts, dead_time = _parts(thetas, structure, problem)
    return Expansion(*expansions(parts), dead_time, bool(np.any(parts.spring)))


def sizes(problem: Problem) -> dict[str, float]:
    """What one of theta is of each part: of tau [s], of c k_0 [1/s], of k k_0 [1/s2]."""
    return {"lag": problem.unit, "drag": 1 / problem.unit, "spring": (2 * math.pi * problem.band[0]) ** 2}


def residual(theta: Array, structure: Structure, problem: Problem) -> Array:
    """Weighted errors (2 N,) [1], less what the ends of a single record explain, whatever their sizes (projection)."""
    return _left(_terms(theta[None], structure, problem), problem)


def left_of(plant: Plant, beside: Beside, problem: Problem) -> Array:
    """The residual (2 N,) [1] of a plant and what acts beside its modes."""
    pole, weight = expansion(plant, beside.lag, beside.drag, beside.spring)
    terms = Expansion(pole[None], weight[None], np.array([plant.dead_time]), beside.spring > 0)
    return _left(terms, problem)


def _left(terms: Expansion, problem: Problem) -> Array:
    """The residual (2 N,) [1] of one expansion."""
    found = []
    for one in problem.lines:
        error = _errors(_shown(terms, one)[0], terms.sprung, one)
        if one.command is not None:
            basis, _ = _spanned(_columns(_ends_of(terms, one), one))
            error = error - basis @ (basis.T @ error)
        found.append(error)
    return np.concatenate(found)


def _errors(shown: Complex, sprung: bool, lines: Lines) -> Array:
    """Weighted errors (2n,) [1] of a weighted response (n,) [1].

    Without a spring the straight line that was taken off the position is among what the ends leave. A spring makes the
    command rise along it, so that there it counts with the size that it had: its spectrum is -g z / (z - 1) at the
    lines, where z^n = 1.
    """
    error = shown - lines.p * lines.weight
    if sprung and lines.command is not None and not lines.levelled:
        error += lines.slope * lines.scale / (1 - lines.back)
    return _stacked(error)


def _shown(terms: Expansion, lines: Lines) -> Complex:
    """The weighted responses (P, n) [1]."""
    if lines.ts == 0:
        response = continuous(terms.pole, terms.weight, lines.f, terms.dead_time)
    else:
        response = sampled(terms.pole, terms.weight, lines.held_back, terms.dead_time, lines.hold)
    return response * lines.weight


class _Ends(NamedTuple):
    """What of the states, unlike at the record's two ends, rings on, for each of P plants: discrete poles in pairs, one
    (P, K) and the other (P, K), and by themselves (P, M), and how many commands act late."""

    one: Complex
    other: Complex
    single: Complex
    late: int


def _ends_of(terms: Expansion, lines: Lines) -> _Ends:
    """At the lines of n samples z^n = 1, so the free response of a pair of poles, from the first sample on, is z (a + b
    (z - 1)) / ((z - p)(z - conj p)) (Pintelon and Schoukens, System Identification, 2012, 6.3.2); the position and its
    slowest real pole, the rigid body, are such a pair, too; a rigid body on a spring is one by itself. The commands
    that act late act at the record's first samples, where they are those from before it, not those of its end: one term
    z^-j for each. Where the excitation was the same before, neither these nor poles that have died out since are
    unlike. Where a spring was known and the lines were taken off both signals, what they differ by under it is a line
    again, a pole at 1: told by the spring, it would outweigh all that was swept. Plants that have other ends than the
    first, as where a pole dies out between them, are taken to have its.
    """
    poles, discrete = terms.pole, np.exp(terms.pole * lines.ts)
    real = np.abs(poles.imag) <= 1e-9 * np.abs(poles)
    rings = np.abs(poles.real) * lines.settled < DIED_OUT
    upper, alone = (poles.imag > 0) & rings & ~real, real & rings
    slow = np.argmin(np.where(real, np.abs(poles), np.inf), axis=1)[:, None]
    if not terms.sprung:
        alone &= poles != np.take_along_axis(poles, slow, axis=1)
    late = (np.maximum(np.ceil(terms.dead_time / lines.ts), 0).astype(int) + 1) * lines.single
    counts = np.column_stack([np.sum(upper, axis=1), np.sum(alone, axis=1), late])
    source = np.where(np.all(counts == counts[0], axis=1), np.arange(len(poles)), 0)
    discrete, upper, alone, slow = discrete[source], upper[source], alone[source], slow[source]
    one, single = discrete[upper].reshape(len(poles), -1), discrete[alone].reshape(len(poles), -1)
    other, steady = one.conj(), np.ones((len(poles), 1), complex)
    if not terms.sprung:
        one, other = np.hstack([one, steady]), np.hstack([other, np.take_along_axis(discrete, slow, axis=1)])
    elif lines.levelled:
        single = np.hstack([single, steady])
    return _Ends(one, other, single, int(late[0]))


def _columns(ends: _Ends, lines: Lines) -> Array:
    """What a unit of each of the first plant's adds to the weighted errors (2n, c) [1]."""
    back, one, other, single = lines.back[:, None], ends.one[0], ends.other[0], ends.single[0]
    shapes = 1 / ((1 - one * back) * (1 - other * back))
    late = back ** np.arange(ends.late)
    parts = np.hstack([back * shapes, (1 - back) * shapes, 1 / (1 - single * back), late])
    parts *= lines.scale[:, None]
    return np.vstack([parts.real, parts.imag])


def _added(ends: _Ends, sizes: Array, lines: Lines) -> Complex:
    """What `_columns` of each plant times sizes (c,) are, as complex numbers (P, n) [1], but for the commands that act
    late, which are alike in all."""
    one, other, alone = ends.one, ends.other, ends.single
    by_place, by_speed, by_single, _ = np.split(sizes, np.cumsum([one.shape[1], one.shape[1], alone.shape[1]]))
    now, before = np.append(by_speed, by_single), np.append(by_place - by_speed, np.zeros(by_single.size))
    total = fractions(
        np.broadcast_to(now, (len(one), now.size)).astype(complex),
        np.broadcast_to(before, (len(one), now.size)).astype(complex),
        np.hstack([-one - other, -alone]),
        np.hstack([one * other, np.zeros_like(alone)]),
        lines.back,
    )
    return np.asarray(total * lines.scale)


def _spanned(columns: Array) -> tuple[Array, Array]:
    """An orthonormal basis (n, r) of columns (n, c), and the weights (c, r) that make it of them.

    Of columns that are the same but for rounding, as those of a pole that dies out within a sample are, one counts.
    """
    norms = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    q, triangle = np.linalg.qr(columns / norms)
    left, sizes, right = np.linalg.svd(triangle, full_matrices=False)  # there may be more columns than rows
    kept = sizes > MIN_COLUMN_RATIO * sizes[:1]  # where all poles have died out, there is no column
    return q @ left[:, kept], right[kept].T / sizes[kept] / norms[:, None]


def _stacked(values: Complex) -> Array:
    return np.concatenate([values.real, values.imag])


def jacobian(theta: Array, structure: Structure, problem: Problem) -> Array:
    """Slopes (2 N, p) [1] of the residual, by differences; of the projection as Kaufman (1975) has it."""
    steps = np.vstack([np.zeros(theta.size), DERIVATIVE_STEP * np.eye(theta.size)])
    terms = _terms(theta + steps, structure, problem)
    return np.vstack([_slopes(terms, one) for one in problem.lines])


def _slopes(terms: Expansion, lines: Lines) -> Array:
    """Of one response; terms: here, and moved by a step of each of theta."""
    shown = _shown(terms, lines)
    if lines.command is None:
        return _parted((shown[1:] - shown[0]) / DERIVATIVE_STEP)
    ends = _ends_of(terms, lines)
    basis, weights = _spanned(_columns(ends, lines))
    shown += _added(ends, -weights @ (basis.T @ _errors(shown[0], terms.sprung, lines)), lines)
    slopes = _parted((shown[1:] - shown[0]) / DERIVATIVE_STEP)
    return np.asarray(slopes - basis @ (basis.T @ slopes))


def _parted(rows: Complex) -> Array:
    """Complex rows (p, n) as real columns (2n, p)."""
    return np.hstack([rows.real, rows.imag]).T


def refined(start: Array, structure: Structure, problem: Problem, *, evaluations: int = 30) -> Array:
    """theta (p,) [1] by least squares from a start, within `bounds`."""
    low, high = bounds(start, structure, problem)
    room = 1e-9 * np.maximum(1.0, np.abs(high))
    found = scipy.optimize.least_squares(
        residual, np.clip(start, low + room, high - room), jac=jacobian, bounds=(low, high), x_scale="jac",
        args=(structure, problem), max_nfev=evaluations,
    )  # fmt: skip
    return np.asarray(found.x)


def bounds(theta: Array, structure: Structure, problem: Problem) -> tuple[Array, Array]:
    """The least and the greatest theta (p,) [1]. A dead time may come out up to a sample below none."""
    low, high = problem.band
    count = (theta.size - structure.before) // 3
    earliest = -max(problem.unit, *(one.ts for one in problem.lines)) / problem.unit
    spring = _known_spring(problem)
    parts = {
        "lag": (MIN_RELATIVE_PART, high / low),
        "drag": (MIN_RELATIVE_PART * low / high, 1.0),
        "spring": (MIN_RELATIVE_PART, STIFFEST)
        if spring == 0
        else (spring / MAX_SPRING_RATIO, spring * MAX_SPRING_RATIO),
    }
    nuisances = [parts[part] for part in structure.parts]
    each = [(-50.0, 50.0), (math.log(low / 2), math.log(2 * high)), (math.log(LEAST_DAMPING), math.log(MOST_DAMPING))]
    pairs = np.array([(problem.gain - WIDE, problem.gain + WIDE), (earliest, 1e4), *nuisances, *(each * count)])
    return pairs[:, 0], pairs[:, 1]


def _known_spring(problem: Problem) -> float:
    """What theta has of the spring that is known [1], with the rigid body's gain as it starts."""
    return problem.spring * math.exp(problem.gain) / sizes(problem)["spring"]


def trend(structure: Structure, problem: Problem) -> Array:
    """theta [1] of a rigid body alone from magnitude and phase slope, robustly by medians; part of what is late counts
    as lag where there may be one, and a slow drag and a soft spring."""
    delays = []
    for one in problem.lines:
        s2 = -((2 * math.pi * one.f) ** 2)
        phase = np.unwrap(np.angle(one.p * s2))
        phase -= 2 * math.pi * round(float(np.median(phase[: max(phase.size // 5, 1)])) / (2 * math.pi))
        upper = one.f > np.median(one.f)
        delays.append(float(np.median(-phase[upper] / (2 * math.pi * one.f[upper]))) - one.hold / 2)
    late = max(float(np.median(delays)), 0.0) / problem.unit
    low, high = problem.band
    lag = min(max(0.3 * late, 0.1), 0.5 * high / low)
    usual = {"lag": lag, "drag": 0.05 * low / high, "spring": _known_spring(problem) or 0.01}
    return np.array([problem.gain, late - lag * structure.lag, *(usual[part] for part in structure.parts)])


def with_mode(theta: Array, structure: Structure, problem: Problem) -> Array:
    """theta [1] and one mode more: of a grid the one that takes away most of what no change of theta takes away."""
    few = problem.thinned(COARSE)
    plant, beside = decoded(theta, structure, few)
    left, basis = residual(theta, structure, few), _explained(theta, structure, few)
    left = left - basis @ (basis.T @ left)
    best, found = 0.0, (0.0, 0.5 * sum(few.band), DAMPINGS[0])
    low, high = few.band
    grid = np.geomspace(1.05 * low, 0.97 * high, GRID_FREQUENCIES)
    for damping in DAMPINGS:
        columns = np.vstack([_mode_columns(grid, damping, plant.dead_time, beside.lag, one) for one in few.lines])
        columns -= basis @ (basis.T @ columns)
        power, load = np.maximum(np.sum(columns**2, axis=0), 1e-300), columns.T @ left
        i = int(np.argmax(load**2 / power))
        if load[i] ** 2 / power[i] > best:
            best, found = float(load[i] ** 2 / power[i]), (float(-load[i] / power[i]), float(grid[i]), damping)
    gain, natural, damping = found
    return np.concatenate([theta, [gain / math.exp(theta[0]), math.log(natural), math.log(damping)]])


def _explained(theta: Array, structure: Structure, problem: Problem) -> Array:
    """Orthonormal columns (2 N, c): what a change of theta, or of what the ends leave, makes of the residual."""
    terms = _terms(theta[None], structure, problem)
    slopes, row = [jacobian(theta, structure, problem)], 0
    for one in problem.lines:
        if one.command is not None:
            ends = _columns(_ends_of(terms, one), one)
            block = np.zeros((problem.size, ends.shape[1]))
            block[row : row + 2 * one.f.size] = ends
            slopes.append(block)
        row += 2 * one.f.size
    whole = np.hstack(slopes)
    basis, _ = np.linalg.qr(whole / np.maximum(np.linalg.norm(whole, axis=0), 1e-300))
    return np.asarray(basis)


def _mode_columns(natural: Array, damping: float, dead_time: float, lag: float, lines: Lines) -> Array:
    """Weighted responses (2n, g) of modes of gain 1 at natural frequencies (g,) [Hz], behind dead time and lag [s]."""
    upper = np.asarray(2 * math.pi * natural * (-damping + 1j * math.sqrt(1 - damping**2)), complex)
    half = np.asarray(upper / (upper - upper.conj()), complex)[:, None]
    behind = lines.weight / (1 + 2j * math.pi * lines.f * lag)
    both = half * units(upper, lines.f, dead_time, lines.hold)
    both += np.conj(half) * units(np.asarray(upper.conj(), complex), lines.f, dead_time, lines.hold)
    both *= behind
    return np.hstack([both.real, both.imag]).T
