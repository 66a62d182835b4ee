"""The trade-off of a PID: tuned ones over the bound on |S|, and rules of thumb to compare them with.

Symbols as in the diagram of `design.loop`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

from design.family import Member, linear
from design.loop import Assessment, assess
from design.pid.problem import Attempt, Bounds, Problem, Tuning, TuningError, mt_bound
from design.pid.rules import fast_rule, lambda_rule, quickest_time, simc, slow_rule
from design.pid.tuning import tuned_from
from models.controller import PID, Feedback
from models.feedback.law import Law
from models.machine import Machine

SECOND_START: Final = 6  # Only every so many points start from the fast rule too, since that doubles the time.
RULE_TIMES: Final = (1.15, 1.35, 1.5, 1.9, 2.3, 3.0, 4.6)  # of the quickest one [1]: time constants tau_c of SIMC,
LAMBDAS: Final = (1.9, 2.3, 2.7, 3.0, 3.8, 5.3, 7.6)  # and those of the lambda rule


@dataclass(frozen=True)
class Point:
    """One PID with its loops over the family, in its order; `bound` is that on |S| it was tuned for, None if not.

    law: a feedback of another structure, whose loops they then are; the PID is the one with nearly the same.
    """

    name: str
    pid: PID
    loops: tuple[Assessment, ...]
    bound: float | None = None
    law: Law | None = None

    @property
    def feedback(self) -> Feedback:
        """What makes the loops [SI]."""
        return self.law or self.pid

    @property
    def ms(self) -> float:
        """Largest peak of |S| [1] over the family; inf if a loop is unstable."""
        return max(loop.ms.value if loop.stable else math.inf for loop in self.loops)


@dataclass(frozen=True)
class Front:
    """The tuned points by the bound on |S|, and every attempt [at that bound] that led to them or to nothing."""

    points: tuple[Point, ...]
    attempts: tuple[tuple[float, Attempt], ...]

    def nearest(self, ms: float) -> Point:
        """The point tuned for the bound `ms` [1]; else for the next stricter one with a PID; else the first of them."""
        return next((point for point in reversed(self.points) if (point.bound or math.inf) <= ms), self.points[0])


def tuned(problem: Problem, levels: Sequence[float], limits: Bounds, machine: Machine) -> Front:
    """The front over rising levels of the bound on |S| [1], each started from the last.

    limits: bounds on |T| (inf: see `mt_bound`) and |CS| [N/m]. Levels without a PID are left out of the
    front; raises TuningError, that of the last level, if none has one, as soon as the first and the last have none.
    """
    points: list[Point] = []
    attempts: list[tuple[float, Attempt]] = []
    refusal: TuningError | None = None
    many = problem.goal.objective != "integral"  # the other objectives have more than one local optimum
    last: Tuning | None = None
    slow, fast = ("slow rule", slow_rule(machine)), ("fast rule", fast_rule(machine))
    for i, ms in enumerate(levels):
        bounds = replace(limits, ms=ms, mt=mt_bound(ms, limits.mt))
        starts = [slow] if last is None else [("neighbour", last.pid)]
        others = [fast]
        if many or i % SECOND_START == 0:
            starts, others = starts + others, []
        others = [*others, ("present PID", machine.control.pid)]  # of a loop that runs, however quick the axis is
        try:
            last = tuned_from(problem, bounds, starts, others)
            points.append(Point(f"tuned, {ms:g}", last.pid, last.loops, ms))
            attempts += [(ms, attempt) for attempt in last.attempts]
        except TuningError as error:
            attempts += [(ms, attempt) for attempt in error.attempts]
            refusal = error
            if i == 0 and len(levels) > 1:  # what keeps to any level keeps to the last one, too
                loosest = replace(limits, ms=levels[-1], mt=mt_bound(levels[-1], limits.mt))
                tuned_from(problem, loosest, [slow, fast], others[-1:])
    if refusal is not None and not points:
        raise refusal
    return Front(tuple(points), tuple(attempts))


def assessed_point(name: str, pid: PID, members: Sequence[Member], law: Law | None = None) -> Point:
    """A PID that was not tuned here, or the law in its place, with its loops [SI]."""
    return Point(name, pid, tuple(assess(member.plant, law or pid) for member in members), law=law)


def rules(machine: Machine, members: Sequence[Member]) -> list[Point]:
    """SIMC's and the lambda rule's PIDs over their time constants [s], as far as they are stable."""
    plant, ts, keep = linear(machine).late, machine.sample_time, machine.control.pid.derivative_filter
    unit = quickest_time(machine)
    points = [assessed_point("SIMC", simc(plant, ts, times * unit, keep), members) for times in RULE_TIMES]
    points += [assessed_point("lambda", lambda_rule(plant, times * unit, keep), members) for times in LAMBDAS]
    return [point for point in points if math.isfinite(point.ms)]
