"""Whether an axis swings while its reference stands still: its loop is not stable there, or something shakes it.

No model of the axis does so while its own loop is stable, so that what a fit makes of such a record is of little worth.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.machine import Machine
from models.quantity import show
from models.records.record import Record

Array = NDArray[np.float64]

LEAST_PERIODS: Final = 10  # of a swing that is told from a motion that dies away, and from noise
IN_ONE_LINE: Final = 0.8  # of the energy, which a swing has within LINE bins of its frequency
LINE: Final = 2  # bins, of a periodogram with Hann's window, whose own line is that wide
KEPT: Final = 0.7  # of its amplitude, which a swing keeps from the first half of what is looked at to the second
SEEN: Final = 5.0  # deviations of the scale's reading, from which on a swing's deviation is more than noise
OFTEN_LOOKED: Final = 4  # rests, from which on a record shows that the axis does not swing
OFTEN: Final = 0.25  # of the rests that are long enough to show one
WORTH: Final = 0.1  # of the tolerance, from which on a swing's amplitude matters to what the axis is for
LEAST_SAMPLES: Final = 4 * LEAST_PERIODS  # of what is looked at of a rest, so that LEAST_PERIODS can be in it


@dataclass(frozen=True)
class Swing:
    """A record's swing at rest, the medians of the rests with one.

    frequency [Hz]; amplitude [m]: sqrt(2) deviations of the position; rests: with one, of how many that are long
    enough to show it.
    """

    frequency: float
    amplitude: float
    rests: int
    of: int

    def __str__(self) -> str:
        size = f"by {show(self.amplitude, 'm', 2)} to each side, in {self.rests} of {self.of} rests"
        return (
            f"swings at {show(self.frequency, 'Hz', 3)} while its reference stands still, {size}: the loop is not "
            "stable there, or something shakes the axis; see to that first"
        )


def swing_at_rest(record: Record, machine: Machine) -> Swing | None:
    """The swing of a record's rests, of which the last half is looked at; None where fewer than OFTEN have one, and for
    one that is in the scale's noise or too small for the specification to notice."""
    noise = 2**0.5 * SEEN * machine.scale.noisy().reading_deviation
    least, parts = max(noise, WORTH * machine.specification.tolerance), list(_ends_of_rests(record))
    lines = [_line(part, record.sample_time) for part in parts]
    found = [one for one in lines if one is not None and one[1] >= least]
    if not found or len(found) < OFTEN * len(parts):
        return None
    frequency, amplitude = np.median(np.array(found), axis=0)
    return Swing(float(frequency), float(amplitude), len(found), len(parts))


def is_quiet(record: Record, machine: Machine) -> bool:
    """Whether a record has OFTEN_LOOKED rests or more that are long enough to show a swing, and none does."""
    return sum(1 for _ in _ends_of_rests(record)) >= OFTEN_LOOKED and swing_at_rest(record, machine) is None


def _ends_of_rests(record: Record) -> Iterator[Array]:
    """The positions (n,) [m] of the last half of each rest that is long enough."""
    halves = (record.position[(start + stop) // 2 : stop] for start, stop in _rests(record))
    return (half for half in halves if half.size >= LEAST_SAMPLES)


def _rests(record: Record) -> list[tuple[int, int]]:
    """Where reference and feedforward stand still, as start and stop."""
    moves = (np.diff(record.reference) != 0) | (np.diff(record.feedforward) != 0)
    ends = np.concatenate([[0], np.flatnonzero(moves) + 1, [record.reference.size]])
    return [(int(a), int(b)) for a, b in pairwise(ends)]


def _line(position: Array, sample_time: float) -> tuple[float, float] | None:
    """Frequency [Hz] and amplitude [m] of a swing that lasts; None where there is none."""
    at = np.linspace(-1.0, 1.0, position.size)
    off = position - np.polyval(np.polyfit(at, position, 1), at)
    first, second = (float(np.std(half)) for half in np.array_split(off, 2))
    energy = np.abs(np.fft.rfft(off * np.hanning(off.size))) ** 2
    peak = int(np.argmax(energy))
    if second <= KEPT * first or peak < LEAST_PERIODS:
        return None
    near = np.arange(peak - LINE, min(peak + LINE + 1, energy.size))
    line = energy[near]
    if float(np.sum(line)) < IN_ONE_LINE * float(np.sum(energy)):
        return None
    return float(np.sum(near * line) / np.sum(line)) / (off.size * sample_time), float(np.std(off)) * 2**0.5
