"""The friction's displacement at the start of a record, searched: whether an element ever slips is no smooth question.

An element's force depends on its start only until it first slips; elements do not act on each other. So the response to
every start on a grid is computed once, and the best combination found by exchanging the starts of two elements at a
time, theta's other entries adapted each time.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.fit import Fit
from diagnosis.kalman import SUBSTEPS, predictor, responses
from diagnosis.nominal import Parameters, initial_state
from diagnosis.residual import Candidate, held, noise
from models.friction import deflections
from models.record import Record

Array = NDArray[np.float64]

GRID: Final = 9  # starts of an element, from limit to limit
ROUNDS: Final = 20  # through all pairs of elements
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
    """The fit's candidate with the best starts on the grid, where they leave less than its own."""
    candidate, layout = fitted.candidate, fitted.candidate.layout
    theta, begin = candidate.theta.copy(), 0
    for i, record in enumerate(records):
        where = layout.of("initial_friction_state").reshape(layout.records, -1)[i]
        theta[where] = _of_record(fitted, record, i, begin, where)
        begin += record.position.size
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
    model = predictor(
        machine.plant, record.sample_time, walk=fitted.walk, noise=noise(machine), shaken=candidate.shaken
    )
    columns = responses(model, force) / model.deviation
    part = slice(begin, begin + n)
    others = np.setdiff1d(np.arange(layout.count), where)
    basis = fitted.slopes[part][:, others] * layout.deviation[others]
    chosen = _best(columns, basis, fitted.innovations[part], limit.size)
    picked = [now[i] if choice < 0 else starts[choice, i] for i, choice in enumerate(chosen)]
    return np.array(picked)


def _best(columns: Array, basis: Array, e: Array, elements: int) -> list[int]:
    """The grid's entry for each element, -1 for staying; columns (n, GRID N), the basis (n, B) adapts each time."""
    normal = basis.T @ basis + np.eye(basis.shape[1])
    along, onto = basis.T @ columns, basis.T @ e
    gram = columns.T @ columns - along.T @ np.linalg.solve(normal, along)
    slope = columns.T @ e - along.T @ np.linalg.solve(normal, onto)
    entry = np.vstack([np.full(elements, -1), np.arange(columns.shape[1]).reshape(GRID, elements)])  # -1: stays
    chosen, alone, pairs = np.zeros(elements, int), np.pad(2 * slope + np.diag(gram), (0, 1)), np.pad(gram, (0, 1))
    for _ in range(ROUNDS):
        before = chosen.copy()
        for i, j in itertools.combinations(range(elements), 2):
            rest = [entry[choice, m] for m, choice in enumerate(chosen) if m not in (i, j)]
            first, second = (
                alone[own] + 2 * pairs[np.ix_(own, rest)].sum(axis=1) for own in (entry[:, i], entry[:, j])
            )
            both = first[:, None] + second + 2 * pairs[np.ix_(entry[:, i], entry[:, j])]
            if both.min() < both[chosen[i], chosen[j]] - 1e-9:
                chosen[i], chosen[j] = np.unravel_index(np.argmin(both), both.shape)
        if np.array_equal(before, chosen):
            break
    return [int(choice) - 1 for choice in chosen]
