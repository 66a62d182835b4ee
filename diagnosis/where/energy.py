"""Where the unknown force's energy lies: in which motions, phases of a motion, frequencies and wavelengths.

Energy is the sum of the force's square over the samples, less what the scale's noise alone would give; shares are of
the total. Confidence intervals come from a bootstrap over whole motions, because neighbouring samples are correlated.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from diagnosis.records.motions import FEWEST, MotionKind, Piece
from models.effects.priors import REFERENCE, Units
from models.quantity import show
from models.records.record import Record

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

PHASES: Final = ("start", "accelerate", "cruise", "decelerate", "settle", "dwell", "excitation")
BEGINNING: Final = 0.1  # fraction of a motion that is its start
# Fraction of a motion's largest acceleration below which its speed counts as constant.
MAX_STEADY_ACCELERATION_SHARE: Final = 0.05
LOOK_LOOP_TIMES: Final = 2.8  # loop times: the reference moves where it changes within them by more than STEADY
STEADY: Final = 0.5  # deviations of the reading
BOOTSTRAP_DRAWS: Final = 400  # bootstrap samples
INTERVAL: Final = 0.95  # of the true values that are in it
# Bands and wavelengths are round numbers for a reader; nothing is decided by them.
DECADES: Final = 4  # edges between wavelengths: powers of ten, the longest of which fits into the way once at least
LEAST_BAND: Final = 10 ** (1 / 3)  # between the ends of the last band: a narrower one is a part of the one before
BANDS: Final = (0.0, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)  # Hz; the last one ends at half the sampling frequency


@dataclass(frozen=True)
class Shares:
    """Shares (K,) [1] of the energy by name, the ends of their intervals low, high (K,), each name's share of the time
    (K,), and the force's standard deviation there (K,) [N], noise included."""

    names: tuple[str, ...]
    share: Array
    low: Array
    high: Array
    time: Array
    deviation: Array

    def ranked(self) -> list[int]:
        """The names' indices, the largest share first."""
        return [int(i) for i in np.argsort(-self.share)]


@dataclass(frozen=True)
class EnergyShares:
    """The energy's shares by kind of motion, by phase, by both (named "kind | phase"), by frequency band, and by
    wavelength over position, between `wavelengths` (K - 1,) [m]."""

    motion: Shares
    phase: Shares
    motion_and_phase: Shares
    band: Shares
    wavelength: Shares
    wavelengths: tuple[float, ...]


@dataclass(frozen=True)
class Samples:
    """Labels of every sample of all records (n,): its motion, its phase (index of PHASES), its kind of motion (index of
    `kinds`), the sign of the last motion, and whether it counts; and the machine's own quantities."""

    motion: Integers
    phase: Integers
    kind: Integers
    kinds: tuple[MotionKind, ...]
    direction: Array
    counts: NDArray[np.bool_]
    units: Units = REFERENCE


def label_samples(
    records: Sequence[Record],
    pieces: Sequence[Piece],
    motion: Integers,
    counts: Array,
    settling: float,
    units: Units = REFERENCE,
) -> Samples:
    """Labels for the samples of all records; motion (n,): see motions.numbered; counts (n,): weights, 0 for samples
    that do not count; settling [s]: the time after the reference's halt that is settling, before the dwell; units: the
    machine's."""
    kinds = tuple(dict.fromkeys(piece.kind for piece in pieces))
    of_piece = np.array([kinds.index(piece.kind) for piece in pieces])
    excited = np.array([piece.kind.excited for piece in pieces])
    parts = [_phases(record, settling, units) for record in records]
    phase = np.concatenate([part[0] for part in parts])
    still = np.isin(phase, [PHASES.index("settle"), PHASES.index("dwell")])
    phase[excited[motion] & still] = PHASES.index("excitation")
    direction = np.concatenate([part[1] for part in parts])
    return Samples(motion, phase, of_piece[motion], kinds, direction, counts > 0, units)


def _phases(record: Record, settling: float, units: Units) -> tuple[Integers, Array]:
    """(phase (n,), sign of the last motion (n,)) of one record from its reference, else from its position."""
    ts, course, n = record.sample_time, record.reference, record.position.size
    if np.ptp(course) == 0:
        course = record.position
    wide = max(round(LOOK_LOOP_TIMES * units.loop / ts / 2), 1)
    padded = np.pad(course, wide, mode="edge")
    gone = padded[2 * wide :] - padded[: -2 * wide]
    moves = np.abs(gone) > max(STEADY * units.reading, _steps(record, course))
    phase, speed = np.full(n, PHASES.index("dwell")), np.gradient(course, ts)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], moves, [False]]).astype(int)))
    for first, last in edges.reshape(-1, 2):  # LOOK_LOOP_TIMES widens a motion at both ends
        start, stop = (int(first) + wide if first > 0 else 0), (int(last) - wide if last < n else n)
        if stop < start:
            continue
        lasts = stop - start
        if lasts < 3:  # the reference jumps: what follows is the table's settling, and the beginning of that its start
            stop, lasts = start, round(settling / ts)
        else:
            phase[start:stop] = _within(speed[start:stop])
        phase[stop : stop + round(settling / ts)] = PHASES.index("settle")
        phase[start : start + max(round(BEGINNING * lasts), 1)] = PHASES.index("start")
    sign = np.sign(gone) * moves
    held = np.maximum.accumulate(np.where(sign != 0, np.arange(n), 0))
    return phase, sign[held]


def _steps(record: Record, course: Array) -> float:
    """Threshold [m] for a measured position, which is noisy at rest: six deviations of its sample-to-sample change."""
    return 6 * float(np.std(np.diff(course))) if course is record.position else 0.0


def _within(speed: Array) -> Integers:
    """accelerate, cruise or decelerate for each sample (n,) of a motion."""
    bend = np.gradient(np.abs(speed))
    phase = np.full(speed.size, PHASES.index("cruise"))
    limit = MAX_STEADY_ACCELERATION_SHARE * float(np.max(np.abs(bend)))
    phase[bend > limit] = PHASES.index("accelerate")
    phase[bend < -limit] = PHASES.index("decelerate")
    return phase


def centred(signal: Array, samples: Samples) -> Array:
    """A signal (n,) less its mean over the samples that count, 0 where they do not; in its unit [SI]."""
    return np.asarray(np.where(samples.counts, signal - np.mean(signal[samples.counts]), 0.0))


def bootstrap_counts(motions: int, seed: int) -> Array:
    """How often each motion is drawn in each bootstrap sample: (BOOTSTRAP_DRAWS, motions) [1]."""
    generator = np.random.default_rng(seed)
    return generator.multinomial(motions, np.full(motions, 1 / motions), BOOTSTRAP_DRAWS).astype(float)


def interval_ends(motions: int) -> tuple[float, float]:
    """The quantiles [1] of what is bootstrapped over so many motions between which INTERVAL of the true values are:
    draws of few motions scatter by less than the motions do (the expanded percentile interval of T. Hesterberg, What
    Teachers Should Know About the Bootstrap, The American Statistician 69, 2015). All draws, of one or two."""
    if motions < 3:
        return 0.0, 1.0
    reach = math.sqrt(motions / (motions - 1)) * stats.t.ppf(0.5 + 0.5 * INTERVAL, motions - 1)
    outside = float(stats.norm.cdf(-reach))
    return outside, 1 - outside


def bootstrap_interval(values: Array, motions: int) -> tuple[float, float]:
    """The 95 % interval of values that are bootstrapped over so many motions (BOOTSTRAP_DRAWS,), in their unit [1]; of
    a handful, whose draws do not reach as far, Student's about their mean."""
    low, high = np.quantile(values, interval_ends(motions))
    if 1 < motions < FEWEST:
        reach = stats.t.ppf(0.5 + 0.5 * INTERVAL, motions - 1) * math.sqrt(motions / (motions - 1)) * np.std(values)
        low, high = np.mean(values) - reach, np.mean(values) + reach
    return float(low), float(high)


def closure_interval(closure: float, drawn: Array, motions: int) -> tuple[float, float]:
    """The 95 % interval of a closure [1] by what is drawn over so many motions; from nothing to all of the gap, or
    beyond, of one motion, which tells nothing of others. No end is beyond -1 or 1, unless the closure itself is."""
    if motions < 2:
        return min(0.0, closure), max(1.0, closure)
    low, high = bootstrap_interval(drawn, motions)
    return max(low, min(-1.0, closure)), min(high, max(1.0, closure))


def shares(
    square: Array, noise: float, label: Integers, names: Sequence[str], samples: Samples, seed: int = 0
) -> Shares:
    """Shares of the energy by label (n,): the force's square (n,) [N2] less `noise` [N2], its variance due to noise."""
    count, used, motions = len(names), samples.counts & (label >= 0), int(samples.motion.max()) + 1
    place = samples.motion[used] * count + label[used]
    energy = np.asarray(np.bincount(place, square[used] - noise, motions * count), float).reshape(motions, count)
    time = np.bincount(label[used], minlength=count)
    return _shared(names, energy, time, noise, int(time.sum()), seed)


def _shared(names: Sequence[str], energy: Array, time: Integers, noise: float | Array, whole: int, seed: int) -> Shares:
    """Shares of net energies (motions, K) [N2 samples] in `time` (K,) of `whole` [samples]; noise [N2] a sample."""
    low, high = np.quantile(
        _of_sums(bootstrap_counts(energy.shape[0], seed) @ energy), interval_ends(energy.shape[0]), axis=0
    )
    share, spent = _of_sums(energy.sum(axis=0)[None])[0], np.maximum(time, 1)
    deviation = np.sqrt(np.maximum(energy.sum(axis=0) / spent + noise, 0.0))
    return Shares(tuple(names), share, np.minimum(low, share), np.maximum(high, share), time / whole, deviation)


def _of_sums(energy: Array) -> Array:
    """Shares (b, K) of energies (b, K); all are zero where nothing exceeds the noise."""
    above = np.maximum(energy, 0.0)
    whole = above.sum(axis=1, keepdims=True)
    return np.asarray(np.divide(above, whole, out=np.zeros_like(above), where=whole > 0))


def by_band(
    force: Sequence[Array], response: Array, noise: float, sample_time: float, samples: Samples, seed: int = 0
) -> Shares:
    """Shares by frequency, between BANDS [Hz]; force (n,) [N] of each record. The noise [m] of the scale is taken off
    each band through `response`, the smoothed force [N] that one reading of 1 m causes."""
    spans, motions = bands(sample_time), int(samples.motion.max()) + 1
    energy, floors = np.empty((motions, len(spans))), np.empty(len(spans))
    for i, (low, high) in enumerate(spans):
        part = np.concatenate([_band(one, low, high, sample_time) for one in force])
        floors[i] = noise**2 * float(np.sum(_band(response, low, high, sample_time) ** 2))
        energy[:, i] = np.bincount(samples.motion, (part**2 - floors[i]) * samples.counts, motions)
    names = [f"{low:g} to {high:g} Hz" for low, high in spans]
    time = int(np.count_nonzero(samples.counts))
    return _shared(names, energy, np.full(len(spans), time), floors, time, seed)


def bands(sample_time: float) -> list[tuple[float, float]]:
    """The bands of frequency [Hz] up to half the sampling frequency; what is left over of one is no band by itself."""
    half = 0.5 / sample_time
    return list(itertools.pairwise([*(edge for edge in BANDS if edge * LEAST_BAND < half), half]))


def _band(signal: Array, low: float, high: float, sample_time: float) -> Array:
    """The part of a signal (n,) with low <= frequency < high [Hz], in the signal's unit; half the sampling frequency
    is a part of the band that ends there."""
    spectrum = np.fft.rfft(signal - np.mean(signal))
    frequency = np.fft.rfftfreq(signal.size, sample_time)
    last = high >= 0.5 / sample_time
    spectrum[(frequency < low) | (frequency >= high) & (not last)] = 0.0
    return np.asarray(np.fft.irfft(spectrum, signal.size))


def wavelengths(position: Array) -> tuple[float, ...]:
    """Wavelengths [m] that tell waves apart on the way of these positions (n,) [m]; none where there is no way."""
    way = float(np.ptp(position))
    last = math.floor(math.log10(way)) if way > 0 else 0
    return tuple(float(f"1e{last - i}") for i in reversed(range(DECADES))) if way > 0 else ()


def by_wavelength(
    force: Array, position: Array, between: Sequence[float], noise: float, samples: Samples, seed: int = 0
) -> Shares:
    """Shares by wavelength over position, `between` these [m], of the force (n,) [N] while the table moves, at its
    position (n,) [m]; noise [N]: standard deviation of one sample. A wave longer than the motion counts as being as
    long as the motion."""
    edges = [0.0, *between, np.inf]
    spans = [f"of {show(low, 'm')} to {show(high, 'm')}" for low, high in itertools.pairwise(between)]
    ends = (f"shorter than {show(between[0], 'm')}", f"longer than {show(between[-1], 'm')}") if between else ()
    names = [ends[0], *spans, ends[1]] if ends else ["of any length"]
    moving = samples.counts & (samples.phase < PHASES.index("settle"))
    energy = np.zeros((int(samples.motion.max()) + 1, len(names)))
    for i in range(len(energy)):
        here = (samples.motion == i) & moving
        if np.count_nonzero(here) > 8 and np.ptp(position[here]) > 0:
            energy[i] = _by_wavelength(position[here], force[here], noise, edges)
    time = int(np.count_nonzero(moving))
    return _shared(names, energy, np.full(len(names), time), 0.0, max(time, 1), seed)


def _by_wavelength(position: Array, force: Array, noise: float, edges: Sequence[float]) -> Array:
    """Net energy (K,) [N2 samples] of a force (n,) [N] over the path of one motion (n,) [m], by wavelength."""
    count, order = force.size, np.argsort(position)
    along = np.interp(np.linspace(position.min(), position.max(), count), position[order], force[order])
    sides = np.where(np.arange(count // 2 + 1) > 0, 2.0, 1.0)
    power = sides * (np.abs(np.fft.rfft(along)) ** 2 / count - noise**2)
    length = np.ptp(position) / np.maximum(np.arange(power.size), 1)  # the mean counts as one wave
    return np.array([np.sum(power[(length >= low) & (length < high)]) for low, high in itertools.pairwise(edges)])
