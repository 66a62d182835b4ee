"""Moves that are longer than the stroke that a feedforward was designed for: as a profile through N_ff and D_ff.

The feedforward is linear, so a step of fifty times the stroke asks for fifty times the thrust: the drive saturates and,
unless the integral is kept from winding up, the table never settles. A target that moves along a profile instead keeps
x_T* = N_ff r and u_ff = D_ff r exactly consistent with the plant, whatever the profile, and both rest as many samples
behind its end as N_ff has. The profile is the smooth one of the wipe, as short as the thrust and the speed allow.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.controller import usable_thrust
from design.deadbeat import DesignError
from design.wiping import FASTEST, wipe_path
from models.controller import Controller, references
from models.deployment.coefficients import STEEPEST, planned
from models.machine import Machine
from models.quantity import show
from models.records.settling import overshoot, settling_time
from models.simulation.simulator import Response, simulate

Array = NDArray[np.float64]

RESERVE: Final = 0.9  # of the thrust that friction leaves: the rest is the feedback's
MAX_PROFILE_SAMPLES: Final = 200_000  # samples that a profile may take: 10 s at 20 kHz
MAX_REST_SAMPLES: Final = 20_000  # samples of rest that are watched, where two settling times are fewer
RESTS: Final = 8  # settling times of rest behind each profile, 2 where they take very many samples
# Times as long a rest where a move does not settle: presliding loops may be slow for their motions.
MAX_REST_FACTOR: Final = 8
REPEATS: Final = 2  # there and back so often; the last counts, so that the friction's past is that of such moves
FASTER: Final = 5.0  # sample times of anti-windup, where none is stated: the integral follows in a few samples


@dataclass(frozen=True)
class LongMove:
    """A move over `stroke` [m] along 10 s^3 - 15 s^4 + 6 s^5 in `duration` [s].

    thrust [N], speed [m/s]: the largest |u_ff| and |dx_T*/dt|; limit: which of them made it no shorter.
    """

    stroke: float
    duration: float
    thrust: float
    speed: float
    limit: str

    def target(self, sample_time: float, rest: int = 0) -> Array:
        """The target r (n,) [m] every sample_time [s], from the first sample that moves on, then `rest` samples."""
        count = round(self.duration / sample_time)
        s = np.arange(1, count + 1) / count
        return np.append(self.stroke * s**3 * (10 - 15 * s + 6 * s**2), np.full(rest, self.stroke))


@dataclass(frozen=True)
class Moved:
    """What a move achieved on the nonsmooth machine, the worst of there and back: settling [s] behind the end of the
    profile, overshoot [m], largest |u_M| [N] as the controller puts it out, largest |x_T* - x| [m] on the way, and for
    how long the table was watched behind the profile [s]."""

    settling_time: float
    overshoot: float
    thrust: float
    lag: float
    watched: float


def plan(machine: Machine, controller: Controller, stroke: float) -> LongMove:
    """The shortest such move over stroke [m] within 0.9 of the thrust that friction leaves, and the rated speed.

    Raises DesignError for a move that takes more samples than MAX_PROFILE_SAMPLES.

    >>> from models.machine import load
    >>> from design.controller import default_controller
    >>> round(plan(load(), default_controller(load()), 1e-3).duration, 6)
    0.033
    """
    ts, drive, mass = machine.sample_time, machine.drive, machine.plant.mass
    limit = RESERVE * usable_thrust(machine)

    def at(count: int) -> LongMove:
        move = LongMove(stroke, count * ts, 0.0, 0.0, "")
        known = references(controller.without_compensation(), move.target(ts, len(controller.n_ff)))
        speed = float(np.max(np.abs(np.diff(known.position, prepend=0.0)))) / ts
        return replace(move, thrust=float(np.max(np.abs(known.feedforward))), speed=speed)

    def within(move: LongMove) -> bool:
        return move.thrust <= limit and move.speed <= drive.rated_speed

    begin = max(math.sqrt(STEEPEST * mass * stroke / limit), FASTEST * stroke / drive.rated_speed) / ts
    high = max(math.ceil(begin), 1)
    while high <= MAX_PROFILE_SAMPLES and not within(at(high)):
        high = math.ceil(1.2 * high) + 1
    if high > MAX_PROFILE_SAMPLES:
        raise DesignError(
            f"a move of {show(stroke, 'm')} within {show(limit, 'N')} and {show(drive.rated_speed, 'm/s')} takes more "
            f"than {MAX_PROFILE_SAMPLES} samples, {show(MAX_PROFILE_SAMPLES * ts, 's')}; give a shorter one"
        )
    low = 0
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if within(at(middle)) else (middle, high)
    shorter = at(max(high - 1, 1))
    return replace(at(high), limit="thrust" if shorter.thrust > limit or high == 1 else "speed")


def run(machine: Machine, controller: Controller, move: LongMove, seed: int = 0) -> Moved:
    """What the move achieves there and back; settled is what stays within the specified tolerance [m]. What does not
    settle is watched for twice the time, up to MAX_REST_FACTOR times, unless it runs away."""
    ts, count, rest = machine.sample_time, round(move.duration / machine.sample_time), _rest(machine)
    longest = max(min(MAX_REST_FACTOR * rest, MAX_REST_SAMPLES), rest)
    while True:
        way = move.target(ts, rest)
        response = simulate(machine, controller, np.tile(np.append(way, move.stroke - way), REPEATS), seed=seed)
        found = _outcome(machine, controller, response, way.size, count)
        if math.isfinite(found.settling_time) or not math.isfinite(found.lag) or 2 * rest > longest:
            return found
        rest *= 2


def step(machine: Machine, controller: Controller, stroke: float, seed: int = 0) -> Moved:
    """What one step of the target by stroke [m] does instead, there and back: the drive saturates where it is long."""
    rest = 2 * _rest(machine)
    target = np.repeat([stroke, 0.0], rest)
    with np.errstate(all="ignore"):  # a loop that winds up may leave all numbers
        response = simulate(machine, controller, target, seed=seed)
    return _outcome(machine, controller, response, rest, 0)


def with_anti_windup(machine: Machine) -> Machine:
    """The machine with its integral kept from winding up: by its own time constant [s], else by FASTER samples."""
    control, integral = machine.control, machine.control.pid.ki if machine.control.cascade is None else 1.0
    if control.anti_windup > 0 or integral == 0:
        return machine
    return replace(machine, control=replace(control, anti_windup=FASTER * machine.sample_time))


def largest_step(machine: Machine, controller: Controller) -> float:
    """The longest step [m] of the target whose u_ff stays within the thrust that friction leaves."""
    peak = float(np.max(np.abs(np.cumsum(controller.d_ff))))
    return usable_thrust(machine) / peak if peak > 0 else math.inf


def _rest(machine: Machine) -> int:
    """Samples of rest behind a move."""
    settling = machine.specification.settling_time / machine.sample_time
    return round(max(2 * settling, min(RESTS * settling, MAX_REST_SAMPLES)))


def _outcome(machine: Machine, controller: Controller, response: Response, way: int, moving: int) -> Moved:
    """The worst of the last move there and the last one back; way, moving: samples of each, and of its profile."""
    found = []
    for begin in (response.position.size - 2 * way, response.position.size - way):
        part = slice(begin, begin + way)
        position, goal = response.position[part], float(response.record.target[begin + way - 1])
        origin = float(response.record.target[begin - 1]) if begin else 0.0
        behind = position[moving:] - goal
        late = np.concatenate([np.full(controller.reference_delay, origin), response.record.reference[part]])[:way]
        travelled = (position - origin) * np.sign(goal - origin)
        with np.errstate(invalid="ignore"):
            finite = bool(np.all(np.isfinite(position)))
        found.append(
            Moved(
                settling_time(behind, machine.specification.tolerance, machine.sample_time) if finite else math.inf,
                overshoot(travelled, abs(goal - origin)) if finite else math.inf,
                float(np.max(np.abs(response.record.command[part]))) if finite else math.inf,
                float(np.max(np.abs(late - position))) if finite else math.inf,
                (way - moving) * machine.sample_time,
            )
        )
    return Moved(*(max(getattr(one, name) for one in found) for name in Moved.__dataclass_fields__))


def moves_to_json(machine: Machine, controller: Controller, moves: Sequence[LongMove]) -> dict[str, Any]:
    """The moves as controller.json holds them, and the longest step that needs none; where effects are compensated with
    the thrust that they ask for on each, after the wipe, there and back from rest at 0, up to a settling time behind
    either profile."""

    def content(move: LongMove) -> dict[str, Any]:
        told = {"stroke_m": move.stroke, "duration_s": move.duration}
        if controller.effect_compensation is None:
            return told
        settling = machine.specification.settling_time / machine.sample_time
        way = move.target(machine.sample_time, len(controller.n_ff) + math.ceil(settling))
        target = np.append(way, move.stroke - way)
        thrust = planned(controller, target, wipe_path(machine))
        return {**told, "plan": {"target_m": target.tolist(), "thrust_N": thrust}}

    return {
        "largest_step_m": largest_step(machine, controller),
        "profile": "10 s^3 - 15 s^4 + 6 s^5",
        "moves": [content(one) for one in moves],
    }
