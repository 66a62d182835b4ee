"""The history-aware compensator: it carries the elements' states forward along x_T*, and may learn their scale.

Every motion has the same x_T* and net thrust n, turned by its direction; u_ff = n. The elements follow x_T* without an
end, and u_rf is their force in the middle of each interval of the thrust, where the design took it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from design.trajectory.lifted import feedforward_only
from models.controller import References
from models.friction import Friction, follow
from models.plant import Plant
from models.records.record import motions
from models.variation import Variation, varied_friction

Array = NDArray[np.float64]

LENGTHS: Final = (0.4, 2.5)  # `learn` searches the length between these shares of the nominal one.
GRID_LENGTHS: Final = 41  # lengths that are tried first
EVALUATIONS: Final = GRID_LENGTHS + 25  # lengths tried altogether, about
MIN_FORCE_RATIO: Final = 0.05  # It takes the force for no less than this share of the nominal one.


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


@dataclass(frozen=True)
class Learned:
    """What the thrust at rest tells: the friction, and the constant force `offset` [N] beside it."""

    friction: Friction
    offset: float


def learn(nominal: Friction, path: ArrayLike, rests: ArrayLike, hold: ArrayLike, *, length: bool = True) -> Learned:
    """`nominal` with the force and length, and the constant force, that explain the thrust `hold` (k,) [N] at rest.

    path (n,) [m]: the way that the table was led from the wipe's begin on; rests (k,): the samples of it at which the
    table rested, none before the end of the wipe's first stroke, so that the state in which the path begins has no
    influence. At rest the thrust is the friction's force and a constant one, so the controller knows their sum without
    a sensor. Force and constant are linear; the length is searched for, as slip makes its sum of squares bumpy.
    length: whether it is learned; the rests of the wipe alone do not tell it.
    """
    points = np.asarray(path, float)
    moves = np.diff(points, prepend=np.nan) != 0  # where the path rests the elements do, too
    at, thrust = np.cumsum(moves)[np.asarray(rests, int)] - 1, np.asarray(hold, float)

    def held(error: float) -> tuple[float, float, float]:
        """Least sum of squares [N^2] with this error of the length, and the factor of the force and constant [N]."""
        force = follow(varied_friction(nominal, Variation(friction_length=error)), points[moves])[0][at]
        varies, about = force - force.mean(), thrust - thrust.mean()
        factor = max(float(varies @ about) / max(float(varies @ varies), 1e-300), MIN_FORCE_RATIO)
        return float(np.sum((about - factor * varies) ** 2)), factor, float(np.mean(thrust - factor * force))

    error = _best_length(lambda tried: held(tried)[0]) if length else 0.0
    _, factor, offset = held(error)
    return Learned(varied_friction(nominal, Variation(friction_force=factor - 1, friction_length=error)), offset)


def _best_length(missed: Callable[[float], float]) -> float:
    """The relative error of the length [1] with the least sum of squares: the best of a grid, then between its
    neighbours."""
    grid = np.geomspace(*LENGTHS, GRID_LENGTHS) - 1
    best = int(np.argmin([missed(float(error)) for error in grid]))
    around = (grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)])
    return float(scipy.optimize.minimize_scalar(missed, bounds=around, method="bounded").x)
