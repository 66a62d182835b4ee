"""The friction elements' displacements at the start of a record, found by a search: whether an element ever slips makes
the cost non-smooth.

An element's force depends on its initial displacement only until it first slips, and elements do not act on each other.
So the response to every start on a grid is computed once, and combinations are compared through their normal equations,
in which the other entries of theta adapt each time. Few combinations are possible, since all elements have made the
same moves: displacement over limit is a curve from zero whose slope is 1 or -1, except where the last moves reversed
(the memory of the stop operator: M. Brokate, J. Sprekels, Hysteresis and Phase Transitions, 1996, section 2.3).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from diagnosis.model.fit import Fit
from diagnosis.model.kalman import SUBSTEPS, changes
from diagnosis.model.parallel import parallel_map
from diagnosis.model.parameters import Parameters, initial_state
from diagnosis.model.residual import Candidate, initial_command
from diagnosis.records.units import friction_force, white_force
from models.compiled import compiled, inlined
from models.friction import deflections
from models.machine import Machine
from models.records.record import Record

Array = NDArray[np.float64]

START_POINTS: Final = (9, 33)  # initial displacements of an element that are computed, from limit to limit
COLUMNS: Final = 270  # responses that are computed at most where more points than the fewest are wanted
FINE_FORCE_SHARE: Final = 1e-3  # of the friction: the white force that the reading's noise makes of it
REVERSALS: Final = 4  # reversals before the record that the elements may still remember
REFINED: Final = 8  # combinations that are refined, the best ones
MAX_PASSES: Final = 20  # passes through all pairs of slopes at most
SLOPES: Final = np.linspace(-1, 1, 9)  # slopes that are tried between one limit and the next
COARSEST, FINEST = 0.125, 2e-3  # steps by which a slope is moved in the end
TAIL: Final = 1000  # samples after the last slip that still count


class StartCost(NamedTuple):
    """The chi-square of a record as a quadratic function of the elements' initial displacements, the elements by
    increasing limit.

    limit (N,) [m]; steps (N,) [m]: the differences of the limits; gram (N, p, N, p) and slope (N, p) [1]: the normal
    equations of the responses to each of p starts on the grid, of which those between two points of the grid are
    interpolated.
    """

    limit: Array
    steps: Array
    gram: Array
    slope: Array


class Fixed(NamedTuple):
    """The elements below one that moves: the displacement [m] of the last of them, and the slope (N, p) [1] of the
    chi-square by each start of the others beside them, which is written to."""

    displacement: float
    slope: Array


class Places(NamedTuple):
    """Where the elements' displacements lie on their grids: the points (N,) below, and the shares (N,) [1] of those
    above."""

    low: NDArray[np.int64]
    share: Array


def static_equilibrium_start(layout: Parameters, records: Sequence[Record]) -> Array:
    """Initial element deflections in static equilibrium with each record's first command, all deflected in one
    direction, as theta (P,) [SI] whose other entries are nominal."""
    theta, friction = np.zeros(layout.count), layout.machine.friction
    k, limit = np.array(friction.stiffness), np.array(friction.limit)
    deflection = np.linspace(-1, 1, 2001) * limit.max()
    force = np.clip(deflection[:, None], -limit, limit) @ k
    common = [np.interp(initial_command(record), force, deflection) for record in records]
    theta[layout.of("initial_friction_state")] = np.concatenate([np.clip(x, -limit, limit) for x in common])
    return theta


def search(fitted: Fit, records: Sequence[Record]) -> Candidate:
    """The fit's candidate with the best initial displacements that moves before the records can have left."""
    candidate, layout = fitted.candidate, fitted.candidate.layout
    theta, starts = candidate.theta.copy(), layout.of("initial_friction_state").reshape(layout.records, -1)
    begin = np.cumsum([0, *(record.position.size for record in records)])
    best = parallel_map(partial(_of_record, fitted), records, range(len(records)), begin[:-1], starts)
    theta[starts.ravel()] = np.concatenate(list(best))
    return replace(candidate, theta=theta)


def has_fine_scale(machine: Machine) -> bool:
    """Whether the scale resolves the friction finely."""
    return white_force(machine) < FINE_FORCE_SHARE * friction_force(machine)


def _points(machine: Machine) -> int:
    """How many initial displacements of each element are computed. Between two of them an element would slip a little
    earlier or later than the interpolation has it; a fine scale sees that. Two contacts may change places with a third
    whose stiffness is their sum: with 9 points the search mistook them on a drawn machine (2,550 of chi-square, an
    innovation of 10 deviations), with 17 it did not."""
    fewest, most = START_POINTS
    return int(np.clip(COLUMNS // len(machine.friction.limit), fewest, most)) if has_fine_scale(machine) else fewest


def _of_record(fitted: Fit, record: Record, index: int, begin: int, where: NDArray[np.int64]) -> Array:
    """Displacements (N,) [m] for one record, whose samples begin at `begin` in the fit's arrays and whose starts stand
    at `where` in theta."""
    candidate, layout, machine = fitted.candidate, fitted.candidate.layout, fitted.candidate.machine
    points, position = _points(candidate.nominal), fitted.paths[index].path.position.ravel()
    k, limit = np.array(machine.friction.stiffness), np.array(machine.friction.limit)
    now = initial_state(layout, candidate.theta, index)
    apart = np.flatnonzero(np.any(deflections(limit, position, limit) != deflections(limit, position, -limit), axis=1))
    n = min((apart[-1] // SUBSTEPS if apart.size else 0) + TAIL, record.position.size)
    force, position = np.empty((points * limit.size, n, SUBSTEPS)), position[: n * SUBSTEPS]
    base = deflections(limit, position, now)
    for start, given in zip(np.linspace(-1, 1, points), np.split(force, points), strict=True):
        given.reshape(limit.size, -1).T[:] = k * (base - deflections(limit, position, start * limit))
    model = candidate.predictor(record.sample_time, fitted.walk, index)
    columns = changes(model, force)
    part = slice(begin, begin + n)
    others = np.setdiff1d(np.arange(layout.count), where)
    basis = fitted.slopes[part][:, others] * layout.deviation[others]
    return best_starts(limit, *_normal(columns, basis, fitted.innovations[part]))


def _normal(columns: Array, basis: Array, e: Array) -> tuple[Array, Array]:
    """Gram matrix (C, C) and slopes (C,) of columns (n, C) after the basis (n, B), with a unit prior, has adapted."""
    normal = basis.T @ basis + np.eye(basis.shape[1])
    along, onto = basis.T @ columns, basis.T @ e
    gram = columns.T @ columns - along.T @ np.linalg.solve(normal, along)
    return gram, columns.T @ e - along.T @ np.linalg.solve(normal, onto)


def best_starts(limit: Array, gram: Array, slope: Array) -> Array:
    """The displacements (N,) [m] with the least chi-square; limit (N,) [m], gram (p N, p N) and slope (p N,) [1]: the
    normal equations of the responses, all elements at the first of p points of the grid, then at the next."""
    order, count, points = np.argsort(limit), limit.size, slope.size // limit.size
    by_element = (np.arange(points) * count + order[:, None]).ravel()
    problem = StartCost(
        limit[order],
        np.diff(limit[order], prepend=0.0),
        np.ascontiguousarray(gram[np.ix_(by_element, by_element)]).reshape(count, points, count, points),
        slope[by_element].reshape(count, points),
    )
    patterns = _patterns(count)
    costs = _costs(patterns, problem)
    least, best = np.inf, patterns[0]
    for i in np.argsort(costs, kind="stable")[:REFINED]:
        slopes = patterns[i].copy()
        _refine(slopes, problem)
        cost = _polish(slopes, problem)
        if cost < least:
            least, best = cost, slopes
    displacements = np.empty(count)
    displacements[order] = np.cumsum(best * problem.steps)
    return displacements


def _patterns(count: int) -> Array:
    """The curves of displacement over limit with slopes (k, N) of 1 and -1 and few reversals."""
    patterns = []
    for reversals in range(min(REVERSALS, count - 1) + 1):
        places = np.array(list(itertools.combinations(range(1, count), reversals)), np.int64)
        turned = np.zeros((len(places), count), np.int64)
        np.put_along_axis(turned, places, 1, axis=1)
        slopes = 1.0 - 2.0 * (np.cumsum(turned, axis=1) % 2)
        patterns.append(np.stack([slopes, -slopes], axis=1).reshape(-1, count))
    return np.concatenate(patterns)


@inlined
def _placed(displacement: float, limit: float, points: int) -> tuple[int, float]:
    """Where a displacement [m] lies on an element's grid: the point below, and the share [1] of the one above."""
    at = (displacement / limit + 1.0) / 2.0 * (points - 1)
    low = min(max(int(at), 0), points - 2)
    return low, at - low


@compiled
def _costs(patterns: Array, problem: StartCost) -> Array:
    """Change in chi-square (k,) [1] against the present start, for each of k rows of slopes (k, N)."""
    count = problem.limit.size
    costs, places = np.empty(len(patterns)), Places(np.empty(count, np.int64), np.empty(count))
    for i in range(costs.size):
        costs[i] = _cost_from(0, patterns[i], Fixed(0.0, problem.slope), problem, places)
    return costs


@compiled
def _cost_from(first: int, slopes: Array, fixed: Fixed, problem: StartCost, places: Places) -> float:
    """Change in chi-square by the elements from `first` on, beside those below it; places: written to."""
    total, at = 0.0, fixed.displacement
    low, share = places.low, places.share
    for k in range(first, problem.limit.size):
        at += slopes[k] * problem.steps[k]
        low[k], share[k] = _placed(at, problem.limit[k], problem.slope.shape[1])
        below = above = 0.0
        for j in range(first, k):
            a, b, s = problem.gram[k, low[k], j], problem.gram[k, low[k] + 1, j], share[j]
            below += (1.0 - s) * a[low[j]] + s * a[low[j] + 1]
            above += (1.0 - s) * b[low[j]] + s * b[low[j] + 1]
        total += 2.0 * ((1.0 - share[k]) * below + share[k] * above)
        total += _own_cost(k, low[k], share[k], fixed, problem)
    return total


@inlined
def _own_cost(k: int, low: int, share: float, fixed: Fixed, problem: StartCost) -> float:
    """Change in chi-square by the element k, beside those that are fixed."""
    own, slope = problem.gram[k, :, k], fixed.slope[k]
    below = slope[low] + 0.5 * ((1.0 - share) * own[low, low] + share * own[low, low + 1])
    above = slope[low + 1] + 0.5 * ((1.0 - share) * own[low + 1, low] + share * own[low + 1, low + 1])
    cost: float = 2.0 * ((1.0 - share) * below + share * above)
    return cost


@compiled
def _with(k: int, slope: float, fixed: Fixed, problem: StartCost) -> tuple[float, Fixed]:
    """The element k, with its slope, among those that are fixed: the change in chi-square by it, and all of them."""
    at, points = fixed.displacement + slope * problem.steps[k], problem.slope.shape[1]
    low, share = _placed(at, problem.limit[k], points)
    cost = _own_cost(k, low, share, fixed, problem)
    for i in range(k + 1, problem.limit.size):
        for j in range(points):
            row = problem.gram[i, j, k]
            fixed.slope[i, j] += (1.0 - share) * row[low] + share * row[low + 1]
    return cost, Fixed(at, fixed.slope)


@compiled
def _polish(slopes: Array, problem: StartCost) -> float:
    """Improves one slope (N,) after another, in place, by ever smaller steps; the cost. One slope moves all elements
    above it alike, as an unrecorded move between two limits did."""
    places = Places(np.empty(slopes.size, np.int64), np.empty(slopes.size))
    nothing = Fixed(0.0, problem.slope)
    cost, step = _cost_from(0, slopes, nothing, problem, places), COARSEST
    while step > FINEST:
        before = cost
        for i in range(slopes.size):
            for moved in (slopes[i] - step, slopes[i] + step):
                kept, slopes[i] = slopes[i], min(max(moved, -1.0), 1.0)
                tried = _cost_from(0, slopes, nothing, problem, places)
                if tried < cost - 1e-9:
                    cost = tried
                else:
                    slopes[i] = kept
        if cost > before - 1e-6:
            step /= 2.0
    return cost


@compiled
def _refine(slopes: Array, problem: StartCost) -> float:
    """Improves two slopes (N,) at a time, in place, until no pair gains; the cost."""
    places = Places(np.empty(slopes.size, np.int64), np.empty(slopes.size))
    cost = _cost_from(0, slopes, Fixed(0.0, problem.slope), problem, places)
    for _ in range(MAX_PASSES):
        before, below, fixed = cost, 0.0, Fixed(0.0, problem.slope.copy())
        for i in range(slopes.size):
            cost = _refine_with(i, slopes, cost, below, fixed, problem, places)
            more, fixed = _with(i, slopes[i], fixed, problem)
            below += more
        if cost > before - 1e-6:
            break
    return cost


@compiled
def _refine_with(
    i: int, slopes: Array, cost: float, below: float, fixed: Fixed, problem: StartCost, places: Places
) -> float:
    """Sets the slopes i and j to the best pair of SLOPES, where that is better than they are, for one j > i after
    another; the cost. below: the part of the cost by the elements below i, which are fixed.

    What the elements below j make of each slope of i is kept from one j to the next."""
    displacement, sums = np.empty(SLOPES.size), np.empty(SLOPES.size)
    beside = np.empty((SLOPES.size, *problem.slope.shape))
    for a in range(SLOPES.size):
        beside[a] = fixed.slope
        more, with_i = _with(i, SLOPES[a], Fixed(fixed.displacement, beside[a]), problem)
        displacement[a], sums[a] = with_i.displacement, below + more
    for j in range(i + 1, slopes.size):
        first, second = slopes[i], slopes[j]
        for a in range(SLOPES.size):
            for other in SLOPES:
                slopes[j] = other
                tried = sums[a] + _cost_from(j, slopes, Fixed(displacement[a], beside[a]), problem, places)
                if tried < cost - 1e-9:
                    cost, first, second = tried, SLOPES[a], other
        slopes[i], slopes[j] = first, second
        for a in range(SLOPES.size):
            more, with_j = _with(j, second, Fixed(displacement[a], beside[a]), problem)
            displacement[a], sums[a] = with_j.displacement, sums[a] + more
    return cost
