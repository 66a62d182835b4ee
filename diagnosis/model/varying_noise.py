"""How likely a record is where the white force beside a machine's linear part varies from sample to sample.

The filter of `kalman`, whose gain follows the covariance as it goes in place of the steady state's: of a force whose
variance is known at every sample its innovations are white and as large as predicted, whatever drives the machine
(T. Kailath, A. Sayed, B. Hassibi, Linear Estimation, 2000, section 9.2).
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from diagnosis.model.kalman import STARTING, likeliest_start
from diagnosis.model.residual import Candidate, Residual, beside_plant
from diagnosis.records.units import noise
from models.compiled import compiled
from models.records.record import Record

Array = NDArray[np.float64]

LANES: Final = (
    8  # sizes that are filtered side by side: as many numbers as a processor adds at once, or a few times that
)


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

    def misfits(self, envelope: Array, sizes: Array) -> Array:
        """-2 log of the likelihood (K,), up to a constant, where the white force's variance is larger by each of the
        sizes (K,) times the envelope (n,) [N^2 together] in the interval after each sample."""
        e, variance = self._filtered(envelope, sizes)
        return np.asarray(np.sum(e**2 / variance + np.log(variance), axis=0))

    def standardised(self, added: Array) -> Array:
        """The innovations (n - STARTING,) over their deviations [1], where the white force's variance is larger by
        `added` (n,) [N^2]."""
        e, variance = self._filtered(added, np.ones(1))
        return np.asarray(e[:, 0] / np.sqrt(variance[:, 0]))

    def _filtered(self, envelope: Array, sizes: Array) -> tuple[Array, Array]:
        """The innovations [m] and their variances [m^2] (n - STARTING, K)."""
        lanes = np.resize(sizes, (-(-sizes.size // LANES), LANES))
        e, variance = np.empty((2, len(lanes), self.reading.size, LANES))
        for some, its_e, its_variance in zip(lanes, e, variance, strict=True):
            _filter(self, envelope, some, its_e, its_variance)
        e, variance = (np.concatenate(list(rows), axis=1)[STARTING:, : sizes.size] for rows in (e, variance))
        return e, variance


def linear_part(candidate: Candidate, record: Record, residual: Residual, index: int, walk: float) -> LinearPart:
    """The linear part of the record of this index under a candidate that has no random forces; walk [usual white forces
    a sample]."""
    model = candidate.predictor(record.sample_time, walk, index)
    reading = record.position - beside_plant(candidate, residual.force, residual.acts, record.sample_time)
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
def _filter(part: LinearPart, envelope: Array, sizes: Array, e: Array, variance: Array) -> None:
    """Writes the innovations [m] and their variances [m^2] (n, LANES) for as many sizes (LANES,) of the envelope (n,).
    The filters run side by side: what is said of one of them below, the last index apart, holds for each."""
    size = part.start.size
    now, P = np.empty((size, LANES)), np.empty((size, size, LANES))  # the state, and its covariance
    onto, spare, moved = np.empty((size, LANES)), np.empty((size, LANES)), np.empty((size, size, LANES))
    force = np.empty(LANES)
    for i in range(size):
        now[i, :] = part.start[i]
        for j in range(size):
            P[i, j, :] = part.covariance[i, j]
    for k in range(envelope.size):
        for one in range(LANES):
            e[k, one], variance[k, one] = part.reading[k], part.noise
            force[one] = part.white + sizes[one] * envelope[k]
        _read(part.C, now, P, onto, spare, e[k], variance[k])
        spare[:, :] = now
        _move(part.A, spare, part.given[k], now)
        _spread(part.A, part.held, force, P, moved)
        for one in range(LANES):
            P[size - 1, size - 1, one] += part.walk**2


@compiled
def _read(C: Array, now: Array, P: Array, onto: Array, gain: Array, e: Array, variance: Array) -> None:
    """State (S, LANES) and covariance (S, S, LANES) after a reading, of which e has the reading itself (LANES,) and
    then the innovation, and variance that of the noise and then of the innovation; onto becomes P C and gain that over
    the variance (S, LANES)."""
    for i in range(C.size):
        for one in range(LANES):
            onto[i, one] = 0.0
        for j in range(C.size):
            if C[j] != 0.0:
                for one in range(LANES):
                    onto[i, one] += C[j] * P[i, j, one]
        for one in range(LANES):
            e[one] -= C[i] * now[i, one]
            variance[one] += C[i] * onto[i, one]
    for i in range(C.size):
        for one in range(LANES):
            gain[i, one] = onto[i, one] / variance[one]
            now[i, one] += gain[i, one] * e[one]
        for j in range(C.size):
            for one in range(LANES):
                P[i, j, one] -= gain[i, one] * onto[j, one]


@compiled
def _move(A: Array, before: Array, given: Array, now: Array) -> None:
    """The state (S, LANES) a sample later than `before`, under known forces that add `given` (S,)."""
    for i in range(given.size):
        for one in range(LANES):
            now[i, one] = given[i]
        for m in range(given.size):
            for one in range(LANES):
                now[i, one] += A[i, m] * before[m, one]


@compiled
def _spread(A: Array, held: Array, force: Array, P: Array, moved: Array) -> None:
    """The covariance (S, S, LANES) a sample later, under a white force of a variance (LANES,) [N^2]; moved becomes A P.
    Most of A is 0: a mode follows from itself and from the force."""
    size = held.size
    rows, moved_rows = P.reshape(size, size * LANES), moved.reshape(size, size * LANES)
    for i in range(size):
        moved_rows[i, :] = 0.0
        for m in range(size):
            if A[i, m] != 0.0:
                for one in range(size * LANES):
                    moved_rows[i, one] += A[i, m] * rows[m, one]
    for i in range(size):
        for j in range(i + 1):
            for one in range(LANES):
                P[i, j, one] = force[one] * held[i] * held[j]
            for m in range(size):
                if A[j, m] != 0.0:
                    for one in range(LANES):
                        P[i, j, one] += A[j, m] * moved[i, m, one]
            P[j, i, :] = P[i, j]
