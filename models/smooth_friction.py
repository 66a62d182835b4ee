"""The rolling friction of friction.py, smoothed for optimisation: the same parameters, as a CasADi expression.

The exact stop element over a displacement d is z+ = clip(z + d, -X, X). Here the two corners of the clip are rounded
within a length w = ratio X of the limit, by a quartic that joins with two continuous derivatives:

    z+ = y - E(y) + E(-y),  y = z + d,  E(y) = max(y - X + w, 0) - 2 w (s - s^3 + s^4 / 2),  s = (y - X + w) / 2 w

with s limited to 0 .. 1. An element further than w from its limit is exact. As the clip moves no two states apart, and
the rounding moves none out of the last w, |z+ - z+ exact| <= w over any path and any number of steps, so that

    |f smoothed - f exact| <= ratio T_fc.

An element at rest within w of its limit creeps back from it, by less than w in all.
"""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.friction import Friction

Array = NDArray[np.float64]


@cache
def law(count: int) -> ca.Function:
    """CasADi function (state (N,), moved, ratio, stiffness (N,), limit (N,)) -> (next state (N,), force), N = count.

    moved [m]: displacement since `state`; ratio [1]: smoothing width over the limit, above 0 and at most 1. SI units.
    """
    state, moved, ratio = ca.SX.sym("state", count), ca.SX.sym("moved"), ca.SX.sym("ratio")
    stiffness, limit = ca.SX.sym("stiffness", count), ca.SX.sym("limit", count)
    after = rounded_clip(state + moved, limit, ratio * limit)
    names = ["state", "moved", "ratio", "stiffness", "limit"]
    inputs = [state, moved, ratio, stiffness, limit]
    return ca.Function("stop_elements", inputs, [after, ca.dot(stiffness, after)], names, ["next", "force"])


@cache
def tangent(count: int) -> ca.Function:
    """CasADi function (unclipped (N,) [m], ratio [1], limit (N,) [m]) -> (clipped [m], slope [1], curvature [1/m])."""
    y, ratio, limit = ca.SX.sym("unclipped", count), ca.SX.sym("ratio"), ca.SX.sym("limit", count)
    ones = ca.SX.ones(count)
    clipped = rounded_clip(y, limit, ratio * limit)
    slope = ca.jtimes(clipped, y, ones)  # each clip knows its own argument only
    return ca.Function("clip", [y, ratio, limit], [clipped, slope, ca.jtimes(slope, y, ones)])


def rounded_clip(y: ca.SX, limit: ca.SX, width: ca.SX) -> ca.SX:
    """clip(y, -limit, limit) with corners rounded within `width` of the limit; any shape, SI units."""
    return y - _excess(y, limit, width) + _excess(-y, limit, width)


def follow_smoothed(friction: Friction, path: ArrayLike, ratio: float, state: ArrayLike | None = None) -> Array:
    """Force (n,) [N] of the smoothed law at each point of the displacement `path` (n,) [m]; see `friction.follow`.

    ratio [1]: smoothing width over each element's limit. `state` is z (N,) [m] at the path's first point.
    """
    points = np.asarray(path, float)
    count = len(friction.limit)
    start = np.zeros(count) if state is None else np.asarray(state, float)
    steps = law(count).mapaccum(points.size)
    moved = np.diff(points, prepend=points[0])[None, :]
    constants = [
        np.tile(np.asarray(each, float)[:, None], points.size) for each in (friction.stiffness, friction.limit)
    ]
    _, force = steps(start, moved, np.full((1, points.size), ratio), *constants)
    return np.asarray(force, float).ravel()


def _excess(y: ca.SX, limit: ca.SX, width: ca.SX) -> ca.SX:
    """What the rounded clip takes off y at the upper corner."""
    over = ca.fmax(y - limit + width, 0)
    s = ca.fmin(over / (2 * width), 1)
    return over - 2 * width * (s - s**3 + s**4 / 2)
