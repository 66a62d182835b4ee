"""The experiment of a drawn machine: two records of moves, dwells, strokes, waves and shaking in its own order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from studies.blind_trial.sealer.machines.axis import Axis
from studies.blind_trial.sealer.machines.drawing import spread

Array = NDArray[np.float64]

LASTS: Final = (10.0, 60.0)  # of both records together [s]
MOST: Final = 100_000  # samples of both records together; a fast controller is watched for less time
PROFILES: Final = ("quintic", "cycloid", "harmonic jerk")
KINDS: Final = ("steps", "ladder", "dwells", "slow", "long", "waves", "shake", "raster", "hold")


@dataclass(frozen=True)
class Schedule:
    """One record, (n,) each: target r [m], reference x_T* [m], feedforward [N]; and what it is made of."""

    target: Array
    reference: Array
    feedforward: Array
    parts: tuple[str, ...]


def profile(kind: str, count: int) -> Array:
    """Way (count,) of a move of one unit that ends one sample after the last."""
    s = np.arange(1, count + 1) / count
    if kind == "quintic":
        return np.asarray(s**3 * (10 - 15 * s + 6 * s**2))
    if kind == "cycloid":
        return np.asarray(s - np.sin(2 * np.pi * s) / (2 * np.pi))
    return np.asarray(s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3))


class _Writer:
    """Puts one piece after another into a record."""

    def __init__(self, axis: Axis, rng: np.random.Generator, kind: str) -> None:
        self.axis, self.rng, self.kind = axis, rng, kind
        self.pieces: list[Array] = []
        self.goals: list[Array] = []
        self.forces: list[Array] = []
        self.here, self.count = 0.0, 0
        self.span, self.pace = axis.travel, 1.0

    def samples(self, seconds: float) -> int:
        return max(round(seconds / self.axis.sample_time), 1)

    def put(self, path: Array, goal: Array | float, force: Array | None = None) -> None:
        self.pieces.append(path)
        self.goals.append(np.broadcast_to(np.asarray(goal, float), path.shape))
        self.forces.append(np.zeros(path.size) if force is None else force)
        self.count += path.size

    def wait(self, seconds: float) -> None:
        """Rests."""
        self.put(np.full(self.samples(seconds), self.here), self.here)

    def move(self, distance: float) -> None:
        """As quickly as speed, acceleration and bandwidth allow; the target jumps at its begin."""
        axis, far = self.axis, abs(distance)
        seconds = max(2.2 * far / axis.speed, np.sqrt(7.6 * far / axis.acceleration), 0.8 / axis.crossover)
        path = self.here + distance * profile(self.kind, max(self.samples(seconds), 6))
        self.here += distance
        self.put(path, self.here)

    def stroke(self, distance: float, speed: float) -> None:
        """At constant speed, with smooth ends."""
        onset = max(1.5 / self.axis.crossover, 2.0 * speed / self.axis.acceleration)
        ends = np.diff(profile("quintic", self.samples(onset)), prepend=0.0)
        steps = np.convolve(np.full(self.samples(abs(distance) / speed), 1.0), ends)
        path = self.here + distance * np.cumsum(steps) / steps.sum()
        self.here += distance
        self.put(path, self.here)

    def room(self, distance: float) -> float:
        """The distance with the sign that stays within the travel."""
        inside = 0.0 <= self.here + distance <= self.span
        return distance if inside else -distance

    def done(self, length: int, parts: tuple[str, ...]) -> Schedule:
        self.put(np.full(max(length - self.count, 1), self.here), self.here)
        target, reference, force = (np.concatenate(one) for one in (self.goals, self.pieces, self.forces))
        return Schedule(target, reference, force, parts)


def _small(w: _Writer) -> float:
    """A length about the presliding range."""
    return max(w.axis.reach * spread(w.rng, (0.1, 4.0)), 30 * w.axis.read)


def _steps(w: _Writer) -> None:
    size, dwell = _small(w), max(spread(w.rng, (0.08, 0.6)) * w.pace, 0.06)
    for _ in range(2 if w.pace > 0.5 else 1):
        sign = np.sign(w.room(5 * size))
        for direction in [sign] * 4 + [-sign] * 4:
            w.move(direction * size)
            w.wait(dwell)


def _ladder(w: _Writer) -> None:
    low, high = max(0.1 * w.axis.reach, 30 * w.axis.read), min(30 * w.axis.reach, 0.3 * w.span)
    for size in np.geomspace(low, max(high, 2 * low), 6 if w.pace > 0.5 else 3):
        sign = np.sign(w.room(size))
        for direction in (sign, -sign):
            w.move(direction * size)
            w.wait(0.1)


def _dwells(w: _Writer) -> None:
    size = _small(w)
    for i, dwell in enumerate(w.rng.permutation(np.geomspace(0.06, max(2.0 * w.pace, 0.3), 6))):
        for turn in (1.0, -1.0) if i % 2 else (1.0, 1.0):
            w.move(w.room(turn * size))
            w.wait(dwell)


def _slow(w: _Writer) -> None:
    for speed in np.geomspace(w.axis.speed / 100, w.axis.speed / 4, 4 if w.pace > 0.5 else 2):
        far = w.room(min(0.6 * speed, 0.8 * w.span))
        for direction in (far, -far):
            w.stroke(direction, speed)
            w.wait(0.06)


def _long(w: _Writer) -> None:
    """To a far place and back; at least three times, as what repeats along the travel needs the travel."""
    for share in (1.0, 0.6, 1.0):
        back = w.here
        for place in (share * w.span, back):
            w.move(place - w.here)
            w.wait(spread(w.rng, (0.05, 0.3)))


def _waves(w: _Writer) -> None:
    frequency = w.rng.uniform(0.03, 0.15) * w.axis.crossover
    for size in _small(w) * np.array([1.0, 0.5, 0.25]):
        count = w.samples(2.0 / frequency)
        s = np.arange(1, count + 1) / count
        path = w.here + np.sign(w.room(size)) * 0.5 * size * (1 - np.cos(2 * np.pi * 2 * s))
        w.put(path, w.here)
    w.wait(0.1)


def _shake(w: _Writer) -> None:
    """Two equal periods of lines spaced by their ratio, in the feedforward, at rest."""
    ts, period = w.axis.sample_time, w.samples(1.0)
    lines = np.unique(np.round(np.geomspace(4, min(500.0, 0.35 / ts), 40)))
    time, phase = np.arange(2 * period) * ts, -np.pi * np.arange(lines.size) ** 2 / lines.size
    size = np.sqrt(lines / 40.0)
    wave = (size[:, None] * np.cos(2 * np.pi * np.outer(lines, time) + phase[:, None])).sum(axis=0)
    strong = spread(w.rng, (0.05, 0.6)) * w.axis.friction
    w.put(np.full(wave.size, w.here), w.here, strong * wave / np.abs(wave).max())
    w.wait(0.1)


def _raster(w: _Writer) -> None:
    step = w.room(0.15 * w.span)
    for _ in range(6):
        w.move(w.room(step))
        w.wait(0.12)


def _hold(w: _Writer) -> None:
    w.wait(w.rng.uniform(0.5, 2.5) * max(w.pace, 0.3))


PIECES: Final[dict[str, Callable[[_Writer], None]]] = {
    "steps": _steps,
    "ladder": _ladder,
    "dwells": _dwells,
    "slow": _slow,
    "long": _long,
    "waves": _waves,
    "shake": _shake,
    "raster": _raster,
    "hold": _hold,
}


def experiment(axis: Axis, rng: np.random.Generator) -> tuple[Schedule, Schedule]:
    """Two records: every kind of piece in a drawn order, divided over both, then again until the time is up.

    What does not fit into its record any more is left out. Each record has feedforward of acceleration, where the
    controller has none, and friction compensation, or not, as drawn.
    """
    seconds = min(spread(rng, LASTS), MOST * axis.sample_time)
    share = rng.uniform(0.35, 0.65)
    span = min(axis.travel, axis.speed * seconds / 25)
    order = [str(name) for name in rng.permutation(KINDS)]
    first, second = order[: round(share * len(order))], order[round(share * len(order)) :]
    halves = ((share, first, order), (1 - share, second, order))
    return _record(axis, rng, seconds, span, halves[0]), _record(axis, rng, seconds, span, halves[1])


def _record(
    axis: Axis, rng: np.random.Generator, seconds: float, span: float, half: tuple[float, list[str], list[str]]
) -> Schedule:
    share, names, more = half
    length = int(share * seconds / axis.sample_time)
    w = _Writer(axis, rng, str(rng.choice(PROFILES)))
    w.span, w.pace = span, float(np.clip(seconds / 40, 0.2, 1.0))
    w.wait(0.1)
    parts: list[str] = []
    for name in [*names, *more, *more]:
        before = len(w.pieces), w.here, w.count
        PIECES[name](w)
        if w.count > length:
            for rows in (w.pieces, w.goals, w.forces):
                del rows[before[0] :]
            w.here, w.count = before[1:]
        else:
            parts.append(name)
    plain = w.done(min(length, w.count + w.samples(0.2)), tuple(parts))
    return _with_feedforward(axis, plain, rng)


def _with_feedforward(axis: Axis, plain: Schedule, rng: np.random.Generator) -> Schedule:
    """With the nominal mass times the reference's acceleration, and perhaps the nominal friction along it."""
    force = plain.feedforward.copy()
    ts, x = axis.sample_time, plain.reference
    ahead = np.append(x[1:], x[-1])
    if axis.control["kind"] == 0.0 and rng.random() < 0.7:
        force += axis.mass * np.gradient(np.gradient(x, ts), ts)
    if rng.random() < 0.5:
        force += friction_along(axis, ahead)
    return Schedule(plain.target, x, force, plain.parts)


def friction_along(axis: Axis, path: Array) -> Array:
    """The nominal friction [N] along a path (n,) [m], from elements at rest."""
    z, force = np.zeros(axis.limit.size), np.empty(path.size)
    for k, step in enumerate(np.diff(path, prepend=path[0])):
        z = np.clip(z + step, -axis.limit, axis.limit)
        force[k] = axis.stiffness @ z
    return force
