"""The scheme for a drive that keeps its own cascade: set point, velocity and torque offset as CiA 402 profiles.

The drive's position controller follows x_T* (607Ah target position, as what 60B0h adds to), its speed controller gets
the speed of x_T* (60B1h velocity offset), its current controller u_ff + u_rf (60B2h torque offset). The thrust is
sent `reference_delay` samples before the set point that it leads to, as the law lets its reference wait.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.controller import Controller, References
from models.feedback.forms import NO_FILTERS, Cascade, law_of
from models.machine import Machine

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

TORQUE_UNIT: Final = 1e-3  # of the rated thrust: what one of 60B2h is
CSV_HEADER: Final = "time_s,target_position_607Ah_inc,velocity_offset_60B1h_inc_per_s,torque_offset_60B2h_permille"


@dataclass(frozen=True)
class Profiles:
    """Set point [increments], velocity offset [increments/s] and torque offset [0.1 % of rated], each of shape (n,)."""

    interval: float
    position: Integers
    velocity: Integers
    torque: Integers

    def rows(self) -> Iterator[str]:
        """The lines of a CSV."""
        yield CSV_HEADER
        for k, one in enumerate(zip(self.position, self.velocity, self.torque, strict=True)):
            yield ",".join([repr(round(k * self.interval, 12)), *(str(number) for number in one)])


@dataclass(frozen=True)
class Drive:
    """What the drive takes: a set point every `interval` [s] in steps of `increment` [m]; its `rated_thrust` [N]."""

    interval: float
    increment: float
    rated_thrust: float


def profiles(known: References, delay: int, sample_time: float, drive: Drive) -> Profiles:
    """The profiles of what the controller knows before the motion [m], [N], whose reference waits `delay` samples [s].

    Raises ValueError for an interval that neither divides the sample time nor is a multiple of it.
    """
    thrust = known.feedforward + known.compensation
    position, force = _at(_late(known.position, delay), thrust, drive.interval / sample_time)
    counts = np.round(position / drive.increment).astype(np.int64)
    speed = np.diff(position, prepend=position[0]) / drive.interval / drive.increment
    torque = np.round(force / drive.rated_thrust / TORQUE_UNIT).astype(np.int64)
    return Profiles(drive.interval, counts, np.round(speed).astype(np.int64), torque)


def _late(signal: Array, delay: int) -> Array:
    return np.concatenate([np.full(delay, 0.0), signal])[: signal.size]


def _at(position: Array, thrust: Array, ratio: float) -> tuple[Array, Array]:
    """Position and thrust at intervals of `ratio` samples: the one interpolated, the other held, or averaged."""
    if ratio > 1:
        whole = round(ratio)
        if abs(ratio - whole) > 1e-6:
            raise ValueError("the drive's interval must be a multiple or a whole fraction of the sample time")
        count = position.size // whole
        return position[: count * whole : whole], thrust[: count * whole].reshape(count, whole).mean(axis=1)
    parts = round(1 / ratio)
    if abs(1 / ratio - parts) > 1e-6:
        raise ValueError("the drive's interval must be a multiple or a whole fraction of the sample time")
    samples = np.arange(position.size * parts) / parts
    return np.interp(samples, np.arange(position.size), position), np.repeat(thrust, parts)


def cascade_of(machine: Machine) -> Cascade:
    """The drive's cascade: the machine's own, or else the one whose loop is nearest to the PID's [1/s, N s/m, s].

    kp = Kv (Kp + 1 / Tn), ki = Kv Kp / Tn, kd = Kv; where that has no real solution, Kp = 1 / Tn = kp / (2 kd).
    Without an integral part there is none in the cascade either: Kp = kp / kd.
    """
    control = machine.control
    if control.cascade is not None:
        return replace(control.cascade, velocity_feedforward=1.0, acceleration_feedforward=0.0)
    pid = control.pid
    if not pid.kd > 0:
        raise ValueError("a PID without a derivative part has no cascade that resembles it; state [control.cascade]")
    if pid.ki == 0:
        return Cascade(pid.kp / pid.kd, pid.kd, 0.0, pid.derivative_filter, 1.0)
    total, product = pid.kp / pid.kd, pid.ki / pid.kd
    root = math.sqrt(max(total**2 / 4 - product, 0.0))
    rate = total / 2 + root
    return Cascade(total / 2 - root if root > 0 else total / 2, pid.kd, 1 / rate, pid.derivative_filter, 1.0)


def on_the_drive(
    machine: Machine, controller: Controller, known: References, *, torque: bool = True, rounded: bool = True
) -> tuple[Controller, References]:
    """The drive's own cascade, and what it is given of what the controller knows [m], [N], at the controller's rate.

    torque: whether the drive takes the torque offset; rounded: whether to increments and per mille of the rating.
    """
    law = law_of(cascade_of(machine), NO_FILTERS, 0.0, machine.sample_time)
    position, thrust = _late(known.position, controller.reference_delay), known.feedforward + known.compensation
    increment, unit = machine.scale.resolution, TORQUE_UNIT * machine.drive.rated_thrust
    if rounded:
        thrust = np.round(thrust / unit) * unit
        position = np.round(position / increment) * increment if increment > 0 else position
    cascade = replace(controller.without_compensation(), law=law, reference_delay=0)
    return cascade, References(position, thrust if torque else np.zeros(thrust.size), np.zeros(thrust.size))
