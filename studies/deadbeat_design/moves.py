"""Long moves: the profile of each, what it achieves, and what one step of the target would do in its place."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Final

from design.controller import usable_thrust
from design.deadbeat import DesignError
from design.judging.known_range import excess, excess_to_json
from design.judging.long_moves import LongMove, Moved, largest_step, plan, run, step, with_anti_windup
from models.controller import Controller
from models.machine import Machine
from models.quantity import show
from studies.deadbeat_design.options import DeadbeatOptions
from studies.options import BadInputError
from studies.study import Check
from studies.wording import cited

USUAL: Final = (50.0, 250.0, 1000.0)  # times the specified stroke: 1, 5 and 20 mm on the paper's table


@dataclass(frozen=True)
class LongMoves:
    """The moves, their part of results.json, their checks, and the designs that leave the range of the records."""

    moves: tuple[LongMove, ...]
    results: dict[str, Any]
    checks: tuple[Check, ...]
    beyond: list[dict[str, Any]]


def long_moves(machine: Machine, controller: Controller, options: DeadbeatOptions) -> LongMoves:
    """The long moves that are asked for, or those of USUAL that the machine can do. Raises BadInputError."""
    asked = bool(options.long_stroke)
    strokes = options.long_stroke or _usual(machine)
    travel = machine.drive.travel
    if 0 < travel < max(strokes, default=0.0):
        if asked:
            longest, most = (show(length, "m") for length in (max(strokes), travel))
            raise BadInputError(f"--long-stroke: {longest} is more than the axis' travel of {most} (machine file)")
        strokes = tuple(stroke for stroke in strokes if stroke <= travel)
    guarded = with_anti_windup(machine)
    moves, rows, checks, beyond = list[LongMove](), list[dict[str, Any]](), list[Check](), list[dict[str, Any]]()
    for stroke in strokes:
        try:
            move = plan(machine, controller, stroke)
        except DesignError as error:
            if asked:
                raise BadInputError(f"--long-stroke: {error}") from error
            continue
        done = run(machine, controller, move, options.seed)
        bare = run(machine, controller.without_compensation(), move, options.seed)
        stepped = step(machine, controller, stroke, options.seed)
        kept = step(guarded, _law_of(controller, guarded), stroke, options.seed)
        moves.append(move)
        asked_for = usable_thrust(machine) * stroke / largest_step(machine, controller)
        rows.append({**_row(machine, move, done, bare), "step_feedforward_N": asked_for, **_stepped(stepped, kept)})
        name = f"move of {show(stroke, 'm')}"
        beyond += excess_to_json(name, excess(machine, min(done.thrust, machine.drive.rated_thrust), move.speed))
        if asked:
            checks.append(_check(machine, name, done))
    results = {
        "rows": rows,
        "asked": asked,
        "largest_step_m": largest_step(machine, controller),
        "anti_windup_s": guarded.control.anti_windup,
        "own_anti_windup": machine.control.anti_windup > 0,
    }
    return LongMoves(tuple(moves), results, tuple(checks), beyond)


def _usual(machine: Machine) -> tuple[float, ...]:
    """Strokes [m] of USUAL; none where the specified stroke is a long move itself, beyond the presliding region."""
    stroke = machine.specification.stroke
    return tuple(factor * stroke for factor in USUAL) if stroke < 2 * max(machine.friction.limit) else ()


def _law_of(controller: Controller, guarded: Machine) -> Controller:
    """The controller with the feedback of a machine whose integral does not wind up."""
    law = guarded.control.law
    return replace(controller, law=law and law.of_error())


def _check(machine: Machine, name: str, done: Moved) -> Check:
    limit, source = machine.specification.settling_time, cited(machine, "specification.settling_time")
    return Check(f"settling behind the profile, {name}", done.settling_time, "s", limit, source)


def _row(machine: Machine, move: LongMove, done: Moved, bare: Moved) -> dict[str, Any]:
    """A move beside the least time of its mass alone, within all the thrust that the profile may use."""
    return {
        "stroke_m": move.stroke,
        "profile_s": move.duration,
        "limit": move.limit,
        "feedforward_N": move.thrust,
        "speed_m_per_s": move.speed,
        "settling_s": done.settling_time,
        "whole_s": move.duration + done.settling_time,
        "least_s": 2 * math.sqrt(machine.plant.mass * move.stroke / machine.drive.rated_thrust),
        "watched_s": done.watched,
        "without_settling_s": bare.settling_time,
        "without_watched_s": bare.watched,
        "overshoot_m": done.overshoot,
        "lag_m": done.lag,
        "thrust_N": done.thrust,
        "saturates": done.thrust > machine.drive.rated_thrust,
    }


def _stepped(stepped: Moved, kept: Moved) -> dict[str, Any]:
    """What one step of the target does, as the machine is and with its integral kept from winding up."""
    return {
        "step_thrust_N": stepped.thrust,
        "step_settling_s": stepped.settling_time,
        "step_watched_s": stepped.watched,
        "step_guarded_settling_s": kept.settling_time,
        "step_guarded_overshoot_m": kept.overshoot,
    }
