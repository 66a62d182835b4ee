"""Kalman filter and smoother of a machine's linear part, driven by a known force: what remains is the unknown force.

    x[k+1] = A x[k] + B f[k] + w[k],    y[k] = C x[k] + v[k]

    n, M, m     number of samples, of substeps in a sample interval, of the plant's modes
    x (S,)      state (q_1, q_1', ..., q_m, q_m', d): modal positions [m] and speeds [m/s], and the unknown force d [N];
                behind d two states for each random force (`Resonance`). S = 2 m + 1 without those
    f (M,)      known force [N], thrust less friction, at the middles of the substeps of the interval after sample k; it
                is linear in there, as a fine scale would see friction held over each
    w           process noise, covariance Q: d walks randomly by `walk` [N] per sample, and a white force of standard
                deviation `white_force` [N] acts beside it
    y, v        reading of the scale [m] and its measurement noise, standard deviation `noise` [m], rounding included
    P-, P+      covariance of x before and after the reading y[k], in steady state
    K (S,)      filter gain, P- C' / (C P- C' + noise^2)                        `Predictor.gain`
    G (S, S)    smoother gain, P+ A' (P-)^-1                                    `Predictor.back`
    F (S, S)    transition of the prediction error, A (I - K C)                 `Predictor.closed`
    e (n,)      innovations y - C x-, whitened by their standard deviation      `Predictor.deviation`
                sqrt(C P- C' + noise^2)

All gains are those of the steady state, so that the innovations, and the smoothed states, are linear, time-invariant
filters of (f, y). See T. Kailath, A. Sayed, B. Hassibi, Linear Estimation (2000), chapters 9 and 10.

Where and how fast the table is at a record's first sample, one reading does not tell: it is noisy, and the table may
move. Of a slow filter a wrong start is seen for thousands of samples. Both are fitted to the record
(`likeliest_start`), within what a faster filter leaves open, and changes of the innovations are taken as they are after
that (`beside_start`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, solve_discrete_are

from models.compiled import compiled
from models.plant import Plant, matrices

Array = NDArray[np.float64]

SUBSTEPS: Final = 2  # of a sample interval, the force of which is a straight line through their middles
BLOCK_SAMPLES: Final = 8  # samples that `responses` filters at once
STARTING: Final = 60  # samples at the start of a record in which the state settles; they do not count
FORGOTTEN: Final = 1e-4  # of a wrong start, below which it is not felt any more
MAX_START_SAMPLES: Final = 200_000  # samples for which a wrong start is followed
FREE: Final = 1e3  # units of a wrong start: its deviation where no faster filter tells it
FADED: Final = 1e-100  # [m], [m/s], ...: of a state in `responses`, below which there is none
TOGETHER: Final = 8  # columns that it filters at once, so that its intermediate arrays stay small


@dataclass(frozen=True)
class Resonance:
    """A narrow-band random force, such as a floor's vibration: centre frequency [Hz], bandwidth [Hz] and standard
    deviation `level` [N]."""

    frequency: float
    bandwidth: float
    level: float


@dataclass(frozen=True)
class Predictor:
    """A (S, S), B (S, M), C (S,), the filter gain K (S,), the smoother gain G (S, S), the innovations' standard
    deviation [m]; see the module's head. spread: deviations (2,) of the predicted position [m] and speed [m/s], and
    start_spread those within which a record's start is fitted."""

    A: Array
    B: Array
    C: Array
    gain: Array
    back: Array
    deviation: float
    spread: Array
    start_spread: Array

    @property
    def closed(self) -> Array:
        """F = A (I - K C), (S, S)."""
        return self.A - np.outer(self.A @ self.gain, self.C)

    @property
    def start_units(self) -> Array:
        """What is one unit of a wrong start: a position [m], and a speed that makes as much of it in a sample [m/s]."""
        return np.array([self.deviation, self.deviation / self.A[0, 1]])

    def start_seen(self, samples: int) -> Array:
        """Whitened innovations (K, 2) [1] after the table began one unit beyond where, and faster than, it was said to,
        for as many of the samples as feel it; 0 for the first ones, which do not count."""
        if samples not in self._starts_seen:
            slowest = float(np.max(np.abs(np.linalg.eigvals(self.closed))))
            felt = min(STARTING + int(np.ceil(np.log(FORGOTTEN) / np.log(slowest))), MAX_START_SAMPLES)
            wrong, seen = np.zeros((self.C.size, 2)), np.empty((min(felt, samples), 2))
            wrong[[0, 1], [0, 1]] = -self.start_units
            _released(self.closed, self.C, wrong, seen)
            seen /= self.deviation
            seen[:STARTING] = 0.0
            self._starts_seen[samples] = seen
        return self._starts_seen[samples]

    @cached_property
    def _starts_seen(self) -> dict[int, Array]:
        """What `start_seen` has found, by the number of samples: few lengths, and of a slow filter a long way."""
        return {}


@lru_cache(maxsize=64)
def discretised(plant: Plant, sample_time: float) -> tuple[Array, Array, Array]:
    """(A (S, S), B (S, M), C (S,)) of the module's head; the plant's dead time is left to the force; SI."""
    slope, force, position = matrices(plant)
    n = len(slope)
    exponent = np.zeros((n + 2, n + 2))  # of the plant's state, the force, and its rate in a sample interval
    exponent[:n, :n], exponent[:n, n] = slope * sample_time, force[:, 0] * sample_time
    exponent[n, n + 1] = 1.0
    phi = expm(exponent)
    begins, rises = phi[:n, n], phi[:n, n + 1]
    a = np.eye(n + 1)
    a[:n, :n], a[:n, n] = phi[:n, :n], begins
    b = np.zeros((n + 1, SUBSTEPS))  # by what the line through the two middles is at the start, and by how it rises
    b[:n] = np.column_stack([1.5 * begins - 2.0 * rises, 2.0 * rises - 0.5 * begins])
    return a, b, np.append(position[0], 0.0)


@lru_cache(maxsize=64)
def predictor(
    plant: Plant,
    sample_time: float,
    *,
    walk: float,
    noise: float,
    white_force: float,
    random_forces: tuple[Resonance, ...] = (),
    starting_walk: float | None = None,
) -> Predictor:
    """The steady-state filter for an unknown force that walks by `walk` [N] per sample, with white process noise of
    standard deviation `white_force` [N] and measurement noise [m].

    random_forces: narrow-band random forces; each adds two states behind d, of which the first is the force.
    starting_walk [N]: of the faster filter that knows a record's start, None if none does.
    Results are cached, so that their arrays must not be written to.
    """
    a, b, c = discretised(plant, sample_time)
    walking = len(a) - 1
    held = a[:, walking].copy()
    held[walking] = 0.0
    q = white_force**2 * np.outer(held, held)
    q[walking, walking] += walk**2
    for one in random_forces:
        a, b, c, q = _shaken(one, sample_time, held, (a, b, c, q))
        held = np.append(held, [0.0, 0.0])
    unit = noise  # the Riccati equation is better conditioned with covariances in units of the noise
    before = solve_discrete_are(a.T, c[:, None], q / unit**2, np.eye(1)) * unit**2
    variance = float(c @ before @ c) + noise**2
    gain = before @ c / variance
    after = before - np.outer(gain, c @ before)
    deviation, spread = float(np.sqrt(variance)), np.sqrt(np.diag(before)[:2])
    start = FREE * np.array([deviation, deviation / a[0, 1]])
    if starting_walk is not None and starting_walk > walk:
        start = predictor(plant, sample_time, walk=starting_walk, noise=noise, white_force=white_force).spread
    return Predictor(a, b, c, gain, smoother_gain(a, before, after), deviation, spread, start)


def smoother_gain(a: Array, before: Array, after: Array) -> Array:
    """G (S, S) from A and the covariances (S, S) before and after a reading, SI; each state in its own deviation, so
    that it does not depend on the units which directions count as having no variance."""
    size = np.sqrt(np.maximum(np.diag(before), np.finfo(float).tiny))
    scaled = before / np.outer(size, size)
    return np.asarray(np.linalg.lstsq(scaled.T, (after @ a.T / size).T, rcond=1e-14)[0].T / size)


def _shaken(one: Resonance, sample_time: float, held: Array, system: tuple[Array, ...]) -> tuple[Array, ...]:
    """(A, B, C, Q) extended by the two states of a random force; `held` (S,): the change of the state over one sample
    by a constant force of 1 N."""
    a, b, c, q = system
    n = len(a)
    angle, keep = 2 * np.pi * one.frequency * sample_time, np.exp(-2 * np.pi * one.bandwidth * sample_time)
    more, noise = np.zeros((n + 2, n + 2)), np.zeros((n + 2, n + 2))
    more[:n, :n], noise[:n, :n] = a, q
    more[:n, n] = held
    more[n:, n:] = keep * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    noise[n:, n:] = (1 - keep**2) * one.level**2 * np.eye(2)
    return more, np.vstack([b, np.zeros((2, b.shape[1]))]), np.append(c, [0.0, 0.0]), noise


def innovations(model: Predictor, force: Array, reading: Array, start: Array) -> Array:
    """Innovations e (n,) [m] for a net force (n, M) [N] and a reading (n,) [m], from the initial state `start` (S,)."""
    e = np.empty(reading.size)
    _predict(model.closed, model.A @ model.gain, model.C, force @ model.B.T, reading, start, e)
    return e


def wrong_start(model: Predictor, e: Array) -> Array:
    """By how many units the table began beyond where it was said to be, and faster, (..., 2) [1], as the whitened
    innovations e (..., n) tell it."""
    seen = model.start_seen(e.shape[-1])
    information = seen.T @ seen + np.diag((model.start_units / model.start_spread) ** 2)
    return np.asarray(e[..., : len(seen)] @ seen @ np.linalg.inv(information))


def beside_start(model: Predictor, e: Array) -> Array:
    """Whitened innovations e (..., n) [1], or changes of them, as they are with the start that explains most of them;
    changed in place."""
    seen = model.start_seen(e.shape[-1])
    e[..., : len(seen)] -= wrong_start(model, e) @ seen.T
    return e


def at_rest(model: Predictor, reading: Array) -> Array:
    """The initial state (S,) [SI] of a table that rests where the first of the readings (n,) [m] has it."""
    start = np.zeros(model.C.size)
    start[0] = reading[0]
    return start


def likeliest_start(model: Predictor, force: Array, reading: Array) -> Array:
    """The initial state (S,) [SI] whose position and speed explain the record best, all else at rest; force (n, M) [N],
    reading (n,) [m]."""
    head, start = slice(len(model.start_seen(reading.size))), at_rest(model, reading)
    e = innovations(model, force[head], reading[head], start) / model.deviation
    start[:2] += wrong_start(model, e) * model.start_units
    return start


def responses(model: Predictor, force: Array, reading: Array | None = None) -> Array:
    """Change (n, k) [1] of the whitened innovations by k forces (k, n, M) [N] added to the net force, and by k
    additions (k, n) [m] to the reading; a column's samples are contiguous.

    Filtered in blocks of BLOCK_SAMPLES samples: the effect of a block's inputs within the block is one matrix product
    over all blocks of several columns, so that the recursion runs only over the states at the head of each block.
    """
    count, n, parts = force.shape
    blocks, size = -(-n // BLOCK_SAMPLES), model.C.size
    within, kept, onto, behind = _block(model, model.B)
    own, _, more, _ = _block(model, (model.A @ model.gain)[:, None])
    e, heads = np.empty((count, blocks * BLOCK_SAMPLES)), np.empty((TOGETHER, blocks, size))
    for first in range(0, count, TOGETHER):
        some = slice(first, first + TOGETHER)
        out = e[some].reshape(-1, BLOCK_SAMPLES)
        given = _blocked(force[some].reshape(-1, n * parts), blocks, BLOCK_SAMPLES * parts)
        np.matmul(given, within.T / model.deviation, out=out)
        entering = given @ onto.T
        if reading is not None:
            given = _blocked(np.asarray(reading[some]), blocks, BLOCK_SAMPLES)
            out += given @ ((own + np.eye(BLOCK_SAMPLES)).T / model.deviation)
            entering += given @ more.T
        of_these = heads[: len(out) // blocks]
        _heads(behind, entering.reshape(of_these.shape), of_these)
        out += of_these.reshape(-1, size) @ (kept.T / model.deviation)
    return np.asarray(e[:, :n].T)


def changes(model: Predictor, force: Array, reading: Array | None = None) -> Array:
    """`responses` (n, k) [1] beside the start: the changes of what the innovations are after it was fitted."""
    return beside_start(model, responses(model, force, reading).T).T


def _block(model: Predictor, entry: Array) -> tuple[Array, Array, Array, Array]:
    """Matrices of a block of BLOCK_SAMPLES samples for m inputs per sample that enter the state by `entry` (S, m).

    From the inputs to the block's innovations (BLOCK_SAMPLES, BLOCK_SAMPLES m), from the state at its head to its
    innovations (BLOCK_SAMPLES, S), from the inputs to the state behind it (S, BLOCK_SAMPLES m), from the state at its
    head to that state (S, S).
    """
    parts, closed = entry.shape[1], model.closed
    within, kept = np.zeros((BLOCK_SAMPLES, BLOCK_SAMPLES * parts)), np.empty((BLOCK_SAMPLES, model.C.size))
    onto, power = np.empty((model.C.size, BLOCK_SAMPLES * parts)), np.eye(model.C.size)
    for k in range(BLOCK_SAMPLES):
        kept[k] = -model.C @ power
        power = closed @ power
    reached = entry
    for j in range(BLOCK_SAMPLES):  # j samples after the input
        onto[:, (BLOCK_SAMPLES - 1 - j) * parts : (BLOCK_SAMPLES - j) * parts] = reached
        for k in range(j + 1, BLOCK_SAMPLES):
            within[k, (k - j - 1) * parts : (k - j) * parts] = -model.C @ reached
        reached = closed @ reached
    return within, kept, onto, power


def _blocked(signals: Array, blocks: int, length: int) -> Array:
    """Signals (k, n) as rows (k blocks, length), padded with zeros at the end."""
    count, given = signals.shape
    if given == blocks * length:
        return signals.reshape(-1, length)
    whole = np.empty((count, blocks * length))
    whole[:, :given], whole[:, given:] = signals, 0.0
    return whole.reshape(-1, length)


def adjoint(model: Predictor, e: Array) -> tuple[Array, Array]:
    """Adjoint of `responses`, up to the whitening: (g (n, M), g_y (n,)) such that the inner product of e (n,) with the
    response to a force f is sum(g f), and to an addition r to the reading sum(g_y r). So a thousand candidates are
    compared with e without filtering any of them. g is in [1/N] and g_y in [1/m], times e's unit."""
    mu = np.empty((e.size, model.C.size))
    _adjoint(np.ascontiguousarray(model.closed.T), model.C, e, mu)
    return mu @ model.B, e + mu @ (model.A @ model.gain)


def smoothed(model: Predictor, force: Array, reading: Array, start: Array) -> Array:
    """Smoothed states (n, S) from the whole record, past and future (Rauch, Tung and Striebel 1965); force (n, M)
    [N], reading (n,) [m], initial state `start` (S,)."""
    states = np.empty((reading.size, model.C.size))
    _smooth(model.A, model.gain, model.C, model.back, force @ model.B.T, reading, start, states)
    return states


@compiled
def _predict(closed: Array, enter: Array, C: Array, given: Array, reading: Array, start: Array, e: Array) -> None:
    size, columns = start.size, closed.T.copy()
    now, ahead = start.copy(), np.empty(size)
    for k in range(reading.size):
        y = 0.0
        for i in range(size):
            y += C[i] * now[i]
        e[k] = reading[k] - y
        for i in range(size):
            ahead[i] = given[k, i] + enter[i] * reading[k]
        for j in range(size):  # the inner loop's sums are independent of each other, so that several run at once
            for i in range(size):
                ahead[i] += columns[j, i] * now[j]
        for i in range(size):
            now[i] = ahead[i]


@compiled
def _released(closed: Array, C: Array, states: Array, e: Array) -> None:
    """`_predict` without force and reading, from two states (S, 2) at once; e (n, 2). As their sums do not depend on
    each other, this takes half of the time."""
    size, now, ahead = C.size, states.copy(), np.empty(states.shape)
    for k in range(e.shape[0]):
        of_a = of_b = 0.0
        for i in range(size):
            of_a += C[i] * now[i, 0]
            of_b += C[i] * now[i, 1]
        e[k, 0], e[k, 1] = -of_a, -of_b
        for i in range(size):
            of_a = of_b = 0.0
            for j in range(size):
                of_a += closed[i, j] * now[j, 0]
                of_b += closed[i, j] * now[j, 1]
            ahead[i, 0], ahead[i, 1] = of_a, of_b
        for i in range(size):
            now[i, 0], now[i, 1] = ahead[i, 0], ahead[i, 1]


@compiled
def _heads(behind: Array, entering: Array, heads: Array) -> None:
    """heads[c, b + 1] = behind heads[c, b] + entering[c, b], from rest.

    Four columns at once (the last one repeated where needed), because the additions of one sum depend on one another
    and would stall the processor, while those of four sums are independent.
    """
    count, blocks, size = heads.shape
    heads[:, 0, :] = 0.0
    for first in range(0, count, 4):
        c, d, e, f = first, min(first + 1, count - 1), min(first + 2, count - 1), min(first + 3, count - 1)
        for b in range(blocks - 1):
            for i in range(size):
                of_c, of_d, of_e, of_f = entering[c, b, i], entering[d, b, i], entering[e, b, i], entering[f, b, i]
                for j in range(size):
                    factor = behind[i, j]
                    of_c += factor * heads[c, b, j]
                    of_d += factor * heads[d, b, j]
                    of_e += factor * heads[e, b, j]
                    of_f += factor * heads[f, b, j]
                heads[c, b + 1, i], heads[d, b + 1, i] = _or_none(of_c), _or_none(of_d)
                heads[e, b + 1, i], heads[f, b + 1, i] = _or_none(of_e), _or_none(of_f)


@compiled
def _or_none(value: float) -> float:
    return value if abs(value) > FADED else 0.0


@compiled
def _adjoint(closed_t: Array, C: Array, e: Array, mu: Array) -> None:
    """mu[k] = gradient with respect to what is added to the state at k + 1."""
    size = C.size
    now, before = np.zeros(size), np.empty(size)
    for k in range(e.size - 1, -1, -1):
        for i in range(size):
            mu[k, i] = now[i]
            total = -C[i] * e[k]
            for j in range(size):
                total += closed_t[i, j] * now[j]
            before[i] = total
        for i in range(size):
            now[i] = before[i]


@compiled
def _smooth(
    A: Array, gain: Array, C: Array, back: Array, given: Array, reading: Array, start: Array, states: Array
) -> None:
    """A forward pass of the filter, then a backward pass that replaces the filtered states by the smoothed ones."""
    n, size = states.shape
    predicted = np.empty((n, size))
    now = start.copy()
    for k in range(n):
        y = 0.0
        for i in range(size):
            predicted[k, i] = now[i]
            y += C[i] * now[i]
        for i in range(size):
            states[k, i] = now[i] + gain[i] * (reading[k] - y)
        for i in range(size):
            total = given[k, i]
            for j in range(size):
                total += A[i, j] * states[k, j]
            now[i] = total
    for k in range(n - 2, -1, -1):
        for i in range(size):
            total = states[k, i]
            for j in range(size):
                total += back[i, j] * (states[k + 1, j] - predicted[k + 1, j])
            states[k, i] = total
