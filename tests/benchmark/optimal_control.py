"""`python -m tests.benchmark.optimal_control`: time to build and solve the trajectory problems."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

import numpy as np

from design.trajectory import schemes
from design.trajectory.history_aware import Limits, Task, build, solve
from design.trajectory.nlp import Solution
from design.trajectory.robust import RobustTask, build_robust, solve_robust
from design.trajectory.scenarios import Scenario
from models.machine import Machine, load

SAMPLES = 40  # N
HISTORIES = 5
SHARES = np.linspace(0.9, 0.99, 7)  # of the element states first solved for: each solve is warm, and of a new problem


@dataclass(frozen=True)
class Time:
    """What was timed, its wall time [s] (of solves the median, all of which must converge) and the target [s], if any.

    iterations: the median; None for a build. slowest [s]: of the solves.
    """

    name: str
    seconds: float
    target: float | None
    iterations: float | None
    converged: bool
    slowest: float = 0.0

    def __str__(self) -> str:
        verdict = "no target"
        if self.target is not None:
            reached = self.converged and self.seconds <= self.target
            verdict = f"target {self.target:g} s: {'reached' if reached else 'MISSED'}"
        work = "" if self.iterations is None else f"(slowest {self.slowest:.3f} s), {self.iterations:g} iterations, "
        return f"{self.name:<58}{self.seconds:8.3f} s   {work}{verdict}{'' if self.converged else ', NOT CONVERGED'}"


def solve_times(machine: Machine) -> tuple[Time, ...]:
    """First build, then warm solves of the history-aware problem and of one trajectory for all histories."""
    states = schemes.slip_states(machine)[:1]
    stroke = machine.specification.stroke
    task = Task(machine.plant, machine.friction, machine.sample_time, SAMPLES, stroke, "peak_thrust")
    begin = time.perf_counter()
    built = build(task)
    first = Time(f"first build, N = {SAMPLES}, {states.size} elements", _since(begin), 2.0, None, True)
    one = solve(built, states)
    several = build(
        Task(machine.plant, machine.friction, machine.sample_time, SAMPLES, stroke, "peak_thrust", HISTORIES)
    )
    many = np.linspace(1, -1, HISTORIES)[:, None] * states
    five = solve(several, many)
    return (
        first,
        _warm("warm solve, one history", 0.06, lambda share: solve(built, share * states, start=one).solution),
        _warm(
            f"warm solve, {HISTORIES} histories", 0.5, lambda share: solve(several, share * many, start=five).solution
        ),
        _robust(machine, one.net, many),
    )


def _robust(machine: Machine, net: schemes.Array, states: schemes.Array) -> Time:
    """The same histories for one trajectory: as many copies of the whole loop, feedback and all."""
    look = SAMPLES + 1 + round(machine.plant.dead_time / machine.sample_time)
    task = RobustTask(
        machine.plant,
        tuple(Scenario(machine.plant, machine.friction, i) for i in range(len(states))),
        schemes.feedback(machine, look, schemes.LOOK_ROBUST),
        machine.sample_time,
        SAMPLES,
        machine.specification.stroke,
    )
    built, limits = build_robust(task), Limits(machine.drive.rated_thrust)
    found = solve_robust(built, list(states), net, limits, ratios=schemes.COARSE_SMOOTHING)
    return _warm(
        f"warm solve, one trajectory for {len(states)} histories",
        0.5,
        lambda share: (
            solve_robust(built, list(share * states), found, limits, ratios=schemes.COARSE_SMOOTHING).solution
        ),
        SHARES,
    )


def _warm(name: str, target: float, solve_at: Callable[[float], Solution], shares: schemes.Array = SHARES) -> Time:
    seconds, found = [], []
    for share in shares:
        begin = time.perf_counter()
        found.append(solve_at(float(share)))
        seconds.append(_since(begin))
    work = median(one.iterations for one in found)
    return Time(name, median(seconds), target, work, all(one.converged for one in found), max(seconds))


def _since(begin: float) -> float:
    return time.perf_counter() - begin


def main() -> int:
    """Prints the times beside their targets; 0 whatever they are."""
    for one in solve_times(load()):
        print(one, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
