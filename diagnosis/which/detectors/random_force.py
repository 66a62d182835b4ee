"""Random forces about a frequency, such as the floor's: a place of their own in the predictor, not a column.

What shakes is not locked to the motion, drifts in phase and is another in each record; so it is a random force with a
frequency, a bandwidth and a level, and what it gains is the likelihood's, of which -2 log is compared like chi-square.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from diagnosis.model.fit import Fit, fit
from diagnosis.model.kalman import STARTING, Resonance
from diagnosis.model.residual import Candidate, evaluate
from diagnosis.records.units import contact_length, loop_time, usual_force, white_force
from diagnosis.which.detectors.scan import NuisanceProjection, adjoints, linear_columns
from models.effects.base import parameters
from models.effects.catalogue import in_order
from models.effects.priors import REFERENCE, Priors
from models.effects.structure import FloorVibration
from models.machine import Machine
from models.records.record import Record

Array = NDArray[np.float64]

NAME: Final = FloorVibration.name  # by which random forces are told
BANDWIDTHS: Final = (0.1, 0.01)  # Hz; the first is that of the search, the others are tried at the line found
# At these relative frequencies the same force must gain less, or it only follows a slow force.
ASIDE: Final = (0.7, 1.4)
WHITER_FACTORS: Final = (2.0, 4.0, 8.0)  # times the white force, which must gain less as well: it has all frequencies
LEVEL_FACTORS: Final = (10**-0.25, 10**0.25)  # of the levels that are tried, which are half a decade apart
MIN_LEVEL_SHARE: Final = 0.125  # of the white force: the smallest level that is tried
# Of the longest record's line: a narrower force keeps its phase for as long as records last.
MIN_BANDWIDTH_LINES: Final = 0.01
MAX_RELATIVE_BANDWIDTH: Final = 0.1  # of a force's frequency: a wider one is no line
# Lines of a record by which a smoothed spectrum may put a force beside its frequency.
MAX_FREQUENCY_OFFSET_LINES: Final = 3.0
MIN_SINE_SAMPLES: Final = 20  # samples to which no sine is fitted
SINE_FIT_CYCLES: Final = 10.0  # of a force over which a sine is fitted to it
MIN_REFINED_GAIN: Final = 100.0  # of -2 log likelihood: what gains more is found more finely than the grid is
MAX_FRICTION_SHARE: Final = 0.02  # of the friction: the largest, unless MIN_LEVELS reach further
MIN_LEVELS: Final = 4  # levels, half a decade apart
SAME_FREQUENCY_RATIOS: Final = (0.8, 1.25)  # frequencies, relative, between which a force counts as being about one
MAX_NYQUIST_SHARE: Final = 0.9  # of half the sampling rate: up to there forces about a frequency are looked for
BELOW_MODES: Final = 0.5  # of the lowest mode's frequency: above, what a wrong mode leaves would pass for one
TRIED_FREQUENCIES: Final = 3  # frequencies
BLOCK_LOOP_TIMES: Final = 415.0  # loop times over which power is averaged
STANDS: Final = (
    0.05  # of a contact's length, and of the friction: a reference, and a feedforward, that go less stand still
)
SETTLES: Final = 5.5  # loop times after which an axis has come to rest
MIN_COMPARED_SHARE: Final = 0.05  # of all samples, at rest and in motion, from which on the two are compared


@dataclass(frozen=True)
class RandomForce:
    """A random force and what it gains of -2 log likelihood with everything else held; steady: how much of its mean
    power is there half of the time [1]; even: the bounds of its `evenness` [1]."""

    resonance: Resonance
    gain: float
    steady: float = 1.0
    even: tuple[float, float] = (1.0, 1.0)


def is_about(frequency: float, other: float) -> bool:
    """Whether two frequencies [Hz] are so near to each other that a force about one may be due to the other."""
    return SAME_FREQUENCY_RATIOS[0] < frequency / other < SAME_FREQUENCY_RATIOS[1]


def with_sines(candidate: Candidate) -> Candidate:
    """The candidate with a sine of equal power in place of each random force, which a simulation can have."""
    sines = [FloorVibration(2**0.5 * one.level, one.frequency, 0.0) for one in candidate.random_forces]
    return replace(candidate, effects=in_order((*candidate.effects, *sines)), random_forces=())


def strongest_random_force(
    fitted: Fit, records: Sequence[Record], projection: NuisanceProjection, about: float | None = None
) -> RandomForce | None:
    """The random force that gains the most beside what is in the model; its gain over that of its neighbours, or of a
    larger white force where that is more. None where the records are sampled too slowly for any. about: looks only at
    frequencies near this one [Hz], which may lie above those that are searched otherwise."""
    tried = _frequencies(fitted, records, projection, about)
    found = [_strongest(fitted, records, one, BANDWIDTHS[0]) for one in tried]
    if not found:
        return None
    best = max(found, key=lambda one: one.gain)
    beside = _aside(best.resonance, fitted, records)
    if best.gain > max(map(_whole, beside)):
        best = _finer(best, fitted, records)
        if best.gain - max(map(_whole, beside)) > MIN_REFINED_GAIN:
            best = _climbed(best, fitted, records)
        beside = [*_aside(best.resonance, fitted, records), *_of_whiter_forces(fitted, records)]
    line = best.resonance
    aside = max(beside, key=_whole)
    whole, slow = (np.concatenate(one) for one in (reductions(fitted, records, line), aside))
    own = whole - slow if np.sum(slow) > 0 else whole
    innovations = [seen.innovations for seen in fitted.residuals]
    loop = loop_time(fitted.candidate.nominal)
    steady = steadiness(innovations, line.frequency, records[0].sample_time, loop)
    resting = np.concatenate([at_rest(record, fitted.candidate.nominal)[STARTING:] for record in records])
    # A line of a law that acts at rest only may gain evenly over its neighbours, and one of motions evenly by itself.
    low, high = zip(evenness(own, resting), evenness(whole, resting), strict=True)
    return RandomForce(line, float(np.sum(own)), steady, (min(low), min(high)))


def _finer(found: RandomForce, fitted: Fit, records: Sequence[Record]) -> RandomForce:
    """The random force with the bandwidth, and the level between those that are tried, with which it gains the most."""
    frequency = found.resonance.frequency
    best = max(
        found, *(_strongest(fitted, records, frequency, one) for one in BANDWIDTHS[1:]), key=lambda one: one.gain
    )
    between = [replace(best.resonance, level=factor * best.resonance.level) for factor in LEVEL_FACTORS]
    tried = [RandomForce(one, _whole(reductions(fitted, records, one))) for one in between]
    return max(best, *tried, key=lambda one: one.gain)


def _climbed(found: RandomForce, fitted: Fit, records: Sequence[Record]) -> RandomForce:
    """The random force at the frequency, and with the bandwidth, at which it gains the most, and as large as it is seen
    to be: the grid's frequencies are those of the records' spectra. The likelihood tells how fast its amplitude may
    change, and hardly how large it is: a force of half the size and four times the bandwidth is followed as well."""

    width = 1 / max(record.position.size * record.sample_time for record in records)  # Hz: of the longest record's line
    least, most = (found.resonance.frequency + side * MAX_FREQUENCY_OFFSET_LINES * width for side in (-1, 1))

    def higher(line: Resonance, hertz: float) -> Resonance:
        return replace(line, frequency=min(max(line.frequency + hertz, least), most))

    def narrower(line: Resonance, decades: float) -> Resonance:
        return replace(
            line,
            bandwidth=min(
                max(line.bandwidth * 10**-decades, MIN_BANDWIDTH_LINES * width), MAX_RELATIVE_BANDWIDTH * most
            ),
        )

    if least <= 0:
        return found
    best = _uphill(found, higher, (width / 4, width / 40), fitted, records)
    line = replace(best.resonance, level=_level(best.resonance.frequency, fitted, records) or best.resonance.level)
    seen = RandomForce(line, _whole(reductions(fitted, records, line)))
    seen = _uphill(seen, narrower, (1.0, 0.25), fitted, records)
    return seen if seen.gain > MIN_REFINED_GAIN else best


def _level(frequency: float, fitted: Fit, records: Sequence[Record]) -> float:
    """The deviation [N] of a force about a frequency [Hz]: of the sines that fit what is left best, by least squares,
    each over some of its cycles. What chance alone makes of them is taken off; 0 where that is all, or no record holds
    a cycle."""
    columns = linear_columns([FloorVibration(1.0, frequency, 0.0)], fitted, records)[0]
    power, count, begin = 0.0, 0, 0
    for record in records:
        inside = slice(begin + STARTING, begin + record.position.size)
        begin = inside.stop
        if inside.stop - inside.start < max(1 / (frequency * record.sample_time), MIN_SINE_SAMPLES):
            continue
        parts = max(int((inside.stop - inside.start) * record.sample_time * frequency / SINE_FIT_CYCLES), 1)
        pieces = (np.array_split(one[inside], parts) for one in (columns, fitted.innovations))
        for shape, left in zip(*pieces, strict=True):
            gram = shape.T @ shape
            size = -np.linalg.solve(gram, shape.T @ left)
            rest = float(np.var(left + shape @ size))
            power += left.size * 0.5 * float(size @ size - rest * np.trace(np.linalg.inv(gram)))
            count += left.size
    return math.sqrt(max(power / max(count, 1), 0.0))


def as_seen(fitted: Fit, records: Sequence[Record]) -> Fit:
    """A fit whose last random force is as large as it is seen to be beside the fitted values: without it, these had
    made up for a part of it."""
    candidate = fitted.candidate
    *others, line = candidate.random_forces
    without = replace(candidate, random_forces=tuple(others))
    alone = fit(without, records, paths=fitted.paths, iterations=0, walk=fitted.walk)
    level = _level(line.frequency, alone, records)
    if level <= 0:
        return fitted
    larger = replace(candidate, random_forces=(*others, replace(line, level=level)))
    return fit(larger, records, paths=fitted.paths, iterations=0, walk=fitted.walk)


def _uphill(
    found: RandomForce,
    moved: Callable[[Resonance, float], Resonance],
    steps: tuple[float, float],
    fitted: Fit,
    records: Sequence[Record],
) -> RandomForce:
    """The random force moved, in steps from the first size down to the last [the unit of what is moved], for as long as
    it gains more."""
    step, least = steps
    while step >= least:
        for size in (step, -step):
            line = moved(found.resonance, size)
            other = RandomForce(line, _whole(reductions(fitted, records, line)))
            if other.gain > found.gain:
                found = other
                break
        else:
            step /= 2
    return found


def _aside(line: Resonance, fitted: Fit, records: Sequence[Record]) -> list[list[Array]]:
    """`reductions` by the same force at the frequencies beside its own."""
    return [reductions(fitted, records, replace(line, frequency=line.frequency * factor)) for factor in ASIDE]


def at_rest(record: Record, machine: Machine) -> NDArray[np.bool_]:
    """Whether a record's reference [m] stands still, has for SETTLES, and no feedforward [N] excites the axis: (n,)."""
    samples = max(round(SETTLES * loop_time(machine) / record.sample_time), 1)
    still = _range(record.reference, samples) <= STANDS * contact_length(machine)
    return np.asarray(still & (_range(record.feedforward, samples) <= STANDS * usual_force(machine)))


def _range(signal: Array, samples: int) -> Array:
    """How far a signal (n,) has gone within the last so many samples: (n,), in its unit [any]."""
    window = {"size": samples + 1, "origin": samples // 2, "mode": "nearest"}
    return np.asarray(maximum_filter1d(signal, **window) - minimum_filter1d(signal, **window))


def evenness(gained: Array, resting: NDArray[np.bool_]) -> tuple[float, float]:
    """What a force gains a sample at rest, over what it gains a sample in all, or in motion where that is less, as
    bounds two deviations to either side [1]: a floor shakes the same whatever the axis does. Gains (n,) of -2 log
    likelihood, whose deviation is that of white innovations beside a force of steady power; (0, infinity) where nothing
    tells, as one of the two is next to never."""
    if gained.size == 0:
        return 0.0, math.inf
    shares = np.array([np.mean(resting), 1 - np.mean(resting)])
    expected = shares * float(np.sum(gained))
    if np.min(shares) < MIN_COMPARED_SHARE or np.min(expected) <= 0:
        return 0.0, math.inf
    parts, chance = np.array([np.sum(gained[resting]), np.sum(gained[~resting])]), 4 * np.sqrt(expected)
    return float(np.min((parts - chance) / expected)), float(np.min((parts + chance) / expected))


def levels(white: float, friction: float) -> tuple[float, ...]:
    """The levels [N] that are tried, half a decade apart: from what the usual white force [N] hides to a part of the
    friction [N]."""
    least = MIN_LEVEL_SHARE * white
    count = math.floor(2 * math.log10(max(MAX_FRICTION_SHARE * friction / least, 1.0))) + 1
    return tuple(least * 10 ** (0.5 * i) for i in range(max(count, MIN_LEVELS)))


def _strongest(fitted: Fit, records: Sequence[Record], frequency: float, bandwidth: float) -> RandomForce:
    """The random force about a frequency [Hz] at the level from which on a larger one gains less."""
    nominal = fitted.candidate.nominal
    best: RandomForce | None = None
    for level in levels(white_force(nominal), usual_force(nominal)):
        resonance = Resonance(frequency, bandwidth, level)
        found = RandomForce(resonance, _whole(reductions(fitted, records, resonance)))
        if best is not None and found.gain < best.gain:
            break
        best = found
    assert best is not None
    return best


def steadiness(
    innovations: Sequence[Array], frequency: float, sample_time: float, loop: float = REFERENCE.loop
) -> float:
    """Median over mean [1] of the power of innovations (n,) about a frequency [Hz]: a floor shakes at rest, too. loop
    [s]: the machine's `units.loop_time`."""
    near = scipy.signal.butter(
        2, np.array(SAME_FREQUENCY_RATIOS) * frequency, "bandpass", fs=1 / sample_time, output="sos"
    )
    power = []
    for one in innovations:
        band = scipy.signal.sosfiltfilt(near, one)
        parts = max(round(band.size * sample_time / (BLOCK_LOOP_TIMES * loop)), 1)
        power += [float(np.mean(part**2)) for part in np.array_split(band, parts)]
    return float(np.median(power) / np.mean(power))


def reductions(fitted: Fit, records: Sequence[Record], resonance: Resonance) -> list[Array]:
    """By how much a random force reduces -2 log likelihood, sample by sample (n,) of each record [1]."""
    with_it = replace(fitted.candidate, random_forces=(*fitted.candidate.random_forces, resonance))
    return _reduced_by(with_it, fitted, records)


def _of_whiter_forces(fitted: Fit, records: Sequence[Record]) -> list[list[Array]]:
    """`reductions` by white forces of WHITER_FACTORS times the fit's, up to the one from which on a larger one gains
    less. A drive whose force scatters a little more than its model's had a floor vibration of 39 mN in place of 10 mN
    of noise: of all lines, that gains the most to which the loop is most sensitive."""
    candidate, found = fitted.candidate, list[list[Array]]()
    for factor in WHITER_FACTORS:
        roughness = tuple(factor * candidate.roughness_of(i) for i in range(len(records)))
        reduced = _reduced_by(replace(candidate, roughness=roughness), fitted, records)
        if found and _whole(reduced) < _whole(found[-1]):
            break
        found.append(reduced)
    return found


def _reduced_by(candidate: Candidate, fitted: Fit, records: Sequence[Record]) -> list[Array]:
    """By how much a candidate of the same values leaves less of -2 log likelihood, sample by sample (n,) of each record
    [1]."""
    made = evaluate(candidate, records, fitted.paths, fitted.walk)
    return [
        before.innovations[STARTING:] ** 2
        - after.innovations[STARTING:] ** 2
        + 2 * math.log(before.deviation / after.deviation)
        for before, after in zip(fitted.residuals, made, strict=True)
    ]


def _whole(reductions: Sequence[Array]) -> float:
    return sum(float(np.sum(one)) for one in reductions)


def _frequencies(
    fitted: Fit, records: Sequence[Record], projection: NuisanceProjection, near: float | None = None
) -> list[float]:
    """The strongest lines [Hz] of what the innovations have in common with a force, relative to those about them; near:
    only those about this frequency [Hz], of which one is enough."""
    machine, sample_time = fitted.candidate.machine, records[0].sample_time
    known = (Priors(units=machine.priors.units), machine.priors)
    usual, stated = (next(item for item in parameters(FloorVibration, one) if item.role == "period") for one in known)
    low, high = min(usual.low, stated.low), _highest(machine, max(usual.high, stated.high), sample_time)
    if near is not None:
        high = max(high, min(near * SAME_FREQUENCY_RATIOS[1], _held(sample_time)))
    if low >= high:
        return []
    own = (stated.low, stated.high) != (usual.low, usual.high)
    first, last = (0.99 * stated.low, 1.01 * stated.high) if own else (low, high)
    longest = max(records, key=lambda one: one.position.size * one.sample_time)
    bins = np.asarray(np.fft.rfftfreq(_padded(longest.position.size), longest.sample_time), float)
    power = np.zeros(bins.size)
    for record, force, _ in adjoints(fitted, records, projection):
        n = _padded(force.size)
        spectrum = np.abs(np.fft.rfft(force, n)) ** 2 / force.size
        power += np.interp(bins, np.fft.rfftfreq(n, record.sample_time), _smooth(spectrum, 5), right=0.0)
    about = _usual_power(bins, power, low, high)
    inside = np.flatnonzero((bins >= max(low, first)) & (bins <= min(high, last)))
    if near is not None:
        inside = inside[[is_about(frequency, near) for frequency in bins[inside]]]
    found: list[float] = []
    for i in inside[np.argsort(-(power / about)[inside], kind="stable")]:
        if all(abs(np.log(bins[i] / other)) > 0.15 for other in found):
            found.append(float(bins[i]))
        if len(found) == (TRIED_FREQUENCIES if near is None else 1):
            break
    return found


def _highest(machine: Machine, usual: float, sample_time: float) -> float:
    """Up to which frequency [Hz] a random force is looked for: the usual one or, as what shakes belongs to the site and
    not to the machine, a part of the lowest mode's; within what records of this sample time [s] hold."""
    modes = [machine.plant.modes[i].frequency for i in machine.plant.flexible]
    return min(max(usual, BELOW_MODES * min(modes, default=np.inf)), _held(sample_time))


def _held(sample_time: float) -> float:
    """Up to which frequency [Hz] records of this sample time [s] hold a random force and its neighbours."""
    return MAX_NYQUIST_SHARE / SAME_FREQUENCY_RATIOS[1] / 2 / sample_time


def _usual_power(bins: Array, power: Array, low: float, high: float) -> Array:
    """The median power (n,) about each of the frequencies (n,) [Hz], over a fifth of the logarithm of those looked at.
    A line itself is narrower than any grid of so wide a range."""
    grid = np.geomspace(low, high, 400)
    there = np.interp(grid, bins, power)
    about = np.array([np.median(there[max(i - 40, 0) : i + 41]) for i in range(grid.size)])
    return np.asarray(np.interp(bins, grid, about))


def _padded(samples: int) -> int:
    """The next power of two."""
    return int(2 ** np.ceil(np.log2(samples)))


def _smooth(spectrum: np.ndarray, width: int) -> np.ndarray:
    return np.convolve(spectrum, np.ones(width) / width, mode="same")
