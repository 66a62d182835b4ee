"""What `pid_tradeoff` computes: the certified front, the present PID beside it, the limits, and a recommendation."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.controller import default_controller
from design.deployment.drive_file import controller_to_json
from design.effect_compensation import left_out, with_effects
from design.family import Member, family, slopes, usual_errors
from design.family import with_effects as plant_with_effects
from design.judging.known_range import excess_of, excess_to_json
from design.limits import bode_area, highest_crossover, least_sensitivity
from design.loop import DIAGRAM, assess, controller_response, frequency_response, grid, intersample, sensitivities
from design.pid.front import LAMBDAS, RULE_TIMES, Front, Point, assessed_point, rules, tuned
from design.pid.goal import OBJECTIVES, Goal
from design.pid.problem import Bounds, TuningError, mt_bound
from design.pid.rules import magnitude
from design.pid.tuning import noise_bound, pose, tune
from design.validation import BATCH, Validation, validate_many
from models.controller import PID, Controller, Feedback
from models.ensemble import DEFAULT as ENSEMBLE
from models.ensemble import load_ensemble
from models.friction import branch
from models.machine import Machine, MachineError, with_pid
from models.plant import Plant
from models.quantity import keeps_to, show
from studies.as_known import limit_rows
from studies.beforehand import require_controller
from studies.compensator import with_elements
from studies.effort import SIMULATED, foresee, period, seconds_a_sample
from studies.options import BadInputError
from studies.pid_tradeoff import ensemble
from studies.pid_tradeoff.checks import made
from studies.pid_tradeoff.options import TradeoffOptions
from studies.pid_tradeoff.published import compare
from studies.pid_tradeoff.refusal import refusal
from studies.pid_tradeoff.rows import MOST_RUNS, nonsmooth, over_runs, point_row, summary
from studies.scattered import scattered
from studies.study import Answer, Progress

LEVELS: Final = tuple(round(1.2 + 0.1 * i, 1) for i in range(19))  # The bounds on |S| that PIDs are tuned for.
QUICK_LEVELS: Final = (1.4, 2.4, 3.0)
ASSESSMENTS: Final = 10  # of each plant's loop that the tuning of one level takes the time of, about
QUICK_MEMBERS: Final = 10  # A quick run takes one machine of an ensemble out of so many.
QUICKER: Final = 0.05  # of a settling time, by which a feedback is better than another
BELOW_CROSSOVER: Final = 0.1  # of a loop's crossover: from there on it is drawn in Nyquist's plot
DRAWN_SETTLING_TIMES: Final = 4.0  # The figures show so many settling times of the reversal.
# The path between the samples is shown for so many settling times after a step of friction.
INTERSAMPLE_SETTLING_TIMES: Final = 2.0
POINTS_PER_SAMPLE: Final = 10  # That path has so many points a sample.


@dataclass(frozen=True)
class _TradeOff:
    """What was tuned: the family's plants, the goal, the bounds of the chosen point, the present PID, and the front."""

    members: tuple[Member, ...]
    goal: Goal
    limits: Bounds
    present: Point
    front: Front
    chosen: Point


def compute(machine: Machine, options: TradeoffOptions, progress: Progress) -> Answer:
    """Answers the study's question for `machine`. Raises BadInputError for options that can't be met."""
    wanted, others = _wanted(machine, options), _ensemble(options)
    controller = require_controller(machine)
    _foresee(machine, options, wanted, len(others), progress)
    tuning = _tuned(machine, wanted, options, others, progress)
    members, limits, points, chosen = tuning.members, tuning.limits, tuning.front.points, tuning.chosen
    progress(0.55, "rules of thumb, and every point on the nonsmooth machine")
    every = [*points, tuning.present, *rules(machine, members)]
    validations = nonsmooth(machine, controller, every)
    rows = [point_row(machine, members, point, v) for point, v in zip(every, validations, strict=True)]
    for i in range(len(points) + 1):  # the front and the present PID; the rules of thumb are there to compare
        rows[i]["settling"] = over_runs(machine, controller, every[i], validations[i], options)
    progress(0.65, "what each limit costs")
    costs = _costs(machine, wanted, limits, chosen, quick=options.quick)
    progress(0.7, f"the PIDs on {len(others)} members of the ensemble")
    on_ensemble = _on_ensemble(machine, others, wanted, limits, controller, chosen, tuned=options.ensemble is not None)
    progress(0.8, "published optima, limits and certificates")
    counted = with_elements(with_pid(machine, chosen.pid, "this study"), options, progress, shares=(0.8, 0.85))
    own = with_elements(machine, options, progress, shares=(0.85, 0.9))  # the present feedback may need other ones
    fit, compensated = _compensated(own.machine, counted.machine, controller)
    results = {
        "quick": options.quick,
        "wanted": _asked(wanted, tuning),
        "diagram": DIAGRAM,
        "ensemble": on_ensemble,
        "family": [member.name for member in members],
        **_named(machine, tuning, rows),
        "attempts": [{"ms": ms, **vars(attempt)} for ms, attempt in tuning.front.attempts],
        "loops": _loops(members, chosen, machine.control.feedback, limits.mcs),
        "limits": _limits(machine, members[0], points, tuning.present, limits.mcs),
        "costs": costs,
        "dearest": max(costs, key=lambda cost: cost["ki_N_per_ms"] or 0.0),
        "published": compare(),
        "reversal": _reversal(machine, every, validations, (chosen, tuning.present, points[-1])),
        "between": _between(machine, chosen.pid),
        "compensated": [_outcome(one) for one in compensated],
        "keep_present": _keeps_present(tuning.present, compensated, limits.ms, machine),
        "effects": [effect.name for effect in machine.effects],
        "left_out": left_out(machine),
        "compensated_over_runs": scattered(counted.machine, fit, compensated[1], options, most=MOST_RUNS),
        "beyond": excess_to_json(
            "the specified motion with the chosen PID and compensation", excess_of(compensated[1])
        ),
        "force_N": _force(machine),
        **counted.results,
    }
    checks = made(members, points, results, compensated[1], machine)
    stroke, settling = machine.specification.stroke, machine.specification.reference_settling_time
    files = {"controller.json": controller_to_json(counted.machine, fit, stroke, settling)}
    return Answer(results, checks, files, [*summary(results), *limit_rows(machine), *counted.summary])


def _compensated(
    machine: Machine, fitted: Machine, controller: Controller
) -> tuple[Controller, tuple[Validation, ...]]:
    """The controller with the fitted machine's PID and compensation, of friction and of the effects that can be met,
    and what the present feedback and the PID achieve, each with the elements that its machine states."""
    present, fit = (
        with_effects(replace(controller, friction_compensation=default_controller(one).friction_compensation), one)
        for one in (machine, fitted)
    )
    fit = fit.with_feedback(fitted.control.pid)
    return fit, validate_many([machine, fitted], [present, fit])


def _keeps_present(present: Point, compensated: Sequence[Validation], ms: float, machine: Machine) -> bool:
    """Whether the present feedback is better where friction is compensated: it settles sooner by more than QUICKER, and
    keeps to the bound on |S| [1] or is the only one of both that is in time."""
    here, there = (one.slowest.settling_time for one in compensated)
    wanted = machine.specification.settling_time
    only = keeps_to(here, wanted) and not keeps_to(there, wanted)
    return here < (1 - QUICKER) * there and (present.ms <= ms or only)


def _tuned(
    machine: Machine,
    wanted: dict[str, Any],
    options: TradeoffOptions,
    others: Sequence[Machine],
    progress: Progress,
) -> _TradeOff:
    """The present PID on the family and the front. Raises BadInputError where no PID keeps to the bounds."""
    members = family(machine, wanted["mode_error"], wanted["mass_error"], others if options.ensemble else ())
    progress(0.02, f"the present PID on {len(members)} plants")
    present = assessed_point("present", machine.control.pid, members, machine.control.law)
    limits = Bounds(wanted["ms"], wanted["mt"], _noise(machine, options.noise, present))
    goal = _goal(machine, options.objective)
    problem = pose(members, goal, magnitude(machine))
    levels = sorted({*(QUICK_LEVELS if options.quick else LEVELS), wanted["ms"]})
    progress(0.05, f"tuning {len(levels)} points of the front")
    try:
        front = tuned(problem, levels, limits, machine)
    except TuningError as error:
        raise BadInputError(f"--ms, --mt, --noise: {refusal(machine, error, levels[-1])}") from error
    chosen = front.nearest(wanted["ms"])
    return _TradeOff(members, goal, replace(limits, ms=chosen.bound or wanted["ms"]), present, front, chosen)


def _foresee(
    machine: Machine, options: TradeoffOptions, wanted: Mapping[str, Any], others: int, progress: Progress
) -> None:
    """The time of all points and members over four periods, and of tuning: so many assessments of a loop a level."""
    levels = len(QUICK_LEVELS if options.quick else LEVELS) + 1
    feedback, plants = machine.control.feedback, family(machine, wanted["mode_error"], wanted["mass_error"])
    begin = time.process_time()
    assess(plants[0].plant, feedback)
    loop = time.process_time() - begin
    runs = levels + len(RULE_TIMES) + len(LAMBDAS) + 4 * others
    seconds = {
        "the motions": runs * 4 * period(machine) * seconds_a_sample(machine),
        "tuning": levels * ASSESSMENTS * (len(plants) + others) * loop,
    }
    foresee(seconds, min(runs, BATCH) * 4 * period(machine) * SIMULATED, options, progress)


def _asked(wanted: dict[str, Any], tuning: _TradeOff) -> dict[str, Any]:
    """What was asked for, with the bound on |CS| and the objective in words."""
    objective = tuning.goal.objective
    return {
        **wanted,
        "mcs_N_per_m": tuning.limits.mcs,
        "objective": objective,
        "meaning": OBJECTIVES[objective],
    }


def _named(machine: Machine, tuning: _TradeOff, rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The rows by what they are: those of the front come first, then the present PID's, then those of the rules."""
    count = len(tuning.front.points)
    front, present, chosen = rows[:count], rows[count], rows[tuning.front.points.index(tuning.chosen)]
    return {
        "front": front,
        "present": present,
        "chosen": chosen,
        "fastest": min(front, key=lambda one: one["settling_s"]),
        "equal": _first_within(front, present["settling_s"]),
        "enough": _first_within(front, machine.specification.settling_time),
        "alone": _settles_alone(chosen, machine.specification.settling_time),
        "settling": [
            {"case": _called(row), "motion": "reversal", **row["settling"]["reversal"]} for row in (present, *front)
        ],
        "rules": rows[count + 1 :],
    }


def _settles_alone(row: Mapping[str, Any], wanted: float) -> bool:
    """Whether a PID's reversal is in time [s] by feedback alone, in the single run and in 95 % of those with a
    dither."""
    return all(keeps_to(row["settling"]["reversal"][key], wanted) for key in ("single_s", "quantile_s"))


def _wanted(machine: Machine, options: TradeoffOptions) -> dict[str, Any]:
    """What is asked for; the errors [1] that the family covers are those asked for, or see `usual_errors`."""
    mode, mass = usual_errors(machine)
    return {
        "ms": options.ms,
        "mt": math.inf if options.mt is None else options.mt,
        "mode_error": mode if options.mode_error is None else options.mode_error,
        "mass_error": mass if options.mass_error is None else options.mass_error,
        "errors_from": "as asked for, else as usual, or three of the machine file's own deviations where they are more",
    }


def _noise(machine: Machine, asked: float | None, present: Point) -> float:
    """The bound on |CS| [N/m]: as asked, or that of the present PID, or what an integral needs where that is more."""
    steepest = max(slopes(machine).values())
    if asked is None:
        return noise_bound(machine, present.loops)
    if asked <= steepest:
        raise BadInputError(
            f"--noise: {show(asked, 'N/m')} is too little; with an integral |CS| is at least the steepest contact "
            f"stiffness, {show(steepest, 'N/m')}, at low frequencies; give more"
        )
    return asked


def _ensemble(options: TradeoffOptions) -> tuple[Machine, ...]:
    """The machines of the given file; by default, the ensemble that the default machine was chosen from."""
    if options.ensemble is None and options.machine is not None:
        return ()
    try:
        others = load_ensemble(options.ensemble or ENSEMBLE)
    except MachineError as error:
        raise BadInputError(f"--ensemble: {error}") from error
    return others[:: QUICK_MEMBERS if options.quick else 1]


def _on_ensemble(
    machine: Machine,
    others: Sequence[Machine],
    wanted: dict[str, Any],
    limits: Bounds,
    controller: Controller,
    chosen: Point,
    *,
    tuned: bool,
) -> dict[str, Any] | None:
    """The PIDs' performance on every member and, unless the front was `tuned` for all of them, one PID that is."""
    if not others:
        return None
    feedbacks: dict[str, Feedback] = {"present": machine.control.feedback, "chosen": chosen.pid}
    outcome = None
    if not tuned:
        errors = wanted["mode_error"], wanted["mass_error"]
        found, outcome = ensemble.held(machine, others, errors, limits)
        feedbacks |= {"all members": found} if found else {}
    deadline = machine.specification.settling_time
    on_every = ensemble.on_every_member(others, controller, feedbacks, limits.ms, deadline)
    return {**on_every, "tuned": tuned, "outcome": outcome}


def _goal(machine: Machine, objective: Any) -> Goal:
    """The objective for this machine's specification: its times and the band below 1 / (2 pi settling time)."""
    begin = machine.specification.settling_time
    top = 1 / (2 * math.pi * begin)
    return Goal(objective, (top / 8, top), 2 * begin if objective == "band" else math.inf, begin, 2 * begin)


def _force(machine: Machine) -> float:
    return float(branch(machine.friction, machine.specification.stroke))


def _first_within(rows: Sequence[dict[str, Any]], time: float) -> dict[str, Any] | None:
    """The point of the front with the least Ms whose reversal settles within `time` [s], in the single run and in 95 %
    of those with a dither; None if there is none."""

    def longest(row: dict[str, Any]) -> float:
        return float(max(row["settling_s"], row["settling"]["reversal"]["quantile_s"]))

    return next((row for row in rows if longest(row) <= time), None)


def _called(row: dict[str, Any]) -> str:
    """A row of the front or the present PID, as a table names it."""
    name = "present" if row["name"] == "present" else "tuned"
    return f"{name}, Ms = {row['ms']:.2f}"


def _costs(
    machine: Machine, wanted: dict[str, Any], limits: Bounds, chosen: Point, *, quick: bool
) -> list[dict[str, Any]]:
    """The largest integral gain at the chosen bound on |S| when one limit is taken away."""
    plant = machine.plant
    cases: list[tuple[str, Machine, float, float, float]] = []

    def case(name: str, changed: Plant = plant, mode: float = 1.0, mass: float = 1.0, noise: float = 1.0) -> None:
        errors = wanted["mode_error"] * mode, wanted["mass_error"] * mass
        cases.append((name, replace(machine, plant=changed), *errors, noise))

    case("as it is")
    if plant.dead_time > 0:
        case("half the dead time", replace(plant, dead_time=plant.dead_time / 2))
    for i in plant.flexible:
        frequency = plant.modes[i].frequency
        case(
            f"no mode at {frequency:.3g} Hz",
            replace(plant, modes=tuple(m for m in plant.modes if m is not plant.modes[i])),
        )
    if plant.flexible:
        case("modes' frequencies known", mode=0.0)
    case("mass known", mass=0.0)
    case("twice the noise in the thrust", noise=2.0)
    rows = []
    for name, changed, mode_error, mass_error, noise in cases[: 2 if quick else None]:
        problem = pose(family(changed, mode_error, mass_error), Goal(), magnitude(machine))
        bounds = Bounds(limits.ms, mt_bound(limits.ms, limits.mt), limits.mcs * noise)
        row: dict[str, Any] = {"name": name}
        try:
            found = tune(problem, bounds, [("chosen", chosen.pid)])
        except TuningError:
            rows.append(row | {"ki_N_per_ms": None, "crossover_Hz": None})
            continue
        rows.append(row | {"ki_N_per_ms": found.pid.ki, "crossover_Hz": found.loops[0].crossover / (2 * math.pi)})
    return rows


def _loops(members: Sequence[Member], chosen: Point, present: Feedback, mcs: float) -> dict[str, Any]:
    """Frequency responses of the nominal plants' loops, and of all for Nyquist's plot and the worst |S|."""
    ts = float(members[0].plant.dt)
    omega = np.geomspace(2e-3, 1, 500) * math.pi / ts
    nominal = [member for member in members if member.nominal]
    curves: dict[str, Any] = {}
    for label, feedback in (("chosen", chosen.pid), ("present", present)):
        c = controller_response(feedback, ts, omega)
        curves[label] = {member.name: _curves(frequency_response(member.plant, omega), c) for member in nominal}
    crossed = zip(members, chosen.loops, strict=True)
    every = [loop_curve(member, chosen.pid, BELOW_CROSSOVER * loop.crossover) for member, loop in crossed]
    return {
        "frequency_Hz": omega / (2 * math.pi),
        **curves,
        "nyquist": [{"real": loop.real, "imaginary": loop.imag} for loop in every],
        "least_s": least_sensitivity(frequency_response(nominal[0].plant, omega), mcs),
    }


def loop_curve(member: Member, pid: PID, lowest: float) -> NDArray[np.complex128]:
    """L (n,) [1] at frequencies from `lowest` [rad/s] on that are dense where a resonance is."""
    omega = grid(member.plant, pid, 250)
    omega = omega[omega > lowest]
    return np.asarray(frequency_response(member.plant, omega) * controller_response(pid, float(member.plant.dt), omega))


def _curves(plant: NDArray[np.complex128], controller: NDArray[np.complex128]) -> dict[str, Any]:
    s, loop = sensitivities(plant, controller), plant * controller
    phase = np.degrees(np.unwrap(np.angle(loop)))
    phase -= 360 * round((phase[0] + 225) / 360)  # an integrator and a rigid body begin at -270 degrees
    names = {"s": s["S"], "t": s["T"], "ps_m_per_N": s["PS"], "cs_N_per_m": s["CS"], "l": loop}
    return {**{name: np.abs(values) for name, values in names.items()}, "phase_deg": phase}


def shown_levels(every: Sequence[Point]) -> NDArray[np.float64]:
    """The M_s (40,) [1] of the figures, among which each point and its bound is."""
    found = [level for point in every for level in (point.ms, point.bound or point.ms) if math.isfinite(level)]
    return np.linspace(0.96 * min(found), 1.05 * max(found), 40)


def _limits(machine: Machine, rolling: Member, points: Sequence[Point], present: Point, mcs: float) -> dict[str, Any]:
    """Crossovers and areas of Bode's integral of the front, with what they cannot pass."""
    levels = shown_levels((*points, present))
    areas = [bode_area(rolling, point.pid, point.ms, mcs) for point in points]
    own = bode_area(rolling, present.feedback, present.ms, mcs)
    plant, ts = machine.plant, machine.sample_time
    return {
        "ms": levels,
        "crossover_Hz": highest_crossover(plant, ts, levels) / (2 * math.pi),
        "modes_Hz": [plant.modes[i].frequency for i in plant.flexible],
        "front_ms": [point.ms for point in points],
        "suppressed_Hz": [area.suppressed / (2 * math.pi) for area in areas],
        "amplified_Hz": [area.amplified / (2 * math.pi) for area in areas],
        "allowed_Hz": [area.allowed / (2 * math.pi) for area in areas],
        "present_suppressed_Hz": own.suppressed / (2 * math.pi),
        "imbalance": max(abs(area.suppressed / area.amplified - 1) for area in areas),
    }


def _reversal(
    machine: Machine, every: Sequence[Point], validations: Sequence[Validation], which: Sequence[Point]
) -> dict[str, Any]:
    """The first DRAWN_SETTLING_TIMES settling times of the reversal with some PIDs, without compensation."""
    wanted = machine.specification
    count = round(min(DRAWN_SETTLING_TIMES * wanted.settling_time, wanted.interval) / machine.sample_time)
    curves = []
    for point in which:
        error = validations[every.index(point)].reversal.error[:count]
        curves.append({"name": point.name, "ms": point.ms, "error_m": error})
    return {"time_s": np.arange(count) * machine.sample_time, "curves": curves}


def _between(machine: Machine, pid: PID) -> dict[str, Any]:
    """x after a step of friction at ten points a sample, on P_l and at the steepest slope, and at the samples only."""
    found: dict[str, Any] = {}
    worst, ts = 0.0, machine.sample_time
    for name, slope in slopes(machine).items():
        count = round(INTERSAMPLE_SETTLING_TIMES * machine.specification.settling_time / ts)
        fast = plant_with_effects(machine, slope=slope, parts=POINTS_PER_SAMPLE)
        path = _force(machine) * intersample(fast, pid, ts, count)
        at_samples = path[::POINTS_PER_SAMPLE]
        found["time_s"] = np.arange(path.size) * ts / POINTS_PER_SAMPLE
        found[name] = {"path_m": path, "samples_m": at_samples}
        worst = max(worst, float(np.max(np.abs(path)) / np.max(np.abs(at_samples)) - 1))
    return {**found, "largest_beyond": worst}


def _outcome(validation: Validation) -> dict[str, Any]:
    return {
        "settling_s": validation.reversal.settling_time,
        "slowest_s": validation.slowest.settling_time,
        "dispersion_m": validation.worst_dispersion,
    }
