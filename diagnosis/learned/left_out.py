"""How far a curve closes the gap on a type of motion that neither its forces nor its choice have seen.

For each type of motion in turn, coordinate, symmetry and smoothness are chosen among the other types (by leaving each
of these out in turn), the curve is fitted to all of them, and judged on the type that was left out: a nested
cross-validation (M. Stone, Cross-validatory choice and assessment of statistical predictions, 1974). It is judged where
the other types show the curve at all: beyond their range there is no evidence of a curve. Knots alone, which over the
position are closer where the force of all types bends, know of the type: they gain nothing there, as a force at a knot
is that of the others (in 200 draws of types with a narrow force each of its own, a closure of -0.15 in the mean, and of
-0.13 by even knots).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.learned.curves_tried import Curve
from diagnosis.where.coordinates import by_motion
from diagnosis.where.energy import bootstrap_counts, bootstrap_interval
from models.effects.priors import Units

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

SMOOTHNESS: Final = (1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1)  # weights of the bends, in a hat function's mean energy
LEVEL: Final = 1e-4  # weight of the forces themselves beside that of their bends
LEAST_SHARE: Final = 0.02  # of the whole gap, from which on a type of motion is reported by itself
SHOWN_LOOP_TIMES: Final = 2.765  # loop times' worth of a hat function from which on other types show it,
MIN_SHOWN_SAMPLES: Final = 3.0  # and of samples at least


@dataclass(frozen=True)
class Tested:
    """A curve with what its hat functions do to the innovations, by motion: products (S, K, K) of columns with each
    other and (S, K) with the innovations [1], over all samples; and the same of what it is judged by, the innovations
    or the unknown force, over the samples (n,) that other types show."""

    curve: Curve
    grams: Array
    slopes: Array
    judged_grams: Array
    judged_slopes: Array
    shown: NDArray[np.bool_]

    def trained(self, motions: NDArray[np.bool_], smoothness: float) -> Array:
        """Forces (K,) [N] fitted to the chosen motions (S,)."""
        return solved(self.curve, self.grams[motions].sum(axis=0), self.slopes[motions].sum(axis=0), smoothness)

    def gains(self, force: Array) -> Array:
        """By how much forces (K,) [N] reduce the squares in each motion, where it is judged: (S,)."""
        linear = self.judged_slopes @ force
        return np.asarray(-2 * linear - np.einsum("i,sij,j->s", force, self.judged_grams, force))


def solved(curve: Curve, gram: Array, slope: Array, smoothness: float) -> Array:
    """The forces (K,) [N] that minimise chi-square and the weighted squares of their bends."""
    bends = curve.bends()
    penalty = bends.T @ bends + LEVEL * np.eye(slope.size)
    weight = smoothness * np.trace(gram) / slope.size + 1e-300
    return np.asarray(-np.linalg.solve(gram + weight * penalty, slope))


def shown_from(known: Units) -> float:
    """The samples' worth of a hat function [1] from which on other types show it, of a machine of these units."""
    return max(SHOWN_LOOP_TIMES * known.loop / known.sample, MIN_SHOWN_SAMPLES)


def summed(curve: Curve, columns: Array, e: Array, motion: Integers, kind: Integers, least: float) -> Tested:
    """The sums of a curve's columns (n, K) and the innovations e (n,), both after the projection [1].

    motion (n,): of each sample; kind: of each motion [-]; least [1]: see `shown_from`.
    """
    size = np.abs(curve.hats)
    of_sample = kind[motion]
    shown = np.zeros(e.size, bool)
    for number in range(int(kind.max()) + 1):
        elsewhere = size[of_sample != number].sum(axis=0) > least
        shown |= (of_sample == number) & (size @ elsewhere > 0.5 * size.sum(axis=1))
    grams, slopes = by_motion(columns, e, motion)
    part, by = by_motion(columns * shown[:, None], e, motion)
    return Tested(curve, grams, slopes, part, by, shown)


def judged_by_force(test: Tested, columns: Array, force: Array, used: NDArray[np.bool_], motion: Integers) -> Tested:
    """The same, fitted to the innovations and judged by the smoothed unknown force (n,) [N], known where it is used.

    columns (n, K): what 1 N at each knot is on the table [1], whose level is the offset's and whose line may be a
    nominal value's; motion (n,): of each sample.
    """
    columns = columns @ test.curve.own_part(used)
    columns = (columns - columns[used].mean(axis=0)) * (used & test.shown)[:, None]
    grams, slopes = by_motion(-columns, force, motion)
    return replace(test, judged_grams=grams, judged_slopes=slopes)


@dataclass(frozen=True)
class Choice:
    """A curve and its smoothness [1], and by how much it reduces the squares on types of motion left out in turn."""

    test: Tested
    smoothness: float
    gain: float


def chosen(tests: Sequence[Tested], kind: Integers, judged: Sequence[int], without: int | None = None) -> Choice:
    """The curve and smoothness that gain the most over the types `judged`, each left out in turn; of what is
    `without` nothing is used [-]."""
    best: Choice | None = None
    for test in tests:
        for smoothness in SMOOTHNESS:
            gain = 0.0
            for out in judged:
                if out != without:
                    force = test.trained((kind != out) & (kind != without), smoothness)
                    gain += float(test.gains(force)[kind == out].sum())
            if best is None or gain > best.gain:
                best = Choice(test, smoothness, gain)
    if best is None:
        raise ValueError("there is no curve to choose")
    return best


@dataclass(frozen=True)
class OfType:
    """A type of motion on which a curve was judged that has not seen it: the closure there, and its share of the whole
    gap, both [1]; the coordinate that the other types chose."""

    motions: str
    closure: float
    share: float
    coordinate: str


@dataclass(frozen=True)
class Judgement:
    """How a curve does on types of motion that it has not seen: the closure over all of them and its 95 % interval [1],
    the share of the whole gap that could be judged [1], and each type."""

    closure: float
    interval: tuple[float, float]
    share: float
    by_type: tuple[OfType, ...]


def judgement(
    tests: Mapping[int | None, Sequence[Tested]], above: Array, motion: Integers, kind: Integers, names: Sequence[str]
) -> Judgement:
    """The nested judgement of curves [1], its interval by drawing motions of these types.

    tests: the curves among which is chosen where a type is left out, by its number; above (n,): the squares of what the
    curves are judged by, less those that a complete model leaves, 0 where they are unknown, of which a type of motion
    may have less than none; motion (n,): of each sample; kind: of each motion; names: of the types, empty where nothing
    moves.
    """
    count, types = kind.size, [number for number, name in enumerate(names) if name]
    whole = max(float(np.maximum(np.bincount(kind[motion], above), 0.0).sum()), 1e-300)
    gains, gaps, rows = np.zeros(count), np.zeros(count), list[OfType]()
    for out in types:
        choice = chosen(tests[out], kind, types, out)
        inside = kind == out
        gain = choice.test.gains(choice.test.trained(~inside, choice.smoothness))
        gap: Array = np.bincount(motion, above * choice.test.shown, count).astype(float)
        if gap[inside].sum() <= 0:  # there is nothing to close, so that only harm counts
            gain, gap = np.minimum(gain, 0.0), np.zeros(count)
        gains[inside], gaps[inside] = gain[inside], gap[inside]
        share = float(gap[inside].sum()) / whole
        closure = float(gain[inside].sum()) / max(float(gap[inside].sum()), 1e-300)
        if share > LEAST_SHARE:  # elsewhere there is nothing to close
            rows.append(OfType(names[out], float(np.clip(closure, -1.0, 1.0)), share, choice.test.curve.law.coordinate))
    moving = np.flatnonzero(np.isin(kind, types))
    drawn = bootstrap_counts(moving.size, 0) @ np.column_stack([gains, gaps])[moving]
    total = max(float(gaps.sum()), 1e-300)
    closures = np.clip(drawn[:, 0] / np.maximum(drawn[:, 1], 1e-300), -1.0, 1.0)
    low, high = bootstrap_interval(closures, moving.size)
    closure = float(np.clip(gains.sum() / total, -1.0, 1.0))
    return Judgement(closure, (min(low, closure), max(high, closure)), float(gaps.sum()) / whole, tuple(rows))
