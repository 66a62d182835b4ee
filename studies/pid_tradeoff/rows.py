"""The performance of each point of the trade-off: loops, noise, and motions on the nonsmooth machine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from design.family import Member
from design.loop import disturbance_response, rms, sensitivity
from design.pid.front import Point
from design.validation import Validation, validate_many
from models.controller import Controller, Feedback
from models.friction import branch
from models.machine import Machine, with_pid
from models.quantity import listed, show
from studies.options import Options
from studies.scattered import scattered
from studies.wording import beyond_records, effect

MOST_RUNS: Final = 20  # with a dither, of each point of the front,
FEW_RUNS: Final = 6  # and in a quick run


def nonsmooth(machine: Machine, controller: Controller, points: Sequence[Point]) -> tuple[Validation, ...]:
    """The paper's motions without friction compensation with each point's PID, on the nonsmooth machine."""
    controllers = [_law(controller, point) for point in points]
    return validate_many([_with_point(machine, point) for point in points], controllers, periods=4)


def over_runs(
    machine: Machine, controller: Controller, point: Point, validation: Validation, options: Options
) -> dict[str, Any]:
    """What a point's settling times hang on, and their scatter over runs with a dither; see `scattered`."""
    most = FEW_RUNS if options.quick else MOST_RUNS
    return scattered(_with_point(machine, point), _law(controller, point), validation, options, most=most)


def _law(controller: Controller, point: Point) -> Controller:
    """The controller with a point's feedback, without friction compensation."""
    return controller.without_compensation().with_feedback(point.feedback)


def _with_point(machine: Machine, point: Point) -> Machine:
    """The machine with a point's PID, or as it is where the point is its own feedback."""
    return machine if point.law else with_pid(machine, point.pid, "this study")


def point_row(machine: Machine, members: Sequence[Member], point: Point, validation: Validation) -> dict[str, Any]:
    """The performance of one point, for results.json."""
    loops, pid = point.loops, point.pid
    nominal = [loop for loop, member in zip(loops, members, strict=True) if member.nominal]
    worst = members[int(np.argmax([loop.ms.value for loop in loops]))]
    force = float(branch(machine.friction, machine.specification.stroke))
    count = round(machine.specification.settling_time / machine.sample_time)
    responses = [disturbance_response(member.plant, point.feedback, 3 * count) for member in members if member.nominal]
    errors = [np.abs(response[count - 1 :]) for response in responses]
    return {
        "name": point.name,
        "bound": point.bound,
        "feedback": machine.control.in_words if point.law else None,
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
        "noise_N": noise(machine, members[0], point.feedback),
        "settling_s": validation.reversal.settling_time,
        "slowest_s": validation.slowest.settling_time,
        "dispersion_m": validation.worst_dispersion,
    }


def noise(machine: Machine, member: Member, feedback: Feedback) -> float:
    """Standard deviation of the thrust [N] from the scale's rounding and its noise."""
    return machine.scale.reading_deviation * rms(sensitivity(member.plant, feedback, "CS"))


def _when(time: float) -> str:
    """When a motion settles [s], in words; infinity for one that never does."""
    return f"in {show(time, 's')}" if math.isfinite(time) else "never settles"


def summary(results: dict[str, Any]) -> list[tuple[str, str]]:
    """The present feedback, the chosen PID and the fastest one in a line each, and what else a reader has to know."""
    present, chosen, fastest = (results[key] for key in ("present", "chosen", "fastest"))

    def line(row: dict[str, Any]) -> str:
        said = f"Ms {row['ms']:.3g} at worst ({row['worst_plant']}), ki {row['ki_N_per_ms']:.3g} N/(m s)"
        said += f", a reversal {'settles ' if math.isfinite(row['settling_s']) else ''}{_when(row['settling_s'])}"
        margin = row["settling"]["reversal"]
        change = "smaller" if margin["nearest_m"] == margin["less_m"] else "larger"
        near = f"{_when(margin['otherwise_s'])} if its error is {show(margin['nearest_m'], 'm', 2)} {change}"
        return f"{said} ({near})" if math.isfinite(margin["nearest_m"]) else said

    stated = f"present feedback, {present['feedback']}" if present["feedback"] else "present PID"
    warnings = [(f"WARNING, {one['design']}", beyond_records(one)) for one in results["beyond"]]
    acting = [("effects that act, met where friction is", listed([effect(one) for one in results["effects"]]))]
    rows = [(stated, line(present)), ("chosen PID", line(chosen)), ("fastest of the front", line(fastest))]
    before, after = (show(one["slowest_s"], "s") for one in results["compensated"])
    kept = [("WARNING, keep the present feedback", f"with friction compensated {before} with it, {after} with the PID")]
    return [*warnings, *(kept if results["keep_present"] else []), *rows, *(acting if results["effects"] else [])]
