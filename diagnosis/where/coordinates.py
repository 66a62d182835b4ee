"""On what the unknown force depends: each coordinate by itself, through a curve that is cross-validated over motions.

A curve is a sum of hat functions over the coordinate (piecewise linear between knots), once plain and once times the
direction of the last motion; it is fitted on some motions and evaluated on the others. The p-value comes from a
randomisation test that flips the sign of the force in whole motions: no curve survives that, while everything within a
motion stays as it is. (Permuting motions instead would keep a force that all motions share, because motions are alike.)
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from diagnosis.criteria import Criteria
from diagnosis.model.fit import Fit
from diagnosis.where.energy import PHASES, Samples, bootstrap_counts, bootstrap_interval, centred
from models.effects.priors import REFERENCE
from models.friction import deflections
from models.records.record import Record

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

FOLDS: Final = 10
KNOTS: Final = 10
FEW_KNOTS: Final = 6  # knots where curves over all coordinates are fitted at once
FLIPS: Final = 199  # random sign flips, so that the smallest p-value is 0.005
RIDGE: Final = 1e-3  # ridge parameter, relative to the mean energy of a column
RIDGES: Final = (1e-3, 1e-2, 0.1, 1.0)  # ridge parameters of which the best is taken for all curves at once
SLOWEST: Final = 0.0475  # contacts' lengths a loop time: below this speed the table counts as at rest
PITCHES: Final = (3e-3, 7e-2)  # m, on the reference table: the range in which a period over position is searched
SMOOTH: Final = 5  # samples over which an acceleration is averaged
STEADY: Final = 3.0  # deviations of a reading: half of what the table goes back before it counts as a reversal
COMMANDED: Final = 0.02  # the same of the command, in its own deviation
RESTED: Final = 276.0  # loop times of rest assumed before a record: longer than any recovery that it could show


@dataclass(frozen=True)
class Coordinate:
    """A coordinate's values (n,) at all samples and its unit; whether the knots of its curve are spaced
    logarithmically (by asinh); turns (n,): the sign with which the curve may change, such as that of the last motion;
    None: there is one curve."""

    name: str
    unit: str
    values: Array
    logarithmic: bool = False
    turns: Array | None = None


@dataclass(frozen=True)
class Explained:
    """How much of a signal's variance a coordinate explains on held-out motions: share [1], its interval, the p-value,
    the share of the part that changes sign with the direction (turning), and at the curve's knots (SI) its plain part
    and its directional part (turned) [N]; pitch [m]: the period, of a periodic curve."""

    name: str
    unit: str
    share: float
    low: float
    high: float
    p: float
    turning: float
    knots: Array
    curve: Array
    turned: Array
    pitch: float | None = None

    def is_stated(self, criteria: Criteria) -> bool:
        """Whether it is more than chance explains, and enough to be told."""
        return self.p < criteria.stated_p_value and self.share > criteria.stated_share


@dataclass(frozen=True)
class Dependence:
    """On what the unknown force depends.

    coordinates: what each explains, the largest share first. ceiling: the share [1] that curves over all of them
    explain at once, with its interval: an upper limit for any effect that they can describe. parity: how much is an
    even and an odd function of the speed. scatter: on what the size of the innovations depends.
    """

    coordinates: tuple[Explained, ...]
    ceiling: tuple[float, float, float]
    parity: tuple[Explained, Explained]
    scatter: tuple[Explained, ...]


def pitches(samples: Samples) -> tuple[float, float]:
    """The range [m] in which a period of the force over position is searched on this machine."""
    contact, way = samples.units.contact / REFERENCE.contact, samples.units.travel / REFERENCE.travel
    return PITCHES[0] * min(contact, way), PITCHES[1] * way


def slowest(samples: Samples) -> float:
    """The speed [m/s] below which the table counts as at rest."""
    return SLOWEST * samples.units.contact / samples.units.loop


def coordinates(fitted: Fit, records: Sequence[Record], samples: Samples) -> tuple[Coordinate, ...]:
    """The coordinates at all samples of all records [SI], without those that are constant in these records."""
    paths, ts, direction = [one.path for one in fitted.paths], records[0].sample_time, samples.direction
    position = np.concatenate([path.at_samples for path in paths])
    thrusts = [seen.acts.thrust.mean(axis=1) for seen in fitted.residuals]
    speed, kernel = np.concatenate([path.speed[:, 0] for path in paths]), np.full(SMOOTH, 1 / SMOOTH)
    acceleration = [np.convolve(np.gradient(path.speed[:, 0], path.sample_time), kernel, "same") for path in paths]
    begins = np.concatenate([[0], np.cumsum([record.position.size for record in records])])
    parts = [slice(a, b) for a, b in itertools.pairwise(begins)]
    time = np.concatenate([np.arange(record.position.size) * ts for record in records])
    since, dwell = (np.concatenate(found) for found in zip(*(_clock(samples, part, ts) for part in parts), strict=True))
    wide, width = STEADY * samples.units.reading, COMMANDED * float(np.std(np.concatenate(thrusts)))
    gone, way = (np.concatenate(found) for found in zip(*(since_turn(p.at_samples, wide) for p in paths), strict=True))
    branch = np.concatenate([since_turn(thrust, width)[1] for thrust in thrusts])
    every = (
        Coordinate("time", "s", time, turns=direction),
        Coordinate("time_in_motion", "s", since, logarithmic=True, turns=direction),
        Coordinate("dwell", "s", dwell, logarithmic=True, turns=direction),
        Coordinate("position", "m", position, turns=direction),
        Coordinate("velocity", "m/s", speed, logarithmic=True),
        Coordinate("velocity_sign", "1", np.sign(speed) * (np.abs(speed) > slowest(samples))),
        Coordinate("acceleration", "m/s2", np.concatenate(acceleration), logarithmic=True),
        Coordinate("command", "N", np.concatenate(thrusts), logarithmic=True, turns=branch),
        Coordinate("since_reversal", "m", gone, logarithmic=True, turns=way),
    )
    return tuple(one for one in every if np.ptp(one.values[samples.counts]) > 0)


def since_turn(signal: Array, width: float) -> tuple[Array, Array]:
    """How far (n,) a signal has gone since it last turned back by more than twice the width, and its direction (n,) [1]
    since then, 0 before it moved; in the signal's unit. A stop of that width is at its limit where the signal goes on.
    """
    stopped = deflections([width], signal)[:, 0]
    index, slides = np.arange(signal.size), np.abs(stopped) == width
    way = np.sign(stopped)[np.maximum.accumulate(np.where(slides, index, 0))]
    turned = np.concatenate([[True], np.diff(way) != 0])
    place = signal - stopped
    before = np.maximum(np.maximum.accumulate(np.where(turned, index, 0)) - 1, 0)
    return np.abs(place - place[before]), way


def _clock(samples: Samples, part: slice, sample_time: float) -> tuple[Array, Array]:
    """(time since the last motion began, duration of the rest before it) [s] at the samples of one record."""
    moving = samples.phase[part] < PHASES.index("settle")
    n = moving.size
    first = moving & ~np.concatenate([[False], moving[:-1]])
    last = ~moving & np.concatenate([[False], moving[:-1]])
    index = np.arange(n)
    began = np.maximum.accumulate(np.where(first, index, 0))
    ended = np.maximum.accumulate(np.where(last, index, -1))
    rest = np.where(ended >= 0, index - ended, index + round(RESTED * samples.units.loop / sample_time))
    return np.asarray((index - began) * sample_time), np.asarray(rest[began] * sample_time)


def hat_functions(
    coordinate: Coordinate, used: NDArray[np.bool_], most: int = KNOTS, *, straight: bool = False
) -> tuple[Array, Array]:
    """(hat functions (n, K) [1], their knots (K,) in the coordinate's unit) over the range of the samples used; K is at
    most `most`. Between knots that are spaced logarithmically they are linear in that scale or, if straight, in the
    coordinate itself, as a reader of a table interpolates."""
    values = coordinate.values
    small = np.abs(values[used & (values != 0)])
    scale = float(np.quantile(small, 0.1)) if coordinate.logarithmic and small.size else 0.0
    warped = np.arcsinh(values / scale) if scale > 0 else values
    levels = np.unique(warped[used])
    knots = levels if levels.size <= most else np.linspace(levels[0], levels[-1], most)
    spaced = np.sinh(knots) * scale if scale > 0 else knots
    over, among = (values, spaced) if straight else (warped, knots)
    place = np.clip(np.interp(over, among, np.arange(knots.size)), 0, knots.size - 1)
    low = np.minimum(place.astype(int), max(knots.size - 2, 0))
    basis = np.zeros((values.size, knots.size))
    rows = np.arange(values.size)
    basis[rows, low] = 1 - (place - low)
    basis[rows, np.minimum(low + 1, knots.size - 1)] += place - low
    return basis, spaced


@dataclass(frozen=True)
class Target:
    """What is to be explained: `products` gives, for columns (n, K) [1], their Gram matrices (motions, K, K) and their
    products with it (motions, K); energy (motions,): its square in each motion; ridges: of which the best is taken."""

    products: Callable[[Array], tuple[Array, Array]]
    energy: Array
    ridges: tuple[float, ...] = (RIDGE,)

    def held_out(self, grams: Array, slopes: Array, fold: Integers) -> tuple[Array, Array]:
        """`held_out` with the ridge that explains the most."""
        found = (held_out(grams, slopes, fold, ridge) for ridge in self.ridges)
        return max(found, key=lambda one: float(one[0].sum()))

    def chance(self, grams: Array, slopes: Array, fold: Integers, seed: int) -> Array:
        """`sign_flip_null` for a choice among the ridges (FLIPS,)."""
        found = [sign_flip_null(grams, slopes, fold, seed, ridge) for ridge in self.ridges]
        return np.asarray(np.max(found, axis=0))


def of_signal(signal: Array, samples: Samples) -> Target:
    """A signal (n,), its mean removed, as what is to be explained; its energy in [its unit squared]."""
    z = centred(signal, samples)
    return Target(lambda columns: by_motion(columns, z, samples.motion), energies(z, samples))


def explain(signal: Array, coordinate: Coordinate, samples: Samples, seed: int = 0) -> Explained:
    """How much of a signal (n,), its mean removed, the coordinate explains [1]."""
    return explain_target(of_signal(signal, samples), coordinate, samples, seed)


def explain_target(target: Target, coordinate: Coordinate, samples: Samples, seed: int = 0) -> Explained:
    """How much of a target's energy the coordinate explains [1]."""
    plain, knots = hat_functions(coordinate, samples.counts)
    count = plain.shape[1]
    columns = np.hstack([plain, plain * coordinate.turns[:, None]]) if coordinate.turns is not None else plain
    grams, slopes = target.products(columns * samples.counts[:, None])
    fold = folds(grams.shape[0], seed)
    gains, weights = target.held_out(grams, slopes, fold)
    chance = target.chance(grams, slopes, fold, seed)
    turned, turning = slice(count, None), np.zeros(1)
    if coordinate.turns is not None:
        turning = target.held_out(grams[:, turned, turned], slopes[:, turned], fold)[0]
    found = explained(coordinate, gains, chance, turning, target.energy, seed)
    return replace(found, knots=knots, curve=weights[:count], turned=weights[turned])


def explain_by_all(
    signal: Array, known: Sequence[Coordinate], samples: Samples, seed: int = 0
) -> tuple[float, float, float]:
    """(share [1] of a signal's variance (n,) that curves over all coordinates explain at once on held-out motions, low
    and high end of its interval): what a flexible model can close, although it names no cause."""
    parts = []
    for one in known:
        plain, _ = hat_functions(one, samples.counts, FEW_KNOTS)
        parts += [plain, plain * one.turns[:, None]] if one.turns is not None else [plain]
    z = centred(signal, samples)
    grams, slopes = by_motion(np.hstack(parts) * samples.counts[:, None], z, samples.motion)
    fold, nothing = folds(grams.shape[0], seed), np.zeros(1)
    gains = max((held_out(grams, slopes, fold, ridge)[0] for ridge in RIDGES), key=lambda gains: float(gains.sum()))
    found = explained(Coordinate("together", "1", z), gains, nothing, nothing, energies(z, samples), seed)
    return found.share, found.low, found.high


def energies(signal: Array, samples: Samples) -> Array:
    """Sum over each motion (motions,) of a signal's square [its unit squared]."""
    return np.asarray(np.bincount(samples.motion, signal**2, int(samples.motion.max()) + 1))


def explained(
    coordinate: Coordinate, gains: Array, chance: Array, turning: Array, energy: Array, seed: int
) -> Explained:
    """The shares [1] of the gain in each motion (motions,), with the p-value against the gains by chance (FLIPS,)."""
    whole = max(float(energy.sum()), 1e-300)
    many = bootstrap_counts(gains.size, seed) @ np.column_stack([gains, energy])
    low, high = bootstrap_interval(np.minimum(many[:, 0] / np.maximum(many[:, 1], 1e-300), 1.0), gains.size)
    p = float((1 + np.count_nonzero(chance >= gains.sum())) / (1 + FLIPS))
    share, turn = (min(max(float(part.sum()) / whole, 0.0), 1.0) for part in (gains, turning))
    nothing = np.zeros(0)
    return Explained(
        coordinate.name, coordinate.unit, share, max(low, 0.0), max(high, 0.0), p, turn, nothing, nothing, nothing
    )


def explain_pitch(
    signal: Array, target: Target, position: Coordinate, samples: Samples, seed: int = 0
) -> Explained | None:
    """How much of a target is periodic over the position [m], with a period that is estimated on the other motions of
    a signal (n,) that shows it; None where the travel is too short for any of `pitches`."""
    place, used = position.values, samples.counts
    extent = float(np.ptp(place[used]))
    if extent < 1.5 * pitches(samples)[0]:
        return None
    z = centred(signal, samples)
    fold = folds(int(samples.motion.max()) + 1, seed)
    gains, turning, chance = np.zeros(fold.size), np.zeros(fold.size), np.zeros(FLIPS)
    signs = np.random.default_rng(seed + 1).choice([-1.0, 1.0], (FLIPS, fold.size))
    for number in range(int(fold.max()) + 1):
        out = fold == number
        grams, slopes = target.products(_harmonics(strongest_period(z, place, samples, ~out), place, samples))
        gains[out] = _left_out(grams, slopes, out)
        turning[out] = _left_out(grams[:, 3:, 3:], slopes[:, 3:], out)
        inside, by = grams[out].sum(axis=0), signs[:, out] @ slopes[out]
        weights = np.linalg.solve(_ridged(grams[~out].sum(axis=0)), (signs[:, ~out] @ slopes[~out]).T).T
        chance += 2 * np.sum(weights * by, axis=1) - np.einsum("fi,ij,fj->f", weights, inside, weights)
    pitch = strongest_period(z, place, samples, np.ones(fold.size, bool))
    found = explained(Coordinate("pitch", "m", place), gains, chance, turning, target.energy, seed)
    return replace(found, pitch=pitch)


def _harmonics(pitch: float, place: Array, samples: Samples) -> Array:
    """Columns (n, 6): 1, cosine, sine of the position, and these times the direction of the last motion."""
    angle = 2 * np.pi * place / pitch
    plain = np.column_stack([np.ones(place.size), np.cos(angle), np.sin(angle)]) * samples.counts[:, None]
    return np.hstack([plain, plain * samples.direction[:, None]])


def strongest_period(signal: Array, place: Array, samples: Samples, among: NDArray[np.bool_]) -> float:
    """The period [m] at which `periodogram` is largest, over the motions (motions,) chosen."""
    inverse, gain = periodogram(signal, place, samples, among)
    return float(1 / inverse[int(np.argmax(gain))])


def periodogram(signal: Array, place: Array, samples: Samples, among: NDArray[np.bool_]) -> tuple[Array, Array]:
    """(1 / period (F,) [1/m] within `pitches`, reduction of the signal's sum of squares (F,) [its unit squared] by
    sines of the position (n,) [m]), plain or times the direction, whichever is more; the signal (n,) is centred."""
    used = samples.counts & among[samples.motion]
    (shortest, most), extent = pitches(samples), float(np.ptp(place[used]))
    width = shortest / 8
    bins = np.floor((place[used] - place[used].min()) / width).astype(int)
    middle = place[used].min() + (np.arange(bins.max() + 1) + 0.5) * width
    count = np.bincount(bins).astype(float)
    longest = min(most, 1.5 * max(extent, shortest))
    inverse = np.arange(1 / longest, 1 / shortest, 1 / (6 * max(extent, shortest)))
    whole = count.sum()
    once, twice = (_waves(count, middle, order * inverse) for order in (1, 2))
    gram = np.empty((inverse.size, 3, 3))  # of 1, cosine and sine
    gram[:, 0, 0], gram[:, 1, 1], gram[:, 2, 2] = whole, (whole + twice.real) / 2, (whole - twice.real) / 2
    gram[:, 0, 1] = gram[:, 1, 0] = once.real
    gram[:, 0, 2] = gram[:, 2, 0] = once.imag
    gram[:, 1, 2] = gram[:, 2, 1] = twice.imag / 2
    gram += RIDGE * whole * np.eye(3)
    best = np.zeros(inverse.size)
    for weight in (signal[used], signal[used] * samples.direction[used]):
        summed = np.bincount(bins, weight).astype(float)
        waves = _waves(summed, middle, inverse)
        onto = np.column_stack([np.full(inverse.size, summed.sum()), waves.real, waves.imag])
        gain = np.einsum("fi,fi->f", onto, np.linalg.solve(gram, onto[:, :, None])[:, :, 0])
        best = np.maximum(best, gain - onto[:, 0] ** 2 / whole)
    return inverse, best


def _waves(weight: Array, place: Array, inverse: Array) -> NDArray[np.complex128]:
    """Sums (F,) of weights (b,) times exp(2 pi i place / period) over evenly spaced places (b,) [m], for evenly spaced
    1 / period (F,) [1/m], by a chirp transform: the table of all their products would be a hundred megabytes."""
    turn, first = 2j * np.pi * (place[1] - place[0] if place.size > 1 else 0.0), inverse[0]
    step = inverse[1] - first if inverse.size > 1 else 0.0
    found = scipy.signal.czt(weight, inverse.size, np.exp(turn * step), np.exp(-turn * first))
    return np.asarray(found * np.exp(2j * np.pi * place[0] * inverse))


def parity(signal: Array, speed: Coordinate, samples: Samples, seed: int = 0) -> tuple[Explained, Explained]:
    """How much of a signal (n,) is an even, and how much an odd function of the speed [m/s], while the table moves.

    Both are shares of the signal's energy about its mean. Turned with the speed it keeps that energy, and has a mean of
    its own, which is no constant of the signal but the part that turns with the speed, as Coulomb friction does.
    """
    moving = replace(samples, counts=samples.counts & (np.abs(speed.values) > slowest(samples)))
    size = replace(speed, name="even", values=np.abs(speed.values), turns=None)
    if np.count_nonzero(moving.counts) < 10 * KNOTS:
        nothing = np.zeros(1)
        none = explained(size, nothing, nothing, nothing, nothing, seed)
        return none, replace(none, name="odd")
    z = centred(signal, moving)
    turned, energy = z * np.sign(speed.values), energies(z, moving)
    even, odd = (Target(partial(by_motion, signal=one, motion=moving.motion), energy) for one in (z, turned))
    return explain_target(even, size, moving, seed), explain_target(odd, replace(size, name="odd"), moving, seed)


def folds(motions: int, seed: int) -> Integers:
    """The fold (motions,) in which each motion is held out."""
    return np.asarray(np.random.default_rng(seed).permutation(motions) % min(FOLDS, motions), np.int64)


def by_motion(columns: Array, signal: Array, motion: Integers) -> tuple[Array, Array]:
    """Gram matrices (motions, K, K) of columns (n, K), and the columns' products (motions, K) with a signal (n,), per
    motion; [units of both multiplied]."""
    ends = np.concatenate([np.flatnonzero(np.diff(motion, prepend=-1)), [motion.size]])
    count, k = int(motion.max()) + 1, columns.shape[1]
    grams, slopes = np.zeros((count, k, k)), np.zeros((count, k))
    for a, b in itertools.pairwise(ends):
        part = columns[a:b]
        grams[motion[a]] += part.T @ part
        slopes[motion[a]] += part.T @ signal[a:b]
    return grams, slopes


def held_out(grams: Array, slopes: Array, fold: Integers, ridge: float = RIDGE) -> tuple[Array, Array]:
    """(reduction of the squared signal in each motion (motions,) by weights fitted on the other folds, weights (K,)
    fitted on all); [square of the signal's unit; the signal's unit]."""
    gains = np.zeros(slopes.shape[0])
    for number in range(int(fold.max()) + 1):
        gains[fold == number] = _left_out(grams, slopes, fold == number, ridge)
    return gains, np.linalg.solve(_ridged(grams.sum(axis=0), ridge), slopes.sum(axis=0))


def _left_out(grams: Array, slopes: Array, out: NDArray[np.bool_], ridge: float = RIDGE) -> Array:
    """What weights fitted on the motions not `out` gain in those that are."""
    weights = np.linalg.solve(_ridged(grams[~out].sum(axis=0), ridge), slopes[~out].sum(axis=0))
    return np.asarray(2 * slopes[out] @ weights - np.einsum("i,mij,j->m", weights, grams[out], weights))


def _ridged(gram: Array, ridge: float = RIDGE) -> Array:
    return np.asarray(gram + (ridge * np.trace(gram) / gram.shape[0] + 1e-300) * np.eye(gram.shape[0]))


def sign_flip_null(grams: Array, slopes: Array, fold: Integers, seed: int, ridge: float = RIDGE) -> Array:
    """`held_out`'s total (FLIPS,) with the signal's sign flipped in random motions; [square of the signal's unit]."""
    signs = np.random.default_rng(seed + 1).choice([-1.0, 1.0], (FLIPS, slopes.shape[0]))
    gram, slope, total = grams.sum(axis=0), signs @ slopes, np.zeros(FLIPS)
    for number in range(int(fold.max()) + 1):
        out = fold == number
        inside, by = grams[out].sum(axis=0), signs[:, out] @ slopes[out]
        weights = np.linalg.solve(_ridged(gram - inside, ridge), (slope - by).T).T
        total += 2 * np.sum(weights * by, axis=1) - np.einsum("fi,ij,fj->f", weights, inside, weights)
    return total
