"""Signals that were added to the command behind the controller: those of a record's columns, and pulses of no column.

The replayed law leaves the logged command less its own. Where a column of the file, times a gain and some samples late,
makes that difference, it was added behind the controller: the column that is mapped to the feedforward, with another
gain or delay than the mapping says, or one that is mapped to nothing. A difference that is constant between jumps is of
pulses that the file has no column for. n samples, of which those from `begin` on count.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.quantity import cut, show
from models.records.record import Column, Record

Array = NDArray[np.float64]

LATEST: Final = 8  # samples by which a column may be added late, or early
# Of the difference, up to which what a column leaves shows that it is there, however small it is.
MAX_LEFT_SHARE: Final = 0.1
COPY: Final = 0.99  # correlation with the command from which on a column is the command in another unit
OMITTED: Final = 0.01  # gain of a feedforward below which it does not act
MIN_DEPARTURE_SHARE: Final = 0.02  # part of a column's range by which it departs from what it mostly is
MIN_LEVEL_SAMPLES: Final = 10  # samples of one level that count as a pulse, or as what is between two
MIN_LEVELS_SHARE: Final = 0.95  # of the samples that such levels have to cover, the others being edges
AS_GOOD: Final = 1.05  # times what pulses leave, up to which a column that the file has is preferred


@dataclass(frozen=True)
class Added:
    """A signal that was added to the command behind the controller.

    column: its name in the file, "" for a feedforward without a name, None for pulses of no column. mapped: whether it
    is the feedforward, which counts with a gain of 1 and no delay. gain [N for 1 of the column]; delay [samples].
    largest [N]: its largest departure from what it mostly is. stretches: the samples from .. to which it departs.
    leaves [N]: the rms difference that remains; noise [N]: what the noise of the log explains.
    missing (n,) [N]: what has to be added to the record's feedforward.
    """

    column: str | None
    mapped: bool
    gain: float
    delay: int
    largest: float
    stretches: tuple[tuple[int, int], ...]
    leaves: float
    noise: float
    missing: Array

    @property
    def is_all(self) -> bool:
        """Whether what is left is no more than the noise of the log."""
        return self.leaves <= self.noise

    @property
    def name(self) -> str:
        """What a sentence calls it."""
        if self.column is None:
            return "pulses that no column of the file shows"
        return f"the column {cut(self.column)}" if self.column else "the feedforward"

    @property
    def shift(self) -> str:
        """By how many samples it is added late, or early."""
        return f"{abs(self.delay)} sample{'s' * (abs(self.delay) > 1)} {'late' if self.delay > 0 else 'early'}"

    @property
    def words(self) -> str:
        """The signal with its gain and its delay, as a part of a sentence."""
        if self.column is None:
            return f"{self.name} added to the command"
        factor = f"{self.gain:.4g}" if self.mapped else show(self.gain, "N")
        late = f", {self.shift}," if self.delay else ""
        return f"{self.name} times {factor}{late} added to the command"

    def when(self, sample_time: float) -> str:
        """When it acts, as a part of a sentence; sample_time [s]."""
        (start, stop), count = self.stretches[0], len(self.stretches)
        if count == 1:
            return f"from {show(start * sample_time, 's')} to {show(stop * sample_time, 's')}"
        if stop - start < MIN_LEVEL_SAMPLES:
            return f"between {show(start * sample_time, 's')} and {show(self.stretches[-1][1] * sample_time, 's')}"
        return (
            f"in {count} stretches, the first from {show(start * sample_time, 's')} to {show(stop * sample_time, 's')}"
        )


def added(record: Record, made: Array, begin: int, noise: float) -> Added | None:
    """The signal that makes a record's command of the replayed one, made (n,) [N]; None where none is there.

    noise [N]: the rms difference that the noise of the log explains.
    """
    columns = list(_columns(record, made, begin, noise))
    best = min(columns, key=lambda one: one.leaves, default=None)
    if best is not None and best.is_all:
        return best
    pulses = _pulses(record.command - made, begin, noise)
    return best if pulses is None or (best and best.leaves <= AS_GOOD * pulses.leaves) else pulses


def with_the_added(record: Record, found: Added) -> Record:
    """The record with the signal in its feedforward, as it acted."""
    return replace(record, feedforward=record.feedforward + found.missing, columns=())


def _columns(record: Record, made: Array, begin: int, noise: float) -> Iterator[Added]:
    """Each column of a record at the delay with which it leaves least."""
    n, difference = record.command.size, record.command - made
    given = record.columns or (Column("", record.feedforward, mapped=True),)
    inside = slice(begin, n - LATEST)
    for column in given:
        values = column.values
        if values.shape != (n,) or not np.all(np.isfinite(values)) or np.ptp(values[inside]) == 0:
            continue
        if not column.mapped and _correlated(values[inside], record.command[inside]) > COPY:
            continue
        whole = difference + values if column.mapped else difference
        fits = [(*_fitted(whole[inside], values, inside, late), late) for late in range(-LATEST, LATEST + 1)]
        leaves, gain, delay = min(fits, key=lambda one: one[0])
        acts = gain * _late(values, delay)
        missing = acts - values if column.mapped else acts
        large = MIN_DEPARTURE_SHARE * max(abs(gain), column.mapped) * float(np.ptp(values))
        if leaves > MAX_LEFT_SHARE * float(np.std(difference[inside])):
            large = max(noise, large)
        if large <= 0:
            continue
        size, stretches = _departures(values if column.mapped and abs(gain) < OMITTED else acts, large)
        if stretches:
            yield Added(column.name, column.mapped, gain, delay, size, stretches, leaves, noise, missing)


def _fitted(wanted: Array, values: Array, inside: slice, late: int) -> tuple[float, float]:
    """(rms [N] left, gain) of a column (n,), so many samples late, against what is wanted of it, beside a constant."""
    shifted = values[inside.start - late : inside.stop - late]
    x, y = shifted - shifted.mean(), wanted - wanted.mean()
    power = float(x @ x)
    gain = float(x @ y) / power if power > 0 else 0.0
    return float(np.sqrt(np.mean((y - gain * x) ** 2))), gain


def _late(values: Array, samples: int) -> Array:
    """Values (n,) so many samples later, the ends held."""
    index = np.clip(np.arange(values.size) - samples, 0, values.size - 1)
    return np.asarray(values[index], float)


def _correlated(a: Array, b: Array) -> float:
    both = float(np.std(a) * np.std(b))
    return abs(float(np.mean((a - a.mean()) * (b - b.mean())))) / both if both > 0 else 0.0


def _departures(signal: Array, large: float) -> tuple[float, tuple[tuple[int, int], ...]]:
    """By how much a signal (n,) [N] departs from what it mostly is, and the stretches in which it does by more than
    `large` [N]."""
    away = np.abs(signal - _usual(signal, large))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], away > large, [False]]).astype(int)))
    return float(np.max(away)), tuple((int(a), int(b)) for a, b in edges.reshape(-1, 2))


def _usual(signal: Array, width: float) -> float:
    """The level near which a signal (n,) is most often; of two that are nearly as frequent the smaller."""
    middle = np.median(signal)
    bins = np.round((signal - middle) / (2 * width)).astype(int)
    kinds, counts = np.unique(bins, return_counts=True)
    often = kinds[counts > 0.5 * counts.max()]
    levels = [float(np.median(signal[bins == one])) for one in often]
    return min(levels, key=abs)


def _pulses(difference: Array, begin: int, noise: float) -> Added | None:
    """Pulses that make a difference (n,) [N], if it is constant but for its jumps."""
    jump = 6 * noise  # noise of one sample makes no step of this size
    n = difference.size
    cuts = np.flatnonzero(np.abs(np.diff(difference[begin:])) > jump) + begin + 1
    edges = [begin, *cuts.tolist(), n]
    levels = [(a, b) for a, b in pairwise(edges) if b - a >= MIN_LEVEL_SAMPLES]
    covered = sum(b - a for a, b in levels)
    if cuts.size == 0 or covered < MIN_LEVELS_SHARE * (n - begin):
        return None
    course, counts = np.full(n, np.nan), np.zeros(n, bool)
    for a, b in levels:
        course[a:b], counts[a:b] = np.median(difference[a:b]), True
    leaves = float(np.sqrt(np.mean((difference - course)[counts] ** 2)))
    course = _filled(course, difference)
    course -= _usual(course, max(noise, jump / 2))
    size, stretches = _departures(course, jump)
    if leaves > noise or not stretches:
        return None
    return Added(None, False, 1.0, 0, size, stretches, leaves, noise, np.where(np.abs(course) > jump, course, 0.0))


def _filled(course: Array, difference: Array) -> Array:
    """A course (n,) with each gap (NaN) at the level before or after it, whichever is nearer to the difference (n,)."""
    known = np.flatnonzero(np.isfinite(course))
    after = np.searchsorted(known, np.arange(course.size))
    before, next_one = course[known[np.maximum(after - 1, 0)]], course[known[np.minimum(after, known.size - 1)]]
    nearer = np.where(np.abs(difference - before) <= np.abs(difference - next_one), before, next_one)
    return np.where(np.isfinite(course), course, nearer)
