"""One trajectory and one thrust for every history: what the friction does differently is left to the feedback.

    minimise J   subject to   n brings the linear plant to rest on the target, x_T* = P n, u_ff = n + g,
                              for every history h:  x_h, u_h = the loop around u_ff, x_T*, f_h,   |u_h| <= limit,
                              z_h[k] = clip(z_h[k-1] + m_h[k] - m_h[k-1]),   e_h = x_h - target

g (N + 1,): what is known of the friction without its history; its last is held after the motion. x_T* and u_ff are
linear filters of the target, so the design is a Controller's n_ff and d_ff. The first solution is IPOPT's; a warm one
is found by Newton's method (newton.py), and by IPOPT again only where that finds none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal, get_args

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from design.deadbeat import DesignError
from design.trajectory.history_aware import (
    CONTINUATION,
    Limits,
    Task,
    require_rest,
    rest_conditions,
    thrust_unit,
)
from design.trajectory.lifted import Lifted, feedforward_only
from design.trajectory.newton import Condensed, Decisions, Histories, at_solution, condense, outcome, solve_near
from design.trajectory.nlp import Program, Solution, Solver
from design.trajectory.scenarios import Feedback, Scenario, error_of, follow_loop, guess_loop
from models.controller import PID, Controller
from models.plant import Plant

Array = NDArray[np.float64]
Objective = Literal["worst_error", "dispersion"]
"""What is least after the settling time: the largest error over every history, or the sum over them of its squares."""

WORST: Final = 0.1  # The largest error is measured in this share of a stroke, which makes it of order 1.
BESIDE_ERROR: Final = (
    1e-4  # Weight of the squared differences of thrust and assistance, which the error leaves undetermined.
)


@dataclass(frozen=True)
class RobustTask:
    """What is asked, fixed when the problem is built: a motion of `samples` samples [s] over `stroke` [m].

    plant: the design's own; scenarios: the histories (and tables) that the one motion serves; feedback: the loop, and
    which errors count.
    """

    plant: Plant
    scenarios: tuple[Scenario, ...]
    feedback: Feedback
    sample_time: float
    samples: int
    stroke: float
    objective: Objective = "worst_error"


@dataclass(frozen=True)
class RobustTrajectory:
    """thrust (N + 1,) [N]: u_ff, the last held; position (N + 1,) [m]: x_T*; error (scenarios, window) [m].

    starts: the scenarios' element states (N,) [m]; ratio [1] and limits: what else it was solved for.
    """

    task: RobustTask
    thrust: Array
    position: Array
    error: Array
    ratio: float
    solution: Solution
    starts: tuple[Array, ...]
    limits: Limits

    def controller(self, sample_time: float, pid: PID, reference_delay: int) -> Controller:
        """The 2DoF law whose N_ff [m/m] and D_ff [N/m] give this motion; sample time [s]."""
        n_ff, d_ff = (np.diff(signal, prepend=0.0) / self.task.stroke for signal in (self.position, self.thrust))
        return Controller(sample_time, pid, reference_delay, tuple(n_ff.tolist()), tuple(d_ff.tolist()))


@dataclass(frozen=True)
class RobustProblem:
    """A task's problem, built once; condensed: the same for a warm solve, None where there is none."""

    task: RobustTask
    lifted: Lifted
    solver: Solver
    condensed: Condensed | None


def build_robust(task: RobustTask) -> RobustProblem:
    """The problem of `task`. Raises DesignError for a task that means nothing."""
    if task.objective not in get_args(Objective):
        raise DesignError(f"objective {task.objective!r} is unknown; choose one of {', '.join(get_args(Objective))}")
    n, last, program = task.samples, task.feedback.last, Program()
    if last <= n or not task.scenarios:
        raise DesignError(
            f"the error counts up to sample {last} of a motion of {n}; look further, at one scenario or more"
        )
    plain = Task(task.plant, None, task.sample_time, n, task.stroke)
    unit = thrust_unit(plain)
    lifted = feedforward_only(task.plant, task.sample_time, n)
    net = program.variable("net", np.full(n, unit))
    assist = program.variable("assist", np.full(n + 1, unit))
    require_rest(program, plain, lifted, net)
    thrust = ca.vertcat(net, 0) + assist
    position = ca.vertcat(0, lifted.on_thrust(lifted.position)[1:] @ net)
    largest, slew, ratio = (program.parameter(name) for name in ("largest", "slew", "ratio"))
    feedforward = ca.vertcat(thrust, ca.repmat(thrust[n], last - n - 1, 1))
    reference = ca.vertcat(position, np.full(last - n - 1, task.stroke))
    program.subject_to(ca.diff(ca.vertcat(0, thrust)), -slew, slew, unit)
    worst = program.variable("worst", WORST * task.stroke, lower=0)
    for i, scenario in enumerate(task.scenarios):
        error, command = follow_loop(
            program, str(i), scenario, task.feedback, task.stroke, feedforward, reference, ratio
        )
        program.subject_to(command, -largest, largest, unit)
        if task.objective == "worst_error":
            program.subject_to(ca.vertcat(worst - error, worst + error), 0, np.inf, task.stroke)
        else:
            share = scenario.weight / (error.shape[0] * len(task.scenarios))
            program.minimise(share * 100 * ca.sumsqr(error / task.stroke))
    program.minimise(worst / (WORST * task.stroke))
    for part in (ca.vertcat(net, 0), assist):
        program.minimise(BESIDE_ERROR * ca.sumsqr(ca.diff(ca.vertcat(0, part))) / unit**2)
    return RobustProblem(task, lifted, program.build(), _condensed(task, plain, lifted))


def _condensed(task: RobustTask, plain: Task, lifted: Lifted) -> Condensed | None:
    """The problem of the least largest error for a warm solve; None for other objectives and uneven scenarios."""
    if task.objective != "worst_error" or len({len(one.friction.limit) for one in task.scenarios}) > 1:
        return None
    n, unit, count = task.samples, thrust_unit(plain), 2 * task.samples + 2
    identity, after = np.eye(count), task.feedback.last - task.samples - 1
    net, assist = np.vstack([identity[:n], np.zeros(count)]), identity[n : 2 * n + 1]
    rows, aim = rest_conditions(plain, lifted)
    position = lifted.on_thrust(lifted.position) @ net[:n] * unit
    weight = np.zeros((count, count))
    for part in (net, assist):
        rough = np.diff(part, axis=0, prepend=0.0)
        weight += 2 * BESIDE_ERROR * rough.T @ rough
    decisions = Decisions(
        rest=rows @ net[:n],
        goal=aim / unit,
        thrust=unit * np.vstack([net + assist, np.repeat((net + assist)[-1:], after, axis=0)]),
        position=np.vstack([position, np.zeros((after, count))]),
        reference=np.append(np.zeros(n + 1), np.full(after, task.stroke)),
        weight=weight,
        unit=WORST,
    )
    return condense(task.scenarios, task.feedback, decisions, task.stroke, unit)


def solve_robust(
    built: RobustProblem,
    starts: Sequence[ArrayLike],
    begin: ArrayLike | RobustTrajectory,
    limits: Limits | None = None,
    *,
    ratios: Sequence[float] = CONTINUATION,
) -> RobustTrajectory:
    """The best motion for scenarios that start from element states `starts` ((N,) [m] each).

    begin: net thrust (N,) [N] of another design, or a trajectory to go on from, warm, at the last of the smoothing
    `ratios` [1]. One that did not converge comes back as it is: see `RobustTrajectory.solution`.
    """
    states, bounds = tuple(np.asarray(state, float) for state in starts), limits or Limits()
    point: Solution | dict[str, Array]
    if isinstance(begin, RobustTrajectory):
        near = _near(built, begin, states, bounds, ratios[-1])
        if near is not None:
            return near
        point, ratios = _whole(built, begin), ratios[-1:]
    else:
        point = _guess(built, states, np.asarray(begin, float), np.zeros(built.task.samples + 1))
    given: dict[str, ArrayLike] = {f"start_{i}": state for i, state in enumerate(states)}
    given |= {"largest": bounds.thrust, "slew": bounds.slew}
    for ratio in ratios:
        point = built.solver.solve({**given, "ratio": ratio}, point)
    assert isinstance(point, Solution)
    task, values = built.task, point.values
    error = np.array([error_of(values, str(i), task.feedback, task.stroke) for i in range(len(task.scenarios))])
    return _trajectory(built, point, error, ratios[-1], states, bounds)


def _near(
    built: RobustProblem, begin: RobustTrajectory, states: tuple[Array, ...], limits: Limits, ratio: float
) -> RobustTrajectory | None:
    """The solution near `begin` at other histories; None where there is none, or the problem has no condensed form."""
    problem, last = built.condensed, begin.solution
    if (
        problem is None
        or not last.converged
        or begin.ratio != ratio
        or np.isfinite(min(limits.slew, begin.limits.slew))
    ):
        return None
    unit, stroke = problem.thrust_unit, built.task.stroke
    values = last.values
    v = np.concatenate([values["net"] / unit, values["assist"] / unit, values["worst"] / (WORST * stroke)])
    old = Histories(np.array(begin.starts), ratio, begin.limits.thrust)
    new = Histories(np.array(states), ratio, limits.thrust)
    point, steps = at_solution(problem, v, old), 0
    if point is not None:
        point, steps = solve_near(problem, point, new)
    if point is None:
        return None
    v, n = point.v, built.task.samples
    objective, error, violation = outcome(problem, v, new)
    named = {"net": unit * v[:n], "assist": unit * v[n:-1], "worst": WORST * stroke * v[-1:]}
    solution = Solution(named, objective, True, "Solved_By_Newton", steps, violation, last.multipliers)
    return _trajectory(built, solution, stroke * error, ratio, states, limits)


def _whole(built: RobustProblem, begin: RobustTrajectory) -> Solution:
    """The solution of `begin` with all variables of the program, of which Newton's method gives the decisions."""
    values = begin.solution.values
    guess = _guess(built, begin.starts, values["net"], values["assist"])
    return replace(begin.solution, values={**guess, **values})


def _trajectory(
    built: RobustProblem, point: Solution, error: Array, ratio: float, starts: tuple[Array, ...], limits: Limits
) -> RobustTrajectory:
    net, assist = point.values["net"], point.values["assist"]
    position = built.lifted.on_thrust(built.lifted.position) @ net
    return RobustTrajectory(built.task, np.append(net, 0.0) + assist, position, error, ratio, point, starts, limits)


def _guess(built: RobustProblem, states: Sequence[Array], net: Array, assist: Array) -> dict[str, Array]:
    """Values of all variables where the exact elements go under net thrust (N,) and assist (N + 1,) [N]."""
    task = built.task
    extra = task.feedback.last - task.samples
    position = built.lifted.on_thrust(built.lifted.position) @ net
    thrust = np.append(net, 0.0) + assist
    feedforward = np.append(thrust, np.full(extra - 1, thrust[-1]))
    reference = np.append(position, np.full(extra - 1, task.stroke))
    guess = {"net": net, "assist": assist}
    for i, (scenario, start) in enumerate(zip(task.scenarios, states, strict=True)):
        guess |= guess_loop(str(i), scenario, task.feedback, start, feedforward, reference)
    errors = [error_of(guess, str(i), task.feedback, task.stroke) for i in range(len(states))]
    worst = float(np.max(np.abs(errors)))
    return {**guess, "worst": np.array([worst])}
