"""What a tuning is about: the bounds, the problem posed for a family of plants, its certified outcome."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from design.family import Member
from design.loop import Assessment, Complex
from design.pid.goal import Goal
from models.controller import PID
from models.quantity import show

Array = NDArray[np.float64]
Slot = tuple[float, complex]  # omega [rad/s] and P there [m/N]

LEAST_MT: Final = 1.4  # A loop with an integrator and a rigid body cannot keep |T| below about this.


@dataclass(frozen=True)
class Bounds:
    """What every loop of the family keeps to: peaks |S| <= ms [1], |T| <= mt [1], |CS| <= mcs [N/m]."""

    ms: float
    mt: float = math.inf
    mcs: float = math.inf


def mt_bound(ms: float, mt: float = math.inf) -> float:
    """The bound on |T| [1] that goes with one on |S|, where none is given (inf)."""
    return max(ms, LEAST_MT) if math.isinf(mt) else mt


@dataclass(frozen=True)
class Attempt:
    """One start and what became of it, a sentence; `value` as the objective has it, None if it failed."""

    start: str
    outcome: str
    value: float | None


class TuningError(ValueError):
    """No PID keeps to the bounds; the message says what was tried and what would help, `attempts` tell each start, and
    `reason` is the message without either."""

    def __init__(self, message: str, attempts: tuple[Attempt, ...] = (), reason: str | None = None) -> None:
        super().__init__(message)
        self.attempts = attempts
        self.reason = message if reason is None else reason


@dataclass(frozen=True)
class Tuning:
    """A certified PID: `loops` are the family's, in its order; `value` is the objective's (see `achieved`).

    >>> tuning
    Tuning(kp = ... N/mm, ki = ... N/(m s), kd = ... N s/m, |S| <= 2 over 20 plants)
    """

    pid: PID
    bounds: Bounds
    value: float
    loops: tuple[Assessment, ...]
    attempts: tuple[Attempt, ...]

    def __repr__(self) -> str:
        pid = self.pid
        return (
            f"Tuning(kp = {show(pid.kp, 'N/m')}, ki = {show(pid.ki, 'N/(m s)')}, kd = {show(pid.kd, 'N s/m')}, "
            f"|S| <= {self.ms:.4g} over {len(self.loops)} plants)"
        )

    @property
    def ms(self) -> float:
        """The family's largest peak of |S| [1]."""
        return max(loop.ms.value for loop in self.loops)


@dataclass(frozen=True)
class Problem:
    """A program built once for a family and a goal, its bounds and slots parameters; see `pose` and `tune`.

    scale: the PID whose gains the unknowns are measured in. solvers: by their room for slots, ascending. lower, upper
    (5,): of the unknowns. check: per member the frequencies (n,) [rad/s] and P there (n,) [m/N], at which every
    solution is looked at. band: slots of the objective.
    """

    members: tuple[Member, ...]
    goal: Goal
    scale: PID
    solvers: Mapping[int, ca.Function]
    lower: Array
    upper: Array
    check: tuple[tuple[Array, Complex], ...]
    band: tuple[Slot, ...]

    @property
    def sample_time(self) -> float:
        """T_s [s]."""
        return float(self.members[0].plant.dt)

    def with_derivative_gain(self, kd: float) -> Problem:
        """The same with the derivative gain given [N s/m] instead of sought; `scale` has to have one."""
        share, lower, upper = kd / self.scale.kd, self.lower.copy(), self.upper.copy()
        lower[2] = upper[2] = share
        return replace(self, lower=lower, upper=upper)
