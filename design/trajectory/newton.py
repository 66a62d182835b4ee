"""The robust problem with all that follows from its decisions solved out, and Newton's method for a warm solve.

It stands beside IPOPT's warm start because a trajectory is solved anew each time its histories change: for five
histories it takes 0.2 to 0.3 s of one processor where IPOPT's warm start takes 1.5 to 1.6 s, for the same objective to
1e-7 (`tests.benchmark.optimal_control` times it). Threads of the linear algebra only slow it down on a busy machine.

Decisions v: the net thrust n, what is known of the friction g, and the largest error w, each in its unit. Of the rest
only the friction is not linear in them: for history h, with f_h the friction less that at the start,

    m_h = A v + a + R f_h,   f_h = K' z_h,   z_h[k] = clip(z_h[k-1] + m_h[k] - m_h[k-1]),   y_h = Y v + b + F f_h

so that first and second derivatives of y, which is u_h over its unit and e_h over the stroke, take a sweep over the
samples. A warm solve begins from the conditions that hold with equality at a solution nearby: Newton's method on them,
each step without the one whose multiplier has the wrong sign and with those that are missed. Where the curvature along
the conditions is negative its sign is turned, so that a step goes down. What it returns is a minimum for certain: all
conditions hold within HOLDS, every multiplier has its sign, the curvature is positive.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, cast

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.trajectory.lifted import lift
from design.trajectory.scenarios import Feedback, Scenario
from models.smooth_friction import tangent

Array = NDArray[np.float64]

TOLERANCE: Final = 1e-8  # A step below this share of each decision's unit ends Newton's method.
HOLDS: Final = 1e-5  # A condition with less slack than this, in its unit, may hold with equality.
MAX_NEWTON_STEPS: Final = 60  # Newton's method takes at most so many steps before it is left to IPOPT.
# A step longer than this share of a decision's unit is shortened, and drops no condition.
MAX_RELATIVE_STEP: Final = 0.3
FLAT: Final = 1e-7  # A step divides by no smaller curvature than this.
LOST: Final = 1e4  # A larger multiplier, in units of the objective over the condition's, says that nothing is near.


@dataclass(frozen=True)
class Decisions:
    """What v (V,) means, each a matrix on it: rest (E, V) and its goal (E,), u_ff [N] and x_T* [m] (n, V) less
    `reference` (n,) [m]; `weight` (V, V): objective = v[-1] + v' weight v / 2. w in units of `unit` of the stroke.
    """

    rest: Array
    goal: Array
    thrust: Array
    position: Array
    reference: Array
    weight: Array
    unit: float


@dataclass(frozen=True)
class Histories:
    """Where the solution is asked: starts (H, N) [m], smoothing ratio [1], bound of |u| [N]."""

    starts: Array
    ratio: float
    thrust: float


@dataclass(frozen=True)
class Condensed:
    """The matrices of the module's equations, stacked over the histories; `bound` (rows, V): d limit / d v."""

    decisions: Decisions
    stiffness: Array
    limit: Array
    a: Array
    offset: Array
    r: Array
    y: Array
    b: Array
    f: Array
    bound: Array
    thrust_unit: float


@dataclass(frozen=True)
class Point:
    """v (V,), which conditions hold with equality (2, H, rows) and their multipliers, 0 for others."""

    v: Array
    holds: NDArray[np.bool_]
    multipliers: Array


def condense(
    scenarios: Sequence[Scenario], feedback: Feedback, decisions: Decisions, stroke: float, thrust_unit: float
) -> Condensed:
    """The matrices for histories of one number of elements; stroke [m], thrust_unit [N]."""
    n, rows = feedback.last, slice(feedback.first, feedback.last)
    given = np.vstack([decisions.thrust, decisions.position])
    constant = np.concatenate([np.zeros(n), decisions.reference])
    parts = []
    for one in scenarios:
        lifted = lift(one.plant, feedback.sample_time, n, feedback.pid, feedback.reference_delay)
        output = np.vstack([lifted.command / thrust_unit, lifted.position[rows] / stroke])
        parts.append((lifted.middle, output))
    middle, output = (np.array(part) for part in zip(*parts, strict=True))
    known = output[:, :, : 2 * n] @ constant
    known[:, n:] -= 1.0
    bound = np.zeros((output.shape[1], given.shape[1]))
    bound[n:, -1] = decisions.unit
    return Condensed(
        decisions,
        np.array([one.friction.stiffness for one in scenarios]),
        np.array([one.friction.limit for one in scenarios]),
        middle[:, :, : 2 * n] @ given,
        middle[:, :, : 2 * n] @ constant,
        middle[:, :, 2 * n :],
        output[:, :, : 2 * n] @ given,
        known,
        output[:, :, 2 * n :],
        bound,
        thrust_unit,
    )


@dataclass(frozen=True)
class _Sweep:
    """y less its limit, by sign (2, H, rows); slope (n, H, N) and curvature [1/m] of each clip along the way."""

    excess: Array
    output: Array
    slope: Array
    curvature: Array


def _sweep(problem: Condensed, v: Array, at: Histories) -> _Sweep:
    """What the loops do under v."""
    histories, count = problem.limit.shape
    known = problem.a @ v + problem.offset
    n = known.shape[1]
    held = np.sum(problem.stiffness * at.starts, axis=1)
    force, middle, state = np.zeros((histories, n)), np.zeros(histories), at.starts
    slope, curvature = np.zeros((2, n, histories, count))
    unclipped, parts = np.zeros((histories, count)), np.zeros((3, histories, count))
    clip = _in_place(tangent(histories * count), (unclipped, np.array([at.ratio]), problem.limit), list(parts))
    for k in range(n):
        before, middle = middle, known[:, k] + (problem.r[:, k : k + 1, :k] @ force[:, :k, None])[:, 0, 0]
        unclipped[:] = state + (middle - before)[:, None]
        clip()
        state, slope[k], curvature[k] = parts.copy()
        force[:, k] = np.sum(problem.stiffness * state, axis=1) - held
    output = problem.y @ v + problem.b + np.einsum("hrk,hk->hr", problem.f, force)
    output[:, :n] += held[:, None] / problem.thrust_unit
    limit = problem.bound @ v
    limit[:n] += at.thrust / problem.thrust_unit
    return _Sweep(np.array([output, -output]) - limit, output, slope, curvature)


def _in_place(function: ca.Function, arguments: Sequence[Array], results: Sequence[Array]) -> Callable[[], None]:
    """`function` as a call that reads and writes these arrays: a sweep calls it at every sample."""
    buffer, call = cast(Any, function).buffer()
    kept = tuple(np.ascontiguousarray(argument) for argument in arguments)
    for i, argument in enumerate(kept):
        buffer.set_arg(i, argument.data)
    for i, result in enumerate(results):
        buffer.set_res(i, result.data)

    def run(_kept: object = (buffer, kept)) -> None:  # the arrays live as long as what reads them
        call()

    return run


@dataclass(frozen=True)
class _Derivatives:
    """Of the motion: d m / d v (H, n, V), d f / d m (H, n, n), d f / d v (H, n, V), d y_k / d m (n, H, N, n)."""

    middle: Array
    reaction: Array
    force: Array
    unclipped: Array


def _derivatives(problem: Condensed, sweep: _Sweep) -> _Derivatives:
    n, histories, count = sweep.slope.shape
    unclipped, row = np.zeros((n, histories, count, n)), np.zeros((histories, count, n))
    reaction = np.zeros((histories, n, n))
    for k in range(n):
        unclipped[k], unclipped[k, :, :, k] = row, 1.0
        row = unclipped[k] * sweep.slope[k, :, :, None]
        reaction[:, k] = np.einsum("hi,hij->hj", problem.stiffness, row)
    difference = np.eye(n) - np.eye(n, k=-1)
    reaction = reaction @ difference
    middle = np.asarray(np.linalg.solve(np.eye(n) - problem.r @ reaction, problem.a), float)
    return _Derivatives(middle, reaction, reaction @ middle, unclipped)


def _gradients(problem: Condensed, derivatives: _Derivatives, holds: NDArray[np.bool_]) -> Array:
    """Rows (held, V): derivatives of y less its limit, for those conditions that hold."""
    sign, h, r = np.nonzero(holds)
    rows = problem.y[h, r] + np.einsum("ij,ijv->iv", problem.f[h, r], derivatives.force[h])
    return np.asarray((1 - 2 * sign)[:, None] * rows - problem.bound[r], float)


def _hessian(problem: Condensed, sweep: _Sweep, derivatives: _Derivatives, multipliers: Array) -> Array:
    """Of the Lagrangian (V, V): the objective's weight, and each clip's curvature by what its force is worth."""
    n, histories, count = sweep.slope.shape
    worth = np.einsum("hr,hrk->hk", multipliers[0] - multipliers[1], problem.f)
    loop = np.transpose(np.eye(n) - derivatives.reaction @ problem.r, (0, 2, 1))
    worth = np.linalg.solve(loop, worth[:, :, None])[:, :, 0]
    hessian, after = problem.decisions.weight.copy(), np.zeros((histories, count))
    share = np.zeros((n, histories, count))
    for k in reversed(range(n)):
        share[k] = problem.stiffness * worth[:, k, None] + after
        after = share[k] * sweep.slope[k]
    share *= sweep.curvature
    difference = np.eye(n) - np.eye(n, k=-1)
    for h in range(histories):
        near = share[:, h] != 0
        along = derivatives.unclipped[:, h][near] @ (difference @ derivatives.middle[h])
        hessian += (along * share[:, h][near][:, None]).T @ along
    return hessian


def outcome(problem: Condensed, v: Array, at: Histories) -> tuple[float, Array, float]:
    """(objective, errors (H, window) over the stroke [1], largest missed condition in its unit [1]) at v (V,)."""
    sweep = _sweep(problem, v, at)
    missed = np.abs(problem.decisions.rest @ v - problem.decisions.goal)
    objective = v[-1] + v @ problem.decisions.weight @ v / 2
    violation = max(float(np.max(sweep.excess)), float(np.max(missed)))
    return float(objective), sweep.output[:, problem.a.shape[1] :], violation


def at_solution(problem: Condensed, v: Array, at: Histories) -> Point | None:
    """The point of a solution v (V,) [1], whose multipliers explain the objective's gradient; None if it is not one."""
    sweep = _sweep(problem, v, at)
    holds = sweep.excess > -HOLDS
    for _ in range(int(holds.sum())):
        gradients = _gradients(problem, _derivatives(problem, sweep), holds)
        rows = np.vstack([problem.decisions.rest, gradients])
        every = np.linalg.lstsq(rows.T, -_slope(problem, v), rcond=None)[0]
        worth = np.asarray(every[len(problem.decisions.rest) :], float)
        if np.min(worth, initial=0.0) >= 0:
            multipliers = np.zeros(holds.shape)
            multipliers[holds] = worth
            return Point(v, holds, multipliers)
        holds = _without(holds, worth)
    return None


def solve_near(problem: Condensed, point: Point, at: Histories) -> tuple[Point | None, int]:
    """The solution at `at` found from that at other histories, None if there is none near; and Newton's steps."""
    v, holds, multipliers = point.v, point.holds, point.multipliers
    rest, goal = problem.decisions.rest, problem.decisions.goal
    for count in range(1, MAX_NEWTON_STEPS + 1):
        sweep = _sweep(problem, v, at)
        holds = holds | (sweep.excess > HOLDS)
        derivatives = _derivatives(problem, sweep)
        rows = np.vstack([rest, _gradients(problem, derivatives, holds)])
        if len(rows) > v.size:
            return None, count
        missed = np.concatenate([rest @ v - goal, sweep.excess[holds]])
        hessian = _hessian(problem, sweep, derivatives, np.where(holds, multipliers, 0.0))
        step, worth, minimum = _step(hessian, _slope(problem, v), rows, missed)
        size, worth = float(np.max(np.abs(step))), worth[len(rest) :]
        if np.max(np.abs(worth), initial=0.0) > LOST:
            return None, count
        v = v + min(1.0, MAX_RELATIVE_STEP / size) * step
        multipliers = np.zeros(holds.shape)
        multipliers[holds] = worth
        if np.min(worth, initial=0.0) < 0:
            holds = _without(holds, worth) if size < MAX_RELATIVE_STEP else holds
        elif size < TOLERANCE and minimum:
            return Point(v, holds, multipliers), count
    return None, MAX_NEWTON_STEPS


def _step(hessian: Array, slope: Array, rows: Array, missed: Array) -> tuple[Array, Array, bool]:
    """(step (V,), multipliers, whether it is a minimum's) of the quadratic program with equalities alone.

    Across the rows it meets them; along them it goes down, whatever the curvature's sign.
    """
    count = len(rows)
    whole, upper = np.linalg.qr(rows.T, mode="complete")
    across, along = whole[:, :count], whole[:, count:]
    back = -across @ np.linalg.lstsq(upper[:count].T, missed, rcond=None)[0]
    curvature, axes = np.linalg.eigh(along.T @ hessian @ along)
    down = axes.T @ (along.T @ (slope + hessian @ back))
    step = back - along @ (axes @ (down / np.maximum(np.abs(curvature), FLAT)))
    worth = -np.linalg.lstsq(upper[:count], across.T @ (slope + hessian @ step), rcond=None)[0]
    return step, np.asarray(worth, float), bool(np.min(curvature, initial=np.inf) > 0)


def _slope(problem: Condensed, v: Array) -> Array:
    """The objective's gradient (V,)."""
    slope = problem.decisions.weight @ v
    slope[-1] += 1.0
    return slope


def _without(holds: NDArray[np.bool_], worth: Array) -> NDArray[np.bool_]:
    """The conditions that hold less the one whose multiplier is the most wrong."""
    left = holds.copy()
    left[tuple(index[np.argmin(worth)] for index in np.nonzero(holds))] = False
    return left
