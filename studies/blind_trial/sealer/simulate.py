"""A run of the sealed machine over one experiment, from a table, what else is in it, and a seed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from studies.blind_trial.sealer import physics
from studies.blind_trial.sealer.loop import Log, Signal, at_rest, logged, run_of
from studies.blind_trial.sealer.machine import LAW, SLOW, STATES, Physics
from studies.blind_trial.sealer.nominal import NOISE, Table
from studies.blind_trial.sealer.schedule import Schedule

Array = NDArray[np.float64]

BEFORE: Final = 2000  # samples of rest under control before the record: a second
EARLIER: Final = 4  # commands before the record that are kept
PARTS: Final = np.array([-2.0, -1.0, 0.0, 1.0, 2.0]) * 0.02  # of a limit, over which each contact is smeared
WEIGHTS: Final = np.array([1.0, 2.0, 3.0, 2.0, 1.0]) / 9.0


def spread(table: Table) -> tuple[Array, Array]:
    """Stiffness [N/m] and limit [m] (E,) of the elements: sum and mean limit of each contact stay."""
    return np.outer(table.stiffness, WEIGHTS).ravel(), np.outer(table.limit, 1.0 + PARTS).ravel()


def physics_of(table: Table, fields: Mapping[str, float] | None = None) -> Physics:
    """The machine of a table, with further fields set; an attached mass is taken off the body's."""
    stiffness, limit = spread(table)
    extra = {name: float(number) for name, number in (fields or {}).items()}
    gains = dict(zip(("kp", "ki", "kd", "tau"), table.gains, strict=True))
    for name in gains:
        gains[name] *= 1.0 + extra.pop(f"{name}_off", 0.0)
    gain = table.gain.copy()
    if "mass" in extra:
        gain[0] = 1.0 / (1.0 / gain[0] - extra["mass"])
    return Physics(
        table.sample_time,
        table.dead_time,
        gain,
        2 * np.pi * table.frequency,
        table.damping,
        stiffness,
        limit,
        table.resolution,
        **gains,
        reference_delay=table.reference_delay + int(extra.pop("later", 0)),
        offset=table.offset + extra.pop("push", 0.0),
        **extra,
    )


def worn_in(limit: Array, rng: np.random.Generator) -> Array:
    """The elements (E,) [m] after a few moves that nobody recorded, of 1 um to 1 mm in either direction."""
    z = np.zeros(limit.size)
    for move in 10.0 ** rng.uniform(-6, -3, size=6) * rng.choice([-1, 1], size=6):
        z = np.clip(z + move, -limit, limit)
    return z


def simulate(
    table: Table,
    schedule: Schedule,
    seed: int,
    fields: Mapping[str, float] | None = None,
    signals: Mapping[str, Signal] | None = None,
    exact: bool = False,
) -> Log:
    """The log of one experiment. signals: functions of (rng, n) for late, stale, held, force; exact: without noise and
    rounding.
    """
    rng = np.random.default_rng(seed)
    machine = physics_of(table, fields)
    z = worn_in(machine.limit, rng)
    n = BEFORE + schedule.target.size
    noise = NOISE * rng.standard_normal(n)
    if exact:
        machine, noise = machine._replace(resolution=0.0), np.zeros(n)
    run = run_of(schedule, BEFORE, noise, z, rng, signals or {})
    physics.run(machine, run, at_rest(z, n, STATES, SLOW, LAW), BEFORE)
    if not np.isfinite(run.command[-1]):
        raise ArithmeticError(f"the simulation of {dict(fields or {})} left all bounds; make the effect smaller")
    return logged(run, BEFORE, EARLIER)
