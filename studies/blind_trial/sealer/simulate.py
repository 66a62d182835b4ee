"""A run of the sealed machine over one experiment, from a table, what else is in it, and a seed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from studies.blind_trial.sealer import physics
from studies.blind_trial.sealer.machine import POINTS, STATES, Moving, Physics, Run
from studies.blind_trial.sealer.nominal import NOISE, Table
from studies.blind_trial.sealer.schedule import Schedule

Array = NDArray[np.float64]

BEFORE: Final = 2000  # samples of rest under control before the record: a second
PARTS: Final = np.array([-2.0, -1.0, 0.0, 1.0, 2.0]) * 0.02  # of a limit, over which each contact is smeared
WEIGHTS: Final = np.array([1.0, 2.0, 3.0, 2.0, 1.0]) / 9.0


@dataclass(frozen=True)
class Log:
    """Command [N] and reading [m] (n,), position [m] (n, POINTS) as only a simulation knows it.

    earlier: the last commands [N] before the record; start: the elements (E,) [m] when it began; energy: lost in
    friction [J].
    """

    command: Array
    reading: Array
    position: Array
    earlier: Array
    start: Array
    energy: float


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
    signals: Mapping[str, Any] | None = None,
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
    given = {name: np.zeros(n) for name in ("late", "stale", "held", "force")}
    for name, make in (signals or {}).items():
        given[name][BEFORE:] = make(rng, n - BEFORE)
    rest = np.zeros(BEFORE)
    logged = Run(
        reference=np.concatenate([rest, schedule.reference]),
        feedforward=np.concatenate([rest, schedule.feedforward]),
        noise=noise,
        reading=np.zeros(n),
        command=np.zeros(n),
        position=np.zeros((n, POINTS)),
        energy=np.zeros(1),
        start=z.copy(),
        **given,
    )
    physics.run(machine, logged, _at_rest(z, n), BEFORE)
    if not np.isfinite(logged.command[-1]):
        raise ArithmeticError(f"the simulation of {dict(fields or {})} left all bounds; make the effect smaller")
    return Log(
        logged.command[BEFORE:],
        logged.reading[BEFORE:],
        logged.position[BEFORE:],
        logged.command[BEFORE - 4 : BEFORE],
        logged.start,
        float(logged.energy[0]),
    )


def _at_rest(z: Array, n: int) -> Moving:
    return Moving(
        y=np.zeros(STATES),
        k=np.zeros((4, STATES)),
        trial=np.zeros(STATES),
        z=z.copy(),
        plays=np.zeros(3),
        slow=np.zeros(9),
        last=np.zeros(4),
        pid=np.zeros(4),
        starts=np.empty(n),
        inputs=np.empty(n),
        active=np.full(1, -1),
    )
