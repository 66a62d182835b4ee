"""Published optima that the program must reproduce as T_s goes to zero: PI and PID, largest integral gain.

Quoted from memory; none of the papers was at hand. Each row is here because a search of another kind, in continuous
time and over all gains (tests/design/pid/test_published.py), reproduces the quoted figures: three digits of two or
three gains do not agree by chance. Remembered rows that this search did not confirm were left out.

"Ms" keeps |1 + L| >= 1 / M. "M" keeps L out of the one circle around those of |S| = M and of |T| = M, of centre -c and
radius r: c = (2 M^2 - 2 M + 1) / (2 M (M - 1)), r = (2 M - 1) / (2 M (M - 1)). Since |c + L| >= r is
|1 + L / c| >= r / c, it is a bound c / r on |S| for the plant P / c. The PID of the second source is not the one of
largest integral gain outright, which is poorly damped, but the one at the largest derivative gain with which L touches
the circle only once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Final

import control
import numpy as np

from design.family import Member
from design.loop import controller_response, frequency_response
from design.pid.goal import Goal
from design.pid.problem import Bounds, Problem
from design.pid.tuning import pose, tune
from models.controller import PID

FIRST: Final = "Åström, Panagopoulos and Hägglund, Automatica 34 (1998), 585–601"
SECOND: Final = "Åström and Hägglund, J. Process Control 14 (2004), 635–650"
TOLERANCE: Final = 1e-5
GAIN_FACTOR: Final = 1.02  # Factor by which the derivative gain grows until L touches the circle a second time.
TOUCHES: Final = 1e-4  # A second maximum of |S| within this fraction of the bound touches it.
LINEAR_APPROACH_DISTANCE: Final = 0.01  # One within this fraction approaches the bound linearly.


@dataclass(frozen=True)
class Optimum:
    """A published controller k (1 + 1 / (s T_i) + s T_d) for P = (1 - zero s) / prod (1 + lag s); times [s].

    circle: "Ms" or "M" (see above), of the size `bound` [1]. sample_time: [s] at which it is reproduced.
    """

    name: str
    lags: tuple[float, ...]
    zero: float
    circle: str
    bound: float
    kp: float
    integral_time: float
    derivative_time: float
    sample_time: float
    source: str


TWO: Final = ("1/((s+1)(0.2s+1)(0.04s+1)(0.008s+1))", (1.0, 0.2, 0.04, 0.008))
LAG: Final = ("1/((s+1)(0.1s+1)(0.01s+1)(0.001s+1))", (1.0, 0.1, 0.01, 0.001))
PUBLISHED: Final = (
    Optimum("1/(s+1)³", (1.0,) * 3, 0.0, "Ms", 1.4, 0.633, 1.95, 0.0, 2.5e-3, FIRST),
    Optimum("1/(s+1)³", (1.0,) * 3, 0.0, "Ms", 2.0, 1.22, 1.78, 0.0, 2.5e-3, FIRST),
    Optimum(*TWO, 0.0, "Ms", 1.4, 1.93, 0.744, 0.0, 5e-4, FIRST),
    Optimum(*TWO, 0.0, "Ms", 2.0, 4.13, 0.59, 0.0, 5e-4, FIRST),
    Optimum("(1−2s)/(s+1)³", (1.0,) * 3, 2.0, "Ms", 1.4, 0.179, 1.78, 0.0, 2.5e-3, FIRST),
    Optimum("1/(s+1)⁴", (1.0,) * 4, 0.0, "M", 1.4, 0.432, 2.43, 0.0, 2.5e-3, SECOND),
    Optimum(*LAG, 0.0, "M", 1.4, 3.56, 0.66, 0.0, 2.5e-4, SECOND),
    Optimum("1/(s+1)⁴", (1.0,) * 4, 0.0, "M", 1.4, 1.19, 2.22, 1.21, 1e-3, SECOND),
    Optimum(*LAG, 0.0, "M", 1.4, 56.9, 0.115, 0.0605, 3e-5, SECOND),
)


def compare() -> list[dict[str, Any]]:
    """Each published controller beside the one found here, SI, with the largest relative difference of its gains."""
    rows = []
    for optimum in PUBLISHED:
        found = find_again(optimum)
        pairs = {
            "kp": (optimum.kp, found.kp),
            "integral_time_s": (optimum.integral_time, found.kp / found.ki),
            "derivative_time_s": (optimum.derivative_time, found.kd / found.kp),
        }
        rows.append(
            {
                "plant": optimum.name,
                "circle": optimum.circle,
                "bound": optimum.bound,
                "sample_time_s": optimum.sample_time,
                "published": {key: given for key, (given, _) in pairs.items()},
                "here": {key: here for key, (_, here) in pairs.items()},
                "largest_error": max(abs(here / given - 1) for given, here in pairs.values() if given),
                "source": optimum.source,
            }
        )
    return rows


def find_again(optimum: Optimum, sample_time: float | None = None) -> PID:
    """The program's controller for the same plant and circle; sample_time [s] overrides the row's own."""
    size, scale = _as_sensitivity(optimum.circle, optimum.bound)
    plant = _sampled(optimum, scale, sample_time or optimum.sample_time)
    kd = optimum.kp * optimum.derivative_time
    magnitude = PID(optimum.kp, optimum.kp / optimum.integral_time, kd, 0.0)
    has_derivative = kd > 0
    members = [Member(optimum.name, plant)]
    problem = pose(members, Goal(), magnitude, derivative=has_derivative, derivative_filter=0.0, lowest=1e-5)
    slow = PID(0.3 * magnitude.kp, 0.1 * magnitude.ki, 0.85 * kd, 0.0)
    if not has_derivative:
        return tune(problem, Bounds(size), [("slow", slow)], TOLERANCE).pid
    return _touching_once(problem, Bounds(size), slow)


def _touching_once(problem: Problem, bounds: Bounds, start: PID) -> PID:
    """The optimum at the largest derivative gain with which |S| reaches its bound at one frequency only.

    From the start's derivative gain on in steps; where a second maximum of |S| grows towards the bound, the gain at
    which it gets there lies on a straight line through the steps before.
    """

    def at(kd: float, last: PID) -> PID:
        start = [("last", replace(last, kd=kd))]
        return tune(problem.with_derivative_gain(kd), bounds, start, TOLERANCE).pid

    pid = start
    gains: list[float] = []
    left: list[float] = []
    while not left or left[-1] > TOUCHES:
        pid = at(pid.kd * GAIN_FACTOR, pid)
        gains.append(pid.kd)
        left.append(1 - _second_maximum(problem, pid) / bounds.ms)
    line = [i for i, distance in enumerate(left) if TOUCHES < distance < LINEAR_APPROACH_DISTANCE]
    kd = float(np.polyval(np.polyfit([left[i] for i in line], [gains[i] for i in line], 1), 0.0))
    return at(kd, replace(pid, kp=0.9 * pid.kp, ki=0.8 * pid.ki))


def _second_maximum(problem: Problem, pid: PID) -> float:
    """The second largest maximum of |S| [1]; 0 if there is only one."""
    plant = problem.members[0].plant
    omega = np.geomspace(problem.check[0][0][0], math.pi / plant.dt, 4000)
    size = np.abs(1 / (1 + frequency_response(plant, omega) * controller_response(pid, plant.dt, omega)))
    inner = np.flatnonzero((size[1:-1] > size[:-2]) & (size[1:-1] > size[2:])) + 1
    return float(np.sort(size[inner])[-2]) if inner.size > 1 else 0.0


def _as_sensitivity(circle: str, bound: float) -> tuple[float, float]:
    """The bound on |S| and the factor of the plant that make `circle` of the size `bound` [1]."""
    if circle == "Ms":
        return bound, 1.0
    below = 2 * bound * (bound - 1)
    centre, radius = (2 * bound**2 - 2 * bound + 1) / below, (2 * bound - 1) / below
    return centre / radius, 1 / centre


def _sampled(optimum: Optimum, factor: float, sample_time: float) -> control.StateSpace:
    """The plant times `factor` behind a hold: lags in a row, the last one's slope giving the zero."""
    poles = -1 / np.array(optimum.lags)
    a = np.diag(poles) - np.diag(poles[:-1], 1)
    b = np.zeros((len(poles), 1))
    b[-1] = -poles[-1]
    c = factor * (np.eye(len(poles))[[0]] - optimum.zero * a[[0]])
    return control.sample_system(control.ss(a, b, c, 0), sample_time)
