"""The history-aware compensator: it carries the elements' states forward along x_T*, and may learn their scale.

Every motion has the same x_T* and net thrust n, turned by its direction; u_ff = n. The elements follow x_T* without an
end, and u_rf is their force in the middle of each interval of the thrust, where the design took it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar

from design.trajectory.lifted import feedforward_only
from models.controller import References
from models.friction import Friction, follow
from models.plant import Plant
from models.records.record import motions
from models.variation import Variation, varied_friction

Array = NDArray[np.float64]

LENGTHS: Final = (0.4, 2.5)  # `learn` searches the length between these shares of the nominal one.
LEAST: Final = 0.05  # It takes the force for no less than this share of the nominal one.


@dataclass(frozen=True)
class MotionProfile:
    """A motion over one `stroke` [m]: position (k,) [m], net thrust (k,) [N] and middle (k,) [m] at its samples.

    middle: position half-way through each interval of the thrust.
    """

    stroke: float
    position: Array
    net: Array
    middle: Array


def motion_profile(plant: Plant, sample_time: float, net: ArrayLike, stroke: float) -> MotionProfile:
    """The motion that net thrust (n,) [N] gives; it ends on the target after n samples [s]."""
    thrust = np.append(np.asarray(net, float), 0.0)
    lifted = feedforward_only(plant, sample_time, thrust.size)
    position, middle = (lifted.on_thrust(signal) @ thrust for signal in (lifted.position[:-1], lifted.middle))
    return MotionProfile(stroke, np.append(position, stroke), np.append(thrust, 0.0), np.append(middle, stroke))


def compensate(motion: MotionProfile, friction: Friction, target: ArrayLike) -> References:
    """x_T* [m], u_ff = n [N] and u_rf [N] over a target r (n,) [m] of strokes of the motion's height, from rest at 0.

    The elements begin virgin. Motions that follow each other before the last has ended are cut off.
    """
    r = np.asarray(target, float)
    position, middle, net = r.copy(), r.copy(), np.zeros(r.size)
    for one in motions(r):
        count = min(motion.position.size, one.stop - one.start)
        part, scale = slice(one.start, one.start + count), (one.target - one.origin) / motion.stroke
        position[part] = one.origin + scale * motion.position[:count]
        middle[part] = one.origin + scale * motion.middle[:count]
        net[part] = scale * motion.net[:count]
    force, _ = follow(friction, np.concatenate([[0.0], middle]))
    return References(position, net, force[1:])


def rest_states(friction: Friction, position: ArrayLike, target: ArrayLike) -> Array:
    """Element states (motions, N) [m] at the start of each motion, of the exact elements along position (n,) [m].

    Virgin at the first sample. A record or a simulated response tells the position at the samples.
    """
    path, states = np.asarray(position, float), []
    state, done = np.zeros(len(friction.limit)), 0
    for one in motions(np.asarray(target, float)):
        _, state = follow(friction, path[done : one.start + 1], state)
        states.append(state)
        done = one.start
    return np.array(states)


def learn(nominal: Friction, middle: ArrayLike, rests: ArrayLike, hold: ArrayLike) -> Friction:
    """`nominal` with the force and length that explain the thrust `hold` (k,) [N] at samples `rests` (k,) of a run.

    middle (n,) [m]: the path the table was led along. At rest the thrust is the friction's force, so the controller
    knows it without a sensor. Two factors by least squares: that of the force is linear; that of the length is searched
    for, as slip makes its sum of squares bumpy.
    """
    path = np.concatenate([[0.0], np.asarray(middle, float)])
    moves = np.diff(path, prepend=np.nan) != 0  # where the path rests the elements do, too
    at, thrust = np.cumsum(moves)[np.asarray(rests, int) + 1] - 1, np.asarray(hold, float)

    def held(length: float) -> tuple[float, float]:
        """Least sum of squares missed with this error of the length, and the factor of the force that gives it."""
        force = follow(varied_friction(nominal, Variation(friction_length=length)), path[moves])[0][at]
        factor = max(float(force @ thrust) / max(float(force @ force), 1e-300), LEAST)
        return float(np.sum((thrust - factor * force) ** 2)), factor

    grid = np.geomspace(*LENGTHS, 41) - 1
    best = int(np.argmin([held(float(length))[0] for length in grid]))
    around = (grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)])
    length = float(minimize_scalar(lambda length: held(length)[0], bounds=around, method="bounded").x)
    return varied_friction(nominal, Variation(friction_force=held(length)[1] - 1, friction_length=length))
