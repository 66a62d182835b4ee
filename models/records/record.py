"""The signals of one experiment, measured or simulated, one row a sample; cut into motions."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator

from models.quantity import show

Array = NDArray[np.float64]

# Of the largest difference from sample to sample, by which a cubic spline is beyond both: 0.10 at a step, 0.08
# where a speed steps, next to nothing along a smooth path.
STEP_OVERSHOOT: Final = 0.05
BETWEEN_STEPS: Final = 20  # samples for which a target that steps stays, at least


@dataclass(frozen=True)
class Column:
    """A column (n,) of a record's file by its name there: in [N] if it is mapped to the feedforward, else as the file
    has it."""

    name: str
    values: Array
    mapped: bool = False


@dataclass(frozen=True, eq=False)  # arrays have no one answer to ==
class Record:
    """Equally spaced samples (n,): r [m], x_T* [m], u_ff + u_rf [N], u_M as put out [N], the scale's reading [m].

    columns: what else its file holds, where that is known; and the column of the feedforward as it was logged. every:
    of how many samples its log had one, the others being interpolated.

    >>> response.record
    Record(2000 samples every 500 µs, position 0 m to 100... µm, command up to ... N)
    """

    sample_time: float
    target: Array
    reference: Array
    feedforward: Array
    command: Array
    position: Array
    columns: tuple[Column, ...] = field(default=(), kw_only=True)
    every: int = field(default=1, kw_only=True)

    def __repr__(self) -> str:
        low, high, most = np.min(self.position), np.max(self.position), np.max(np.abs(self.command))
        return (
            f"Record({self.position.size} samples every {show(self.sample_time, 's')}, position "
            f"{show(float(low), 'm')} to {show(float(high), 'm')}, command up to {show(float(most), 'N')})"
        )

    def last(self, count: int) -> Record:
        """The last `count` samples."""
        return self.part(max(self.position.size - count, 0), self.position.size)

    def part(self, start: int, stop: int) -> Record:
        """Samples start .. stop."""
        signals = (self.target, self.reference, self.feedforward, self.command, self.position)
        columns = tuple(replace(one, values=one.values[start:stop]) for one in self.columns)
        parts = (signal[start:stop] for signal in signals)
        return Record(self.sample_time, *parts, columns=columns, every=self.every)

    def thinned(self, every: int) -> Record:
        """One sample of `every`, as a log has them that is slower than the controller."""
        columns = tuple(replace(one, values=one.values[::every]) for one in self.columns)
        signals = (self.target, self.reference, self.feedforward, self.command, self.position)
        return Record(every * self.sample_time, *(signal[::every] for signal in signals), columns=columns)

    def filled(self, every: int) -> Record:
        """The record with `every` samples where it has one: all along cubic splines, but a reference or a feedforward
        that steps along a curve that does not overshoot, the target held. Its columns are left out."""
        count = self.position.size
        at, fine = np.arange(count, dtype=float), np.arange((count - 1) * every + 1) / every
        command, position = (CubicSpline(at, signal)(fine) for signal in (self.command, self.position))
        reference, feedforward = (_without_overshoot(at, one, fine) for one in (self.reference, self.feedforward))
        target = self.target[np.floor(fine + 1e-9).astype(int)]
        return Record(self.sample_time / every, target, reference, feedforward, command, position, every=every)


def _without_overshoot(at: Array, signal: Array, fine: Array) -> Array:
    """A signal (n,) [any unit] at finer places (m,): along a cubic spline, whose second derivative is continuous as an
    acceleration feedforward asks, unless somewhere it overshoots as at a step; then along a curve that does not."""
    spline = CubicSpline(at, signal)(fine)
    left = np.minimum(np.floor(fine).astype(int), at.size - 2)
    low, high = (least(signal[left], signal[left + 1]) for least in (np.minimum, np.maximum))
    beyond = np.max(np.maximum(spline - high, low - spline))
    if beyond < STEP_OVERSHOOT * np.max(np.abs(np.diff(signal))):
        return np.asarray(spline, float)
    return np.asarray(PchipInterpolator(at, signal)(fine), float)


@dataclass(frozen=True)
class Motion:
    """Samples start .. stop of a record, in which the target steps from `origin` to `target` [m] and stays there.

    A motion is a reversal if the one before it went the other way, else an inching motion.
    """

    start: int
    stop: int
    origin: float
    target: float
    reversal: bool

    @property
    def direction(self) -> int:
        """+1 or -1."""
        return 1 if self.target > self.origin else -1


def motions(target: Array, initial: float = 0.0) -> tuple[Motion, ...]:
    """The motions that a target r (n,) [m] commands, coming from `initial` [m] at rest before its first sample.

    The first motion counts as a reversal: nothing is known of a motion before it.
    """
    before = np.concatenate([[initial], target[:-1]])
    starts = np.flatnonzero(target != before)
    found: list[Motion] = []
    for start, stop in zip(starts, [*starts[1:], len(target)], strict=True):
        origin, goal = float(before[start]), float(target[start])
        reversal = not found or (goal > origin) != (found[-1].target > found[-1].origin)
        found.append(Motion(int(start), int(stop), origin, goal, reversal))
    return tuple(found)


def cut(record: Record) -> tuple[Motion, ...]:
    """The motions of a record: where its target steps, or, for a target that moves along, from one halt to the next.

    Changes that are BETWEEN_STEPS samples apart, in the median, are steps. A halt of the reference is where its speed
    is zero or changes its sign; a motion starts there.
    """
    r = record.target
    changes = np.flatnonzero(np.diff(r))
    # The reference that stands in for a target may rest most of the time, too, but moves along in between.
    stands = changes.size < 2 or float(np.median(np.diff(changes))) >= BETWEEN_STEPS
    if 0 < changes.size < r.size / BETWEEN_STEPS and stands:
        return motions(r, float(record.reference[0]))  # at rest before the record, or on its way already
    speed = np.sign(np.diff(record.reference, append=record.reference[-1]))
    before = np.concatenate([[0.0], speed[:-1]])
    starts = np.flatnonzero((speed != 0) & (speed != before))
    found: list[Motion] = []
    for start, stop in zip(starts, [*starts[1:], r.size][: starts.size], strict=True):  # none where nothing moves
        origin, goal = float(record.reference[start]), float(record.reference[stop - 1])
        reversal = not found or (goal > origin) != (found[-1].target > found[-1].origin)
        found.append(Motion(int(start), int(stop), origin, goal, reversal))
    return tuple(found)


def feeding_sequence(stroke: float, count: int, interval: float, sample_time: float, repeats: int = 1) -> Array:
    """The target r (n,) [m] of Fig. 5, `repeats` times: `count` strokes [m] up, as many down, `interval` [s] apart.

    >>> target = pos.feeding_sequence(20e-6, 5, 0.1, 0.5e-3)
    >>> target.shape, float(target.max())
    ((2000,), 0.0001)
    """
    samples = round(interval / sample_time)
    levels = np.concatenate([np.arange(1, count + 1), np.arange(count - 1, -1, -1)]) * stroke
    return np.tile(np.repeat(levels, samples), repeats)
