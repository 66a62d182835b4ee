"""x_T* by optimal control on the smoothed model: one trajectory for all that the friction may remember.

A history is the elements' state z (N,) at a motion's start. Two designs, both over every history at once:

*history-aware*: the compensator carries z forward, so its thrust is u_h = n + f_h, with one net thrust n and hence one
x_T* for every history h. As x_T* is the same, so is the path that each friction follows:

    minimise J   subject to   rest on the target after N samples,   m = M n,   z_h[k] = clip(z_h[k-1] + m[k] - m[k-1]),
                              f_h[k] = K' z_h[k],   |u_h| <= limit,   |u_h[k] - u_h[k-1]| <= slew

*robust* (robust.py): one x_T* and one thrust for every history; the feedback meets what differs.

M: middle of each sample's interval on n (lifted.py): friction once a sample, of second order in T_s, and quasi-static
(without the dampers D_i). The clip is smooth_friction's; its width follows CONTINUATION.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from design.deadbeat import DesignError
from design.trajectory.lifted import Lifted, feedforward_only
from design.trajectory.nlp import Program, Solution, Solver
from design.trajectory.scenarios import Feedback, Scenario, follow_loop, guess_loop
from models.friction import Friction
from models.plant import Plant, delay_split
from models.quantity import show
from models.smooth_friction import law

Array = NDArray[np.float64]
Objective = Literal["peak_thrust", "energy", "thrust_difference", "sensitivity", "tracking"]

OBJECTIVES: Final[dict[Objective, str]] = {
    "peak_thrust": "least peak thrust",
    "energy": "least sum of squares of the thrust",
    "thrust_difference": "least sum of squares of the thrust's differences",
    "sensitivity": "least mean square error after the settling time, over tables with other friction, mass and modes",
    "tracking": "least sum of squares of the error and the thrust, weighted",
}
# Each solve starts from the one before, with the friction's corners rounded over this share of each element's limit:
# from a coarse smoothing, which converges easily, to one that is close to the exact law.
CONTINUATION: Final = (0.3, 0.1, 0.03)
# Weight of the thrust's squared differences beside the peak: that leaves some of the thrust undetermined.
BESIDE_PEAK: Final = 1e-8
# The same beside the sensitivity. With less the thrust oscillates from sample to sample, which the friction as it is
# modelled here, once a sample and smoothed, does not penalise: the nonsmooth table would lose more than is gained.
BESIDE_SENSITIVITY: Final = 1e-5


@dataclass(frozen=True)
class Task:
    """What is asked, fixed when the problem is built; times [s], stroke [m].

    samples: N, over which the motion goes; histories: how many element states it is solved for. friction None: the
    linear plant alone. scenarios and feedback: what the objective "sensitivity" looks at. weights: (error [1/m^2],
    thrust [1/N^2]) for "tracking", whose end is free.

    >>> task = pos.TrajectoryTask(machine.plant, machine.friction, machine.sample_time, 38, 20e-6, "peak_thrust")
    >>> task.samples * task.sample_time  # [s]
    0.019
    """

    plant: Plant
    friction: Friction | None
    sample_time: float
    samples: int
    stroke: float
    objective: Objective = "thrust_difference"
    histories: int = 1
    monotone: bool = False
    scenarios: tuple[Scenario, ...] = ()
    feedback: Feedback | None = None
    weights: tuple[float, float] = (1.0, 1.0)

    def __repr__(self) -> str:
        way = f"{show(self.stroke, 'm')} in {self.samples} samples of {show(self.sample_time, 's')}"
        return f"Task({way}, {self.objective!r})"


@dataclass(frozen=True)
class Limits:
    """|u_h| [N], |u_h[k] - u_h[k-1]| [N], and |x_T* - target| <= tolerance [m] from sample `settled` on; inf: free.

    >>> pos.TrajectoryLimits(thrust=138.5).slew  # free
    inf
    """

    thrust: float = math.inf
    slew: float = math.inf
    tolerance: float = math.inf
    settled: int = 0


@dataclass(frozen=True)
class Trajectory:
    """net (N,) [N]: thrust less friction; position (N + 1,) [m]: x_T* it gives; thrust (H, N) [N]: n + f_h, smoothed.

    hold (H,) [N]: thrust that holds each friction after the motion. `solution` is the last iterate, also a failed one.

    >>> trajectory
    Trajectory(20 µm in 38 samples, peak thrust ... N, converged)
    """

    task: Task
    net: Array
    position: Array
    thrust: Array
    hold: Array
    ratio: float
    solution: Solution

    def __repr__(self) -> str:
        ended = "converged" if self.solution.converged else "NOT converged"
        return (
            f"Trajectory({show(self.task.stroke, 'm')} in {self.task.samples} samples, "
            f"peak thrust {show(self.peak, 'N')}, {ended})"
        )

    @property
    def peak(self) -> float:
        """max |u_h| [N]."""
        return float(np.max(np.abs(np.column_stack([self.thrust, self.hold]))))


@dataclass(frozen=True)
class Built:
    """A task's problem, built once; `lifted` is its linear part."""

    task: Task
    lifted: Lifted
    solver: Solver


def build(task: Task) -> Built:
    """The problem of `task`. Raises DesignError for a task that means nothing.

    >>> built = pos.build_trajectory(task)
    >>> built.task is task
    True
    """
    _require_sense(task)
    lifted, n, program = feedforward_only(task.plant, task.sample_time, task.samples), task.samples, Program()
    unit = thrust_unit(task)
    net = program.variable("net", np.full(n, unit))
    thrust, slew, ratio = (program.parameter(name) for name in ("thrust", "slew", "ratio"))
    tolerance = program.parameter("tolerance", n)
    position = ca.vertcat(0, lifted.on_thrust(lifted.position)[1:] @ net)
    program.subject_to(position[1:], task.stroke - tolerance, task.stroke + tolerance, task.stroke)
    if task.objective != "tracking":
        require_rest(program, task, lifted, net)
    if task.monotone:
        program.subject_to(position[1:] - position[:-1], 0, np.inf, task.stroke / n)
    forces = _forces(program, task, lifted, net, ratio)
    for force in forces:  # (N + 2,): before the motion, over its intervals, after it
        applied = force + ca.vertcat(0, net, 0)
        program.subject_to(applied[1:], -thrust, thrust, unit)
        program.subject_to(applied[1:] - applied[:-1], -slew, slew, unit)
    if task.objective == "sensitivity":
        _minimise_sensitivity(program, task, position, net, forces, ratio)
    else:
        _minimise(program, task, position, net, forces)
    return Built(task, lifted, program.build())


def solve(
    built: Built,
    states: ArrayLike | None = None,
    limits: Limits = Limits(),
    *,
    direction: int = 1,
    start: Trajectory | None = None,
    ratios: Sequence[float] = CONTINUATION,
    others: Sequence[ArrayLike] = (),
    net: ArrayLike | None = None,
) -> Trajectory:
    """The best trajectory for element states (H, N) [m], continued over the smoothing `ratios` [1]; the last counts.

    direction -1: the motion goes down. others: the states (N,) [m] that each of the task's scenarios starts from. With
    `start`, warm from it at the last ratio alone; else from the net thrust `net` (N,) [N], by default the linear
    plant's least squares. One that did not converge comes back as it is: see `Trajectory.solution`.

    >>> trajectory = pos.solve_trajectory(built, [machine.friction.limit])  # every element at its limit before
    >>> trajectory.solution.converged, trajectory.position.shape
    (True, (39,))
    """
    task = built.task
    z = direction * _states(task, states)
    starts = [direction * np.asarray(state, float) for state in others]
    given: dict[str, ArrayLike] = {
        **{f"start_{i}": state for i, state in enumerate(starts)},
        "thrust": limits.thrust,
        "slew": limits.slew,
        "tolerance": np.where(np.arange(1, task.samples + 1) >= limits.settled, limits.tolerance, np.inf),
        "z": z.ravel(),
    }
    point: Solution | dict[str, Array] = _guess(built, z, starts, net) if start is None else start.solution
    for ratio in ratios if start is None else ratios[-1:]:
        point = built.solver.solve({**given, "ratio": ratio}, point)
    assert isinstance(point, Solution)
    return _trajectory(built, point, direction, ratios[-1])


def least_settling_time(
    built: Built, states: ArrayLike | None, limits: Limits, *, ratios: Sequence[float] = CONTINUATION
) -> tuple[int, dict[int, Trajectory]]:
    """(samples, trajectories tried): the earliest sample from which x_T* stays within limits.tolerance [m].

    `built` minimises the peak thrust, so that every solve is feasible; what can be settled at a sample can be at the
    next, so that halving the interval finds the earliest with a peak within limits.thrust [N]. Each solve starts from
    the one before. The number is samples + 1 if not even the whole motion is long enough.
    """
    if built.task.objective != "peak_thrust":
        raise DesignError(f"least settling time needs the objective 'peak_thrust', not {built.task.objective!r}")
    tried: dict[int, Trajectory] = {}
    low, high, last = 0, built.task.samples + 1, None
    while high - low > 1:
        middle = (low + high) // 2
        asked = Limits(math.inf, limits.slew, limits.tolerance, middle)
        last = solve(built, states, asked, start=last, ratios=ratios)
        if not last.solution.converged:
            last = solve(built, states, asked, ratios=ratios)
        tried[middle] = last
        possible = last.solution.converged and last.peak <= limits.thrust * (1 + 1e-6)
        low, high = (low, middle) if possible else (middle, high)
        last = last if last.solution.converged else None
    return high, tried


def thrust_unit(task: Task) -> float:
    """What the thrust is measured in [N]: the peak that the rigid body alone would need."""
    return 4 * task.stroke / (task.plant.rigid_gain * (task.samples * task.sample_time) ** 2)


def _require_sense(task: Task) -> None:
    if task.objective not in get_args(Objective):
        raise DesignError(f"objective {task.objective!r} is unknown; choose one of {', '.join(get_args(Objective))}")
    if not (math.isfinite(task.stroke) and task.stroke > 0):
        raise DesignError(f"the stroke is {show(task.stroke, 'm')}; give one above 0, such as 20 um")
    if task.samples < 2 * len(task.plant.modes):
        raise DesignError(
            f"{task.samples} samples cannot bring {len(task.plant.modes)} modes to rest; "
            f"give at least {2 * len(task.plant.modes)}"
        )
    if task.objective == "sensitivity" and (task.feedback is None or not task.scenarios or task.friction is None):
        raise DesignError("the objective 'sensitivity' needs a friction, scenarios and the feedback; give all three")
    if task.feedback is not None and task.feedback.last <= task.samples:
        raise DesignError(
            f"the error counts up to sample {task.feedback.last}, but the motion takes {task.samples}; look further"
        )


def require_rest(program: Program, task: Task, lifted: Lifted, net: ca.MX) -> None:
    """The modes rest on the target after the motion."""
    rows, aim = rest_conditions(task, lifted)
    program.subject_to(ca.DM(rows) @ net, aim, aim, thrust_unit(task))


def rest_conditions(task: Task, lifted: Lifted) -> tuple[Array, Array]:
    """Rows (E, N) [1] and aims (E,) [N] on the net thrust; orthonormal, as the modes' reach differs by hundreds."""
    reach, goal = lifted.on_thrust(lifted.state), np.zeros(lifted.state.shape[0])
    goal[2 * task.plant.rigid] = task.stroke
    orthonormal, mixing = np.linalg.qr((reach / np.linalg.norm(reach, axis=1)[:, None]).T)
    rows, aim = orthonormal.T, np.linalg.solve(mixing.T, goal / np.linalg.norm(reach, axis=1))
    if delay_split(task.plant.dead_time, task.sample_time)[1] > 0:  # the last thrust acts until after the last sample
        rows, aim = np.vstack([rows, np.eye(task.samples)[-1]]), np.append(aim, 0.0)
    return rows, aim


def _forces(program: Program, task: Task, lifted: Lifted, net: ca.MX, ratio: ca.MX) -> list[ca.MX]:
    """For each history the friction (N + 2,) [N]: before the motion, over each interval of the thrust, after it."""
    n = task.samples
    if task.friction is None:
        program.parameter("z", 0)
        return [ca.MX.zeros(n + 2)] * task.histories
    stiffness, limit = np.array(task.friction.stiffness), np.array(task.friction.limit)
    count, elements = limit.size, law(limit.size).map(n + 1)
    middle = program.variable("middle", np.full(n, task.stroke))
    program.subject_to(middle - lifted.on_thrust(lifted.middle) @ net, 0, 0, task.stroke)
    moved = ca.diff(ca.vertcat(0, middle, task.stroke)).T
    starts = ca.reshape(program.parameter("z", task.histories * count), count, task.histories)
    forces = []
    for h in range(task.histories):
        force = program.variable(f"force_{h}", np.full(n + 1, task.friction.coulomb_force))
        z = ca.reshape(program.variable(f"z_{h}", np.tile(limit, n)), count, n)
        before = ca.horzcat(starts[:, h], z)
        after, pull = elements(before, moved, *(ca.repmat(one, 1, n + 1) for one in (ratio, stiffness, limit)))
        program.subject_to(ca.vec(z - after[:, :n]), 0, 0, np.tile(limit, n))
        program.subject_to(force - pull.T, 0, 0, task.friction.coulomb_force)
        forces.append(ca.vertcat(ca.dot(stiffness, starts[:, h]), force))
    return forces


def _minimise(program: Program, task: Task, position: Any, net: Any, forces: list[Any]) -> None:
    """Adds the objective, of the order of 1, that the task names."""
    n, unit = task.samples, thrust_unit(task)
    applied = [(force + ca.vertcat(0, net, 0)) / unit for force in forces]
    rough = ca.sumsqr(ca.diff(ca.vertcat(0, net, 0) / unit))
    if task.objective == "peak_thrust":
        peak = program.variable("peak", unit, lower=0) / unit
        for thrust in applied:
            program.subject_to(ca.vertcat(peak - thrust[1:], peak + thrust[1:]), 0, np.inf)
        program.minimise(peak + BESIDE_PEAK * rough)
    elif task.objective == "energy":
        program.minimise(sum(ca.sumsqr(thrust[1:-1]) for thrust in applied) / (n * task.histories))
    elif task.objective == "thrust_difference":
        program.minimise(sum(ca.sumsqr(ca.diff(thrust)) for thrust in applied) / task.histories)
    elif task.objective == "tracking":
        error, effort = task.weights
        cost = sum(ca.sumsqr(thrust[1:-1]) for thrust in applied) * effort * unit**2 / task.histories
        scale = error * task.stroke**2 * n
        program.minimise((cost + error * ca.sumsqr(position[1:] - task.stroke)) / scale)


def _minimise_sensitivity(program: Program, task: Task, position: Any, net: Any, forces: list[Any], ratio: Any) -> None:
    """Adds the mean square error [tenths of a stroke, squared] over the scenarios, each with its history's thrust."""
    assert task.feedback is not None
    n, last, unit = task.samples, task.feedback.last, thrust_unit(task)
    reference = ca.vertcat(position, np.full(last - n - 1, task.stroke))
    for i, scenario in enumerate(task.scenarios):
        force = forces[scenario.history]
        change = force[1:] + ca.vertcat(net, 0) - force[0]
        thrust = ca.vertcat(change[:n], ca.repmat(change[n], last - n, 1))
        error, _ = follow_loop(program, str(i), scenario, task.feedback, task.stroke, thrust, reference, ratio)
        program.minimise(scenario.weight * 100 * ca.sumsqr(error / task.stroke) / error.shape[0] / task.histories)
    program.minimise(BESIDE_SENSITIVITY * ca.sumsqr(ca.diff(ca.vertcat(0, net, 0) / unit)))


def _states(task: Task, states: ArrayLike | None) -> Array:
    count = 0 if task.friction is None else len(task.friction.limit)
    z = np.zeros((task.histories, count)) if states is None else np.atleast_2d(np.asarray(states, float))
    if z.shape != (task.histories, count):
        raise DesignError(f"the element states have the shape {z.shape}; give {(task.histories, count)}")
    return z


def _guess(built: Built, z: Array, starts: Sequence[Array], given: ArrayLike | None) -> dict[str, Array]:
    """The least-squares thrust of the linear plant, or the given one, and what the exact elements do along its path."""
    task, lifted = built.task, built.lifted
    net = _least_squares(task, lifted) if given is None else np.asarray(given, float)
    middle = lifted.on_thrust(lifted.middle) @ net
    guess = {"net": net, "middle": middle, "peak": np.array([np.max(np.abs(net))])}
    if task.friction is None:
        return guess
    stiffness, limit = np.array(task.friction.stiffness), np.array(task.friction.limit)
    for h, state in enumerate(z):
        states = [state]
        for moved in np.diff([0.0, *middle, task.stroke]):
            states.append(np.clip(states[-1] + moved, -limit, limit))
        guess[f"z_{h}"] = np.ravel(states[1:-1])
        guess[f"force_{h}"] = np.array(states[1:]) @ stiffness
    position = lifted.on_thrust(lifted.position) @ net
    for i, (scenario, start) in enumerate(zip(task.scenarios, starts, strict=True)):
        assert task.feedback is not None
        extra = task.feedback.last - task.samples
        force = guess[f"force_{scenario.history}"] - stiffness @ z[scenario.history]
        thrust = np.append(net + force[:-1], np.full(extra, force[-1]))
        reference = np.append(position, np.full(extra - 1, task.stroke))
        guess |= guess_loop(str(i), scenario, task.feedback, start, thrust, reference)
    return guess


def _least_squares(task: Task, lifted: Lifted) -> Array:
    """The least-squares thrust (N,) that brings the linear plant to rest on the target."""
    reach, goal = lifted.on_thrust(lifted.state), np.zeros(lifted.state.shape[0])
    goal[2 * task.plant.rigid] = task.stroke
    weight = 1 / np.linalg.norm(reach, axis=1)
    return np.asarray(np.linalg.lstsq(weight[:, None] * reach, weight * goal, rcond=None)[0], float)


def _trajectory(built: Built, point: Solution, direction: int, ratio: float) -> Trajectory:
    task, n = built.task, built.task.samples
    net = direction * point.values["net"]
    force = np.zeros((task.histories, n + 1))
    if task.friction is not None:
        force = direction * np.array([point.values[f"force_{h}"] for h in range(task.histories)])
    position = built.lifted.on_thrust(built.lifted.position) @ net
    return Trajectory(task, net, position, net + force[:, :n], force[:, n], ratio, point)
