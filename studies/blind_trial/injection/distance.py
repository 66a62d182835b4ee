"""How well an injected force could be seen in a record by its own roughness, decided before any answer.

The record's own force, after the mass, drag, friction and offset that fit it best, is the noise; what of the injected
force these cannot explain is the signal, both as smooth as the motion. D is the signal-to-noise ratio of a matched
filter, D^2 = 4 int |X|^2 / S df (Turin 1960). All that the uninjected record leaves counts as noise, also what a
diagnosis may explain. Imports nothing of the models.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from studies.blind_trial.injection.motion import WINDOW, Course, dragged

Array = NDArray[np.float64]

SEGMENTS: Final = 8  # of the record over which the spectrum of its roughness is averaged
LIMIT: Final = 5.0  # D from which an injected force counts as identifiable
KNOTS: Final = 8  # of a free curve over speed, evenly in its logarithm
SLOWEST: Final = 0.01  # quantile of the speeds at which it begins
SAME_DIRECTION_RATIO: Final = 1e-9  # of the largest singular value, below which directions are one
SIZES: Final = {"low": 0.5 * LIMIT, "middle": 1.5 * LIMIT, "high": 4 * LIMIT}


@dataclass(frozen=True)
class Noise:
    """What a record's rigid axis with friction leaves: its directions (n, k), orthonormal, and the one-sided
    spectral density (m,) [N2/Hz] at frequencies (m,) [Hz]; the sample time [s]; rms [N] of what is left."""

    directions: Array
    frequency: Array
    density: Array
    sample_time: float
    rms: float


def noise_of(path: Course, sample_time: float) -> Noise:
    """The roughness of a record by its motion; [s]."""
    columns = [path.acceleration, path.speed, dragged(path.position, path.soft), np.ones(path.time.size)]
    scaled = np.stack([one / max(float(np.max(np.abs(one))), 1e-300) for one in columns], axis=1)
    directions = np.linalg.qr(scaled)[0]
    command = scipy.signal.savgol_filter(path.command, min(WINDOW, (path.time.size - 1) // 2 * 2 + 1), 3)
    left = command - directions @ (directions.T @ command)
    segment = max(2 * path.time.size // (SEGMENTS + 1), 16)
    frequency, density = scipy.signal.welch(left, 1 / sample_time, nperseg=segment, detrend=False)
    return Noise(directions, frequency, density, sample_time, float(np.sqrt(np.mean(left**2))))


def beside_speed(path: Course, noise: Noise) -> Noise:
    """The same roughness, with friction over speed among what is explained: any curve, in each direction for itself."""
    friction, speed = dragged(path.position, path.soft), np.abs(path.speed)
    if not np.any(speed):
        return noise
    knots = np.log(np.geomspace(np.quantile(speed[speed > 0], SLOWEST), np.max(speed), KNOTS))
    at = np.log(np.maximum(speed, np.exp(knots[0])))
    hats = [np.interp(at, knots, one) for one in np.eye(KNOTS)]
    curves = [np.maximum(way * friction, 0) * hat for way in (1, -1) for hat in hats]
    columns = [one / max(float(np.linalg.norm(one)), 1e-300) for one in curves]
    left, sizes, _ = np.linalg.svd(np.column_stack([noise.directions, *columns]), full_matrices=False)
    return replace(noise, directions=left[:, sizes > SAME_DIRECTION_RATIO * sizes[0]])


def unexplained(force: Array, noise: Noise) -> Array:
    """What of a force (n,) [N] the noise's directions cannot explain [N]: mass, drag, friction and offset."""
    return np.asarray(force - noise.directions @ (noise.directions.T @ force))


def distance(force: Array, noise: Noise) -> float:
    """D [1] of a force (n,) [N]."""
    ts = noise.sample_time
    spectrum = np.abs(np.fft.rfft(unexplained(force, noise))) ** 2 * ts**2
    frequency = np.fft.rfftfreq(force.size, ts)
    seen = frequency <= 1 / (WINDOW * ts)  # above, the motion is smoothed away
    density = np.interp(frequency, noise.frequency, noise.density)[seen]
    return float(np.sqrt(4 * np.sum(spectrum[seen] / density) * (frequency[1] - frequency[0])))
