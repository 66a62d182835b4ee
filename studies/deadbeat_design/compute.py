"""The deadbeat design, its trade-offs and its validation; plain results, no drawing.

The feedforward is validated twice, by means independent of its design: on the linear plant by the closed form of its
motion, on the nonsmooth machine by simulation over the sequence of Fig. 5.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.controller import assemble, lead, usable_thrust
from design.deadbeat import (
    OBJECTIVES,
    Constraints,
    Deadbeat,
    DesignError,
    least_peak_thrust,
    shortest_settling_time,
    synthesise,
)
from design.deployment.drive_file import controller_to_json
from design.judging.known_range import excess_of, excess_to_json
from design.judging.long_moves import moves_to_json
from design.linear_response import linear_response
from design.validation import LONGER_PERIODS, PERIODS, Validation, sequence, validate
from design.wiping import after_wipe, wipe, wipe_to_json
from models.controller import Controller, references
from models.friction import Friction, branch
from models.machine import Machine
from models.machines.consistency import MAX_SETTLING_SAMPLES
from models.plant import Plant, bode, delay_split
from models.quantity import show
from models.variation import Variation, at_mode, known, varied_plant
from studies.as_known import limit_rows, on_allowed_machines, summary_row
from studies.as_known import row as known_row
from studies.beforehand import require_designable
from studies.compensator import Counted, with_elements
from studies.deadbeat_design.effects import Knowing, Written, by_place_rows, compensate, knowing
from studies.deadbeat_design.in_place import LATER_RATIO, beside_in_place, in_place_row
from studies.deadbeat_design.moves import long_moves
from studies.deadbeat_design.options import DeadbeatOptions
from studies.deadbeat_design.outcomes import beside_the_paper, checks_of, reproduction, validation_results
from studies.deadbeat_design.remedies import needed, remedies
from studies.deadbeat_design.remedies import told as told_remedies
from studies.effort import SIMULATED, foresee, period, seconds_a_sample
from studies.options import BadInputError
from studies.scattered import rows_of, scattered
from studies.starts import cost_of_starts
from studies.sticking import found_in
from studies.sticking import rows as sticking_rows
from studies.study import Answer, Progress
from studies.wording import beyond_records

Array = NDArray[np.float64]

# Settling times at rest in which a deadbeat proves itself. What rounding leaves of the speed drifts on with the square
# of the samples: 0.2 s were ten settling times of the paper's table, and 7e-9 of the stroke on a galvo, 500 of them.
WATCHED: Final = 10
VIBRATION_PERIODS: Final = 2.0  # of the slowest mode, over which the residual vibration is evaluated after settling,
VIBRATION_TIMES: Final = 401  # at so many times.
BISECTIONS: Final = 25  # linear programs that two searches for the shortest settling time solve, about
STARTS: Final = 30  # states of the friction from which the controller is started,
FEW_STARTS: Final = 4  # in a quick run, with effects, and where the motions take long:
START_SAMPLES: Final = 400_000  # samples that all of them have together, about


def compute(machine: Machine, options: DeadbeatOptions, progress: Progress) -> Answer:
    """Answers the study's question for `machine`. Raises BadInputError for options that can't be met."""
    wanted = _wanted(machine, options)
    progress(0.05, "synthesising the deadbeat feedforward")
    try:
        _foresee(machine, wanted, options, progress)
        plain = _synthesise(machine, wanted, wanted["objective"])
        robust = _synthesise(machine, wanted, "mode_robustness")
    except DesignError as error:
        longer = "; or give it as --long-stroke, which goes along a profile" if _is_longer(machine, options) else ""
        raise BadInputError(f"--settling-time, --stroke: {error}{longer}") from error
    known = knowing(machine, plain, partial(_synthesise, wanted=wanted, objective=wanted["objective"]))
    counted = with_elements(machine, options, progress, known.deadbeat, plant=known.plant, shares=(0.1, 0.15))
    machine = counted.machine
    progress(0.15, "trade-off of settling time and thrust")
    trade_off = _trade_off(machine, wanted, quick=options.quick)
    without, written = _validated(machine, plain, known, options, progress)
    controller, deadbeat, judged = written.controller, written.deadbeat, written.validation
    progress(0.6, "sensitivity to the modes' frequencies")
    if written.plant != machine.plant:
        robust = _synthesise(replace(machine, plant=written.plant), wanted, "mode_robustness")
    sensitivity = _sensitivity(replace(machine, plant=written.plant), deadbeat, robust, quick=options.quick)
    progress(0.7, "collecting the results")
    proof = _proof(written.plant, deadbeat)
    results = {
        "quick": options.quick,
        "wanted": wanted,
        "deadbeat": _deadbeat(deadbeat, proof),
        "robust": {"thrust_N": robust.thrust, "position_m": robust.position},
        "bode": _bode(machine, quick=options.quick),
        "trade_off": trade_off,
        "sensitivity": sensitivity,
        "friction": {
            **_friction(machine, controller),
            "assumed": bool(_assumed(machine)),
            "rfm_lead_samples": lead(written.plant, machine.sample_time),
        },
        "without": validation_results(machine.specification, without),
        "with": validation_results(machine.specification, judged),
        "paper": beside_the_paper(machine, wanted, without, judged),
        **counted.results,
        **written.results,
        **found_in(machine, controller.feedback),
    }
    progress(0.75, "repeating the motions with a dither and from other pasts of the friction")
    results["settling"] = _settling(machine, controller, without, judged, options)
    results["in_place"] = beside_in_place(machine, judged, plain.stroke, options.seed)
    checks = checks_of(machine, wanted, deadbeat, proof, judged, results["settling"]["with"])
    progress(0.8, "on machines that the file allows")
    results["as_known"] = on_allowed_machines(machine, controller, judged, options, wanted["stroke_m"])
    if needed(machine, judged, results["as_known"]):
        progress(0.82, "what would bring all motions in time")
        results["remedies"] = remedies(
            machine, written, wanted, trade_off["shortest_s"], options, partial(_resting, wanted=wanted)
        )
    progress(0.85, "longer moves")
    moved = long_moves(machine, controller, options)
    results["long_moves"], checks = moved.results, (*checks, *moved.checks)
    results["beyond"] = [*excess_to_json("the specified motion", excess_of(judged)), *moved.beyond]
    progress(0.9, "starting from what random motions left in the friction")
    results["wipe"], results["starts"] = wipe_to_json(wipe(machine)), _starts(machine, controller, wanted, options)
    file = controller_to_json(machine, controller, plain.stroke, plain.settling_time)
    file["long_moves"] = moves_to_json(machine, controller, moved.moves)
    if counted.choice is not None:
        file["compensator_elements"] = counted.choice.count
    if machine.control.law is not None:
        results["feedback"] = machine.control.without_feedforward().in_words
    return Answer(results, checks, {"controller.json": file}, _summary(machine, controller, options, results, counted))


def _summary(
    machine: Machine, controller: Controller, options: DeadbeatOptions, results: Mapping[str, Any], counted: Counted
) -> list[tuple[str, str]]:
    """What the terminal says, row by row."""
    summary = [
        (f"x_T* rests on the target after ({_asked_by(options)})", show(results["wanted"]["settling_time_s"], "s")),
        ("motions are checked to settle within (machine file)", show(machine.specification.settling_time, "s")),
        ("shortest settling time within the thrust limit", show(results["trade_off"]["shortest_s"], "s")),
        *counted.summary,
        *_assumed(machine),
        *_reference_delay(machine, controller),
        *sticking_rows(results),
        *by_place_rows(results),
        *limit_rows(machine),
        summary_row(results["as_known"]),
        in_place_row(results["in_place"]),
        *told_remedies(results),
        *((f"WARNING, {one['design']}", beyond_records(one)) for one in results["beyond"]),
        *(_told(one, machine) for one in results["long_moves"]["rows"]),
        *reproduction(results["paper"]),
    ]
    if "feedback" in results:
        summary.append(("feedback kept, its reference entering as the position does", results["feedback"]))
    return summary


def _validated(
    machine: Machine, plain: Deadbeat, known: Knowing, options: DeadbeatOptions, progress: Progress
) -> tuple[Validation, Written]:
    """The validation without friction compensation, and the controller that is written, with its own."""
    controller, stroke, seed = assemble(machine, plain), plain.stroke, options.seed
    progress(0.3, "validating on the nonsmooth machine")
    with_rfm = validate(machine, controller, stroke=stroke, seed=seed)
    progress(0.45, "validating without friction compensation")
    without = validate(machine, controller.without_compensation(), stroke=stroke, seed=seed)
    if not machine.effects:
        return without, Written(controller, plain, machine.plant, with_rfm, {})
    progress(0.5, "meeting the machine's effects")
    return without, compensate(machine, plain, known, (without, with_rfm), seed)


def _reference_delay(machine: Machine, controller: Controller) -> list[tuple[str, str]]:
    """That the drive's setting has to change with this controller, where it has to."""
    now, then = machine.control.reference_delay, controller.reference_delay
    if now == then:
        return []
    return [
        ("WARNING, reference delay of this controller", f"{then} samples, where the one in place has {now}: set it")
    ]


def _asked_by(options: DeadbeatOptions) -> str:
    """Where the settling time of x_T* is from."""
    return "machine file" if options.settling_time is None else "--settling-time"


def _is_longer(machine: Machine, options: DeadbeatOptions) -> bool:
    return options.stroke is not None and options.stroke > machine.specification.stroke


def _assumed(machine: Machine) -> list[tuple[str, str]]:
    """A warning where nobody measured the friction that the compensator has."""
    known = (machine.sources.get(f"friction.{name}") for name in ("limit", "stiffness"))
    if not all(one is not None and one.kind == "assumed" for one in known):
        return []
    said = (
        "assumed, not measured; on an axis with another one its compensation may do harm: identify it from slow loops"
    )
    return [("WARNING, friction", said)]


def _told(row: Mapping[str, Any], machine: Machine) -> tuple[str, str]:
    """A long move, what it takes, and whether it is later than specified: no check says so of moves not asked for."""
    watched = f"does not settle within {show(row['watched_s'], 's')} after it"
    settled = watched if math.isinf(row["settling_s"]) else f"settles {show(row['settling_s'], 's')} after it"
    specified = machine.specification.settling_time
    late = f", later than {show(specified, 's')}" if specified < row["settling_s"] < math.inf else ""
    bare = row["without_settling_s"]
    if row["settling_s"] > max(LATER_RATIO * bare, specified):  # a compensation that is worse there than none
        late = f"{late}, and {show(bare, 's')} after it without friction compensation"
    stroke = show(row["stroke_m"], "m")
    if row["profile_s"] < 1.5 * machine.sample_time:  # a thrust that is strong for the mass needs no more
        return f"{stroke} in one step", f"{settled}{late}"
    return f"{stroke} along a profile", f"{show(row['profile_s'], 's')}, {settled}{late}"


def _settling(
    machine: Machine, controller: Controller, without: Validation, judged: Validation, options: DeadbeatOptions
) -> dict[str, Any]:
    """The settling times of the single runs, what each hangs on, and their scatter, without and with compensation."""
    stroke = abs(judged.reversal.motion.target - judged.reversal.motion.origin)
    bare = scattered(machine, controller.without_compensation(), without, options, stroke=stroke)
    compensated = scattered(machine, controller, judged, options, stroke=stroke)
    rows = rows_of((("without compensation", bare), ("with compensation", compensated)))
    return {"without": bare, "with": compensated, "rows": rows}


def _starts(
    machine: Machine, controller: Controller, wanted: Mapping[str, Any], options: DeadbeatOptions
) -> dict[str, Any] | None:
    """What an unknown start costs this controller; None without a friction compensator."""
    rfm, target = controller.friction_compensation, sequence(machine, wanted["stroke_m"], 1)
    if rfm is None:
        return None
    given, few = references(controller, target), options.quick or machine.effects
    count = FEW_STARTS if few else min(max(START_SAMPLES // target.size, FEW_STARTS), STARTS)
    wiped = after_wipe(machine, controller, target, given)
    return cost_of_starts(machine, controller, rfm, given, wiped, target, count, options.seed)


def _foresee(machine: Machine, wanted: Mapping[str, Any], options: DeadbeatOptions, progress: Progress) -> None:
    """The time of three validations that never become periodic, and of the linear programs of the trade-off."""
    samples, count = period(machine), 2 * len(_counts(machine, wanted, quick=options.quick)) + BISECTIONS
    begin = time.process_time()
    least_peak_thrust(machine.plant, machine.sample_time, _whole(machine, wanted), machine.specification.stroke)
    program = time.process_time() - begin
    seconds = {
        "the validation": 3 * (PERIODS + sum(LONGER_PERIODS)) * samples * seconds_a_sample(machine),
        "the trade-off": 2 * count * program,
    }
    foresee(seconds, max(LONGER_PERIODS) * samples * SIMULATED, options, progress)


def _whole(machine: Machine, wanted: Mapping[str, Any]) -> float:
    """The settling time [s], rounded to whole samples: one that is not is refused later, with the nearest that is."""
    return float(max(round(wanted["settling_time_s"] / machine.sample_time), 1) * machine.sample_time)


def _wanted(machine: Machine, options: DeadbeatOptions) -> dict[str, Any]:
    """The requirements on the design, from the options, else from the machine file."""
    require_designable(machine)
    specification, drive = machine.specification, machine.drive
    given = options.thrust_limit
    reserved = usable_thrust(machine)
    if given is not None and not 0 < given <= drive.rated_thrust:
        raise BadInputError(
            f"--thrust-limit: {show(given, 'N')} must be between 0 and the rated {show(drive.rated_thrust, 'N')}"
        )
    time, stroke = options.settling_time, options.stroke
    interval = specification.interval
    if time is not None and time >= interval:
        raise BadInputError(
            f"--settling-time: {show(time, 's')} is longer than a motion; give less than {show(interval, 's')}"
        )
    if stroke is not None and not 1e-9 <= stroke <= 1e3 and stroke != 0:
        raise BadInputError(f"--stroke: {show(stroke, 'm')} must be from 1 nm to 1 km")
    return {
        "settling_time_s": specification.reference_settling_time if time is None else time,
        "stroke_m": specification.stroke if stroke is None else stroke,
        "thrust_limit_N": reserved if given is None else given,
        "thrust_limit_source": "rated thrust less friction's share" if given is None else "--thrust-limit",
        "objective": options.objective,
        "objective_meaning": OBJECTIVES[options.objective],
        "overshoot": options.overshoot,
        "monotone": options.monotone,
    }


def _constraints(wanted: Mapping[str, Any]) -> Constraints:
    return Constraints(wanted["thrust_limit_N"], wanted["overshoot"], wanted["monotone"])


def _synthesise(machine: Machine, wanted: Mapping[str, Any], objective: Any) -> Deadbeat:
    time, stroke = wanted["settling_time_s"], wanted["stroke_m"]
    return synthesise(machine.plant, machine.sample_time, time, stroke, objective, _constraints(wanted))


def _resting(machine: Machine, time: float, wanted: Mapping[str, Any]) -> Deadbeat:
    """The wanted feedforward of a machine, but at rest after another time [s]."""
    return _synthesise(machine, {**wanted, "settling_time_s": time}, wanted["objective"])


def _proof(plant: Plant, deadbeat: Deadbeat) -> dict[str, Any]:
    """What remains for WATCHED settling times after the first, at ten points a sample, relative to the stroke."""
    ts = deadbeat.sample_time
    count = round(deadbeat.settling_time / ts)
    times = (count + np.arange(round(10 * WATCHED * deadbeat.settling_time / ts)) / 10) * ts + plant.dead_time
    remains = np.abs(linear_response(plant, deadbeat.thrust, ts, times) / deadbeat.stroke - 1)
    whole, _ = delay_split(plant.dead_time, ts)
    at_samples = linear_response(plant, deadbeat.thrust, ts, (np.arange(count + 1) + whole) * ts)
    return {
        "residual": float(np.max(remains)),
        "reference_error_m": float(np.max(np.abs(at_samples - deadbeat.position))),
    }


def _deadbeat(deadbeat: Deadbeat, proof: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "time_s": np.arange(deadbeat.position.size) * deadbeat.sample_time,
        "thrust_N": deadbeat.thrust,
        "position_m": deadbeat.position,
        "peak_thrust_N": np.max(np.abs(deadbeat.thrust)),
        "overshoot_m": max(float(np.max(deadbeat.position)) - deadbeat.stroke, 0.0),
        "backward_m": max(-float(np.min(np.diff(deadbeat.position))), 0.0),
        "numerator": deadbeat.numerator,
        "denominator": deadbeat.denominator,
        "free": deadbeat.free,
        **proof,
    }


def _bode(machine: Machine, *, quick: bool) -> dict[str, Any]:
    slowest = min((machine.plant.modes[mode].frequency for mode in machine.plant.flexible), default=math.inf)
    frequency = np.geomspace(min(1.0, slowest / 10), 0.5 / machine.sample_time, 200 if quick else 800)
    slopes = {"P_l": 0.0, "P_e1": machine.presliding.stiffness_1, "P_e2": machine.presliding.stiffness_2}
    curves: dict[str, Any] = {"frequency_Hz": frequency}
    for name, slope in slopes.items():
        magnitude, phase = bode(machine.plant, 2 * math.pi * frequency, slope)
        curves[name] = {"magnitude_m_per_N": magnitude, "phase_deg": np.degrees(phase), "stiffness_N_per_m": slope}
    return curves


def _counts(machine: Machine, wanted: Mapping[str, Any], *, quick: bool) -> range:
    """The settling times, in samples, at which the least peak thrust is found: as far as a deadbeat is designed."""
    target = round(wanted["settling_time_s"] / machine.sample_time)
    least, step = max(target // 2, 2 * len(machine.plant.modes)), max(target // (8 if quick else 20), 1)
    return range(least, min(2 * target, MAX_SETTLING_SAMPLES) + 1, step)


def _trade_off(machine: Machine, wanted: Mapping[str, Any], *, quick: bool) -> dict[str, Any]:
    """Least peak thrust against the settling time, free and with a monotone x_T*, and the shortest within the limit."""
    ts, stroke, plant = machine.sample_time, wanted["stroke_m"], machine.plant
    times = [count * ts for count in _counts(machine, wanted, quick=quick)]
    peaks = {
        name: [least_peak_thrust(plant, ts, time, stroke, monotone=monotone) for time in times]
        for name, monotone in (("free_N", False), ("monotone_N", True))
    }
    limit = Constraints(thrust=wanted["thrust_limit_N"])
    return {
        "settling_time_s": times,
        **peaks,
        "limit_N": wanted["thrust_limit_N"],
        "rated_N": machine.drive.rated_thrust,
        "shortest_s": shortest_settling_time(plant, ts, stroke, limit),
        "shortest_monotone_s": shortest_settling_time(plant, ts, stroke, replace(limit, monotone=True)),
    }


def _sensitivity(machine: Machine, plain: Deadbeat, robust: Deadbeat, *, quick: bool) -> dict[str, Any]:
    """Largest |x - r| [m] of the linear plant after the settling time with one mode off; feedforward alone."""
    errors = np.linspace(-0.05, 0.05, 11 if quick else 41)
    deviations = {one.name: one for one in known(machine)}
    begin = plain.settling_time + machine.plant.dead_time
    slowest = min((machine.plant.modes[mode].frequency for mode in machine.plant.flexible), default=math.inf)
    window = VIBRATION_PERIODS / (slowest * (1 - float(np.max(errors))))
    times = begin + np.linspace(0.0, window, VIBRATION_TIMES)

    def left(deadbeat: Deadbeat, mode: int, error: float) -> float:
        wrong = varied_plant(machine.plant, Variation(frequency=at_mode(machine.plant, mode, float(error))))
        position = linear_response(wrong, deadbeat.thrust, deadbeat.sample_time, times)
        return float(np.max(np.abs(position - deadbeat.stroke)))

    modes = [
        {
            "frequency_Hz": machine.plant.modes[mode].frequency,
            "plain_m": [left(plain, mode, error) for error in errors],
            "robust_m": [left(robust, mode, error) for error in errors],
            "known": known_row(deviations[f"plant.modes.{mode + 1}.frequency"]),
        }
        for mode in machine.plant.flexible
    ]
    return {"error": errors, "modes": modes}


def _friction(machine: Machine, controller: Controller) -> dict[str, Any]:
    """The branch behind a reversal (Fig. 3b) of the machine and of its RFM, and its mean slopes in both regions."""
    rfm, facts = controller.friction_compensation, machine.presliding
    assert rfm is not None
    reach = 2 * max(machine.friction.limit)  # behind a reversal, where the last element slips
    distance = np.linspace(0, 1.1 * (max(reach, 2 * facts.boundary) if reach > facts.boundary else reach), 400)

    def climbed(friction: Friction) -> Array:
        return branch(friction, distance)

    ends = branch(machine.friction, [facts.boundary, reach])
    return {
        "distance_m": distance,
        "machine_N": climbed(machine.friction),
        "rfm_N": climbed(rfm),
        "slope_1_N_per_m": float(ends[0]) / facts.boundary,
        "slope_2_N_per_m": float(ends[1] - ends[0]) / (reach - facts.boundary) if reach > facts.boundary else None,
        "rfm_largest_error_N": float(np.max(np.abs(climbed(rfm) - climbed(machine.friction)))),
        "elements": len(machine.friction.limit),
        "rfm": {"stiffness_N_per_m": rfm.stiffness, "limit_m": rfm.limit},
    }
