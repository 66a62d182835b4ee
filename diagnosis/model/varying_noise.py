"""How likely a record is where the white force beside a machine's linear part varies from sample to sample.

The filter of `kalman`, whose gain follows the covariance as it goes in place of the steady state's: of a force whose
variance is known at every sample its innovations are white and as large as predicted, whatever drives the machine
(T. Kailath, A. Sayed, B. Hassibi, Linear Estimation, 2000, section 9.2).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from diagnosis.model.kalman import STARTING, likeliest_start
from diagnosis.model.residual import Candidate, Residual, vibration
from diagnosis.records.units import noise
from models.compiled import compiled
from models.records.record import Record

Array = NDArray[np.float64]


class LinearPart(NamedTuple):
    """A record as a linear system: transition A (S, S) and output C (S,) of the state, whose last entry is the unknown
    force [N] that walks by `walk` [N] a sample; held (S,): the change of the state by 1 N over a sample; what known
    forces add to it (n, S), the reading [m] (n,), the state at the start (S,) and its covariance (S, S); variances of
    the reading's noise [m^2] and of the usual white force [N^2]."""

    A: Array
    C: Array
    held: Array
    given: Array
    reading: Array
    start: Array
    covariance: Array
    noise: float
    white: float
    walk: float

    def misfit(self, added: Array) -> tuple[float, Array]:
        """-2 log of the likelihood, up to a constant, and the standardised innovations (n - STARTING,) [1], where the
        white force's variance is larger by `added` (n,) [N^2] in the interval after each sample."""
        e, variance = np.empty(self.reading.size), np.empty(self.reading.size)
        _filtered(self, added, e, variance)
        e, variance = e[STARTING:], variance[STARTING:]
        return float(np.sum(e**2 / variance + np.log(variance))), e / np.sqrt(variance)


def linear_part(candidate: Candidate, record: Record, residual: Residual, index: int, walk: float) -> LinearPart:
    """The linear part of the record of this index under a candidate that has no random forces; walk [usual white forces
    a sample]."""
    model = candidate.predictor(record.sample_time, walk, index)
    reading = record.position - residual.acts.reading - vibration(candidate, residual.force, record.sample_time)
    deviation, white = noise(candidate.machine), candidate.usual_white_force * candidate.roughness_of(index)
    step, held = walk * candidate.usual_white_force, model.A[:, -1].copy()
    held[-1] = 0.0
    process = white**2 * np.outer(held, held)
    process[-1, -1] += step**2
    before = solve_discrete_are(model.A.T, model.C[:, None], process / deviation**2, np.eye(1)) * deviation**2
    return LinearPart(
        model.A,
        model.C,
        held,
        residual.force @ model.B.T,
        reading,
        likeliest_start(model, residual.force, reading),
        before,
        deviation**2,
        white**2,
        step,
    )


@compiled
def _filtered(part: LinearPart, added: Array, e: Array, variance: Array) -> None:
    """Writes the innovations [m] and their variances [m^2] (n,); added (n,) [N^2]."""
    size, now, P = part.start.size, part.start.copy(), part.covariance.copy()
    onto, ahead, moved = np.empty(size), np.empty(size), np.empty((size, size))
    for k in range(e.size):
        _applied(P, part.C, onto)
        y, v = 0.0, part.noise
        for i in range(size):
            y += part.C[i] * now[i]
            v += part.C[i] * onto[i]
        e[k], variance[k] = part.reading[k] - y, v
        for i in range(size):
            now[i] += onto[i] / v * e[k]
            for j in range(size):
                P[i, j] -= onto[i] * onto[j] / v
        _applied(part.A, now, ahead)
        for i in range(size):
            now[i] = ahead[i] + part.given[k, i]
            _applied(part.A, P[i], moved[i])  # P is symmetric: moved is P A'
        for i in range(size):
            for j in range(size):
                total = (part.white + added[k]) * part.held[i] * part.held[j]
                for m in range(size):
                    total += part.A[i, m] * moved[m, j]
                P[i, j] = total
        P[size - 1, size - 1] += part.walk**2


@compiled
def _applied(matrix: Array, vector: Array, out: Array) -> None:
    """out (S,) = matrix (S, S) vector (S,)."""
    for i in range(out.size):
        total = 0.0
        for j in range(out.size):
            total += matrix[i, j] * vector[j]
        out[i] = total
