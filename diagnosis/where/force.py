"""The unknown force in a record: what a smoother adds to the fitted model's forces, with its band, and what repeats.

Two settings see different things: a slow force keeps drifts that a fast one swallows as noise, a fast one follows what
happens within milliseconds. Between them is the likeliest setting: how far the force walks a sample as the innovations
show it, which is what a stochastic grey-box model estimates as its diffusion (Kristensen, Madsen and Jorgensen 2004).
n samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from diagnosis.model.fit import Fit
from diagnosis.model.kalman import JITTER, SUBSTEPS, Predictor, discretised, innovations, smoothed
from diagnosis.model.motions import Piece, repeated, rms, scatter
from diagnosis.model.residual import AGAIN, STARTING, Candidate, modal, noise, seeing
from models.plant import Plant
from models.records.record import Record

Array = NDArray[np.float64]

SLOW: Final = 4e-3  # [N a sample] of the unknown force's walk
FAST: Final = 0.3  # [N a sample]
WALKS: Final = tuple(np.geomspace(2e-3, 2.0, 13))  # [N a sample], of which the likeliest is taken
REACH: Final = 4000  # samples over which the smoother answers to one reading
DOUBLINGS: Final = 40  # of the samples that the smoother's recursion runs over


@dataclass(frozen=True)
class Force:
    """The unknown force d (n,) [N] of each record, for a walk [N a sample]; deviation [N] of it as the smoother states
    it, steady; noise [N]: what of d's deviation the scale's noise alone would give."""

    walk: float
    values: tuple[Array, ...]
    deviation: float
    noise: float


@dataclass(frozen=True)
class Floor:
    """What no deterministic effect can close, as deviations: force [N], position [m], whitened innovations [1].

    source: "repeats" (within groups of equal motions, `groups` of them with `motions` together) or "innovations", where
    nothing repeats. repeats: share of the force's variance that equal motions have in common [1], None without any.
    """

    source: str
    force: float
    position: float
    innovations: float
    groups: int
    motions: int
    repeats: float | None


def explained_reading(fitted: Fit, record: Record, index: int) -> Array:
    """The record's reading (n,) [m] less what the fit's effects add to it."""
    seen = fitted.seen[index]
    reading = record.position - seen.acts.reading
    for effect in fitted.candidate.effects:
        for mode in effect.modes():
            reading = reading - modal(mode, seen.force, record.sample_time)
    return np.asarray(reading)


def unknown(fitted: Fit, records: Sequence[Record], walk: float) -> Force:
    """The unknown force for a walk [N a sample], in newtons of thrust."""
    machine, model = fitted.candidate.machine, seeing(fitted.candidate, records[0].sample_time, walk)
    place, values = 2 * len(machine.plant.modes), []  # of the force among the states
    for i, record in enumerate(records):
        reading = explained_reading(fitted, record, i)
        values.append(smoothed(model, fitted.seen[i].force, reading, _start(model, reading))[:, place])
    deviation = steady_deviation(machine.plant, records[0].sample_time, walk=walk, noise=noise(machine))
    part = noise(machine) * float(np.linalg.norm(answer(fitted.candidate, records[0].sample_time, walk)[0]))
    return Force(walk, tuple(values), deviation, part)


def answer(candidate: Candidate, sample_time: float, walk: float) -> tuple[Array, Array]:
    """What one reading of 1 m in the middle makes of the smoothed force [N] and position [m]: (2 REACH + 1,) each.

    Without the candidate's random forces.
    """
    model = seeing(replace(candidate, shaken=()), sample_time, walk)
    reading = np.zeros(2 * REACH + 1)
    reading[REACH] = 1.0
    states = smoothed(model, np.zeros((reading.size, SUBSTEPS)), reading, np.zeros(model.C.size))
    return states[:, model.C.size - 1], states @ model.C


def likeliest(fitted: Fit, records: Sequence[Record]) -> float:
    """The walk [N a sample] of WALKS under which the readings are the most probable."""
    chance = [sum(_chances(fitted, records, walk)) for walk in WALKS]
    return float(WALKS[int(np.argmax(chance))])


def _chances(fitted: Fit, records: Sequence[Record], walk: float) -> Iterator[float]:
    """Logarithm of each record's likelihood, but for a constant."""
    model = seeing(fitted.candidate, records[0].sample_time, walk)
    for i, record in enumerate(records):
        reading = explained_reading(fitted, record, i)
        e = innovations(model, fitted.seen[i].force, reading, _start(model, reading))[STARTING:] / model.deviation
        yield -0.5 * float(e @ e) - e.size * float(np.log(model.deviation))


def _start(model: Predictor, reading: Array) -> Array:
    start = np.zeros(model.C.size)
    start[0] = reading[0]
    return start


def steady_deviation(plant: Plant, sample_time: float, *, walk: float, noise: float) -> float:
    """Deviation [N] of the smoothed force far from a record's ends: P = P+ + G (P - P-) G', steady."""
    a, _, c = discretised(plant, sample_time)
    held = a[:, -1].copy()
    held[-1] = 0.0
    q = JITTER**2 * np.outer(held, held)
    q[-1, -1] += walk**2
    before = solve_discrete_are(a.T, c[:, None], q / noise**2, np.eye(1)) * noise**2
    gain = before @ c / (float(c @ before @ c) + noise**2)
    after = before - np.outer(gain, c @ before)
    back = np.linalg.lstsq(before.T, (after @ a.T).T, rcond=1e-14)[0].T
    smooth = after - back @ before @ back.T
    for _ in range(DOUBLINGS):  # P = sum of G^k (P+ - G P- G') G'^k
        smooth, back = smooth + back @ smooth @ back.T, back @ back
    return float(np.sqrt(max(smooth[-1, -1], 0.0)))


def unseen(candidate: Candidate, sample_time: float, force: Force) -> float:
    """Deviation [N] that d has where nothing is unknown: from the scale's noise, and from what noise leaves of the
    position at which the friction is evaluated, while all contacts stick."""
    machine = candidate.machine
    position = noise(machine) * np.linalg.norm(answer(candidate, sample_time, AGAIN[-1])[1])
    return float(np.hypot(force.noise, sum(machine.friction.stiffness) * position))


def floor(fitted: Fit, records: Sequence[Record], pieces: Sequence[Piece], force: Force) -> Floor:
    """The floor from what does not repeat between equal motions, or, where none are equal, from the innovations."""
    groups = repeated(pieces, records)
    if not groups:
        return _from_innovations(fitted, records)
    position = [record.position - record.reference for record in records]
    split = np.cumsum([record.position.size for record in records])[:-1]
    signals = (force.values, position, np.split(fitted.innovations, split))
    size, place, left = (rms(scatter(groups, pieces, signal)) for signal in signals)
    spread = _about_the_mean(groups, pieces, force.values)
    repeats = float(np.clip(1 - size**2 / spread, 0.0, 1.0)) if spread > 0 else 0.0
    return Floor("repeats", size, place, left, len(groups), sum(len(group) for group in groups), repeats)


def _from_innovations(fitted: Fit, records: Sequence[Record]) -> Floor:
    """A fast unknown force takes up whatever else there is: what it leaves is the scale's noise."""
    candidate, ts = fitted.candidate, records[0].sample_time
    model = seeing(candidate, ts, FAST)
    left = []
    for i, record in enumerate(records):
        reading = explained_reading(fitted, record, i)
        left.append(innovations(model, fitted.seen[i].force, reading, _start(model, reading))[STARTING:])
    size = float(np.sqrt(np.mean(np.concatenate(left) ** 2))) / model.deviation
    force = size * unseen(candidate, ts, unknown(fitted, records, SLOW))
    return Floor("innovations", force, size * noise(candidate.machine), size, 0, 0, None)


def _about_the_mean(groups: Sequence[Sequence[int]], pieces: Sequence[Piece], signals: Sequence[Array]) -> float:
    """Variance of a signal over all motions that repeat; [square of the signal's unit]."""
    every = [signals[pieces[i].record][pieces[i].start : pieces[i].stop] for group in groups for i in group]
    return float(np.var(np.concatenate(every)))
