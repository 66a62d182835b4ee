"""From a hysteresis curve alone, measured or published, to the elements of eqs. (3)-(8); from a whole record: force/.

Two stages. Convex: on a fine grid of limits the force is linear in the stiffnesses, so that non-negative least squares
finds the best distribution of them, whose neighbours are joined until N are left. Then a CasADi NLP sets the limits
free. Symbols as in models.friction; n points of the curve.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca
import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from models.friction import Friction, deflections, elements
from models.identification.solving import interruptible

Array = NDArray[np.float64]
GRID_LIMITS = 80  # limits of the convex stage
CURVE_POINTS = 300  # of the curve that the NLP looks at; between its points a path has only to be monotone


@dataclass(frozen=True)
class Identified:
    """Elements with the standard deviation of each parameter, (N,) [N/m], [m], [N s/m], and the curve's rms error [N].

    first: the point of the curve from which on it was fitted. The deviations are those of independent errors of the
    force, of the size that the fit leaves; infinite for a parameter on which the curve does not depend.
    """

    friction: Friction
    stiffness_std: Array
    limit_std: Array
    damping_std: Array
    rms_error: float
    first: int


def identify(path: ArrayLike, force: ArrayLike, count: int, *, velocity: ArrayLike | None = None) -> Identified:
    """N = count elements whose friction follows force (n,) [N] along the displacement path (n,) [m].

    The curve is fitted from its first extreme on: there every element has the state that the path gave it, whatever its
    state was at the first point. With velocity (n,) [m/s] the damping D_i is identified too, else it is 0.
    Raises ValueError for a curve that can't show friction.
    """
    x, f = _checked(path, force)
    first = _first_extreme(x)
    # Up to the first extreme the path is replaced by one that saturates whatever this curve can saturate.
    span = float(np.ptp(x))
    approach = x[first] - np.sign(x[first] - np.mean(x)) * span
    x, f = np.concatenate([[approach], x[first:]]), np.concatenate([[0.0], f[first:]])
    v = np.zeros(x.size) if velocity is None else np.concatenate([[0.0], np.asarray(velocity, float)[first:]])
    start = _convex(x, f, count)
    return _refined(x, f, v, start, first, damped=velocity is not None)


def branch_of_facts(
    coulomb_force: float, stiffness_1: float, stiffness_2: float, boundary: float, points: int = 200
) -> tuple[Array, Array]:
    """(path [m], force [N]): full slip, then the branch behind a reversal that the published facts of Fig. 3b describe.

    Slope stiffness_1 [N/m] up to `boundary` [m], then stiffness_2 [N/m] until 2 T_fc are climbed, level from there on.
    """
    corner = stiffness_1 * boundary
    end = boundary + (2 * coulomb_force - corner) / stiffness_2
    distance = np.linspace(0, 1.3 * end, points)
    climbed = np.interp(distance, [0, boundary, end], [0, corner, 2 * coulomb_force])
    return np.concatenate([[-end], distance - 2 * end]), np.concatenate([[0.0], climbed - coulomb_force])


def prediction_error(friction: Friction, path: ArrayLike, force: ArrayLike) -> float:
    """Rms difference [N] of a friction to a curve, path (n,) [m] and force (n,) [N], from its first extreme on."""
    x, f = _checked(path, force)
    first = _first_extreme(x)
    approach = x[first] - np.sign(x[first] - np.mean(x)) * float(np.ptp(x))
    z = deflections(friction.limit, np.concatenate([[approach], x[first:]]))[1:]
    return float(np.sqrt(np.mean((z @ np.asarray(friction.stiffness) - f[first:]) ** 2)))


def _checked(path: ArrayLike, force: ArrayLike) -> tuple[Array, Array]:
    x, f = np.asarray(path, float), np.asarray(force, float)
    if x.shape != f.shape or x.ndim != 1 or x.size < 8:
        raise ValueError("a hysteresis curve needs as many displacements as forces, eight at least")
    if not (np.all(np.isfinite(x)) and np.all(np.isfinite(f))):
        raise ValueError("the hysteresis curve has values that are not finite; leave those points out")
    if np.ptp(x) == 0 or np.ptp(f) == 0:
        raise ValueError("displacement or force is constant: this curve shows no friction; record a loop")
    return x, f


def _first_extreme(path: Array) -> int:
    """The first point at which the path is farthest from its middle, to within a hundredth of its span."""
    away = np.abs(path - 0.5 * (np.max(path) + np.min(path)))
    return int(np.argmax(away >= np.max(away) - 0.01 * np.ptp(path)))


def _convex(path: Array, force: Array, count: int) -> tuple[Array, Array]:
    """(stiffness, limit) (N,): the best distribution of stiffness over a grid of limits, brought down to N elements."""
    steps = np.abs(np.diff(path[1:]))
    smallest = max(float(np.median(steps[steps > 0])), float(np.ptp(path[1:])) / 2000)
    grid = np.geomspace(0.5 * smallest, float(np.ptp(path[1:])) / 2, GRID_LIMITS)
    stiffness, _ = scipy.optimize.nnls(deflections(grid, path)[1:], force[1:])
    used = stiffness > 1e-9 * np.max(stiffness, initial=0.0)
    if not np.any(stiffness > 0):
        raise ValueError("the force does not rise with the displacement; check the signs of the two")
    k, x = stiffness[used], grid[used]
    while k.size > count:  # join the neighbours whose difference matters least: Ward's rule on the logarithm of X
        share = k * x
        cost = share[1:] * share[:-1] / (share[1:] + share[:-1]) * np.diff(np.log(x)) ** 2
        i = int(np.argmin(cost))
        k, x = _joined(k, x, i)
    while k.size < count:  # more elements than the grid needed: the strongest is halved
        i = int(np.argmax(k * x))
        k = np.concatenate([k[:i], [0.5 * k[i], 0.5 * k[i]], k[i + 1 :]])
        x = np.concatenate([x[:i], [0.9 * x[i], 1.1 * x[i]], x[i + 1 :]])
    return k, x


def _joined(stiffness: Array, limit: Array, i: int) -> tuple[Array, Array]:
    """Elements i and i + 1 as one that has their stiffness and their slip force."""
    k = stiffness[i] + stiffness[i + 1]
    x = (stiffness[i] * limit[i] + stiffness[i + 1] * limit[i + 1]) / k
    return np.concatenate([stiffness[:i], [k], stiffness[i + 2 :]]), np.concatenate([limit[:i], [x], limit[i + 2 :]])


def _refined(
    path: Array, force: Array, velocity: Array, start: tuple[Array, Array], first: int, *, damped: bool
) -> Identified:
    """The NLP over log K, log X and, if damped, D; scaled by what the convex stage found."""
    count = start[0].size
    keep = np.unique(
        np.concatenate([[0], np.round(np.linspace(1, path.size - 1, CURVE_POINTS)), _turns(path)]).astype(int)
    )
    x, f, v = path[keep], force[keep], velocity[keep]
    scale = np.max(np.abs(f))
    speed = max(float(np.max(np.abs(v))), 1e-12)
    model = _model(count, keep.size - 1)
    theta = ca.MX.sym("theta", 3 * count)
    reference = ca.DM(np.concatenate([start[0], start[1], np.full(count, scale / speed)]))
    values = ca.vertcat(ca.exp(theta[: 2 * count]), theta[2 * count :]) * reference
    residual = (model(values, np.diff(x)[None], v[None, 1:]).T - f[1:]) / scale
    problem = {"x": theta, "f": ca.sumsqr(residual)}
    options: dict[str, Any] = {
        "ipopt": {
            "hessian_approximation": "limited-memory",
            "print_level": 0,
            "sb": "yes",
            "max_iter": 200,
            "tol": 1e-9,
        },
        "print_time": False,
    }
    top = 1.0 if damped else 0.0
    with interruptible():
        solution = ca.nlpsol("elements", "ipopt", problem, options)(
            x0=ca.DM.zeros(3 * count),
            lbx=ca.DM(np.concatenate([np.full(2 * count, -6.0), np.zeros(count)])),
            ubx=ca.DM(np.concatenate([np.full(2 * count, 6.0), np.full(count, top)])),
        )
    best = np.asarray(solution["x"]).ravel()
    jacobian = ca.Function("jacobian", [theta], [ca.jacobian(residual, theta), residual])
    slopes, left = (np.asarray(part) for part in jacobian(best))
    values_at = np.concatenate([np.exp(best[: 2 * count]), best[2 * count :]]) * np.asarray(reference).ravel()
    deviation = _deviations(slopes, left.ravel(), free=3 * count if damped else 2 * count)
    unit = np.concatenate([values_at[: 2 * count], np.asarray(reference).ravel()[2 * count :]])
    order = np.argsort(values_at[count : 2 * count], kind="stable")
    k, limit, d = (values_at.reshape(3, count)[row][order] for row in range(3))
    stds = (deviation * unit).reshape(3, count)[:, order]
    rms = float(np.sqrt(np.mean(left**2)) * scale)
    return Identified(elements(k, limit, d), stds[0], stds[1], stds[2], rms, first)


def _turns(path: Array) -> NDArray[np.int64]:
    """The points at which the path turns: between any two that are kept it has to be monotone."""
    direction = np.sign(np.diff(path))
    return np.asarray(np.flatnonzero(direction[1:] * direction[:-1] < 0) + 1, np.int64)


@cache
def _model(count: int, steps: int) -> ca.Function:
    """CasADi function (K, X, D stacked (3 N,), steps of x (1, n), v (1, n)) -> force (1, n), from the virgin state."""
    z, values = ca.SX.sym("z", count), ca.SX.sym("values", 3 * count)
    moved, velocity = ca.SX.sym("moved"), ca.SX.sym("velocity")
    stiffness, limit, damping = values[:count], values[count : 2 * count], values[2 * count :]
    after = ca.fmax(ca.fmin(z + moved, limit), -limit)
    slip = stiffness * limit
    force = ca.fmax(ca.fmin(stiffness * after + damping * velocity, slip), -slip)
    step = ca.Function("step", [z, values, moved, velocity], [after, ca.sum1(force)])
    rolled = step.mapaccum("rolled", steps)
    inputs = [ca.MX.sym("values", 3 * count), ca.MX.sym("moved", 1, steps), ca.MX.sym("velocity", 1, steps)]
    _, forces = rolled(ca.DM.zeros(count), ca.repmat(inputs[0], 1, steps), inputs[1], inputs[2])
    return ca.Function("curve", inputs, [forces])


def _deviations(jacobian: Array, residual: Array, free: int) -> Array:
    """Standard deviations of the parameters from the Gauss-Newton covariance; infinite where nothing depends on one."""
    used = jacobian[:, :free]
    variance = float(residual @ residual) / max(residual.size - free, 1)
    _, singular, right = np.linalg.svd(used, full_matrices=False)
    known = singular > 1e-9 * singular[0]
    deviations = np.full(jacobian.shape[1], 0.0)
    deviations[:free] = np.sqrt(variance * np.sum((right[known].T / singular[known]) ** 2, axis=1))
    unknown = np.any(np.abs(right[~known]) > 0.3, axis=0)
    deviations[:free][unknown] = np.inf
    return deviations
