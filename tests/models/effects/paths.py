"""Paths along which the tests replay effects."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.effects.base import Effect
from models.effects.catalogue import every
from models.simulation.effect_kernel import Path

Array = NDArray[np.float64]

TS = 5e-4


def make(name: str, *values: float) -> Effect:
    """The effect of that name with its parameters in their order."""
    return every()[name](*values)


def through(
    points: ArrayLike, parts: int = 4, sample_time: float = TS, command: ArrayLike | float = 0.0, leaving: float = 0.0
) -> Path:
    """The path straight from each point [m] at a sample to the next, and on by `leaving` [m] from the last."""
    at = np.asarray(points, float)
    steps = np.append(np.diff(at), leaving)
    share = (np.arange(parts) + 0.5) / parts
    speed = np.repeat(steps[:, None] / sample_time, parts, axis=1)
    return Path(sample_time, at[:, None] + steps[:, None] * share, speed, at, np.broadcast_to(command, at.shape))


def steady(speed: float, samples: int, parts: int = 4) -> Path:
    """A path at a constant speed [m/s]."""
    return through(np.arange(samples) * TS * speed, parts, leaving=TS * speed)
