"""How visible an effect is: its distance in noise units from the nearest nominal table.

A predictor is driven by the recorded command and by the friction of the true position; what it misses goes through
the whitening filter of the scale's noise and of a slowly wandering force. The nominal parameters, each within its
tolerance, explain what they can (ridge regression); the norm of the rest is the distance D: a test that knew the
effect's form exactly would gain D^2 in chi-square.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, solve_discrete_are

from studies.blind_trial.sealer import nominal
from studies.blind_trial.sealer.loop import Log
from studies.blind_trial.sealer.nominal import Table
from studies.blind_trial.sealer.schedule import sampled
from studies.blind_trial.sealer.simulate import PARTS, spread

Array = NDArray[np.float64]

WANDER: Final = 2e-3  # of the slow force, from a sample to the next, one standard deviation [N]
SMOOTH: Final = 21  # samples over which a wrong reading is smoothed before friction is looked up there
READ: Final = float(np.hypot(nominal.NOISE, 1e-7 / np.sqrt(12)))  # noise and rounding together [m]


@numba.njit(cache=True, fastmath=True)
def contact_force(path: Array, stiffness: Array, limit: Array, z: Array) -> Array:
    """Force (n,) [N] of a contact's elements (e,), mean over each sample; path: (n, p) [m], p points a sample."""
    n, points = path.shape
    z, out, last = z.copy(), np.zeros(n), 0.0
    for i in range(z.size):
        last += stiffness[i] * z[i]
    for k in range(n):
        for j in range(points):
            x = path[k, j]
            step = (path[k, j + 1] if j + 1 < points else path[min(k + 1, n - 1), 0]) - x
            total = 0.0
            for i in range(z.size):
                at = z[i] + step
                at = min(at, limit[i])
                at = max(at, -limit[i])
                z[i] = at
                total += stiffness[i] * at
            out[k] += 0.5 * (last + total) / points
            last = total
    return out


@numba.njit(cache=True, fastmath=True)
def innovations(a: Array, b: Array, c: Array, gain: Array, force: Array, reading: Array) -> Array:
    """What a stationary filter (states (s,), gain (s,)) misses of the reading (n,) [m], driven by a force (n,) [N]."""
    n, s = force.size, b.size
    state, ahead, out = np.zeros(s), np.zeros(s), np.empty(n)
    for k in range(n):
        miss = reading[k]
        for i in range(s):
            miss -= c[i] * state[i]
        out[k] = miss
        for i in range(s):
            state[i] += gain[i] * miss
        for i in range(s):
            total = b[i] * force[k]
            for j in range(s):
                total += a[i, j] * state[j]
            ahead[i] = total
        state, ahead = ahead, state
    return out


def whitener(table: Table) -> tuple[Array, float]:
    """The filter's gain (2m + 1,), the last for the slow force, and the innovations' deviation [m]."""
    a, b, c = _with_force(table)
    s = a.shape[0]
    q = np.zeros((s, s))
    q[-1, -1] = WANDER**2
    q += 1e-12 * np.outer(np.append(b[:-1], 0), np.append(b[:-1], 0))  # keeps the problem regular
    scale = 1e9  # metres to nanometres, for the solver
    p = solve_discrete_are(a.T, c[:, None] * scale, q, np.array([[(READ * scale) ** 2]]))
    variance = c @ p @ c + READ**2
    return p @ c / variance, float(np.sqrt(variance))


def _with_force(table: Table) -> tuple[Array, Array, Array]:
    a, b, c = sampled(table)
    s = b.size + 1
    whole = np.zeros((s, s))
    whole[:-1, :-1], whole[:-1, -1], whole[-1, -1] = a, b, 1.0
    return whole, np.append(b, 0.0), np.append(c, 0.0)


def applied(command: Array, earlier: Array, late: float) -> Array:
    """Command (n,) [N], mean over each sample, that acts `late` samples after it was put out."""
    whole = int(np.floor(late + 1e-9))
    u, first, part = np.concatenate([earlier, command]), earlier.size - whole, late - whole
    return np.asarray(part * u[first - 1 : first - 1 + command.size] + (1 - part) * u[first : first + command.size])


def seen_path(log: Log) -> Array:
    """Where the friction is looked up (n, POINTS) [m]: the true position, moved by what the scale slowly misreads."""
    wrong = log.reading - log.position[:, 0]
    around = np.convolve(np.pad(wrong, SMOOTH // 2, mode="edge"), np.full(SMOOTH, 1 / SMOOTH), mode="valid")
    return np.asarray(log.position + around[:, None])


@dataclass(frozen=True)
class Missed:
    """Innovations (n,) [m] of one record, and what they change by with each parameter (n, P) and start (n, N)."""

    base: Array
    parameters: Array
    starts: Array


def missed(table: Table, log: Log, gain: Array) -> Missed:
    """What a predictor with this table misses of an exact log, by one tolerance of every nominal parameter."""
    path, (stiffness, limit) = seen_path(log), spread(table)
    contacts, parts = table.limit.size, PARTS.size
    model, late = _with_force(table), table.dead_time / table.sample_time
    nothing = np.zeros(log.command.size)

    def contact(i: int, wider: float = 1.0, moved: float = 0.0) -> Array:
        own = slice(i * parts, (i + 1) * parts)
        start = np.clip(log.start[own] + moved, -wider * limit[own], wider * limit[own])
        return contact_force(path, stiffness[own], wider * limit[own], start)

    def answer(force: Array) -> Array:
        return -innovations(*model, gain, -force, nothing)  # what more friction changes

    held = [contact(i) for i in range(contacts)]
    u = applied(log.command, log.earlier, late)
    force = u - np.sum(held, axis=0) + table.offset
    base = innovations(*model, gain, force, log.reading)
    found = [innovations(*_with_force(other), gain, force, log.reading) - base for other in linear_moves(table)]
    stiff = [nominal.STIFFNESS_EACH * answer(one) for one in held]
    found += [*stiff, nominal.STIFFNESS_ALL / nominal.STIFFNESS_EACH * np.sum(stiff, axis=0)]
    found += [answer(contact(i, wider=1 + nominal.LIMIT) - held[i]) for i in range(contacts)]
    later = applied(log.command, log.earlier, late + nominal.LATENESS / 2 / table.sample_time)
    found += [answer(u - later), answer(np.full(u.size, nominal.OFFSET))]
    starts = []
    for i in range(contacts):
        inward = -np.sign(log.start[i * parts + parts // 2]) * 0.1 * table.limit[i]
        starts.append(answer(contact(i, moved=inward) - held[i]))
    return Missed(base, np.stack(found, axis=1), np.stack(starts, axis=1))


def linear_moves(table: Table) -> list[Table]:
    """The nominal table moved by one tolerance in each parameter of its modes."""

    def off(array: Array, i: int, share: float) -> Array:
        moved = array.copy()
        moved[i] *= 1 + share
        return moved

    m, mass = table.gain.size, float(np.hypot(nominal.MASS, nominal.THRUST))
    return [
        *(replace(table, gain=off(table.gain, i, mass)) for i in range(m)),
        *(replace(table, frequency=off(table.frequency, i, nominal.FREQUENCY)) for i in range(1, m)),
        *(replace(table, damping=off(table.damping, i, nominal.DAMPING)) for i in range(1, m)),
    ]


def distance(table: Table, logs: Sequence[Log]) -> float:
    """D of exact logs (no noise, no rounding) of this table with effects in it, all of them together."""
    gain, deviation = whitener(table)
    found = [missed(table, log, gain) for log in logs]
    whole = np.concatenate([one.base for one in found]) / deviation
    common = np.concatenate([one.parameters for one in found])
    moves = np.hstack([common, block_diag(*(one.starts for one in found))]) / deviation
    penalty = np.concatenate([np.ones(common.shape[1]), np.full(moves.shape[1] - common.shape[1], 0.1)])
    best = np.linalg.solve(moves.T @ moves + np.diag(penalty**2), moves.T @ whole)
    return float(np.sqrt(np.sum((whole - moves @ best) ** 2) + np.sum((penalty * best) ** 2)))
