"""Where the table was between the samples, from smoothed states at them."""

from __future__ import annotations

from functools import reduce

import numpy as np
from numpy.typing import NDArray

from diagnosis.model.kalman import SUBSTEPS
from models.compiled import compiled
from models.records.record import Record
from models.simulation.effect_kernel import Path

Array = NDArray[np.float64]


def path_through(states: Array, count: int, record: Record, vibration: Array) -> Path:
    """The path (n, M) [m] through smoothed states (n, S), of which the first `count` are the plant's, with the
    vibration (n,) [m] of its effects: cubic Hermite between the samples."""
    ts = record.sample_time
    positions, speeds_of_modes = states.T[0:count:2], states.T[1:count:2]  # added whole: numpy's sums of few are slow
    x, v = reduce(np.add, positions) + vibration, reduce(np.add, speeds_of_modes)
    t = (np.arange(SUBSTEPS) + 0.5) / SUBSTEPS
    places = np.array([2 * t**3 - 3 * t**2 + 1, (t**3 - 2 * t**2 + t) * ts, 3 * t**2 - 2 * t**3, (t**3 - t**2) * ts])
    speeds = np.array([6 * (t**2 - t) / ts, 3 * t**2 - 4 * t + 1, 3 * t**2 - 2 * t])
    position, speed = np.empty((x.size, SUBSTEPS)), np.empty((x.size, SUBSTEPS))
    _hermite(x, v, places, speeds, position, speed)
    return Path(ts, position, speed, x, record.command)


@compiled
def _hermite(x: Array, v: Array, places: Array, speeds: Array, position: Array, speed: Array) -> None:
    """Writes positions [m] and speeds [m/s] (n, M) between samples x, v (n,), the last of which stay.

    places (4, M): the weights of x, v, the next x and the next v; speeds (3, M): of x less the next, v, the next v.
    """
    last = x.size - 1
    for k in range(x.size):
        ahead, faster = x[min(k + 1, last)], v[min(k + 1, last)]
        for j in range(position.shape[1]):
            begun = places[0, j] * x[k] + places[1, j] * v[k]
            position[k, j] = begun + (places[2, j] * ahead + places[3, j] * faster)
            speed[k, j] = speeds[0, j] * (x[k] - ahead) + speeds[1, j] * v[k] + speeds[2, j] * faster
