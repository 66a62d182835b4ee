"""The menu: experiments that can be run on a machine, each in words, with the coordinates that it varies the most."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from diagnosis.experiments.schedules import (
    Schedule,
    amplitude_ladder,
    at_share,
    dwell_stroke,
    dwell_sweep,
    hard_moves,
    hold,
    ladder,
    length,
    moves_along,
    multisine,
    nested_loops,
    pause,
    reach,
    repeated_strokes,
    rests,
    room,
    rounded,
    shaking,
    strokes,
    top,
)
from models.machine import Machine
from models.quantity import listed, show

HALF_WAY: Final = 0.45  # of the stated travel, over which what depends on the place is looked at, at the least
AT_TOP_SPEED: Final = 3.0  # s that such a stroke takes at the rated speed, at the most
FAST_MOVE_PLACES: Final = 6  # along the way at which fast moves are made
SPEEDS: Final = (0.0021, 0.0083, 0.021, 0.042)  # of the rated speed


@dataclass(frozen=True)
class Experiment:
    """One entry of the menu: its settings in words, its schedule, and the coordinates that it varies the most."""

    words: str
    schedule: Schedule
    coordinates: tuple[str, ...] = ()


def menu(machine: Machine) -> tuple[Experiment, ...]:
    """The experiments that can be run on this machine, with settings within its ratings."""
    high, each_way = top(machine), 8 * pause(machine)
    stroke, short = length(machine, 100, 0.1), length(machine, 10, 0.1)
    half = min(HALF_WAY * machine.drive.travel, AT_TOP_SPEED * machine.drive.rated_speed)
    longest = max(length(machine, 600, 3), min(rounded(half), room(machine)))
    apart = min(length(machine, 100, 0.5), (room(machine) - short) / (FAST_MOVE_PLACES - 1))
    apart = apart if apart > machine.scale.resolution else 0.0  # what the scale cannot tell apart is one place
    where = (
        f"at {FAST_MOVE_PLACES} places {show(apart, 'm', 3)} apart"
        if apart > 0
        else f"{FAST_MOVE_PLACES} times at one place"
    )
    speeds = tuple(dict.fromkeys(rounded(at_share(machine, stroke, share), 3) for share in SPEEDS))
    slow, fast = speeds[0], rounded(at_share(machine, longest, 1 / 16), 3)
    loops = tuple(rounded(share * min(reach(machine), room(machine))) for share in (0.3, 0.1, 0.03, 0.01))
    strong, gentle = shaking(machine), shaking(machine, 0.018)
    return (
        Experiment(
            f"a dwell sweep: moves of {show(dwell_stroke(machine), 'm', 3)} after rests of {_list(rests(machine), 1)} "
            "s, onward in the same direction and back",
            dwell_sweep(machine),
            ("dwell", "time_in_motion"),
        ),
        Experiment("a hold: nothing moves for 15 s", hold(machine), ("time",)),
        Experiment(
            f"a speed ladder: strokes of {show(stroke, 'm', 3)} there and back at peak speeds of {_list(speeds, 1e3)} "
            "mm/s",
            strokes(machine, stroke, speeds),
            ("velocity", "velocity_sign"),
        ),
        Experiment(
            f"a slow stroke of {show(stroke, 'm', 3)} there and back at {slow * 1e3:g} mm/s, not commensurate with "
            "the scale's period",
            strokes(machine, min(stroke + 0.17 * reach(machine), room(machine)), (slow,)),
            (),
        ),
        Experiment(
            f"long strokes of {show(longest, 'm', 3)} there and back at {1e3 * fast:g} mm/s, twice",
            strokes(machine, longest, (fast,), passes=2),
            ("position", "pitch"),
        ),
        Experiment(
            f"a multisine of {high / 200:g} to {high:g} Hz and {show(strong, 'N')} (rms) at rest, for "
            f"{show(3200 / high, 's', 3)}",
            multisine(machine, (high / 200, high), strong),
            ("acceleration",),
        ),
        Experiment(
            f"a small multisine of {high / 400:g} to {high / 8:g} Hz and {show(gentle, 'N')} (rms) at rest, for "
            f"{show(3200 / high, 's', 3)}",
            multisine(machine, (high / 400, high / 8), gentle, 3200 / high),
        ),
        Experiment(
            f"nested loops of {_lengths(loops)} back and forth, {show(each_way, 's', 3)} each way",
            nested_loops(machine, loops, each_way),
            ("since_reversal",),
        ),
        Experiment(
            f"an amplitude ladder: moves of {_lengths(ladder(machine))}, twice up and twice down",
            amplitude_ladder(machine),
        ),
        Experiment(
            f"hard moves of {show(short, 'm', 3)} there and back at 20, 40, 60 and 80 % of the rated thrust, twice "
            "each",
            hard_moves(machine, short),
            ("command",),
        ),
        Experiment(
            f"fast moves of {show(short, 'm', 3)} back and forth, at half the rated thrust, {where}",
            moves_along(machine, FAST_MOVE_PLACES, apart, short),
        ),
        Experiment(
            f"one stroke of {show(length(machine, 50, 1), 'm', 3)} at the same place, twelve times there and back",
            repeated_strokes(machine),
        ),
    )


def _lengths(numbers: Sequence[float]) -> str:
    """Lengths [m] as text."""
    return listed(show(number, "m", 3) for number in numbers)


def _list(numbers: Sequence[float], factor: float) -> str:
    """Numbers times a factor, as text."""
    return listed(f"{factor * number:g}" for number in dict.fromkeys(numbers))
