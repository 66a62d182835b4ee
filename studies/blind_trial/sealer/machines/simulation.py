"""A run of a drawn machine over one record of its experiment, with what is changed in it, from a seed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from studies.blind_trial.sealer.machines import integrator
from studies.blind_trial.sealer.machines.axis import Axis
from studies.blind_trial.sealer.machines.motions import Schedule
from studies.blind_trial.sealer.machines.truth import (
    ATTACHED,
    CONTROL,
    NAMES,
    PLACE,
    POINTS,
    SLOW,
    Motion,
    Signals,
    Truth,
)

Array = NDArray[np.float64]
Signal = Callable[[np.random.Generator, int], Array]

LEAD: Final = 0.6  # s at rest under control before the record
EARLIER: Final = 8  # commands before the record that are kept
FINE: Final = 30.0  # steps in a period of the fastest resonance
LONGEST: Final = 2e-4  # step [s]
LAG_STEPS: Final = 6.0  # steps in the time constant of a lag
MOST_STEPS: Final = 64  # in a sample
SMEARED: Final = (-0.03, 0.0, 0.03)  # of a limit, over which each contact is spread at most
SEEN: Final = 0.5  # of a reading's deviation, by which it is spread at most


@dataclass(frozen=True)
class Change:
    """What an effect changes: coefficients of the truth, signals of (rng, n), values of the controller by name, samples
    by which the reference waits longer."""

    fields: Mapping[str, float] = field(default_factory=dict)
    signals: Mapping[str, Signal] = field(default_factory=dict)
    control: Mapping[str, float] = field(default_factory=dict)
    later: int = 0


@dataclass(frozen=True)
class Log:
    """Command [N] and reading [m] (n,), position [m] (n, POINTS) as only a simulation knows it; the last commands [N]
    before the record, and the elements (E,) [m] when it began."""

    command: Array
    reading: Array
    position: Array
    earlier: Array
    start: Array


def elements(axis: Axis) -> tuple[Array, Array]:
    """Stiffness [N/m] and limit [m] (E,): each contact smeared, its sum and mean limit kept.

    By no more than the scale can see: on a precise one, rounder corners than the nominal elements' would be an effect.
    """
    parts = np.array(SMEARED) / max(SMEARED)
    width = np.minimum(max(SMEARED) * axis.limit, SEEN * axis.read)
    return np.repeat(axis.stiffness / parts.size, parts.size), (axis.limit[:, None] + np.outer(width, parts)).ravel()


def truth(axis: Axis, changes: Mapping[str, float], control: Mapping[str, float], later: int = 0) -> Truth:
    """The true machine with coefficients set and the controller's values replaced."""
    stiffness, limit = elements(axis)
    c = np.zeros(len(NAMES))
    for name, number in changes.items():
        c[PLACE[name]] = number
    gain = axis.gain.copy()
    if changes.get("mass_form") == 1.0:
        gain[0] = 1.0 / (1.0 / gain[0] - changes["mass"])
    fastest = max(np.sqrt(stiffness.sum() * np.abs(gain).sum()) / (2 * np.pi), *axis.frequency, 100.0)
    shortest = min(changes.get("current", np.inf), changes.get("lag", np.inf))
    wanted = max(FINE * fastest * axis.sample_time, axis.sample_time / LONGEST, LAG_STEPS * axis.sample_time / shortest)
    steps = POINTS * int(np.ceil(np.clip(wanted / POINTS, 1.0, MOST_STEPS / POINTS)))
    c[PLACE["step"]] = axis.sample_time / steps
    c[PLACE["travel"]] = axis.travel
    return Truth(
        axis.sample_time,
        axis.dead_time,
        gain,
        2 * np.pi * axis.frequency,
        axis.damping,
        stiffness,
        limit,
        axis.resolution,
        np.array([{**axis.control, **control}.get(name, 0.0) for name in CONTROL]),
        axis.delay + later,
        axis.offset,
        steps,
        c,
    )


def worn_in(limit: Array, rng: np.random.Generator) -> Array:
    """The elements (E,) [m] after a few moves either way that nobody recorded."""
    z = np.zeros(limit.size)
    for move in limit.max() * 10.0 ** rng.uniform(-1.5, 1.0, 6) * rng.choice([-1, 1], 6):
        z = np.clip(z + move, -limit, limit)
    return z


def simulate(
    axis: Axis,
    schedule: Schedule,
    seed: int,
    change: Change | None = None,
    *,
    start: int | None = None,
    exact: bool = False,
) -> Log:
    """The log of one record; exact: without noise and rounding; start: the seed of the friction's state at the begin
    (None: the same). Raises ArithmeticError where the command leaves the drive's range.
    """
    change = change or Change()
    machine = truth(axis, change.fields, change.control, change.later)
    z = worn_in(machine.limit, np.random.default_rng([seed if start is None else start, 0]))
    before = int(np.ceil(LEAD / axis.sample_time))
    n = before + schedule.target.size
    noise = axis.noise * np.random.default_rng([seed, 1]).standard_normal(n)
    rng = np.random.default_rng([seed, 2])
    if exact:
        machine, noise = machine._replace(resolution=0.0), np.zeros(n)
    given = {name: np.zeros(n) for name in ("late", "stale", "held", "force")}
    for name, make in change.signals.items():
        given[name][before:] = make(rng, n - before)
    rest = np.zeros(before)
    logged = Signals(
        reference=np.concatenate([rest, schedule.reference]),
        feedforward=np.concatenate([rest, schedule.feedforward]),
        noise=noise,
        reading=np.zeros(n),
        command=np.zeros(n),
        position=np.zeros((n, POINTS)),
        start=z.copy(),
        **given,
    )
    integrator.run(machine, logged, _at_rest(machine, z, n), before)
    if not np.all(np.isfinite(logged.command)) or np.abs(logged.command).max() > axis.rated:
        raise ArithmeticError("the command left the drive's range")
    return Log(
        logged.command[before:],
        logged.reading[before:],
        logged.position[before:],
        logged.command[before - EARLIER : before],
        logged.start,
    )


def _at_rest(machine: Truth, z: Array, n: int) -> Motion:
    size = 2 * machine.gain.size + ATTACHED
    return Motion(
        y=np.zeros(size),
        k=np.zeros((4, size)),
        trial=np.zeros(size),
        z=z.copy(),
        gaps=np.zeros(3),
        slow=np.zeros(SLOW),
        last=np.zeros(4),
        law=np.zeros(6),
        starts=np.empty(n),
        inputs=np.empty(n),
        active=np.full(1, -1),
    )
