"""The study: design, trade-offs and the comparison on perturbed tables; plain results, no drawing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.controller import waiting
from design.deadbeat import Deadbeat, DesignError, synthesise
from design.trajectory.compensator import compensate
from design.trajectory.history_aware import (
    OBJECTIVES,
    Limits,
    Task,
    Trajectory,
)
from design.validation import PERIODS, sequence
from models.controller import Controller, to_json
from models.machine import Machine, parameters
from models.quantity import show
from studies.options import BadInputError
from studies.study import Answer, Check, Progress
from studies.trajectory_optimisation import designs
from studies.trajectory_optimisation.certificate import certify, held
from studies.trajectory_optimisation.comparison import compare, contestants
from studies.trajectory_optimisation.designs import Wanted, motion_of
from studies.trajectory_optimisation.members import on_members
from studies.trajectory_optimisation.options import TrajectoryOptions
from studies.trajectory_optimisation.outcomes import MODE_RANGE, RANGE, Aim
from studies.trajectory_optimisation.tradeoff import (
    failed_iterate,
    pareto,
    rest_at_rated_thrust,
    shortest_motion,
    to_tolerance,
)

Array = NDArray[np.float64]

LONGEST_STROKE: Final = 10.0  # of the way on which the last element slips: beyond, history has no part in a motion
MOST_SAMPLES: Final = 120  # of a motion: three times those of the paper's
RESERVE: Final = 0.7  # of T_fc, kept of the rated thrust for the feedback and for tables with more friction


def compute(machine: Machine, options: TrajectoryOptions, progress: Progress) -> Answer:
    """Answers the study's question for `machine`. Raises BadInputError for options that can't be met."""
    wanted = _wanted(machine, options)
    aim = Aim(wanted.stroke, wanted.tolerance, wanted.settling_time)
    progress(0.02, "the shortest motion that the thrust allows")
    try:
        shortest, tried = designs.quickest(machine, wanted, designs.samples_for(machine, wanted.settling_time))
        count = max(shortest, designs.samples_for(machine, wanted.settling_time))
        deadbeat = _deadbeat(machine, wanted)
    except DesignError as error:
        raise BadInputError(f"--settling-time, --stroke, --thrust-limit: {error}") from error
    progress(0.06, "least peak thrust over all histories")
    _, peak = designs.least_peak(machine, wanted, count)
    found, scenarios = peak, None
    progress(0.1, f"history-aware: {OBJECTIVES[options.objective]}")
    if options.objective == "sensitivity":
        _, found, scenarios = designs.least_sensitive(machine, wanted, peak, quick=options.quick)
    elif options.objective != "peak_thrust":
        _, found = designs.aware(machine, wanted, _renamed(peak.task, options.objective))
    chosen = found if found.solution.converged else peak  # a failed iterate is shown, and drives no table
    progress(0.2, "one trajectory for all histories")
    common = designs.one_for_all(machine, wanted, peak, options.common_objective, quick=options.quick)
    progress(0.35, "certificate of the smoothing")
    certificate = certify(machine, peak, options.seed, quick=options.quick)
    target = sequence(machine, wanted.stroke, periods=1)
    for name, one in (("held_peak", peak), ("held_chosen", chosen)):
        certificate[name] = held(machine, compensate(motion_of(machine, one), machine.friction, target), target)
    progress(0.4, "settling time, thrust and sensitivity against each other")
    trade_off = pareto(machine, wanted, shortest, aim, quick=options.quick)
    tolerance = to_tolerance(machine, wanted, shortest, quick=options.quick)
    progress(0.6, "judging on nonsmooth tables")
    schemes = contestants(machine, wanted, (deadbeat, peak, chosen, common))
    judged = compare(machine, wanted, aim, options, schemes, progress)
    progress(0.82, "judging on the tables that behave as the paper says")
    members = on_members(machine, wanted, aim, options, schemes, count, progress)
    progress(0.95, "collecting the results")
    results = {
        "quick": options.quick,
        "wanted": _plain_wanted(machine, wanted, options),
        "shortest": {
            **shortest_motion(machine, shortest, tried, tolerance),
            "rest_rated_s": rest_at_rated_thrust(machine, wanted, shortest),
        },
        "certificate": certificate,
        "designs": _designs(machine, deadbeat, peak, found, common),
        "failed": failed_iterate(machine, wanted, shortest),
        "pareto": trade_off,
        "errors": vars(designs.ERRORS),
        "range": {
            "friction_force": RANGE.friction_force,
            "presliding_length": RANGE.friction_length,
            "mass": RANGE.mass,
            "mode_frequency": MODE_RANGE,
        },
        "periods": PERIODS,
        **judged,
        "members": members,
        "fell_back": chosen is not found,
        "solver": _solver(peak, found, common, 0 if scenarios is None else len(scenarios)),
        "parameters": [vars(one) | {"provenance": vars(one.provenance)} for one in parameters(machine)],
    }
    files = {"controller.json": _controller_file(machine, wanted, chosen)}
    summary = [
        ("shortest time to rest within the thrust", show(results["shortest"]["rest_s"], "s")),
        *((row["name"] + ", 95 % of 3 sigma", show(row["ensemble"]["dispersion_m"], "m", 3)) for row in judged["rows"]),
    ]
    return Answer(results, _checks(wanted, results), files, summary)


def _wanted(machine: Machine, options: TrajectoryOptions) -> Wanted:
    specification, rated = machine.specification, machine.drive.rated_thrust
    stroke = specification.stroke if options.stroke is None else options.stroke
    aimed = specification.reference_settling_time if options.settling_time is None else options.settling_time
    tolerance, limit = options.tolerance, options.thrust_limit
    slew = math.inf if options.slew is None else options.slew
    if limit is not None and not 0 < limit <= rated:
        raise BadInputError(f"--thrust-limit: {show(limit, 'N')} is not between 0 and the rated {show(rated, 'N')}")
    left = rated - RESERVE * machine.friction.coulomb_force - abs(machine.drive.offset)
    if limit is not None and limit <= machine.friction.coulomb_force:
        raise BadInputError(
            f"--thrust-limit: friction alone takes {show(machine.friction.coulomb_force, 'N')} of {show(limit, 'N')}; "
            "allow more"
        )
    if limit is None and left <= machine.friction.coulomb_force:
        raise BadInputError(
            f"--machine: friction takes {show(machine.friction.coulomb_force, 'N')} of the rated {show(rated, 'N')}; "
            "give a stronger drive.rated_thrust or less friction"
        )
    if aimed >= specification.interval / 2:
        raise BadInputError(
            f"--settling-time: {show(aimed, 's')} is not well below the {show(specification.interval, 's')} from one "
            "motion to the next; give less"
        )
    _check_size(machine, stroke, aimed)
    return Wanted(stroke, tolerance, aimed, Limits(left if limit is None else limit, slew))


def _check_size(machine: Machine, stroke: float, aimed: float) -> None:
    """Raises BadInputError for a motion in which history has no part, and for one of too many samples."""
    reach = 2 * max(machine.friction.limit)
    if stroke > LONGEST_STROKE * reach:
        raise BadInputError(
            f"--machine, --stroke: all friction elements slip within {show(reach, 'm')} of a stroke of "
            f"{show(stroke, 'm')}, so that what they remember hardly counts; give a stroke of at most "
            f"{show(LONGEST_STROKE * reach, 'm')}, or design this one with deadbeat_design"
        )
    if aimed > MOST_SAMPLES * machine.sample_time:
        raise BadInputError(
            f"--settling-time: {show(aimed, 's')} are {aimed / machine.sample_time:.0f} samples, the optimal control "
            f"is made for {MOST_SAMPLES} at most; give at most {show(MOST_SAMPLES * machine.sample_time, 's')}, or "
            "design this motion with deadbeat_design"
        )


def _deadbeat(machine: Machine, wanted: Wanted) -> Deadbeat:
    """The deadbeat beside which all is judged: x_T* by the specification's time, as the paper has it."""
    return synthesise(machine.plant, machine.sample_time, machine.specification.reference_settling_time, wanted.stroke)


def _renamed(task: Task, objective: Any) -> Task:
    return Task(
        task.plant, task.friction, task.sample_time, task.samples, task.stroke, objective, histories=task.histories
    )


def _designs(
    machine: Machine, deadbeat: Deadbeat, peak: Trajectory, chosen: Trajectory, common: Any
) -> dict[str, dict[str, Any]]:
    ts = machine.sample_time

    def signals(position: Array, thrusts: Sequence[Array]) -> dict[str, Any]:
        return {"time_s": np.arange(len(position)) * ts, "position_m": position, "thrust_N": thrusts}

    return {
        "deadbeat": signals(deadbeat.position, [np.append(deadbeat.thrust, 0.0)]),
        "peak": signals(peak.position, list(np.column_stack([peak.thrust, peak.hold]))),
        "aware": signals(chosen.position, list(np.column_stack([chosen.thrust, chosen.hold]))),
        "common": signals(common.position, [common.thrust]),
    }


def _solver(peak: Trajectory, chosen: Trajectory, common: Any, scenarios: int) -> list[dict[str, Any]]:
    return [
        {
            "design": name,
            "variables": int(sum(np.size(value) for value in found.solution.values.values())),
            "iterations": found.solution.iterations,
            "status": found.solution.status.replace("_", " "),
            "converged": found.solution.converged,
            "advice": found.solution.advice,
            "ratio": found.ratio,
            "copies": copies,
        }
        for name, found, copies in (
            ("history-aware, least peak", peak, 0),
            ("history-aware, chosen", chosen, scenarios),
            ("one for all", common, len(common.task.scenarios)),
        )
    ]


def _controller_file(machine: Machine, wanted: Wanted, chosen: Trajectory) -> dict[str, Any]:
    """controller.json: n_ff and d_ff give x_T* and the net thrust; the friction to follow is the machine's own."""
    motion = motion_of(machine, chosen)
    filters = designs.polynomials(motion)
    control = machine.control
    controller = Controller(
        machine.sample_time,
        control.pid,
        waiting(machine),
        tuple(filters["n_ff"]),
        tuple(filters["d_ff"]),
        machine.friction,
    )
    return {
        **to_json(controller, wanted.stroke, chosen.task.samples * machine.sample_time),
        "trajectory": {
            "design": "history-aware",
            "objective": chosen.task.objective,
            "position_m": motion.position,
            "net_thrust_N": motion.net,
            "middle_m": motion.middle,
        },
    }


def _plain_wanted(machine: Machine, wanted: Wanted, options: TrajectoryOptions) -> dict[str, Any]:
    return {
        "settling_time_s": wanted.settling_time,
        "stroke_m": wanted.stroke,
        "tolerance_m": wanted.tolerance,
        "thrust_limit_N": wanted.limits.thrust,
        "slew_N": wanted.limits.slew,
        "rated_N": machine.drive.rated_thrust,
        "objective": options.objective,
        "objective_meaning": OBJECTIVES[options.objective],
        "common_objective": options.common_objective,
    }


def _checks(wanted: Wanted, results: Mapping[str, Any]) -> tuple[Check, ...]:
    certificate = results["certificate"]
    excess = max(f / b for f, b in zip(certificate["force_N"], certificate["bound_N"], strict=True))
    return (
        *_aims(wanted, results["rows"], ""),
        *_aims(wanted, results["fresh"]["rows"], "; seed not used before"),
        Check("smoothed force over its bound", excess, "1", 1.0 + 1e-9, "smooth_friction"),
        Check("designs that did not converge", sum(not one["converged"] for one in results["solver"]), "1", 0, "IPOPT"),
    )


def _aims(wanted: Wanted, judged: Sequence[Mapping[str, Any]], where: str) -> tuple[Check, ...]:
    """The aims on one set of tables, which `where` names."""
    rows = {row["key"]: row for row in judged}
    best, paper = rows["learning"], rows["paper"]
    in_time = f"tables with every motion within {show(wanted.tolerance, 'm')} by {show(wanted.settling_time, 's')}"
    shares = (
        (in_time, "fine_aim", 0.99, "aim"),
        ("tables with every motion settled by the specified time", "specified", 0.99, "II.D"),
        ("tables with thrust within the rating", "thrust", 1.0, "drive.rated_thrust"),
    )
    ratio = best["ensemble"]["dispersion_m"] / paper["ensemble"]["dispersion_m"]
    return (
        Check(f"3 sigma, 95 % of the tables, over the paper's scheme{where}", ratio, "1", 0.5, "aim: half of it"),
        *(Check(f"{name}{where}", best["yield"][key], "1", least, source, ">=") for name, key, least, source in shares),
    )
