"""Inputs that reach every branch of the law, and what the reference answers to them.

The readings do not come from a closed loop, so that they lead anywhere: near the reference, far from it, into the
limit and back, and to values that are not numbers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.deployment.coefficients import Coefficients, WipeMotion
from models.deployment.learning_numbers import Learning
from models.deployment.running_law import INIT, LEARN, PLAN, RESET, STEP, WIPE, RunningLaw
from models.feedback.law import REFERENCE

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

MOST_GOLDEN: Final = 8000  # vectors that are kept with the code
MISSING: Final = 1e300  # stands for NaN in exported vectors: neither C nor structured text can write it as a constant
FARTHEST: Final = 0.2  # m from 0 to where a reset may be


@dataclass(frozen=True)
class Vectors:
    """What is asked (n,), what is given (n, 2) [m] or [N], and the reference's thrust [N] and status (n,)."""

    asked: Integers
    given: Array
    thrust: Array
    status: Integers

    def rows(self) -> Iterator[list[float]]:
        """One row a sample: what is asked, the two numbers given [m], thrust [N], status."""
        for asked, given, thrust, status in zip(self.asked, self.given, self.thrust, self.status, strict=True):
            yield [float(asked), float(given[0]), float(given[1]), float(thrust), float(status)]


def answered(known: Coefficients, asked: Integers, given: Array) -> Vectors:
    """The inputs [m], [N] with what the reference answers."""
    return Vectors(asked, given, *RunningLaw(known).run(asked, given))


def golden(known: Coefficients, seed: int) -> Vectors:
    """The vectors that are kept with the code: each kind of part once, the wipe last as it may be long; SI units."""
    return answered(known, *_joined(_parts(known, np.random.default_rng(seed), MOST_GOLDEN)))


def many(known: Coefficients, seed: int, count: int) -> Vectors:
    """About `count` vectors for a proof: parts of all kinds in random order; SI units."""
    rng, pieces, size = np.random.default_rng(seed), list[tuple[Integers, Array]](), 0
    while size < count:
        parts = list(_parts(known, rng, count))
        for index in rng.permutation(len(parts)):
            pieces.append(parts[index])
            size += parts[index][0].size
    asked, given = _joined(iter(pieces))
    return answered(known, asked[:count], given[:count])


def steady(known: Coefficients, seed: int, count: int) -> Vectors:
    """`count` samples of motions, one after the other without a reset, with readings near the reference; SI units."""
    rng, length = np.random.default_rng(seed), 2 * (len(known.position) + known.delay)
    heights = known.stroke * np.round(rng.uniform(-2, 2, count // length + 1), 1)
    return answered(known, *_followed(known, rng, np.repeat(heights, length)[:count], 1e-3 * known.stroke))


def _joined(parts: Iterator[tuple[Integers, Array]]) -> tuple[Integers, Array]:
    asked, given = zip(*parts, strict=True)
    return np.concatenate(asked), np.concatenate(given)


def _parts(known: Coefficients, rng: np.random.Generator, most: int) -> Iterator[tuple[Integers, Array]]:
    """Parts of every kind, as what is asked and given; each is short enough to leave room for the others."""
    stroke, length = known.stroke, 3 * (len(known.position) + known.delay)
    reset = (
        np.array([RESET]),
        np.array([[rng.uniform(-FARTHEST, FARTHEST), rng.uniform(-0.2, 0.2) * known.thrust_limit]]),
    )
    yield reset
    at, quiet = float(reset[1][0, 0]), length // 2
    # Strokes either way, one after the other has ended and before; a ramp; a staircase of random targets.
    steps = rng.choice([-1.0, 1.0], 6) * stroke * rng.uniform(0.2, 1.5, 6)
    long = np.repeat(at + np.cumsum(steps), [length, length, quiet // 3, quiet // 5, 1, length])
    yield _followed(known, rng, long, 0.02 * stroke)
    ramp = long[-1] + np.linspace(0, rng.uniform(-3, 3) * stroke, length)
    yield _followed(known, rng, ramp, 0.02 * stroke)
    yield _followed(known, rng, ramp[-1] + stroke * rng.uniform(-1, 1, quiet), 0.2 * stroke)
    # What is not a number, or out of range, on either input, alone and together.
    broken = _followed(known, rng, np.full(quiet, ramp[-1]), 0.02 * stroke)
    for value in (math.nan, math.inf, -math.inf, 1.1e6):
        where = rng.integers(0, quiet, 3)
        broken[1][where[0], 0], broken[1][where[1], 1], broken[1][where[2]] = value, value, value
    yield broken
    # Into the limit by a long stroke, and by readings far away; back again.
    yield _followed(known, rng, np.full(quiet, ramp[-1] + rng.choice([-1.0, 1.0]) * 50 * stroke), 0.02 * stroke)
    yield _followed(known, rng, np.full(length, ramp[-1]), 20 * stroke)
    yield _followed(known, rng, np.full(quiet, ramp[-1]), 0.02 * stroke)
    again = np.array([RESET]), np.array([[ramp[-1], rng.uniform(-0.2, 0.2) * known.thrust_limit]])
    yield again
    if known.plan:
        yield np.array([PLAN]), np.zeros((1, 2))
        yield _followed(known, rng, np.full(min(len(known.plan) + 5, most // 4), ramp[-1]), 0.02 * stroke)
    yield np.array([RESET]), np.array([[rng.choice([0.0, math.nan, ramp[-1]]), rng.choice([0.0, math.nan, -1e9])]])
    yield _followed(known, rng, np.full(quiet, ramp[-1]), 0.5 * stroke)
    yield again
    yield _followed(known, rng, ramp[-1] + np.repeat([0.0, 1.7 * stroke], quiet), 0.02 * stroke)
    yield again
    yield _followed(known, rng, np.full(quiet, ramp[-1]), 0.02 * stroke)
    if known.wipe is not None:
        whole = 2 * (known.wipe.count + known.wipe.still) + known.delay + 10
        yield again
        yield np.array([WIPE]), np.zeros((1, 2))
        still = np.full(min(whole, 3 * most // 4), ramp[-1])
        asked, given = _followed(known, rng, still, 0.02 * stroke)
        given[:, 1] += _way(known.wipe, still.size)
        yield asked, given
        yield _followed(known, rng, ramp[-1] + np.repeat([stroke, 0.0], length), 0.02 * stroke)
        if known.learning is not None:
            yield again
            yield from _learned(known, known.wipe, known.learning, rng, float(ramp[-1]))


def _learned(
    known: Coefficients, wipe: WipeMotion, learning: Learning, rng: np.random.Generator, at: float
) -> Iterator[tuple[Integers, Array]]:
    """A whole learning from rest at `at` [m], motions with what it has told, before and after a reset and another wipe,
    a learning that a reset breaks off, and one that a wipe breaks off; then all is forgotten.

    The readings lag behind as they do with friction, so that the thrust at rest tells something of it.
    """
    stroke, rest = known.stroke, learning.rest + 3
    coulomb = sum(k * x for k, x in zip(known.stiffness, known.limit, strict=True))
    lag = 0.3 * coulomb / abs(known.pid.kp if known.law is None else known.law.d[REFERENCE])
    whole = 2 * (wipe.count + wipe.still) + known.delay + 5

    def motions(count: int) -> Array:
        up = np.where(np.arange(count) % learning.motions < learning.motions / 2, 1.0, -1.0)
        return np.repeat(stroke * np.cumsum(up), rest)

    def wiped(asked: int, count: int) -> Iterator[tuple[Integers, Array]]:
        yield np.array([asked]), np.zeros((1, 2))
        what, given = _followed(known, rng, np.full(count, at), 0.02 * stroke)
        out = np.arange(count) < wipe.count + wipe.still
        given[:, 1] += _way(wipe, count) - np.where(out, lag, -lag)
        yield what, given

    def moved(target: Array) -> tuple[Integers, Array]:
        led = np.convolve(np.diff([0.0, *known.position, 1.0]), target)[: target.size]
        late = np.concatenate([np.zeros(known.delay), led])[: target.size]
        what, given = _followed(known, rng, at + target, 0.02 * stroke)
        sample, way = np.arange(target.size), np.sign(np.diff(target, prepend=target[0] - stroke))
        lags = np.where(sample % rest < len(learning.mass), 0.0, lag * way[sample // rest * rest])
        given[:, 1] = at + late - lags + 1e-3 * stroke * rng.integers(-5, 6, target.size)
        return what, given

    yield from wiped(LEARN, whole)
    # The first are not over the stroke, and do not count; they leave the friction where no round of motions closes.
    aside = np.repeat([0.5 * stroke, 0.2 * stroke], 2 * rest)
    yield moved(np.append(aside, aside[-1] + motions(learning.rounds * learning.motions + 2)))
    reset = np.array([RESET]), np.array([[at, 0.1 * coulomb]])
    yield reset
    yield from wiped(WIPE, whole)
    yield moved(motions(2))
    for broken_off in (reset, (np.array([WIPE]), np.zeros((1, 2)))):
        yield from wiped(LEARN, wipe.count)
        yield broken_off
        yield _followed(known, rng, np.full(wipe.still, at), 0.02 * stroke)
    yield np.array([INIT]), np.zeros((1, 2))
    yield _followed(known, rng, np.repeat([0.0, stroke], rest), 0.02 * stroke)


def _way(wipe: WipeMotion, count: int) -> Array:
    """About where the wipe leads, over its first samples."""
    s = np.clip(np.arange(count) / wipe.count, 0, 1)
    back = np.clip((np.arange(count) - wipe.count - wipe.still) / wipe.count, 0, 1)
    return np.asarray(wipe.distance * (s**3 * (10 - 15 * s + 6 * s**2) - back**3 * (10 - 15 * back + 6 * back**2)))


def _followed(known: Coefficients, rng: np.random.Generator, target: Array, off: float) -> tuple[Integers, Array]:
    """Samples of a target with readings that wander `off` [m] about what is left of it, in steps as of a scale."""
    wander = off * np.convolve(rng.standard_normal(target.size), np.ones(5) / 5)[: target.size]
    late = np.concatenate([np.full(min(known.delay + 3, target.size), target[0]), target])[: target.size]
    scale = 1e-3 * known.stroke
    return np.full(target.size, STEP), np.column_stack([target, np.round((late + wander) / scale) * scale])
