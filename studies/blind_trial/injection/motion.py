"""The motion of a record as an injected law sees it, smooth and still where the axis rests.

A law that acted on the raw reading would put the scale's noise into the command. Imports nothing of the models.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

WINDOW: Final = 21  # samples over which the position is smoothed by a cubic, which no steady acceleration bends
GRAINS: Final = 2.0  # half the play, in grains of the scale, within which an axis counts as being at rest
SOFT: Final = 5.0  # the distance over which the sealer's friction turns, in the longest limit of a nominal contact


@dataclass(frozen=True)
class Course:
    """Signals (n,) at the times at which the sample's command acts: time [s], position [m], speed [m/s], acceleration
    [m/s2], the logged command [N]; soft: the distance [m] over which friction turns; length [m] of the travel."""

    time: Array
    position: Array
    speed: Array
    acceleration: Array
    command: Array
    soft: float

    @property
    def length(self) -> float:
        """Of the travel [m]."""
        return float(np.ptp(self.position))

    @property
    def middle(self) -> float:
        """Of the travel [m]."""
        return float(np.min(self.position) + np.max(self.position)) / 2


def course(
    position: Array, command: Array, sample_time: float, *, grain: float, longest_limit: float, ahead: float
) -> Course:
    """The motion of a record (n,) [m], [N]. grain [m]: the step of its scale; longest_limit [m]: of the nominal
    friction's contacts; ahead [s]: from a sample to the middle of the time over which its command acts."""
    window = min(WINDOW, (position.size - 1) // 2 * 2 + 1)
    smooth, speed, acceleration = (
        scipy.signal.savgol_filter(position, window, min(3, window - 1), deriv=order, delta=sample_time)
        for order in range(3)
    )
    held = _within_play(smooth, GRAINS * grain)
    still = np.convolve(np.abs(np.gradient(held)) > 0, np.ones(window), "same") == 0
    time = np.asarray(np.arange(position.size) * sample_time, float)

    def then(signal: Array) -> Array:
        return np.asarray(np.interp(time + ahead, time, signal), float)

    return Course(
        time,
        then(held),
        then(np.where(still, 0.0, speed)),
        then(np.where(still, 0.0, acceleration)),
        command,
        max(SOFT * longest_limit, 10 * grain),
    )


def _within_play(signal: Array, half: float) -> Array:
    """What a play of this half width [m] passes on of a signal (n,) [m]."""
    out = np.empty_like(signal)
    at = float(signal[0])
    for k, value in enumerate(signal.tolist()):
        at = min(max(at, value - half), value + half)
        out[k] = at
    return out


def dragged(position: Array, soft: float) -> Array:
    """The direction (n,) [1] in which friction is dragged: -1 .. 1, by an exponential over the path (Dahl 1968)."""
    out = np.zeros(position.size)
    state = 0.0
    for k, step in enumerate(np.diff(position).tolist()):
        if step != 0.0:
            end = 1.0 if step > 0 else -1.0
            state = end + (state - end) * float(np.exp(-abs(step) / soft))
        out[k + 1] = state
    return out


def since_reversal(position: Array, back: float) -> Array:
    """The path (n,) [m] since the axis last turned by more than `back` [m]."""
    out = np.zeros(position.size)
    turn = extreme = float(position[0])
    way = 0.0
    for k, x in enumerate(position.tolist()):
        if way == 0.0 and abs(x - turn) > back:
            way, extreme = (1.0, x) if x > turn else (-1.0, x)
        if way * (x - extreme) >= 0:
            extreme = x
        elif abs(x - extreme) > back:
            turn, way, extreme = extreme, -way, x
        out[k] = abs(x - turn)
    return out


def stretched(position: Array, reach: float) -> Array:
    """The stretch (n,) [1] of a spring that slips beyond `reach` [m]: -1 .. 1."""
    out = np.zeros(position.size)
    state = 0.0
    for k, step in enumerate(np.diff(position).tolist()):
        state = min(max(state + step / reach, -1.0), 1.0)
        out[k + 1] = state
    return out
