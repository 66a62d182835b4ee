"""The trade-off of settling time, thrust and sensitivity, and the shortest feasible motion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from design.controller import feedback_alone
from design.trajectory import schemes
from design.trajectory.compensator import compensate
from design.trajectory.history_aware import CONTINUATION, Limits, Task, Trajectory, build, least_settling_time, solve
from design.trajectory.scenarios import Errors
from design.trajectory.scenarios import tables as scenario_tables
from design.trajectory.schemes import Wanted, profile_of
from design.validation import sequence
from models.machine import Machine
from studies.trajectory_optimisation.outcomes import ERRORS, Aim, judge

PARETO: Final = (0, 1, 2, 4, 6, 8, 12)  # samples beyond the shortest motion
NONE: Final = {"force": 0.0, "length": 0.0, "mass": 0.0, "frequency": 0.0}
PARETO_ROBUST: Final = (0, 4)  # those at which the least sensitive trajectory is designed too


def pareto(
    machine: Machine, wanted: Wanted, shortest: int, aim: Aim, known: Mapping[int, Trajectory], *, quick: bool
) -> list[dict[str, Any]]:
    """Least peak thrust for each motion time, and the error at one-sigma deviations; for some, a robust design too.

    known: trajectories of least peak thrust that are designed already, by their number of samples.
    """
    rows = []
    for count in (shortest + extra for extra in (PARETO[:2] if quick else PARETO)):
        if schemes.rest_time(machine, count) >= machine.specification.interval:  # it would not end
            continue
        peak = known[count] if count in known else schemes.least_peak(machine, wanted, count)[1]
        rows.append(_pareto_row(machine, peak, aim, "least peak thrust"))
        if not quick and count - shortest in PARETO_ROBUST:
            _, robust, _ = schemes.least_sensitive(machine, wanted, peak, ERRORS)
            if robust.solution.converged:
                rows.append(_pareto_row(machine, robust, aim, "least sensitivity"))
    return rows


def _pareto_row(machine: Machine, found: Trajectory, aim: Aim, design: str) -> dict[str, Any]:
    """Sensitivity: root of the mean square error after the motion over one-sigma tables, nonsmooth; by what is off."""
    ts = machine.sample_time
    motion = profile_of(machine, found)
    given = compensate(motion, machine.friction, sequence(machine, aim.stroke))
    first = found.task.samples + round(machine.plant.dead_time / ts)
    part = slice(first, first + round(schemes.LOOK * machine.specification.settling_time / ts))

    def square(errors: Errors) -> float:
        cases = scenario_tables(machine.plant, machine.friction, errors)
        if not cases:  # a rigid axis has no frequency that could be wrong
            return 0.0
        wrong = [replace(machine, plant=plant, friction=friction) for plant, friction, _ in cases]
        outcomes = judge(wrong, feedback_alone(machine), aim, given)
        return float(sum(case[2] * np.mean(one.error[:, part] ** 2) for one, case in zip(outcomes, cases, strict=True)))

    shares = {name: square(Errors(**{**NONE, name: size})) for name, size in vars(ERRORS).items()}
    central = judge([machine], feedback_alone(machine), aim, given)[0]
    return {
        "design": design,
        "time_s": schemes.rest_time(machine, found.task.samples),
        "peak_N": max(float(np.max(np.abs(given.feedforward + given.compensation))), found.peak),
        "sensitivity_m": math.sqrt(sum(shares.values())),
        "by_m": {name: math.sqrt(share) for name, share in shares.items()},
        "central_m": float(np.sqrt(np.mean(central.error[:, part] ** 2))),
    }


def to_tolerance(machine: Machine, wanted: Wanted, shortest: int, *, quick: bool) -> dict[str, Any]:
    """The least time to the specified accuracy when the rest of the motion may take longer."""
    task = Task(machine.plant, machine.friction, machine.sample_time, shortest + 8, wanted.stroke, "peak_thrust", 2)
    tolerance = machine.specification.tolerance
    limits = Limits(wanted.limits.thrust, wanted.limits.slew, tolerance)
    count, tried = least_settling_time(
        build(task),
        schemes.slip_states(machine),
        limits,
        ratios=schemes.COARSE_SMOOTHING[:1] if quick else CONTINUATION,
    )
    return {
        "tolerance_m": tolerance,
        "time_s": schemes.rest_time(machine, count),
        "solves": len(tried),
        "iterations": [one.solution.iterations for one in tried.values()],
    }


def shortest_motion(
    machine: Machine, shortest: int, tried: Mapping[int, Trajectory], tolerance: Mapping[str, Any]
) -> dict[str, Any]:
    """The shortest motion, the other candidates of the search, and the least time to the specified accuracy."""
    counts = sorted(tried)
    return {
        "samples": shortest,
        "rest_s": schemes.rest_time(machine, shortest),
        "tried": [{"time_s": schemes.rest_time(machine, count), "peak_N": tried[count].peak} for count in counts],
        "to_tolerance": tolerance,
    }


def rest_at_rated_thrust(machine: Machine, wanted: Wanted, shortest: int, tried: Mapping[int, Trajectory]) -> float:
    """When [s] the table rests at the earliest if the trajectory may take all of the rated thrust; tried: what the
    search within the limits tried."""
    whole = replace(wanted, limits=Limits(machine.drive.rated_thrust, wanted.limits.slew))
    return schemes.rest_time(machine, schemes.quickest(machine, whole, shortest, known=tried)[0])


def failed_iterate(machine: Machine, wanted: Wanted, shortest: int) -> dict[str, Any] | None:
    """The problem one sample shorter than possible: the iterate at which IPOPT stops, and what to do.

    None where it has fewer samples than conditions, or where this objective converges all the same.
    """
    count = shortest - 1
    if count < schemes.least_samples(machine.plant, machine.sample_time):
        return None
    task = Task(machine.plant, machine.friction, machine.sample_time, count, wanted.stroke, "energy", 2)
    found = solve(build(task), schemes.slip_states(machine), wanted.limits)
    if found.solution.converged:
        return None
    return {
        "time_s": schemes.rest_time(machine, count),
        "step_s": np.arange(count + 1) * machine.sample_time,
        "thrust_N": [*found.thrust[0], found.hold[0]],
        "position_m": found.position,
        "converged": found.solution.converged,
        "status": found.solution.status.replace("_", " "),
        "iterations": found.solution.iterations,
        "violation": found.solution.violation,
        "advice": found.solution.advice,
    }
