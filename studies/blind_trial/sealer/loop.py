"""What the loops of the one table and of the drawn machines share: signals, commands that act late, what is logged."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, Protocol

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Signal = Callable[[np.random.Generator, int], Array]

POINTS: Final = 4  # logged positions in a sample
compiled = numba.njit(fastmath=True, error_model="numpy", forceinline=True)


class Run(NamedTuple):
    """Signals in, (n,) each: reference, feedforward, noise of the scale, lateness of a command [s], age of a reading
    [s], whether a reading is held (1) or taken (0), and a force [N]. Written to: reading, command (n,), position (n,
    POINTS) at the fractions 0, 1/POINTS, ... of each sample, energy (1,) [J] lost in friction since the record began,
    where the loop counts it, start (E,) [m]: the friction's elements then.
    """

    reference: Array
    feedforward: Array
    noise: Array
    late: Array
    stale: Array
    held: Array
    force: Array
    reading: Array
    command: Array
    position: Array
    energy: Array
    start: Array


class Moving(NamedTuple):
    """What a loop carries from step to step.

    y: states (S,) of modes and attachments; k: their rates at the four stages (4, S); trial: states at a stage; z:
    elements (E,); gaps: contacts behind clearances (3,); slow: what moves once a step; last: acceleration, friction,
    amplifier's input, applied command; law: the controller's states; starts, inputs: when each command begins to act
    [s] and what it is then [N] (n,); active: the one that acts (1,).
    """

    y: Array
    k: Array
    trial: Array
    z: Array
    gaps: Array
    slow: Array
    last: Array
    law: Array
    starts: Array
    inputs: Array
    active: NDArray[np.int64]


class Asked(Protocol):
    """What a record of an experiment asks of the machine: reference [m] and feedforward [N], (n,) each."""

    @property
    def reference(self) -> Array:
        """x_T* (n,) [m]."""

    @property
    def feedforward(self) -> Array:
        """u_ff (n,) [N]."""


@dataclass(frozen=True)
class Log:
    """Command [N] and reading [m] (n,), position [m] (n, POINTS) as only a simulation knows it.

    earlier: the last commands [N] before the record; start: the elements (E,) [m] when it began; energy: lost in
    friction [J], where the loop counts it.
    """

    command: Array
    reading: Array
    position: Array
    earlier: Array
    start: Array
    energy: float


def run_of(
    asked: Asked, before: int, noise: Array, z: Array, rng: np.random.Generator, signals: Mapping[str, Signal]
) -> Run:
    """The signals of a run that begins with `before` samples at rest; noise (n,) [m] of the scale; z (E,) [m]; signals:
    functions of (rng, n) for late, stale, held and force, of the record alone."""
    n, rest = noise.size, np.zeros(before)
    given = {name: np.zeros(n) for name in ("late", "stale", "held", "force")}
    for name, make in signals.items():
        given[name][before:] = make(rng, n - before)
    return Run(
        reference=np.concatenate([rest, asked.reference]),
        feedforward=np.concatenate([rest, asked.feedforward]),
        noise=noise,
        reading=np.zeros(n),
        command=np.zeros(n),
        position=np.zeros((n, POINTS)),
        energy=np.zeros(1),
        start=z.copy(),
        **given,
    )


def at_rest(z: Array, n: int, states: int, slow: int, law: int) -> Moving:
    """What a loop over n samples begins with: so many states, slow states and states of the controller, all 0; z (E,)
    [m]."""
    sized: dict[str, Any] = {"slow": np.zeros(slow), "law": np.zeros(law)}
    return Moving(
        y=np.zeros(states),
        k=np.zeros((4, states)),
        trial=np.zeros(states),
        z=z.copy(),
        gaps=np.zeros(3),
        last=np.zeros(4),
        starts=np.empty(n),
        inputs=np.empty(n),
        active=np.full(1, -1),
        **sized,
    )


def logged(run: Run, before: int, earlier: int) -> Log:
    """The log of a run without its first `before` samples, of which the last `earlier` commands are kept."""
    return Log(
        run.command[before:],
        run.reading[before:],
        run.position[before:],
        run.command[before - earlier : before],
        run.start,
        float(run.energy[0]),
    )


@compiled
def mean_input(m: Moving, k: int, now: float, h: float) -> float:
    """Mean of the command that acts over a step, of those up to the k-th."""
    mean, since, active = 0.0, now, m.active[0]
    while active < k and m.starts[active + 1] <= now + h:
        begin = max(m.starts[active + 1], since)
        mean += m.last[3] * (begin - since)
        m.last[3], since, active = m.inputs[active + 1], begin, active + 1
    m.active[0] = active
    return float(mean + m.last[3] * (now + h - since)) / h


@compiled
def alone(m: Moving, k: int, now: float, h: float) -> float:
    """Lets the commands act, of those up to the k-th, that begin by now; for how long [s] the last of them acts before
    another one does, h at most. What begins within a thousandth of h begins now."""
    active = m.active[0]
    while active < k and m.starts[active + 1] <= now + 1e-3 * h:
        m.last[3], active = m.inputs[active + 1], active + 1
    m.active[0] = active
    if active < k and m.starts[active + 1] < now + h:
        return float(m.starts[active + 1] - now)
    return h
