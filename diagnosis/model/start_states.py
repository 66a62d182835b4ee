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
from diagnosis.model.kalman import SUBSTEPS, responses
from diagnosis.model.parallel import parallel_map
from diagnosis.model.parameters import Parameters, initial_state
from diagnosis.model.residual import Candidate, initial_command
from models.compiled import compiled
from models.friction import deflections
from models.records.record import Record

Array = NDArray[np.float64]

GRID: Final = 9  # initial displacements of an element that are computed, from limit to limit
REVERSALS: Final = 4  # reversals before the record that the elements may still remember
REFINED: Final = 8  # combinations that are refined, the best ones
ROUNDS: Final = 20  # passes through all pairs of slopes at most
SLOPES: Final = np.linspace(-1, 1, 9)  # slopes that are tried between one limit and the next
TAIL: Final = 1000  # samples after the last slip that still count


class StartCost(NamedTuple):
    """The chi-square of a record as a quadratic function of the elements' initial displacements.

    limit (N,) [m] of each element; order (N,): the elements by increasing limit; steps (N,) [m]: the differences of
    the limits in that order; gram (GRID N, GRID N) and slope (GRID N,) [1]: the normal equations of the responses to
    each start on the grid, of which those between two points of the grid are interpolated.
    """

    limit: Array
    order: NDArray[np.int64]
    steps: Array
    gram: Array
    slope: Array


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


def _of_record(fitted: Fit, record: Record, index: int, begin: int, where: NDArray[np.int64]) -> Array:
    """Displacements (N,) [m] for one record, whose samples begin at `begin` in the fit's arrays and whose starts stand
    at `where` in theta."""
    candidate, layout, machine = fitted.candidate, fitted.candidate.layout, fitted.candidate.machine
    points = fitted.paths[index].path.position.ravel()
    k, limit = np.array(machine.friction.stiffness), np.array(machine.friction.limit)
    now = initial_state(layout, candidate.theta, index)
    starts = np.linspace(-1, 1, GRID)[:, None] * limit
    base = deflections(limit, points, now)
    changed = np.stack([(deflections(limit, points, start) - base).T for start in starts])  # (GRID, N, n M)
    apart = np.flatnonzero(np.any(changed != 0, axis=(0, 1)))
    n = min((apart[-1] // SUBSTEPS if apart.size else 0) + TAIL, record.position.size)
    force = -(changed[:, :, : n * SUBSTEPS] * k[:, None]).reshape(GRID * limit.size, n, SUBSTEPS)
    columns = responses(candidate.predictor(record.sample_time, fitted.walk, index), force)
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
    """The displacements (N,) [m] with the least chi-square; limit (N,) [m], gram, slope: see `StartCost`."""
    order = np.argsort(limit)
    problem = StartCost(limit, order, np.diff(limit[order], prepend=0.0), gram, slope)
    patterns = np.array(list(_patterns(limit.size)))
    costs = np.array([_cost(slopes, problem) for slopes in patterns])
    least, best = np.inf, patterns[0]
    for i in np.argsort(costs, kind="stable")[:REFINED]:
        slopes = patterns[i].copy()
        cost = _refine(slopes, problem)
        if cost < least:
            least, best = cost, slopes
    return _displacements(best, problem)


def _patterns(count: int) -> list[Array]:
    """The curves of displacement over limit with slopes (N,) of 1 and -1 and few reversals."""
    patterns = []
    for reversals in range(min(REVERSALS, count - 1) + 1):
        for places in itertools.combinations(range(1, count), reversals):
            turned = np.zeros(count)
            turned[list(places)] = 1
            slopes = 1.0 - 2.0 * (np.cumsum(turned) % 2)
            patterns += [slopes, -slopes]
    return patterns


@compiled
def _displacements(slopes: Array, problem: StartCost) -> Array:
    """Displacements (N,) [m] whose curve over the limit has the slopes (N,) [1]."""
    displacements, at = np.empty(slopes.size), 0.0
    for i in range(slopes.size):
        at += slopes[i] * problem.steps[i]
        displacements[problem.order[i]] = at
    return displacements


@compiled
def _cost(slopes: Array, problem: StartCost) -> float:
    """Change in chi-square against the present start; responses between points of the grid are interpolated."""
    count = problem.limit.size
    displacements = _displacements(slopes, problem)
    column, weight = np.empty(2 * count, np.int64), np.empty(2 * count)
    for i in range(count):
        at = (displacements[i] / problem.limit[i] + 1.0) / 2.0 * (GRID - 1)
        low = min(max(int(at), 0), GRID - 2)
        column[2 * i], column[2 * i + 1] = low * count + i, (low + 1) * count + i
        weight[2 * i], weight[2 * i + 1] = 1.0 - (at - low), at - low
    total = 0.0
    for a in range(2 * count):
        row = 2.0 * problem.slope[column[a]]
        for b in range(2 * count):
            row += weight[b] * problem.gram[column[a], column[b]]
        total += weight[a] * row
    return total


@compiled
def _refine(slopes: Array, problem: StartCost) -> float:
    """Improves two slopes (N,) at a time, in place, until no pair gains; the cost."""
    cost = _cost(slopes, problem)
    for _ in range(ROUNDS):
        before = cost
        for i in range(slopes.size):
            for j in range(i + 1, slopes.size):
                cost = _refine_pair(slopes, i, j, cost, problem)
        if cost > before - 1e-6:
            break
    return cost


@compiled
def _refine_pair(slopes: Array, i: int, j: int, cost: float, problem: StartCost) -> float:
    """Sets the slopes i and j to the best pair of SLOPES, where that is better than they are; the cost."""
    first, second = slopes[i], slopes[j]
    for one in SLOPES:
        for other in SLOPES:
            slopes[i], slopes[j] = one, other
            tried = _cost(slopes, problem)
            if tried < cost - 1e-9:
                cost, first, second = tried, one, other
    slopes[i], slopes[j] = first, second
    return cost
