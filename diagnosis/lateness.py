"""Commands that act late now and then: no force law repeats them, but they grow with the commands' steps.

A command that is late by a part of a sample acts that long in its predecessor's place: a pulse of force in proportion
to u[k] - u[k-1]. A constant lateness is a dead time, and re-fitted; one that varies differs between motions that are
equal otherwise. So what *differs* among equal motions tells whether it does: a law of force repeats and cancels there.
How much it varies, all motions tell: few steps are large, and of those few are late. What is left is white noise and,
at every step, the mark m of a pulse whose variance is s^2 (u[k] - u[k-1])^2. The locally best test of s = 0 sums
(m'e)^2 with these squares as weights (D. Cox, D. Hinkley, Theoretical Statistics, 1974, section 4.8). Noise does not
know of the command. The scale's rounding does, as it is another while the table moves; so the weights are taken
orthogonal to a constant and to the share of moving.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve

from diagnosis.fit import Fit
from diagnosis.kalman import SUBSTEPS, Predictor, predictor, responses
from diagnosis.motions import Piece, pieces
from diagnosis.residual import STARTING, noise
from models.record import Record

Array = NDArray[np.float64]

REACH: Final = 400  # samples over which a pulse leaves its mark
ALIKE: Final = 1e-6  # m: motions that start as near to each other as this start from one place
FEW: Final = 500  # samples of repeated motions
LATE: Final = 64.0  # chi-square from which on commands are late now and then: clean tables reach 15
RARE: Final = 0.005  # of the samples, with the largest steps, that have no say: not a handful is to decide


@dataclass(frozen=True)
class Lateness:
    """Root mean square of the lateness [s], as all motions show it; its chi-square where motions repeat, and what its
    square scatters by there if no command is late [s^2]."""

    size: float
    gain: float
    scatter: float


@dataclass(frozen=True)
class _Met:
    """What is left of a stretch of time, by sample (n,): the mean of (m'e)^2 and its degrees of freedom, the mark's
    energy up to the stretch's end, the squared steps of the command [N^2], and how much of the time the table moves."""

    square: Array
    freedom: Array
    energy: Array
    step: Array
    moving: Array


def lateness(fitted: Fit, records: Sequence[Record]) -> Lateness:
    """How much the commands' lateness varies; 0 without repeated motions, which alone can show that it does."""
    machine = fitted.candidate.machine
    ts = records[0].sample_time
    model = predictor(machine.plant, ts, walk=fitted.walk, noise=noise(machine), shaken=fitted.candidate.shaken)
    left = mark(model)
    found = pieces(records)
    groups = [_alike(fitted, records, group, left) for group in repeats(found)]
    if sum(group.step.size for group in groups) < FEW:
        return Lateness(0.0, 0.0, float("inf"))
    slope, spread = _slope(groups, left)
    whole, _ = _slope([_alike(fitted, records, [piece], left) for piece in found if piece.start >= STARTING], left)
    return Lateness(ts * float(np.sqrt(max(whole, 0.0))), max(slope / spread, 0.0) ** 2, ts**2 * spread)


def repeats(found: Sequence[Piece]) -> list[list[Piece]]:
    """Groups of pieces, two and more, that are the same motion from the same place."""
    groups: dict[tuple[object, ...], list[Piece]] = {}
    for piece in found:
        key = (piece.record, piece.kind, piece.direction, round(piece.origin / ALIKE), piece.stop - piece.start)
        if piece.start >= STARTING:
            groups.setdefault(key, []).append(piece)
    return [group for group in groups.values() if len(group) > 1]


def mark(model: Predictor) -> Array:
    """What a force of 1 N over the first sample leaves in the whitened innovations: (REACH,) [1]."""
    pulse = np.zeros((1, REACH, SUBSTEPS))
    pulse[0, 0] = 1.0
    return np.asarray(responses(model, pulse)[:, 0] / model.deviation)


def _alike(fitted: Fit, records: Sequence[Record], group: Sequence[Piece], left: Array) -> _Met:
    """Of what differs among equal motions, or of all that one motion leaves; left (REACH,): the mark of a pulse."""
    machine, index, n = fitted.candidate.machine, group[0].record, group[0].stop - group[0].start
    delay = round(machine.plant.dead_time / records[index].sample_time)
    command, path = records[index].command, fitted.paths[index].path.position.mean(axis=1)
    step = np.diff(command, prepend=np.full(delay + 1, command[0]))[: command.size] ** 2
    moving = np.minimum(np.abs(np.gradient(path)) / (machine.scale.resolution or np.inf), 1.0)
    e, freedom = _each(fitted.seen[index].innovations, group), max(len(group) - 1, 1)
    if len(group) > 1:
        e = e - e.mean(axis=0)
    met = np.stack([_met(row, left) for row in e])
    energy = np.cumsum(left**2)[np.minimum(np.arange(n)[::-1], left.size - 1)]
    steps, moves = (_each(signal, group).mean(axis=0) for signal in (step, moving))
    return _Met(np.sum(met**2, axis=0) / freedom, np.full(n, float(freedom)), energy, steps, moves)


def _each(signal: Array, group: Sequence[Piece]) -> Array:
    """A signal's parts of each motion (motions, n)."""
    return np.stack([signal[piece.start : piece.stop] for piece in group])


def _met(signal: Array, left: Array) -> Array:
    """The inner product of a signal (n,) with the mark of a pulse at each sample: (n,)."""
    return np.asarray(fftconvolve(signal, left[::-1])[left.size - 1 :])


def _slope(groups: Sequence[_Met], left: Array) -> tuple[float, float]:
    """s^2 [1], a part of the sample time squared, and its deviation where there is none."""
    alike = fftconvolve(left, left[::-1]) ** 2  # of the marks of two pulses, by the time between them

    def spread_out(signal: Array) -> Array:
        return np.asarray(fftconvolve(signal, alike)[left.size - 1 :][: signal.size])

    step, square, energy = (
        np.concatenate([getattr(one, name) for one in groups]) for name in ("step", "square", "energy")
    )
    moving, freedom = (np.concatenate([getattr(one, name) for one in groups]) for name in ("moving", "freedom"))
    few = step <= np.quantile(step, 1 - RARE)
    beside = np.stack([energy, energy * moving], axis=1) * few[:, None]
    weight = np.where(few, step, 0.0)
    weight -= beside @ np.linalg.lstsq(beside, weight, rcond=None)[0]
    expected = np.concatenate([spread_out(one.step) for one in groups])
    variance = float(square[few].mean() / energy[few].mean())
    spread = variance * float(np.sqrt(2 * np.sum(weight * spread_out(weight) / freedom)))
    return float(weight @ square / (weight @ expected)), spread / float(weight @ expected)
