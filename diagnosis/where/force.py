"""The unknown force in a record: what a Kalman smoother adds to the fitted model's forces, and its noise floor.

The force is a random walk. Its standard deviation per sample is a setting: with a slow walk the estimate shows drifts
with little noise, with a fast one it follows what happens within milliseconds. Between both is the likeliest walk,
which maximises the likelihood of the innovations, as a stochastic grey-box model estimates its diffusion (Kristensen,
Madsen and Jorgensen 2004). n samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from diagnosis.criteria import Criteria
from diagnosis.model.fit import Fit, fit
from diagnosis.model.kalman import (
    STARTING,
    SUBSTEPS,
    Predictor,
    discretised,
    innovations,
    likeliest_start,
    smoothed,
    smoother_gain,
)
from diagnosis.model.residual import SMOOTHER_WALK, Candidate, beside_plant, unweighted_predictor
from diagnosis.model.roughness import variance_by_record
from diagnosis.records.motions import Piece, repeated, rms, scatter
from diagnosis.records.units import noise
from diagnosis.where.energy import Samples, centred
from models.plant import Plant
from models.records.record import Record

Array = NDArray[np.float64]

# Random walks of the unknown force, in the machine's usual white force a sample: one that follows it slowly, one fast.
SLOW_WALK: Final = 0.05
FAST_WALK: Final = 3.75
WALKS: Final = tuple(np.geomspace(0.025, 25.0, 13))  # the likeliest of them is taken
REACH: Final = 4000  # samples to either side over which the smoother's response to one reading is computed
DOUBLINGS: Final = 40  # of the horizon in the smoother's covariance recursion: 2^40 samples are as good as infinite


@dataclass(frozen=True)
class Force:
    """The unknown force d (n,) [N] of each record for one random walk [N per sample]; deviation [N]: its posterior
    standard deviation, in steady state; noise [N]: the standard deviation that the scale's noise alone would give d."""

    walk: float
    values: tuple[Array, ...]
    deviation: float
    noise: float


@dataclass(frozen=True)
class Floor:
    """The noise floor, which no deterministic effect can lower, as standard deviations: force [N], position [m],
    whitened innovations [1].

    source: "repeats" (the scatter within `groups` groups of equal motions, `motions` in total) or "innovations", where
    no motions are equal. repeats: share of the force's variance that equal motions have in common [1], else None.
    """

    source: str
    force: float
    position: float
    innovations: float
    groups: int
    motions: int
    repeats: float | None


@dataclass(frozen=True)
class UnknownForce:
    """The force that the fitted model lacks: with a slow, a fast and the likeliest random walk. noise [N]: the standard
    deviation that the likeliest one has where nothing is missing. floor: what does not repeat."""

    slow: Force
    fast: Force
    likely: Force
    noise: float
    floor: Floor

    def centred(self, samples: Samples) -> Array:
        """The likeliest force (n,) [N] of all records, one after another, its mean over what counts removed."""
        return centred(np.concatenate(self.likely.values), samples)


def unknown_force(fitted: Fit, records: Sequence[Record], pieces: Sequence[Piece]) -> UnknownForce:
    """The force [N] that the fitted model lacks in the records, whose motions are the pieces."""
    slow, fast = smoothed_force(fitted, records, SLOW_WALK), smoothed_force(fitted, records, FAST_WALK)
    likely = smoothed_force(fitted, records, likeliest_walk(fitted, records))
    noise = noise_deviation(fitted.candidate, records[0].sample_time, likely)
    return UnknownForce(slow, fast, likely, noise, noise_floor(fitted, records, pieces, likely))


def explained_reading(fitted: Fit, record: Record, index: int) -> Array:
    """The record's reading (n,) [m] less what the fitted effects add to it."""
    seen = fitted.residuals[index]
    return record.position - beside_plant(fitted.candidate, seen.force, seen.acts, record.sample_time)


def smoothed_force(fitted: Fit, records: Sequence[Record], walk: float) -> Force:
    """The unknown force [N of thrust] for a random walk [usual white forces per sample]."""
    machine, model = fitted.candidate.machine, unweighted_predictor(fitted.candidate, records[0].sample_time, walk)
    place, values = 2 * len(machine.plant.modes), []  # the force's index among the states
    for i, record in enumerate(records):
        values.append(smoothed(model, *_seen(model, fitted, record, i))[:, place])
    white, ts = fitted.candidate.usual_white_force, records[0].sample_time
    deviation = steady_deviation(machine.plant, ts, walk=walk * white, noise=noise(machine), white_force=white)
    part = noise(machine) * float(np.linalg.norm(smoother_response(fitted.candidate, records[0].sample_time, walk)[0]))
    return Force(walk * white, tuple(values), deviation, part)


def smoother_response(candidate: Candidate, sample_time: float, walk: float) -> tuple[Array, Array]:
    """Impulse response of the smoother: (force [N], position [m]), (2 REACH + 1,) each, to one reading of 1 m in the
    middle, without the candidate's random forces."""
    model = unweighted_predictor(replace(candidate, random_forces=()), sample_time, walk)
    reading = np.zeros(2 * REACH + 1)
    reading[REACH] = 1.0
    states = smoothed(model, np.zeros((reading.size, SUBSTEPS)), reading, np.zeros(model.C.size))
    return states[:, model.C.size - 1], states @ model.C


def likeliest_walk(fitted: Fit, records: Sequence[Record]) -> float:
    """The random walk [usual white forces per sample] of WALKS with the largest likelihood of the readings."""
    likelihoods = [sum(_log_likelihoods(fitted, records, walk)) for walk in WALKS]
    return float(WALKS[int(np.argmax(likelihoods))])


def borne_out(fitted: Fit, records: Sequence[Record], criteria: Criteria = Criteria()) -> Fit:
    """The fit as it is where its weights hold. Where a record leaves far more than they promise, it is linearised anew,
    nothing fitted, beside a force that walks as is likeliest: what a slow force leaves that follows no law, such as
    wind, is then noise, and only then are a chi-square and what follows from it in units of the noise."""
    if np.max(variance_by_record(fitted)) <= criteria.rough_variance:
        return fitted
    walk = likeliest_walk(fitted, records)
    return fit(fitted.candidate, records, paths=fitted.paths, iterations=0, walk=walk) if walk > fitted.walk else fitted


def own_course(fitted: Fit, records: Sequence[Record], walk: float) -> float:
    """The part [1] of the innovations' energy that goes where the unknown force may walk by `walk` [usual white forces
    per sample] instead of the fit's own: what it was a moment ago tells the force, whatever it depends on."""
    left = [0.0, 0.0]
    for k, one in enumerate((fitted.walk, walk)):
        model = unweighted_predictor(fitted.candidate, records[0].sample_time, one)
        for i, record in enumerate(records):
            e = innovations(model, *_seen(model, fitted, record, i))[STARTING:]
            left[k] += float(e @ e)
    return float(np.clip(1 - left[1] / max(left[0], 1e-300), 0.0, 1.0))


def _log_likelihoods(fitted: Fit, records: Sequence[Record], walk: float) -> Iterator[float]:
    """Logarithm of each record's likelihood, up to a constant."""
    model = unweighted_predictor(fitted.candidate, records[0].sample_time, walk)
    for i, record in enumerate(records):
        e = innovations(model, *_seen(model, fitted, record, i))[STARTING:] / model.deviation
        yield -0.5 * float(e @ e) - e.size * float(np.log(model.deviation))


def _seen(model: Predictor, fitted: Fit, record: Record, index: int) -> tuple[Array, Array, Array]:
    """What filters take: the net force (n, M) [N], the reading (n,) [m] and the initial state (S,)."""
    seen, reading = fitted.residuals[index], explained_reading(fitted, record, index)
    return seen.force, reading, likeliest_start(model, seen.force, reading)


def steady_deviation(plant: Plant, sample_time: float, *, walk: float, noise: float, white_force: float) -> float:
    """Posterior standard deviation [N] of the smoothed force far from a record's ends.

    Steady state of the Rauch-Tung-Striebel smoother, P = P+ + G (P - P-) G', with P- and P+ the covariances before and
    after a reading and G the smoother's gain.
    """
    a, _, c = discretised(plant, sample_time)
    held = a[:, -1].copy()
    held[-1] = 0.0
    q = white_force**2 * np.outer(held, held)
    q[-1, -1] += walk**2
    before = solve_discrete_are(a.T, c[:, None], q / noise**2, np.eye(1)) * noise**2
    gain = before @ c / (float(c @ before @ c) + noise**2)
    after = before - np.outer(gain, c @ before)
    back = smoother_gain(a, before, after)
    smooth = after - back @ before @ back.T
    for _ in range(DOUBLINGS):  # P = sum of G^k (P+ - G P- G') G'^k
        smooth, back = smooth + back @ smooth @ back.T, back @ back
    return float(np.sqrt(max(smooth[-1, -1], 0.0)))


def noise_deviation(candidate: Candidate, sample_time: float, force: Force) -> float:
    """Standard deviation [N] of d where the model is complete: from the scale's noise directly, and from the error that
    it leaves in the position at which the friction is evaluated, with all contacts sticking."""
    machine = candidate.machine
    position = noise(machine) * np.linalg.norm(smoother_response(candidate, sample_time, SMOOTHER_WALK)[1])
    return float(np.hypot(force.noise, sum(machine.friction.stiffness) * position))


def noise_floor(fitted: Fit, records: Sequence[Record], pieces: Sequence[Piece], force: Force) -> Floor:
    """The noise floor from the scatter between equal motions or, where none are equal, from the innovations."""
    groups = repeated(pieces, records, noise(fitted.candidate.nominal))
    if not groups:
        return _from_innovations(fitted, records)
    position = [record.position - record.reference for record in records]
    split = np.cumsum([record.position.size for record in records])[:-1]
    signals = (force.values, position, np.split(fitted.innovations, split))
    size, place, innovation = (rms(scatter(groups, pieces, signal)) for signal in signals)
    variance = _variance(groups, pieces, force.values)
    repeats = float(np.clip(1 - size**2 / variance, 0.0, 1.0)) if variance > 0 else 0.0
    return Floor("repeats", size, place, innovation, len(groups), sum(len(group) for group in groups), repeats)


def _from_innovations(fitted: Fit, records: Sequence[Record]) -> Floor:
    """A fast unknown force absorbs everything else, so that what it leaves of the readings is the scale's noise."""
    candidate, ts = fitted.candidate, records[0].sample_time
    model = unweighted_predictor(candidate, ts, FAST_WALK)
    residual = []
    for i, record in enumerate(records):
        residual.append(innovations(model, *_seen(model, fitted, record, i))[STARTING:])
    size = float(np.sqrt(np.mean(np.concatenate(residual) ** 2))) / model.deviation
    force = size * noise_deviation(candidate, ts, smoothed_force(fitted, records, SLOW_WALK))
    return Floor("innovations", force, size * noise(candidate.machine), size, 0, 0, None)


def _variance(groups: Sequence[Sequence[int]], pieces: Sequence[Piece], signals: Sequence[Array]) -> float:
    """Variance of a signal over all motions that repeat [square of the signal's unit]."""
    every = [signals[pieces[i].record][pieces[i].start : pieces[i].stop] for group in groups for i in group]
    return float(np.var(np.concatenate(every)))
