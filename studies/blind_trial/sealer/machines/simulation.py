"""A run of a drawn machine over one record of its experiment, with what is changed in it, from a seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from studies.blind_trial.sealer.loop import POINTS, Log, Signal, at_rest, logged, run_of
from studies.blind_trial.sealer.machines import integrator
from studies.blind_trial.sealer.machines.axis import Axis
from studies.blind_trial.sealer.machines.motions import Schedule
from studies.blind_trial.sealer.machines.truth import ATTACHED, CONTROL, LAW, NAMES, PLACE, SLOW, Truth

Array = NDArray[np.float64]

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
    run = run_of(schedule, before, noise, z, rng, change.signals)
    states = 2 * machine.gain.size + ATTACHED
    integrator.run(machine, run, at_rest(z, n, states, SLOW, LAW), before)
    if not np.all(np.isfinite(run.command)) or np.abs(run.command).max() > axis.rated:
        raise ArithmeticError("the command left the drive's range")
    return logged(run, before, EARLIER)
