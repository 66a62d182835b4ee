"""The trade-off's points: tuned PIDs over the bound on |S|, rules of thumb beside them, and what each achieves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.family import Member
from design.loop import Assessment, assess, rms, sensitivity
from design.pid.problem import Bounds, Problem, Tuning, TuningError
from design.pid.rules import lambda_rule, simc
from design.pid.tuning import tune
from design.validation import Validation, validate_many
from models.controller import PID, Controller
from models.friction import branch
from models.machine import Machine, with_pid
from models.plant import sampled

Array = NDArray[np.float64]

LEAST_MT: Final = 1.4  # below it no loop with an integrator and a rigid body gets along
SLOW_START: Final = 25e-3  # s: closed-loop time constant of the rule that the front starts from
FAST_START: Final = 6e-3  # s: of the rule from which some points start as well
SECOND_START: Final = 6  # every so many points do
RULE_TIMES: Final = (3e-3, 3.5e-3, 4e-3, 5e-3, 6e-3, 8e-3, 12e-3)  # s: tau_c of SIMC, from about theta on
LAMBDAS: Final = (5e-3, 6e-3, 7e-3, 8e-3, 10e-3, 14e-3, 20e-3)  # s


@dataclass(frozen=True)
class Point:
    """One PID with its loops over the family, in its order; `bound` is that on |S| it was tuned for, None if not."""

    name: str
    pid: PID
    loops: tuple[Assessment, ...]
    bound: float | None = None

    @property
    def ms(self) -> float:
        """Largest peak of |S| [1] over the family; inf if a loop is unstable."""
        return max(loop.ms.value if loop.stable else math.inf for loop in self.loops)


def tuned(problem: Problem, levels: Sequence[float], limits: Bounds, machine: Machine) -> tuple[list[Point], list[Any]]:
    """The front over the levels of the bound on |S| [1], each warm-started from the last; and every attempt made.

    limits: bounds on |T| (inf: that on |S|, at least LEAST_MT) and |CS| [N/m]. Levels without a PID are left out of the
    front; raises TuningError, that of the last level, if none has one.
    """
    points, log = [], []
    refusal: TuningError | None = None
    keep = machine.control.pid.derivative_filter
    slow, fast = (simc(machine.plant, machine.sample_time, time, keep) for time in (SLOW_START, FAST_START))
    many = problem.goal.objective != "integral"  # the other objectives have more than one local optimum
    last: Tuning | None = None
    for i, ms in enumerate(levels):
        bounds = replace(limits, ms=ms, mt=mt_bound(ms, limits.mt))
        starts = [("slow rule", slow)] if last is None else [("neighbour", last.pid)]
        if many or i % SECOND_START == 0:
            starts += [("fast rule", fast)]
        try:
            last = tune(problem, bounds, starts)
            points.append(Point(f"tuned, {ms:g}", last.pid, last.loops, ms))
            log += [{"ms": ms, **vars(attempt)} for attempt in last.attempts]
        except TuningError as error:
            log += [{"ms": ms, **vars(attempt)} for attempt in error.attempts]
            refusal = error
    if refusal is not None and not points:
        raise refusal
    return points, log


def magnitude(machine: Machine) -> PID:
    """A PID whose gains are of the right size: the present one, or SIMC's where the present lacks a part."""
    pid = machine.control.pid
    if min(pid.kp, pid.ki, pid.kd) > 0:
        return pid
    return simc(machine.plant, machine.sample_time, FAST_START, pid.derivative_filter)


def nearest(points: Sequence[Point], ms: float) -> Point:
    """The point tuned for the bound `ms` [1]; else for the next stricter one with a PID; else the first of them."""
    return next((point for point in reversed(points) if (point.bound or math.inf) <= ms), points[0])


def mt_bound(ms: float, mt: float) -> float:
    """The bound on |T| [1] that goes with one on |S|."""
    return max(ms, LEAST_MT) if math.isinf(mt) else mt


def judged(name: str, pid: PID, members: Sequence[Member]) -> Point:
    """A PID that was not tuned here, with its loops [SI]."""
    return Point(name, pid, tuple(assess(member.plant, pid) for member in members))


def rules(machine: Machine, members: Sequence[Member]) -> list[Point]:
    """SIMC's and the lambda rule's PIDs over their time constant, as far as they are stable."""
    plant, ts, keep = machine.plant, machine.sample_time, machine.control.pid.derivative_filter
    points = [judged("SIMC", simc(plant, ts, time, keep), members) for time in RULE_TIMES]
    points += [judged("lambda", lambda_rule(plant, time, keep), members) for time in LAMBDAS]
    return [point for point in points if math.isfinite(point.ms)]


def nonsmooth(machine: Machine, controller: Controller, points: Sequence[Point]) -> tuple[Validation, ...]:
    """The paper's motions without friction compensation with each point's PID, on the nonsmooth machine."""
    controllers = [replace(controller.without_compensation(), pid=point.pid) for point in points]
    machines = [with_pid(machine, point.pid, "this study") for point in points]
    return validate_many(machines, controllers, periods=4)


def row(machine: Machine, members: Sequence[Member], point: Point, validation: Validation) -> dict[str, Any]:
    """What one point achieves, for results.json."""
    loops, pid = point.loops, point.pid
    nominal = [loop for loop, member in zip(loops, members, strict=True) if member.nominal]
    worst = members[int(np.argmax([loop.ms.value for loop in loops]))]
    force = float(branch(machine.friction, machine.specification.stroke))
    errors = [step_error(member, pid, machine.specification.settling_time) for member in members if member.nominal]
    return {
        "name": point.name,
        "bound": point.bound,
        "kp_N_per_m": pid.kp,
        "ki_N_per_ms": pid.ki,
        "kd_Ns_per_m": pid.kd,
        "derivative_filter_s": pid.derivative_filter,
        "ms": point.ms,
        "worst_plant": worst.name,
        "mt": max(loop.mt.value for loop in loops),
        "mps_m_per_N": max(loop.mps.value for loop in loops),
        "mcs_N_per_m": max(loop.mcs.value for loop in loops),
        "crossover_Hz": nominal[0].crossover / (2 * math.pi),
        "bandwidth_Hz": nominal[0].bandwidth / (2 * math.pi),
        "gain_margin": min(loop.gain_margin for loop in loops),
        "phase_margin_deg": math.degrees(min(loop.phase_margin for loop in loops)),
        "disk_margin": min(loop.disk_margin for loop in loops),
        "error_m": force * max(float(error[0]) for error in errors),
        "error_from_then_on_m": force * max(float(np.max(error)) for error in errors),
        "noise_N": noise(machine, members[0], pid),
        "settling_s": validation.reversal.settling_time,
        "slowest_s": validation.slowest.settling_time,
        "dispersion_m": validation.worst_dispersion,
    }


def step_error(member: Member, pid: PID, begin: float) -> Array:
    """|x| (n,) [m] per newton at the samples from `begin` [s] on, twice as long, after a step of d."""
    model = sensitivity(member.plant, pid, "PS")
    count = round(begin / member.plant.dt)
    state, found = np.zeros(model.nstates), []
    for _ in range(3 * count):
        state = model.A @ state + model.B[:, 0]
        found.append(abs(float(model.C[0] @ state)))
    return np.array(found[count - 1 :])


def noise(machine: Machine, member: Member, pid: PID) -> float:
    """Standard deviation of the thrust [N] from the scale's rounding, resolution / sqrt(12), and its noise."""
    reading = math.hypot(machine.scale.resolution / math.sqrt(12), machine.scale.noise)
    return reading * rms(sensitivity(member.plant, pid, "CS"))


def between_samples(
    machine: Machine, pid: PID, slope: float, parts: int, duration: float
) -> tuple[Array, Array, Array]:
    """(time (n,) [s], x (n,) [m] at `parts` points a sample, x at the samples) after friction's step at slope [N/m].

    The plant is exact at every part: it is sampled `parts` times as fast, under a command that changes with T_s.
    """
    ts = machine.sample_time
    plant = sampled(machine.plant, ts / parts, slope)
    force = float(branch(machine.friction, machine.specification.stroke))
    keep = pid.pole(ts)
    state, integral, derivative, previous, command = np.zeros(plant.nstates), 0.0, 0.0, 0.0, 0.0
    count = round(duration / ts) * parts
    path = np.empty(count)
    for k in range(count):
        path[k] = float(plant.C[0] @ state)
        if k % parts == 0:
            error = -path[k]
            integral += pid.ki * ts * error
            derivative = keep * derivative + (1 - keep) * (error - previous) / ts
            command, previous = pid.kp * error + integral + pid.kd * derivative, error
        state = plant.A @ state + plant.B[:, 0] * (command + force)
    return np.arange(count) * ts / parts, path, path[::parts]
