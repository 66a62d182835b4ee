"""The friction's displacement at the start of a record, searched: whether an element ever slips is no smooth question.

An element's force depends on its start only until it first slips; elements do not act on each other. So the response to
every start on a grid is computed once, and combinations are then compared by small algebra, theta's other entries
adapted each time. Which combinations there are is known: the elements have seen the same moves. Displacement over limit
is a curve from zero whose slope is 1 or -1 but where the last moves reversed (the stop operator's memory: M. Brokate,
J. Sprekels, Hysteresis and Phase Transitions, 1996, section 2.3), so a few reversals tell all starts.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.model.fit import Fit
from diagnosis.model.kalman import SUBSTEPS, responses
from diagnosis.model.parallel import beside
from diagnosis.model.parameters import Parameters, initial_state
from diagnosis.model.residual import Candidate, held
from models.compiled import compiled
from models.friction import deflections
from models.records.record import Record

Array = NDArray[np.float64]

GRID: Final = 9  # starts of an element, from limit to limit
REVERSALS: Final = 4  # of the moves before the record that are still remembered
BEST: Final = 8  # combinations that are refined
ROUNDS: Final = 20  # through all pairs of slopes
SLOPES: Final = np.linspace(-1, 1, 9)  # that are tried for each step from a limit to the next
TAIL: Final = 1000  # samples behind the last slip that still count


def balanced(layout: Parameters, records: Sequence[Record]) -> Array:
    """theta (P,) with nothing wrong, but starts [m] that hold each record's first commands, loaded all one way."""
    theta, friction = np.zeros(layout.count), layout.machine.friction
    k, limit = np.array(friction.stiffness), np.array(friction.limit)
    rising = np.linspace(-1, 1, 2001) * limit.max()
    force = np.clip(rising[:, None], -limit, limit) @ k
    starts = [np.interp(held(record), force, rising) for record in records]
    theta[layout.of("initial_friction_state")] = np.concatenate([np.clip(x, -limit, limit) for x in starts])
    return theta


def search(fitted: Fit, records: Sequence[Record]) -> Candidate:
    """The fit's candidate with the best starts that moves before the records can have left."""
    candidate, layout = fitted.candidate, fitted.candidate.layout
    theta, starts = candidate.theta.copy(), layout.of("initial_friction_state").reshape(layout.records, -1)
    begin = np.cumsum([0, *(record.position.size for record in records)])
    best = beside(partial(_of_record, fitted), records, range(len(records)), begin[:-1], starts)
    theta[starts.ravel()] = np.concatenate(list(best))
    return replace(candidate, theta=theta)


def _of_record(fitted: Fit, record: Record, index: int, begin: int, where: NDArray[np.int64]) -> Array:
    """Displacements (N,) [m] for one record, whose samples begin at `begin` in the fit's arrays."""
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
    columns = responses(candidate.predictor(record.sample_time, fitted.walk), force)
    part = slice(begin, begin + n)
    others = np.setdiff1d(np.arange(layout.count), where)
    basis = fitted.slopes[part][:, others] * layout.deviation[others]
    return best_starts(limit, *_normal(columns, basis, fitted.innovations[part]))


def _normal(columns: Array, basis: Array, e: Array) -> tuple[Array, Array]:
    """Gram matrix and slopes of columns (n, C), to which the basis (n, B) adapts."""
    normal = basis.T @ basis + np.eye(basis.shape[1])
    along, onto = basis.T @ columns, basis.T @ e
    gram = columns.T @ columns - along.T @ np.linalg.solve(normal, along)
    return gram, columns.T @ e - along.T @ np.linalg.solve(normal, onto)


def best_starts(limit: Array, gram: Array, slope: Array) -> Array:
    """The displacements (N,) [m] that leave the least; gram (GRID N, GRID N), slope (GRID N,): see `_cost`."""
    order = np.argsort(limit)
    steps = np.diff(limit[order], prepend=0.0)
    patterns = np.array(list(_patterns(limit.size)))
    costs = np.array([_cost(slopes, steps, order, limit, gram, slope) for slopes in patterns])
    least, chosen = np.inf, patterns[0]
    for i in np.argsort(costs, kind="stable")[:BEST]:
        refined = patterns[i].copy()
        cost = _refine(refined, SLOPES, steps, order, limit, gram, slope, ROUNDS)
        if cost < least:
            least, chosen = cost, refined
    return _starts(chosen, steps, order)


def _patterns(count: int) -> list[Array]:
    """Slopes (N,) of 1 and -1 of displacement over limit, with few reversals."""
    found = []
    for reversals in range(min(REVERSALS, count - 1) + 1):
        for places in itertools.combinations(range(1, count), reversals):
            turned = np.zeros(count)
            turned[list(places)] = 1
            slopes = 1.0 - 2.0 * (np.cumsum(turned) % 2)
            found += [slopes, -slopes]
    return found


@compiled
def _starts(slopes: Array, steps: Array, order: NDArray[np.int64]) -> Array:
    """Displacements (N,) [m] from slopes (N,) over limits that are `steps` apart."""
    z, at = np.empty(slopes.size), 0.0
    for i in range(slopes.size):
        at += slopes[i] * steps[i]
        z[order[i]] = at
    return z


@compiled
def _cost(slopes: Array, steps: Array, order: NDArray[np.int64], limit: Array, gram: Array, slope: Array) -> float:
    """Chi-square beside staying; columns between those of the grid by interpolation."""
    count = limit.size
    z = _starts(slopes, steps, order)
    place, part = np.empty(2 * count, np.int64), np.empty(2 * count)
    for i in range(count):
        at = (z[i] / limit[i] + 1.0) / 2.0 * (GRID - 1)
        low = min(max(int(at), 0), GRID - 2)
        place[2 * i], place[2 * i + 1] = low * count + i, (low + 1) * count + i
        part[2 * i], part[2 * i + 1] = 1.0 - (at - low), at - low
    total = 0.0
    for a in range(2 * count):
        row = 2.0 * slope[place[a]]
        for b in range(2 * count):
            row += part[b] * gram[place[a], place[b]]
        total += part[a] * row
    return total


@compiled
def _refine(
    slopes: Array,
    values: Array,
    steps: Array,
    order: NDArray[np.int64],
    limit: Array,
    gram: Array,
    slope: Array,
    rounds: int,
) -> float:
    """Exchanges two slopes at a time, in place, until nothing is gained; the cost."""
    best = _cost(slopes, steps, order, limit, gram, slope)
    for _ in range(rounds):
        before = best
        for i in range(slopes.size):
            for j in range(i + 1, slopes.size):
                first, second = slopes[i], slopes[j]
                for one in values:
                    for other in values:
                        slopes[i], slopes[j] = one, other
                        cost = _cost(slopes, steps, order, limit, gram, slope)
                        if cost < best - 1e-9:
                            best, first, second = cost, one, other
                slopes[i], slopes[j] = first, second
        if best > before - 1e-6:
            break
    return best
