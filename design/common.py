"""One trajectory and one thrust for every history: what the friction does differently is left to the feedback.

    minimise J   subject to   n brings the linear plant to rest on the target, x_T* = P n, u_ff = n + g,
                              for every history h:  x_h, u_h = the loop around u_ff, x_T*, f_h,   |u_h| <= limit,
                              z_h[k] = clip(z_h[k-1] + m_h[k] - m_h[k-1]),   e_h = x_h - target

g (N + 1,): what is known of the friction without its history; its last is held after the motion. x_T* and u_ff are
linear filters of the target, so the design is a Controller's n_ff and d_ff.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal, get_args

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from design.deadbeat import DesignError
from design.lifted import Lifted, feedforward_only
from design.ocp import Program, Solution, Solver
from design.scenarios import Feedback, Scenario, error_of, follow_loop, guess_loop
from design.trajectory import CONTINUATION, SMOOTH, Limits, Task, require_rest, thrust_unit
from models.controller import PID, Controller
from models.plant import Plant

Array = NDArray[np.float64]
Objective = Literal["worst_error", "dispersion"]

OBJECTIVES: Final[dict[Objective, str]] = {
    "worst_error": "least largest error after the settling time, over every history",
    "dispersion": "least sum over the histories of the squared errors after the settling time",
}


@dataclass(frozen=True)
class CommonTask:
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
class CommonTrajectory:
    """thrust (N + 1,) [N]: u_ff, the last held; position (N + 1,) [m]: x_T*; error (scenarios, window) [m]."""

    task: CommonTask
    thrust: Array
    position: Array
    error: Array
    ratio: float
    solution: Solution

    def controller(self, sample_time: float, pid: PID, reference_delay: int) -> Controller:
        """The 2DoF law whose N_ff [m/m] and D_ff [N/m] give this motion; sample time [s]."""
        n_ff, d_ff = (np.diff(signal, prepend=0.0) / self.task.stroke for signal in (self.position, self.thrust))
        return Controller(sample_time, pid, reference_delay, tuple(n_ff.tolist()), tuple(d_ff.tolist()))


@dataclass(frozen=True)
class BuiltCommon:
    """A task's problem, built once."""

    task: CommonTask
    lifted: Lifted
    solver: Solver


def build_common(task: CommonTask) -> BuiltCommon:
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
    program.require(ca.diff(ca.vertcat(0, thrust)), -slew, slew, unit)
    worst = program.variable("worst", 0.1 * task.stroke, lower=0)
    for i, scenario in enumerate(task.scenarios):
        error, command = follow_loop(
            program, str(i), scenario, task.feedback, task.stroke, feedforward, reference, ratio
        )
        program.require(command, -largest, largest, unit)
        if task.objective == "worst_error":
            program.require(ca.vertcat(worst - error, worst + error), 0, np.inf, task.stroke)
        else:
            share = scenario.weight / (error.shape[0] * len(task.scenarios))
            program.minimise(share * 100 * ca.sumsqr(error / task.stroke))
    program.minimise(worst / (0.1 * task.stroke))
    for part in (ca.vertcat(net, 0), assist):
        program.minimise(SMOOTH * ca.sumsqr(ca.diff(ca.vertcat(0, part))) / unit**2)
    return BuiltCommon(task, lifted, program.build())


def solve_common(
    built: BuiltCommon,
    starts: Sequence[ArrayLike],
    begin: ArrayLike | CommonTrajectory,
    limits: Limits | None = None,
    *,
    ratios: Sequence[float] = CONTINUATION,
) -> CommonTrajectory:
    """The best motion for scenarios that start from element states `starts` ((N,) [m] each).

    begin: net thrust (N,) [N] of another design, or a trajectory to go on from, warm, at the last of the smoothing
    `ratios` [1]. One that did not converge comes back as it is: see `CommonTrajectory.solution`.
    """
    task = built.task
    states = [np.asarray(state, float) for state in starts]
    given: dict[str, ArrayLike] = {f"start_{i}": state for i, state in enumerate(states)}
    bounds = limits or Limits()
    given |= {"largest": bounds.thrust, "slew": bounds.slew}
    warm = isinstance(begin, CommonTrajectory)
    point = begin.solution if isinstance(begin, CommonTrajectory) else _guess(built, states, np.asarray(begin, float))
    for ratio in ratios[-1:] if warm else ratios:
        point = built.solver.solve({**given, "ratio": ratio}, point)
    assert isinstance(point, Solution)
    net, assist = point.values["net"], point.values["assist"]
    position = built.lifted.on_thrust(built.lifted.position) @ net
    error = np.array([error_of(point.values, str(i), task.feedback, task.stroke) for i in range(len(task.scenarios))])
    return CommonTrajectory(task, np.append(net, 0.0) + assist, position, error, ratios[-1], point)


def _guess(built: BuiltCommon, states: list[Array], net: Array) -> dict[str, Array]:
    task = built.task
    extra = task.feedback.last - task.samples
    position = built.lifted.on_thrust(built.lifted.position) @ net
    feedforward, reference = np.append(net, np.zeros(extra)), np.append(position, np.full(extra - 1, task.stroke))
    guess = {"net": net, "assist": np.zeros(task.samples + 1)}
    for i, (scenario, start) in enumerate(zip(task.scenarios, states, strict=True)):
        guess |= guess_loop(str(i), scenario, task.feedback, start, feedforward, reference)
    errors = [error_of(guess, str(i), task.feedback, task.stroke) for i in range(len(states))]
    worst = float(np.max(np.abs(errors)))
    return {**guess, "worst": np.array([worst])}
