"""Proof of a design on the nonsmooth machine: the motions of Fig. 5, repeated until periodic, and what they achieve.

Beside it, a closed form of the linear plant's motion that shares nothing with the models that a feedforward is made of.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.controller import Controller
from models.machine import Machine
from models.plant import Mode, Plant
from models.records.record import Motion, feeding_sequence, motions
from models.records.settling import dispersion, overshoot, settling_time
from models.simulation.simulator import Response, simulate, simulate_many

Array = NDArray[np.float64]
REPEATS = (3, 6, 12, 24)  # of the sequence, until the last two agree


@dataclass(frozen=True)
class Achieved:
    """One motion's outcome: times [s], lengths [m], thrust [N]; `error` (n,) [m] is x - target from the step on."""

    motion: Motion
    settling_time: float
    overshoot: float
    peak_thrust: float
    error: Array


@dataclass(frozen=True)
class Validation:
    """The last period of the sequence: its response, cut into motions; `repeat_error` [m] to the period before.

    dispersion (n,) [m] is 3 sigma over the positive motions at each time from the step on; worst_dispersion [m] its
    largest value after the specified settling time.
    """

    response: Response
    achieved: tuple[Achieved, ...]
    repeats: int
    repeat_error: float
    dispersion: Array
    worst_dispersion: float

    def positive(self) -> tuple[Achieved, ...]:
        """The motions that the paper evaluates: those in the positive direction, the reversal first."""
        return tuple(one for one in self.achieved if one.motion.direction > 0)


def validate(machine: Machine, controller: Controller, *, stroke: float | None = None, seed: int = 0) -> Validation:
    """The sequence of Fig. 5 with strokes of `stroke` [m] (default: the specification's) on the nonsmooth machine."""
    period = _period(machine, stroke)
    for repeats in REPEATS:
        response = simulate(machine, controller, np.tile(period, repeats), seed=seed)
        found = _assess(machine, response, period, repeats)
        if found.repeat_error <= agreement(machine):
            break
    return found


def validate_many(
    machines: Sequence[Machine], controllers: Sequence[Controller], *, repeats: int = REPEATS[0], substeps: int = 10
) -> tuple[Validation, ...]:
    """`validate` of machines[i] with controllers[i] in one call, for `repeats` periods [1] of one sequence for all.

    The machines must agree in stroke, number and interval of motions and sample time. Whether the last two periods
    agree is in each Validation's repeat_error [m].
    """
    period = _period(machines[0], None)
    responses = simulate_many(machines, controllers, np.tile(period, repeats), substeps=substeps)
    return tuple(
        _assess(machine, response, period, repeats) for machine, response in zip(machines, responses, strict=True)
    )


def agreement(machine: Machine) -> float:
    """How far [m] two periods may differ to count as equal: a step of the scale, which rounds them, and noise."""
    return max(machine.scale.resolution + 6 * machine.scale.noise, 1e-3 * machine.specification.tolerance)


def linear_response(plant: Plant, thrust: ArrayLike, sample_time: float, times: ArrayLike) -> Array:
    """x [m] of P_l(s) from rest at `times` (n,) [s], for thrust samples (k,) [N], each held, and 0 after them.

    A superposition of the modes' step responses in closed form, delayed by the dead time.
    """
    steps = np.diff(np.asarray(thrust, float), prepend=0.0, append=0.0)
    begins = np.arange(steps.size) * sample_time + plant.dead_time
    age = np.asarray(times, float)[:, None] - begins
    age = np.where(age > 0, age, 0.0)
    response: Array = sum((_step_response(mode, age) for mode in plant.modes), np.zeros_like(age)) @ steps
    return plant.thrust_constant * response


def _step_response(mode: Mode, t: Array) -> Array:
    """q(t) of q'' + 2 zeta w q' + w^2 q = k from rest, for zeta < 1."""
    if mode.frequency == 0:
        return 0.5 * mode.gain * t**2
    if mode.damping >= 1:
        raise ValueError("the closed form is for modes that vibrate; give a damping ratio below 1")
    omega, zeta = 2 * math.pi * mode.frequency, mode.damping
    root = math.sqrt(1 - zeta**2)
    decay = np.exp(-zeta * omega * t)
    shape = np.cos(root * omega * t) + zeta / root * np.sin(root * omega * t)
    return np.asarray(mode.gain / omega**2 * (1 - decay * shape), float)


def _period(machine: Machine, stroke: float | None) -> Array:
    wanted = machine.specification
    height = wanted.stroke if stroke is None else stroke
    return feeding_sequence(height, wanted.motions, wanted.interval, machine.sample_time)


def _assess(machine: Machine, response: Response, period: Array, repeats: int) -> Validation:
    """What the last of the periods achieved, and how far it is from the one before."""
    n = period.size
    error = float(np.max(np.abs(response.position[-n:] - response.position[-2 * n : -n])))
    last = response.last(n)
    achieved = tuple(_achieved(machine, last, motion) for motion in _within_period(period))
    spread = dispersion([one.error for one in achieved if one.motion.direction > 0])
    after = round(machine.specification.settling_time / machine.sample_time)
    return Validation(last, achieved, repeats, error, spread, float(np.max(spread[after:], initial=0.0)))


def _within_period(period: Array) -> Sequence[Motion]:
    """The motions of one period that others precede: its first comes after a motion down, so it is a reversal."""
    return motions(np.concatenate([period, period]), initial=0.0)[: len(motions(period))]


def _achieved(machine: Machine, response: Response, motion: Motion) -> Achieved:
    part = slice(motion.start, motion.stop)
    position, stroke = response.position[part], abs(motion.target - motion.origin)
    error = position - motion.target
    return Achieved(
        motion,
        settling_time(error, machine.specification.tolerance, machine.sample_time),
        overshoot((position - motion.origin) * motion.direction, stroke),
        float(np.max(np.abs(response.record.command[part]))),
        error,
    )
