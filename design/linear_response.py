"""The motion of the linear plant in closed form: it shares nothing with the models that a feedforward is made of."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.plant import Mode, Plant

Array = NDArray[np.float64]


def linear_response(plant: Plant, thrust: ArrayLike, sample_time: float, times: ArrayLike) -> Array:
    """x [m] of P_l(s) from rest at `times` (n,) [s], for thrust samples (k,) [N], each held, and 0 after them.

    A superposition of the modes' step responses in closed form, delayed by the dead time. Raises ValueError for a mode
    whose damping ratio is 1 or more.
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
