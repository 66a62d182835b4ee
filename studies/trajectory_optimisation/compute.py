"""The study: design, trade-offs and the comparison on perturbed tables; plain results, no drawing."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.controller import design_deadbeat, reference_delay_samples, usable_thrust
from design.deadbeat import Constraints, Deadbeat, DesignError, shortest_settling_time, synthesise
from design.deployment.drive_file import controller_to_json
from design.judging.known_range import excess, excess_to_json, fastest
from design.trajectory import schemes
from design.trajectory.compensator import compensate
from design.trajectory.history_aware import (
    OBJECTIVES,
    Limits,
    Task,
    Trajectory,
)
from design.trajectory.learning import learning_to_json, sensitivities
from design.trajectory.robust import RobustTrajectory
from design.trajectory.schemes import MAX_MOTION_SAMPLES, Scheme, Wanted, profile_of
from design.validation import BATCH, PERIODS, sequence
from models.controller import Controller
from models.machine import Machine, parameters
from models.quantity import keeps_to, show
from studies.as_known import limit_rows
from studies.beforehand import require_designable, require_pid
from studies.compensator import with_elements
from studies.effort import SIMULATED, foresee, period, seconds_a_sample
from studies.options import BadInputError
from studies.perturbed import MODE_RANGE, RANGE, STRICT_TOLERANCE_SHARE
from studies.study import Answer, Check, Progress
from studies.trajectory_optimisation.certificate import certify, held
from studies.trajectory_optimisation.comparison import compare, contestants
from studies.trajectory_optimisation.everything import everything, tables_of
from studies.trajectory_optimisation.members import on_members
from studies.trajectory_optimisation.options import TrajectoryOptions
from studies.trajectory_optimisation.outcomes import ERRORS, VIBRATION, Aim
from studies.trajectory_optimisation.tradeoff import (
    failed_iterate,
    pareto,
    rest_at_rated_thrust,
    shortest_motion,
    to_tolerance,
)
from studies.wording import beyond_records as told
from studies.wording import cited

Array = NDArray[np.float64]

# Beyond so many times the distance over which the last element slips, history hardly counts.
LONGEST_STROKE: Final = 10.0
SCHEMES: Final = 10  # that are judged on every table, those that learn counting more
DESIGNS: Final = 60  # times the time of the first design that all of them take
DESIGNS_QUICK: Final = 10
AIMED_SPREAD: Final = 0.8  # of the fine tolerance: 0.4 um on the default machine
RESERVE: Final = 0.7  # So much of T_fc is kept of the rated thrust, for the feedback and for tables with more friction.


@dataclass(frozen=True)
class _Designs:
    """What was designed: the least number of samples that the thrust allows, with all that was tried for it; how many
    the motions take; and the trajectories. `asked` is by the objective that was asked for, and may not have converged.
    """

    shortest: int
    tried: Mapping[int, Trajectory]
    samples: int
    deadbeat: Deadbeat
    peak: Trajectory
    asked: Trajectory
    copies: int
    robust: RobustTrajectory

    @property
    def chosen(self) -> Trajectory:
        """The design used on the tables: an iterate that did not converge is shown but not used."""
        return self.asked if self.asked.solution.converged else self.peak


def compute(machine: Machine, options: TrajectoryOptions, progress: Progress) -> Answer:
    """Answers the study's question for `machine`. Raises BadInputError for options that can't be met."""
    wanted = _wanted(machine, options)
    aim = Aim(wanted.stroke, wanted.tolerance, wanted.settling_time)
    _foresee(machine, options, progress)
    made = _designed(machine, wanted, options, progress)
    progress(0.35, "certificate of the smoothing")
    certificate = _certificate(machine, wanted, made, options)
    progress(0.4, "settling time, thrust and sensitivity against each other")
    trade_off = pareto(machine, wanted, made.shortest, aim, {made.samples: made.peak}, quick=options.quick)
    shortest = {
        **shortest_motion(
            machine, made.shortest, made.tried, to_tolerance(machine, wanted, made.shortest, quick=options.quick)
        ),
        "rest_rated_s": rest_at_rated_thrust(machine, wanted, made.shortest, made.tried),
    }
    progress(0.6, "judging on nonsmooth tables")
    counted = with_elements(machine, options, progress, made.deadbeat, shares=(0.6, 0.62))
    entrants = contestants(counted.machine, wanted, (made.deadbeat, made.peak, made.chosen, made.robust))
    judged = compare(machine, wanted, aim, options, entrants, progress)
    progress(0.82, "judging on the tables that behave as the paper says")
    members = on_members(machine, wanted, aim, options, entrants, made.samples, progress)
    learner = next(one.learning for one in entrants if one.key == "learning")
    assert learner is not None
    all_of_it = everything(counted.machine, wanted, aim, options, learner, progress)
    progress(0.95, "collecting the results")
    results = {
        "quick": options.quick,
        "wanted": _plain_wanted(machine, wanted, options),
        "shortest": shortest,
        "certificate": certificate,
        "designs": _signals(machine, made),
        "failed": failed_iterate(machine, wanted, made.shortest),
        "pareto": trade_off,
        **_assumed(machine),
        **judged,
        "members": members,
        "everything": all_of_it,
        **counted.results,
        "beyond": _beyond(machine, made.chosen, judged["rows"]),
        "fell_back": made.chosen is not made.asked,
        "solver": _solver(made),
        "parameters": [vars(one) | {"provenance": one.provenance.plain} for one in parameters(machine)],
    }
    files = {"controller.json": _controller_file(machine, wanted, made.chosen, learner)}
    return Answer(
        results, _checks(machine, wanted, results), files, [*_summary(results), *limit_rows(machine), *counted.summary]
    )


def _foresee(machine: Machine, options: TrajectoryOptions, progress: Progress) -> None:
    """The time of judging; that of the designs is bounded by MAX_MOTION_SAMPLES, and known once the first is made."""
    tables = 1 + (options.tables or (8 if options.quick else 200))
    samples = PERIODS * period(machine)
    judged = 2 * (SCHEMES * tables + tables_of(options)) * samples * seconds_a_sample(machine)
    foresee({"judging": judged}, BATCH * samples * SIMULATED, options, progress)


def _foresee_designs(taken: float, options: TrajectoryOptions, progress: Progress) -> None:
    """The time of all designs after the shortest motion's, whose processor time [s] says what a program takes."""
    foresee({"the designs": (DESIGNS_QUICK if options.quick else DESIGNS) * taken}, 0.0, options, progress)


def _designed(machine: Machine, wanted: Wanted, options: TrajectoryOptions, progress: Progress) -> _Designs:
    """All designs. Raises BadInputError where no motion keeps to the thrust."""
    progress(0.02, "the shortest motion that the thrust allows")
    try:
        aimed = schemes.samples_for(machine, wanted.settling_time)
        begin = time.process_time()
        shortest, tried = schemes.quickest(machine, wanted, aimed)
        _foresee_designs(time.process_time() - begin, options, progress)
        samples = max(shortest, aimed)
        deadbeat = deadbeat_beside(machine, wanted.stroke)
    except DesignError as error:
        raise BadInputError(f"--settling-time, --stroke, --thrust-limit: {error}") from error
    progress(0.06, "least peak thrust over all histories")
    _, peak = schemes.least_peak(machine, wanted, samples)
    asked, copies = peak, 0
    progress(0.1, f"history-aware: {OBJECTIVES[options.objective]}")
    if options.objective == "sensitivity":
        errors = replace(ERRORS, length=0.0, mass=0.0) if options.quick else ERRORS
        _, asked, scenarios = schemes.least_sensitive(machine, wanted, peak, errors)
        copies = len(scenarios)
    elif options.objective != "peak_thrust":
        _, asked = schemes.aware(machine, wanted, _renamed(peak.task, options.objective))
    progress(0.2, "one trajectory for all histories")
    effort: dict[str, Any] = {"seen": 2, "ratios": schemes.COARSE_SMOOTHING[:1], "rounds": 1} if options.quick else {}
    robust = schemes.robust_trajectory(machine, wanted, peak, options.common_objective, **effort)  # type: ignore[arg-type]
    return _Designs(shortest, tried, samples, deadbeat, peak, asked, copies, robust)


def _certificate(machine: Machine, wanted: Wanted, made: _Designs, options: TrajectoryOptions) -> dict[str, Any]:
    """The error of the smoothed friction, and that of friction once a sample over the motions."""
    certificate = certify(machine, made.peak, options.seed, quick=options.quick)
    target = sequence(machine, wanted.stroke, periods=1)
    for name, one in (("held_peak", made.peak), ("held_chosen", made.chosen)):
        certificate[name] = held(machine, compensate(profile_of(machine, one), machine.friction, target), target)
    return certificate


def _assumed(machine: Machine) -> dict[str, Any]:
    """The variation of the tables used for validation, the length of their simulation, and for how long [s] errors
    after a motion and the vibration after the settling time are looked at."""
    time = machine.specification.settling_time
    return {
        "error_window_s": schemes.LOOK * time,
        "vibration_window_s": VIBRATION * time,
        "errors": vars(ERRORS),
        "range": {
            "friction_force": RANGE.friction_force,
            "presliding_length": RANGE.friction_length,
            "mass": RANGE.mass,
            "mode_frequency": MODE_RANGE,
        },
        "periods": PERIODS,
    }


def _beyond(machine: Machine, chosen: Trajectory, rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """What the motions need beyond the range of force and speed of the records that the machine is from."""
    force = max(row["central"]["peak_thrust_N"] for row in rows if row["key"] in ("aware", "learning"))
    speed = fastest(chosen.position, machine.sample_time, machine)
    return excess_to_json("the trajectory", excess(machine, min(force, machine.drive.rated_thrust), speed))


def _summary(results: Mapping[str, Any]) -> list[tuple[str, str]]:
    row = results["everything"]["rows"][-1]
    fine, count = row["fine_aim"], row["tables"]
    return [
        *((f"WARNING, {one['design']}", told(one)) for one in results["beyond"]),
        ("shortest time to rest within the thrust", show(results["shortest"]["rest_s"], "s")),
        (
            "tables off in everything that meet the fine aim after learning (at least, with 95 % confidence)",
            f"{fine['hits']} of {count} ({100 * fine['low']:.1f} %)",
        ),
        *(
            (row["name"] + ", 95 % of 3 sigma", show(row["ensemble"]["dispersion_m"], "m", 3))
            for row in results["rows"]
        ),
    ]


def _wanted(machine: Machine, options: TrajectoryOptions) -> Wanted:
    require_pid(machine)
    require_designable(machine)
    specification, rated = machine.specification, machine.drive.rated_thrust
    stroke = specification.stroke if options.stroke is None else options.stroke
    aimed = specification.reference_settling_time if options.settling_time is None else options.settling_time
    tolerance = STRICT_TOLERANCE_SHARE * specification.tolerance if options.tolerance is None else options.tolerance
    limit = options.thrust_limit
    slew = math.inf if options.slew is None else options.slew
    if limit is not None and not 0 < limit <= rated:
        raise BadInputError(f"--thrust-limit: {show(limit, 'N')} must be between 0 and the rated {show(rated, 'N')}")
    left = rated - RESERVE * machine.friction.coulomb_force - abs(machine.drive.offset)
    if limit is not None and limit <= machine.friction.coulomb_force:
        raise BadInputError(
            f"--thrust-limit: friction alone takes {show(machine.friction.coulomb_force, 'N')} of {show(limit, 'N')}; "
            "allow more"
        )
    if limit is None and left <= machine.friction.coulomb_force:
        raise BadInputError(
            f"--machine: friction takes {show(machine.friction.coulomb_force, 'N')} and drive.offset "
            f"{show(abs(machine.drive.offset), 'N')} of the rated {show(rated, 'N')}; give a stronger "
            "drive.rated_thrust, less friction or less offset"
        )
    if aimed >= specification.interval / 2:
        raise BadInputError(
            f"--settling-time: {show(aimed, 's')} must be well below the {show(specification.interval, 's')} from one "
            "motion to the next; give less"
        )
    _check_size(machine, stroke, aimed)
    return Wanted(stroke, tolerance, aimed, Limits(left if limit is None else limit, slew))


def _check_size(machine: Machine, stroke: float, aimed: float) -> None:
    """Raises BadInputError for a motion on which history has no influence, and for one of too many samples."""
    reach = 2 * max(machine.friction.limit)
    if not keeps_to(stroke, LONGEST_STROKE * reach):  # or it may be refused for what it is told to be
        raise BadInputError(
            f"--machine, --stroke: all friction elements slip within {show(reach, 'm')} of a stroke of "
            f"{show(stroke, 'm')}, so that history hardly matters; give a stroke of at most "
            f"{show(LONGEST_STROKE * reach, 'm')}, or design this one with deadbeat_design"
        )
    if aimed > MAX_MOTION_SAMPLES * machine.sample_time:
        raise BadInputError(
            f"--settling-time: {show(aimed, 's')} are {aimed / machine.sample_time:.0f} samples, the optimal control "
            f"supports at most {MAX_MOTION_SAMPLES}; give at most "
            f"{show(MAX_MOTION_SAMPLES * machine.sample_time, 's')}, or design this motion with deadbeat_design"
        )


def deadbeat_beside(machine: Machine, stroke: float) -> Deadbeat:
    """The deadbeat that the designs are compared with, over a stroke [m]: x_T* by the specified time, as in the paper,
    or as soon as the thrust allows.

    Raises DesignError if the thrust allows none.
    """
    plant, ts, aimed = machine.plant, machine.sample_time, machine.specification.reference_settling_time
    within = Constraints(thrust=usable_thrust(machine))
    shortest = shortest_settling_time(plant, ts, stroke, within)
    if keeps_to(shortest, aimed):
        return synthesise(plant, ts, aimed, stroke)
    return design_deadbeat(machine, settling_time=shortest, stroke=stroke, constraints=within)


def _renamed(task: Task, objective: Any) -> Task:
    """The same task with another objective."""
    return replace(task, objective=objective)


def _signals(machine: Machine, made: _Designs) -> dict[str, dict[str, Any]]:
    """x_T* and u_ff of each design over time."""

    def signals(position: Array, thrusts: Sequence[Array]) -> dict[str, Any]:
        time = np.arange(len(position)) * machine.sample_time
        return {"time_s": time, "position_m": position, "thrust_N": thrusts}

    def of(found: Trajectory) -> dict[str, Any]:
        return signals(found.position, list(np.column_stack([found.thrust, found.hold])))

    return {
        "deadbeat": signals(made.deadbeat.position, [np.append(made.deadbeat.thrust, 0.0)]),
        "peak": of(made.peak),
        "aware": of(made.asked),
        "common": signals(made.robust.position, [made.robust.thrust]),
    }


def _solver(made: _Designs) -> list[dict[str, Any]]:
    """The solver's statistics of each design."""
    cases: tuple[tuple[str, Trajectory | RobustTrajectory, int], ...] = (
        ("history-aware, least peak", made.peak, 0),
        ("history-aware, chosen", made.asked, made.copies),
        ("one for all", made.robust, len(made.robust.task.scenarios)),
    )
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
        for name, found, copies in cases
    ]


def _controller_file(machine: Machine, wanted: Wanted, chosen: Trajectory, scheme: Scheme) -> dict[str, Any]:
    """controller.json: n_ff and d_ff give x_T* and the net thrust; the friction to follow is the machine's own.

    `wipe` makes the friction's state known; `learning` is what learning needs to know beforehand.
    """
    motion = profile_of(machine, chosen)
    n_ff, d_ff, path_ff = (
        tuple((np.diff(signal, prepend=0.0) / motion.stroke).tolist())
        for signal in (motion.position, motion.net, motion.middle)
    )
    pid, delay = machine.control.pid, reference_delay_samples(machine)
    controller = Controller(machine.sample_time, pid, delay, n_ff, d_ff, machine.friction, path_ff=path_ff)
    return {
        **controller_to_json(
            machine,
            controller,
            wanted.stroke,
            chosen.task.samples * machine.sample_time,
        ),
        "trajectory": {
            "design": "history-aware",
            "objective": chosen.task.objective,
            "position_m": motion.position,
            "net_thrust_N": motion.net,
            "middle_m": motion.middle,
        },
        "learning": learning_to_json(sensitivities(machine, scheme, wanted.stroke), machine, scheme, wanted.stroke),
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


def _checks(machine: Machine, wanted: Wanted, results: Mapping[str, Any]) -> tuple[Check, ...]:
    certificate, source = results["certificate"], cited(machine, "specification.settling_time")
    excess = max(f / b for f, b in zip(certificate["force_N"], certificate["bound_N"], strict=True))
    return (
        *_aims(wanted, results["rows"], source, ""),
        *_aims(wanted, results["fresh"]["rows"], source, "; seed not used before"),
        *_over_everything(wanted, results["everything"]["rows"][-1]),
        Check("smoothed force over its bound", excess, "1", 1.0 + 1e-9, "smooth_friction"),
        Check("designs that did not converge", sum(not one["converged"] for one in results["solver"]), "1", 0, "IPOPT"),
    )


def _over_everything(wanted: Wanted, row: Mapping[str, Any]) -> tuple[Check, ...]:
    """The aims on tables that are off in everything at once and have learned."""
    within = f"within {show(wanted.tolerance, 'm')} by {show(wanted.settling_time, 's')}"
    spread = AIMED_SPREAD * wanted.tolerance
    return (
        Check(f"tables off in everything, every motion {within}", row["fine_aim"]["share"], "1", 0.99, "aim", ">="),
        Check("3 sigma, 95 % of the tables off in everything", row["dispersion_m"], "m", spread, "aim"),
    )


def _aims(wanted: Wanted, judged: Sequence[Mapping[str, Any]], source: str, where: str) -> tuple[Check, ...]:
    """The aims on one set of tables, which `where` names; source: of the specified time."""
    rows = {row["key"]: row for row in judged}
    best, paper = rows["learning"], rows["paper"]
    in_time = f"tables with every motion within {show(wanted.tolerance, 'm')} by {show(wanted.settling_time, 's')}"
    shares = (
        (in_time, "fine_aim", 0.99, "aim"),
        ("tables with every motion settled by the specified time", "specified", 0.99, source),
        ("tables with thrust within the rating", "thrust", 1.0, "drive.rated_thrust"),
    )
    ratio = best["ensemble"]["dispersion_m"] / paper["ensemble"]["dispersion_m"]
    return (
        Check(f"3 sigma, 95 % of the tables, over deadbeat and RFM{where}", ratio, "1", 0.5, "aim: half of it"),
        *(Check(f"{name}{where}", best["yield"][key], "1", least, source, ">=") for name, key, least, source in shares),
    )
