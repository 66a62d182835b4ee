"""How rough a drive is, record by record: what its models leave, and a force as rough for records that are simulated.

What does not repeat between equal motions follows no law. Where nothing repeats, or where what repeats is finer than
any law of the catalogue, time tells: a rough force leaves most of its mark about and above the frequencies that the
loop controls, alike at all times. A law that is missing leaves most of its own below, and what it leaves there it
leaves at times: where the table turns, starts or halts. So the median over short blocks of the innovations' power there
tells the one from the other. A drive is as rough in all of its records, so that what is steadily there counts as far as
it is in each of them: in one alone it is a law that its motions show.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.model.fit import Fit, unrepeated
from diagnosis.model.kalman import STARTING
from diagnosis.records.motions import pieces
from diagnosis.records.units import loop_time
from models.effects.base import Effect, Numbers, Place, T, hook
from models.effects.parameter import parameter
from models.records.record import Record

Array = NDArray[np.float64]

BAND: Final = (1.0, 4.0)  # in units of the frequency to which the loop controls the table
NYQUIST_BAND: Final = (0.2, 0.8)  # of half the sampling rate, where that band is beyond it
BLOCK_LOOP_TIMES: Final = 24.0  # loop times of a spectrum: its lines are much narrower than the band
MIN_BLOCK_SAMPLES: Final = 32  # samples of such a block at least
MOVING: Final = 10  # blocks with motion from which on those at rest do not count


def variance_by_record(fitted: Fit) -> Array:
    """Chi-square per sample that a fit leaves of each record [1]; 1 where its weights hold."""
    return np.array([float(np.mean(one.innovations[STARTING:] ** 2)) for one in fitted.residuals])


def unmodelled_variance(fitted: Fit, records: Sequence[Record], least: int) -> Array:
    """By record, the variance [1] of what no law of the catalogue can explain, in the deviations that the weights
    promise: of what is steadily there in every record, or of what equal motions do not repeat, whichever is more.
    least: equal motions from which on they tell."""
    nominal = fitted.candidate.nominal
    loop = loop_time(nominal)
    apart = unrepeated(fitted, records, pieces(records, loop), least)
    ends = np.cumsum([record.position.size for record in records])[:-1]
    known = (own[~np.isnan(own)] for own in np.split(apart, ends))
    scatter = np.array([float(np.mean(own**2)) if own.size else 0.0 for own in known])
    pairs = zip(fitted.residuals, records, strict=True)
    steady = np.array([steady_variance(residual.innovations, record, loop) for residual, record in pairs])
    told = np.minimum(steady, variance_by_record(fitted))
    counts = np.array([_blocks(record, loop)[1] for record in records])
    of_many = told[counts >= min(MOVING, counts.max())]  # the least of a few blocks is of chance
    return np.asarray(np.maximum(scatter, np.min(of_many) if counts.max() > 1 else 1.0))


def _blocks(record: Record, loop: float) -> tuple[int, int]:
    """The samples of a short block, and how many of them a record has."""
    length = max(round(BLOCK_LOOP_TIMES * loop / record.sample_time), MIN_BLOCK_SAMPLES)
    return length, (record.position.size - STARTING) // length


def steady_variance(innovations: Array, record: Record, loop: float) -> float:
    """Variance [1] of a record's innovations (n,) about and above the loop's frequency, in that of white noise: the
    median over short blocks and over the frequencies, as a law leaves lines; nan of a record that is too short to tell.
    loop [s]: `units.loop_time`."""
    half = 0.5 / record.sample_time
    low, high = (np.array(BAND) / (2 * np.pi * loop)).clip(max=np.array(NYQUIST_BAND) * half)
    length, count = _blocks(record, loop)
    e, course = innovations[STARTING:], record.reference[STARTING:]
    if count < 2:
        return math.nan
    window = np.hanning(length)
    power = np.abs(np.fft.rfft(e[: count * length].reshape(count, length) * window)) ** 2 / np.sum(window**2)
    frequency = np.fft.rfftfreq(length, record.sample_time)
    within = power[:, (frequency >= low) & (frequency <= high)]
    moving = np.ptp(course[: count * length].reshape(count, length), axis=1) > 0
    chosen = within[moving] if np.count_nonzero(moving) >= MOVING else within
    return float(np.median(chosen) / np.log(2))  # the median of an exponential distribution of mean 1


@hook
def _rough(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:  # noqa: ARG001
    number = int(now[T] / p[1] + 1e-6 + p[2]) & 0x7FFFFFFF
    total = 0.0
    for _ in range(3):  # the sum of three uniform numbers is nearly normal
        for _ in range(2):
            number = ((number ^ (number >> 15)) * 0x2C1B3C6D + 0x297A2D39) & 0x7FFFFFFF
        total += number / 0x80000000 - 0.5
    return value + 2.0 * p[0] * total


@dataclass(frozen=True)
class WhiteForce(Effect):
    """A force that is another in every sample: what a simulated drive has that is as rough as a measured one.

    No effect of the catalogue: it has no law, and nothing is told by its name.
    """

    name: ClassVar = "white_force"
    family: ClassVar = "structure"
    equation: ClassVar = r"d_k\sim(0,\sigma^2)"
    source: ClassVar = "assumed: three uniform numbers of a hash of the sample's number"
    hooks: ClassVar = {Place.FORCE: _rough}
    depends_on_time: ClassVar = True
    deviation: float = parameter("N", "deviation sigma", 1e-3, 10.0, "amplitude", at_least=0)
    sample: float = parameter("s", "sample time", 1e-5, 1e-1, "shape", above=0)
    first: float = parameter("1", "number of the first sample", 1.0, 1e9, "shape", at_least=0)
