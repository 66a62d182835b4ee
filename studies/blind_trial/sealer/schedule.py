"""What the table is asked to do: references and feedforwards of the two experiments, designed on the nominal table."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from studies.blind_trial.sealer.nominal import Table, load

Array = NDArray[np.float64]

STEP_TIME: Final = 0.020  # of a deadbeat move of up to 20 um [s]
LADDER: Final = (  # amplitude [m] and time [s], so that the thrust stays at about 100 N
    *((size, STEP_TIME) for size in (2e-6, 5e-6, 1e-5, 2e-5)),
    (5e-5, 0.024),
    (1e-4, 0.028),
    (2e-4, 0.032),
)
ROUGHNESS: Final = 1.0  # weight of the input's second differences in a move, beside its size


@dataclass(frozen=True)
class Schedule:
    """One experiment, (n,) each: target r [m], reference x_T* [m], feedforward u_ff (+ u_rf) [N]."""

    target: Array
    reference: Array
    feedforward: Array


def sampled(table: Table) -> tuple[Array, Array, Array]:
    """Modes of a table sampled with a held force, without dead time: A (2m, 2m), B (2m,), C (2m,)."""
    m = table.gain.size
    a, b, c = np.zeros((2 * m, 2 * m)), np.zeros(2 * m), np.zeros(2 * m)
    for i in range(m):
        omega = 2 * np.pi * table.frequency[i]
        a[2 * i : 2 * i + 2, 2 * i : 2 * i + 2] = [[0, 1], [-(omega**2), -2 * table.damping[i] * omega]]
        b[2 * i + 1], c[2 * i] = table.gain[i], 1.0
    whole = np.zeros((2 * m + 1, 2 * m + 1))
    whole[:-1, :-1], whole[:-1, -1] = a, b
    transition = expm(whole * table.sample_time)
    return transition[:-1, :-1], transition[:-1, -1], c


@cache
def deadbeat(count: int) -> tuple[Array, Array]:
    """The smoothest input (count,) [N/m] that brings the nominal modes from rest to rest 1 m on, and where they are
    (count,) [m/m] at its samples: least squares under as many equations as the modes have states.
    """
    a, b, c = sampled(load())
    reach = np.empty((b.size, count))
    column = b
    for k in reversed(range(count)):
        reach[:, k], column = column, a @ column
    goal = np.zeros(b.size)
    goal[0] = 1.0
    bent = np.diff(np.eye(count + 4), n=2, axis=0)[:, 2:-2]
    cost = np.eye(count) + ROUGHNESS * bent.T @ bent
    left = np.linalg.solve(cost, reach.T)
    size = np.sqrt(np.diag(reach @ left))
    u = left @ (np.linalg.solve(reach @ left / np.outer(size, size), goal / size) / size)
    state, x = np.zeros(b.size), np.empty(count)
    for k in range(count):
        x[k] = c @ state
        state = a @ state + b * u[k]
    return u, x


class _Writer:
    """Puts one move after another into a schedule; all that it adds up is linear."""

    def __init__(self, table: Table, duration: float) -> None:
        self.table, n = table, round(duration / table.sample_time)
        self.target, self.reference, self.feedforward = np.zeros(n), np.zeros(n), np.zeros(n)
        self.now = 0

    def wait(self, seconds: float) -> None:
        """Nothing moves."""
        self.now += round(seconds / self.table.sample_time)

    def move(self, distance: float, seconds: float = STEP_TIME) -> None:
        """A deadbeat move; time goes on only by `wait`."""
        u, x = deadbeat(round(seconds / self.table.sample_time))
        self.target[self.now :] += distance
        self._add(distance * u, distance * x, distance)

    def stroke(self, distance: float, speed: float, onset: float = 0.1) -> None:
        """A stroke at constant speed that begins and ends within `onset` seconds; time goes on to its end."""
        count = round(abs(distance) / speed / self.table.sample_time)
        ramp, gentle = np.full(count, 1.0 / count), round(onset / self.table.sample_time)
        u, x = deadbeat(gentle)
        self.target[self.now :] += distance
        steps = np.diff(x, append=1.0)
        self._add(
            distance * np.convolve(ramp, u), distance * np.cumsum(np.convolve(ramp, steps))[:-1], distance, leading=True
        )
        self.now += count + gentle

    def shake(self, force: Array) -> None:
        """A force in the feedforward column; time goes on to its end."""
        self.feedforward[self.now : self.now + force.size] += force
        self.now += force.size

    def _add(self, u: Array, x: Array, distance: float, leading: bool = False) -> None:
        self.feedforward[self.now : self.now + u.size] += u
        begin = self.now + 1 if leading else self.now  # a cumulative sum is one sample early
        self.reference[begin : begin + x.size] += x
        self.reference[begin + x.size :] += distance


def compensation(table: Table, reference: Array) -> Array:
    """u_rf (n,) [N]: the nominal friction on the reference of the next sample, from elements at rest."""
    z, force = np.zeros(table.limit.size), np.empty(reference.size)
    steps = np.diff(reference, append=reference[-1])
    for k, step in enumerate(steps):
        z = np.clip(z + step, -table.limit, table.limit)
        force[k] = table.stiffness @ z
    return force


@cache
def sequential() -> Schedule:
    """20 um moves, five up and five down, three times, 0.5 s apart; with friction compensation."""
    table = load()
    w = _Writer(table, 15.0)
    for _ in range(3):
        for direction in [1.0] * 5 + [-1.0] * 5:
            w.move(direction * 20e-6)
            w.wait(0.5)
    return Schedule(w.target, w.reference, w.feedforward + compensation(table, w.reference))


@cache
def suite() -> Schedule:
    """2 .. 200 um, dwells of 0.06 .. 1.5 s, a multisine of 4 .. 400 Hz, slow strokes, 20 mm and twice 60 mm."""
    w = _Writer(load(), 20.0)
    w.wait(0.1)
    for amplitude, seconds in LADDER:
        for direction in (1.0, -1.0):
            w.move(direction * amplitude, seconds)
            w.wait(0.1)
    for i, dwell in enumerate((0.06, 0.12, 0.25, 0.5, 1.0, 1.5)):
        for direction in (1.0, -1.0) if i % 2 else (1.0, 1.0):  # reversals and continuations
            w.move(direction * 17.3e-6)
            w.wait(dwell)
    w.shake(multisine(w.table.sample_time))
    w.wait(0.1)
    for distance, speed in ((2.5e-3, 5e-3), (16e-3, 20e-3), (60e-3, 80e-3)):
        for direction in (1.0, -1.0):
            w.stroke(direction * distance, speed)
            w.wait(0.08)
    for distance, seconds in ((20e-3, 0.2), (60e-3, 0.4), (60e-3, 0.4)):
        for direction in (1.0, -1.0):
            w.move(direction * distance, seconds)
            w.wait(seconds + 0.12)
    return Schedule(w.target[: w.now], w.reference[: w.now], w.feedforward[: w.now])


def multisine(sample_time: float) -> Array:
    """Two seconds of 4 .. 400 Hz (n,) [N], 40 lines spaced by their ratio, Schroeder's phases: two equal periods."""
    time = np.arange(round(2.0 / sample_time)) * sample_time
    lines = np.unique(np.round(np.geomspace(4, 400, 40)))
    phases = -np.pi * np.arange(lines.size) ** 2 / lines.size
    size = 0.35 * np.sqrt(lines / 40.0)
    return np.asarray((size[:, None] * np.cos(2 * np.pi * np.outer(lines, time) + phases[:, None])).sum(axis=0))
