"""Commands that act late now and then: no force law repeats them, but they grow with the commands' steps.

A command that is late by a part of a sample acts that long in its predecessor's place: a pulse of force in proportion
to u[k] - u[k-1]. A constant lateness is a dead time, and re-fitted; one that varies differs between motions that are
equal otherwise. So the innovations' variance *within* groups of equal motions is regressed on what pulses in proportion
to the command's steps would give: a law of force repeats and cancels there, noise does not know of the command. The
scale's rounding does: it is another while the table moves, so the share of moving goes into the regression too.
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


@dataclass(frozen=True)
class Lateness:
    """Root mean square of the lateness [s], its deviation [s], and what it gains of chi-square."""

    size: float
    deviation: float
    gain: float


def lateness(fitted: Fit, records: Sequence[Record]) -> Lateness:
    """How much the commands' lateness varies, as repeated motions show it; 0 without any."""
    machine = fitted.candidate.machine
    ts = records[0].sample_time
    model = predictor(machine.plant, ts, walk=fitted.walk, noise=noise(machine), shaken=fitted.candidate.shaken)
    delay = round(machine.plant.dead_time / ts)
    pulse = np.concatenate([np.zeros(delay), mark(model) ** 2])
    given = [
        fftconvolve(np.diff(record.command, prepend=record.command[0]) ** 2, pulse)[: record.command.size]
        for record in records
    ]
    moves = [
        np.minimum(np.abs(np.gradient(path.path.position.mean(axis=1))) / (machine.scale.resolution or np.inf), 1.0)
        for path in fitted.paths
    ]
    squares, expected, moving = [], [], []
    for group in repeats(pieces(records)):
        e = np.stack([fitted.seen[piece.record].innovations[_part(piece)] for piece in group])
        within = (e - e.mean(axis=0)) ** 2 * len(group) / (len(group) - 1)
        squares.append(within.mean(axis=0))
        expected.append(np.mean([given[piece.record][_part(piece)] for piece in group], axis=0))
        moving.append(np.mean([moves[piece.record][_part(piece)] for piece in group], axis=0))
    if sum(one.size for one in squares) < FEW:
        return Lateness(0.0, float("inf"), 0.0)
    slope, spread = _slope(np.concatenate(expected), np.concatenate(squares), np.concatenate(moving))
    size = ts * float(np.sqrt(max(slope, 0.0)))
    deviation = ts * 0.5 * spread / float(np.sqrt(max(slope, spread)))
    return Lateness(size, deviation, max(slope / spread, 0.0) ** 2)


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


def _part(piece: Piece) -> slice:
    return slice(piece.start, piece.stop)


def _slope(size: Array, square: Array, moving: Array) -> tuple[float, float]:
    """Slope of the squares (n,) by their expected size, a constant and the share of moving (n,) [1] taken off, and its
    deviation where there is none."""
    few = size <= np.quantile(size, 0.99)  # so that not a handful of samples decides
    beside = np.stack([np.ones(np.count_nonzero(few)), moving[few]], axis=1)
    own = size[few] - beside @ np.linalg.lstsq(beside, size[few], rcond=None)[0]
    total = float(own @ own)
    return float(own @ square[few]) / total, float(square[few].mean()) / float(np.sqrt(total))
