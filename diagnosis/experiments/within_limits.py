"""Experiments for a machine that states how far, how fast and with what force it may be driven.

The menu (menu.py) is in the machine's own sizes. Here each experiment is as large as the travel, speed and force
allow, and so short that several fit into a minute.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from diagnosis.experiments import schedules as made
from diagnosis.experiments.menu import Experiment
from diagnosis.experiments.schedules import PEAK_SPEED, Move, Schedule, schedule
from models.machine import Machine
from models.quantity import listed, show

LADDER: Final = (0.02, 0.1, 0.3, 1.0)  # of the longest move that dwells on presliding
SPEEDS: Final = (0.01, 0.05, 0.2, 0.6)  # of the highest speed
LASTS: Final = 0.4  # s at each of these speeds
BRIEF: Final = (2.4, 4.8, 10, 20)  # pauses
SHARES: Final = (0.25, 0.5, 0.75)  # of the largest force
SPEED_ROUNDING: Final = 1e-9  # of a speed: that of differences
TURN: Final = 0.9  # of the travel, force and speed that are used


@dataclass(frozen=True)
class Bounds:
    """How far from 0 [m], how fast [m/s] and with what feedforward [N] a machine may be driven."""

    distance: float
    speed: float
    force: float

    def keep(self, planned: Schedule, sample_time: float) -> bool:
        """Whether a schedule at this sample time [s] stays within them."""
        given = planned.given
        way = np.abs(np.diff(given.position, prepend=0.0))
        return bool(
            max(np.abs(given.position).max(), np.abs(planned.target).max()) <= self.distance
            and way.max() <= self.speed * sample_time * (1 + SPEED_ROUNDING)
            and np.abs(given.feedforward + given.compensation).max() <= self.force
        )


def own_test(machine: Machine, bounds: Bounds) -> Experiment:
    """What an engineer has run already: the specified motions, reversals and inching, up and down once [SI]."""
    wanted = machine.specification
    size = min(wanted.stroke, TURN * bounds.distance / wanted.motions)
    seconds = max(_within(machine, bounds, size), wanted.reference_settling_time)
    rest = max(min(wanted.interval - seconds, 4 * made.pause(machine)), made.pause(machine))
    steps = [Move(sign * size, seconds, rest) for sign in (1, -1) for _ in range(wanted.motions)]
    words = f"{wanted.motions} moves of {show(size, 'm', 3)} up and {wanted.motions} down"
    return Experiment(words, schedule("own test", machine, steps))


def experiments(machine: Machine, bounds: Bounds) -> tuple[Experiment, ...]:
    """The experiments that this machine may run [SI], each within the bounds and the room that its file leaves; what is
    not is left out."""
    bounds = replace(bounds, distance=min(bounds.distance, made.room(machine)))
    found = (build(machine, bounds) for build in BUILDERS)
    return tuple(one for one in found if bounds.keep(one.schedule, machine.sample_time))


def _within(machine: Machine, bounds: Bounds, distance: float, speed: float = np.inf) -> float:
    """Duration [s] of a move of so far [m], within TURN of the bounds' force and so fast [m/s] at most."""
    force = min(TURN * bounds.force / machine.drive.rated_thrust, made.UNHURRIED_THRUST_SHARE)
    fastest = min(speed, TURN * bounds.speed)
    return max(made.quickest(machine, distance, force), PEAK_SPEED * distance / fastest)


def _reach(bounds: Bounds, wanted: float) -> float:
    return made.rounded(min(wanted, TURN * bounds.distance), 3)


def _brisk(bounds: Bounds, wanted: float) -> float:
    """A length [m] that takes half a second at the highest speed at most, so that it can be gone several times."""
    return min(_reach(bounds, wanted), made.rounded(0.5 * TURN * bounds.speed / PEAK_SPEED, 3))


def _there_and_back(machine: Machine, bounds: Bounds, distance: float, speed: float, rest: float) -> list[Move]:
    seconds = _within(machine, bounds, distance, speed=speed)
    return [Move(sign * distance, seconds, rest) for sign in (1, -1)]


def _dwells(machine: Machine, bounds: Bounds) -> Experiment:
    size, rest = _reach(bounds, made.DWELL_STROKE * machine.specification.stroke), made.pause(machine)
    seconds = max(_within(machine, bounds, 2 * size), machine.specification.settling_time)
    steps = [Move(sign * size, seconds, share * rest) for share in BRIEF for sign in (1, 1, -1, -1)]
    shown = listed(f"{share * rest:.3g}" for share in BRIEF)
    words = f"moves of {show(size, 'm', 3)} after rests of {shown} s, onward in the same direction and back"
    return Experiment(words, schedule("dwell sweep", machine, steps), ("dwell", "time_in_motion"))


def _ladder(machine: Machine, bounds: Bounds) -> Experiment:
    longest, rest = _reach(bounds, made.length(machine, 4, 1)) / 2, 4 * made.pause(machine)
    sizes = [made.rounded(share * longest) for share in LADDER]
    steps = [
        Move(sign * size, max(_within(machine, bounds, size), machine.specification.settling_time), rest)
        for size in sizes
        for sign in (1, 1, -1, -1)
    ]
    words = f"moves of {listed(show(size, 'm', 3) for size in sizes)}, twice up and twice down"
    return Experiment(words, schedule("amplitude ladder", machine, steps), ("since_reversal",))


def _speeds(machine: Machine, bounds: Bounds) -> Experiment:
    top, rest = min(machine.drive.rated_speed, bounds.speed), 2 * made.pause(machine)
    longest = _reach(bounds, made.length(machine, 200, 1))
    steps = [
        step
        for share in SPEEDS
        for step in _there_and_back(machine, bounds, min(longest, LASTS * share * top), share * top, rest)
    ]
    words = f"strokes there and back at up to {listed(f'{1e3 * share * top:.3g}' for share in SPEEDS)} mm/s"
    return Experiment(words, schedule("speed ladder", machine, steps), ("velocity", "velocity_sign"))


def _slow(machine: Machine, bounds: Bounds) -> Experiment:
    distance = _reach(bounds, made.length(machine, 30, 1))
    steps = _there_and_back(machine, bounds, distance, distance * PEAK_SPEED / 3.0, 4 * made.pause(machine))
    return Experiment(f"a slow stroke of {show(distance, 'm', 3)} there and back", schedule("slow", machine, steps))


def _long(machine: Machine, bounds: Bounds) -> Experiment:
    """The whole travel at a speed at which half a second or more goes by, twice."""
    distance = _reach(bounds, np.inf)
    steps = _there_and_back(machine, bounds, distance, distance * PEAK_SPEED / 1.2, 4 * made.pause(machine)) * 2
    words = f"strokes of {show(distance, 'm', 3)} there and back, twice"
    return Experiment(words, schedule("long strokes", machine, steps), ("position", "pitch"))


def _far_and_slow(machine: Machine, bounds: Bounds) -> Experiment:
    distance = _reach(bounds, np.inf)
    steps = _there_and_back(machine, bounds, distance, distance * PEAK_SPEED / 4.0, 4 * made.pause(machine))
    words = f"one slow stroke of {show(distance, 'm', 3)} there and back"
    return Experiment(words, schedule("long slow stroke", machine, steps), ("position", "pitch"))


def _hard(machine: Machine, bounds: Bounds) -> Experiment:
    distance, rest = _brisk(bounds, made.length(machine, 20, 0.5)), 4 * made.pause(machine)
    most = min(bounds.force / machine.drive.rated_thrust, 1.0)
    steps = []
    for share in SHARES:
        seconds = max(made.quickest(machine, distance, share * most), PEAK_SPEED * distance / (TURN * bounds.speed))
        steps += [Move(sign * distance, seconds, rest) for sign in (1, -1, 1, -1)]
    words = f"moves of {show(distance, 'm', 3)} there and back at {listed(f'{100 * share:.0f}' for share in SHARES)} % "
    return Experiment(words + "of the largest force", schedule("hard moves", machine, steps), ("command",))


def _at_places(machine: Machine, bounds: Bounds) -> Experiment:
    places = 5
    apart = _reach(bounds, np.inf) / places
    size = min(apart, _brisk(bounds, made.length(machine, 10, 0.5)))
    fast, rest = _within(machine, bounds, size), 4 * made.pause(machine)
    on = Move(apart, max(_within(machine, bounds, apart), 16 * made.pause(machine)), rest)
    here = [Move(size, fast, rest), Move(-size, fast, rest)]
    back = Move(-apart * (places - 1), max(_within(machine, bounds, apart * (places - 1)), 0.5), rest)
    words = f"moves of {show(size, 'm', 3)} back and forth at {places} places {show(apart, 'm', 3)} apart"
    return Experiment(words, schedule("places", machine, [*here, *([on, *here] * (places - 1)), back]), ("position",))


def _strong_shaking(machine: Machine, bounds: Bounds) -> Experiment:
    return _shaking(machine, bounds, 1 / 200, 1.0, made.shaking(machine))


def _gentle_shaking(machine: Machine, bounds: Bounds) -> Experiment:
    return _shaking(machine, bounds, 1 / 400, 1 / 8, made.shaking(machine, 0.018))


def _shaking(machine: Machine, bounds: Bounds, low: float, high: float, force: float) -> Experiment:
    top = made.top(machine)
    band, rms = (max(low * top, 1.0), high * top), made.rounded(min(force, bounds.force / 5), 2)
    planned = made.multisine(machine, band, rms, 3.0)
    words = f"a multisine of {band[0]:.3g} to {band[1]:.3g} Hz and {show(rms, 'N')} (rms) at rest, for 3 s"
    return Experiment(words, planned, ("acceleration",))


def _equal_strokes(machine: Machine, bounds: Bounds) -> Experiment:
    distance = _brisk(bounds, made.length(machine, 50, 1))
    steps = _there_and_back(machine, bounds, distance, np.inf, 4 * made.pause(machine)) * 5
    words = f"a stroke of {show(distance, 'm', 3)}, five times there and back"
    return Experiment(words, schedule("equal strokes", machine, steps))


def _hold(machine: Machine, bounds: Bounds) -> Experiment:
    small = _reach(bounds, machine.specification.stroke)
    seconds = max(_within(machine, bounds, small), machine.specification.settling_time)
    steps = [Move(small, seconds, 4.0), Move(-small, seconds, 1.0)]
    return Experiment("a rest of 4 s after a small move", schedule("hold", machine, steps), ("time",))


BUILDERS: Final[tuple[Callable[[Machine, Bounds], Experiment], ...]] = (
    own_test,
    _ladder,
    _dwells,
    _speeds,
    _slow,
    _long,
    _far_and_slow,
    _hard,
    _at_places,
    _strong_shaking,
    _gentle_shaking,
    _equal_strokes,
    _hold,
)
