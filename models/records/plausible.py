"""Whether a record can be what it says: its scale, signs and columns, judged by the machine's own quantities.

Each doubt is a sentence. A record with one is refused, unless it is said to be right as it is.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.quantity import show
from models.records.checks import (
    INERTIA,
    Facts,
    at_rest,
    fitted_mass,
    is_at_rate,
    quantisation,
    replay,
    smoothed,
)
from models.records.feedback_sign import Mistake, is_made_by, mistake
from models.records.record import Record

Array = NDArray[np.float64]

THOUSAND: Final = (300.0, 3000.0)  # a ratio in here is a factor of 1000, or its inverse
# A loop keeps the position to the reference, so that a ratio beyond this one, where they go together so CLOSELY, is a
# factor of units wherever the error would have made the stated controller put out UNIT_ERROR_THRUST_RATIO times what
# was logged.
UNIT_ERROR_RATIO: Final = 1.5
CLOSELY: Final = 0.98  # correlation
UNIT_ERROR_THRUST_RATIO: Final = 3.0
# A factor of all commands, or its inverse, from which on it is one of units; a loop may be tuned for another load.
UNIT_ERROR_FACTOR: Final = 4.0
MADE: Final = 0.05  # of the command's deviation: the stated controller, times a factor, leaves less than this
IDLE: Final = 1e-3  # of the command: a feedback that adds less was switched off
PEAK: Final = 100.0  # times the rated thrust, which no drive gives
# What holds an axis beyond so many times its friction, and within such a share of the rated thrust, is a force that the
# file does not have (cogging, a cable), rather than an error of units.
UNMODELLED: Final = (3.0, 0.1)
# A speed beyond so many times the one that the rated thrust gives over the whole way is an error of units, as it would
# take a hundred times the force, or a hundredth of the mass.
FASTER: Final = 10.0
# Of its distance from the stated offset, within which a mean command at rest of minus that offset is one with its sign
# turned.
TURNED_OFFSET_RATIO: Final = 0.2
CLOSED: Final = 0.1  # of the way, within which a path ends where it began
FEWEST_WINDOWS: Final = 40  # in a record at least, over which its slowest motion is seen
TAKEN: Final = -0.5  # of all that a command does, from which on it takes out what it should put in,
OF_FRICTION: Final = -0.3  # and of what the stated friction takes on the way; noise and resonances make 0.04 of it
SLIGHT: Final = 0.005  # of the rated thrust: friction that is less is not what such work is told by
FLICKER: Final = 20.0  # steps of the scale that a reading may jump by without a motion
FEWEST_SPACED: Final = 50  # samples that a reading of slow motions is compared at
MIN_REPEATED_SAMPLES: Final = 4  # samples alike, from which on a log is thought to repeat the first of them
MIN_CATCH_UP_RATIO: Final = 3.0  # times the steps before and after, from which on a step makes up for what was missed
NEIGHBOURS: Final = 20  # samples on either side with which a step of the position is compared
MIN_GAP_RATIO: Final = 10.0  # times the largest of these, from which on a step is one over samples that are missing
SMOOTHED: Final = 20  # samples over which accelerations are taken
# Jumps, and their share of the samples, up to which a reading is at fault; more: a wrong unit.
MAX_JUMPS, MAX_JUMP_SHARE = 10, 1e-3


def doubts(record: Record, given: set[str], facts: Facts, as_it_ran: Record | None = None) -> Iterator[str]:
    """Why a record can't be what it says, in whole sentences, the plainest first. given: signals that the file has.

    as_it_ran: the record as the stated feedback made it, where that differs, as for a derivative of the position.
    """
    ran = as_it_ran or record
    yield from _against_sample_time(record, facts)
    yield from _swapped(record, given)
    against = [*_against_feedback(ran, facts)] if {"reference", "target"} & given else []
    yield from against or _against_motion(ran, facts)
    if "reference" in given and np.ptp(record.reference) > 0:
        yield from _against_reference(ran, facts)
    yield from _against_scale(record, facts)
    yield from _jumps(record, facts)
    yield from _gaps(record, given, facts)
    yield from _held(record, given, facts)
    yield from _against_force(record, facts)
    if "reference" in given:
        yield from _against_unit(ran, facts)
    if {"reference", "target"} & given and not against:  # the sign of the command alone turns the offset, too
        yield from _against_offset(record, facts)


def _against_sample_time(record: Record, facts: Facts) -> Iterator[str]:
    if facts.sample_time is not None and _thousand(record.sample_time / facts.sample_time):
        yield (
            f"the sample time is {show(record.sample_time, 's')} and the machine's {show(facts.sample_time, 's')}, a "
            "factor of 1000: the time's unit is wrong; mark it, as in [ms]"
        )


def _thousand(ratio: float) -> bool:
    size = abs(ratio)
    return THOUSAND[0] < size < THOUSAND[1] or 1 / THOUSAND[1] < size < 1 / THOUSAND[0]


def _off(ratio: float) -> bool:
    """Whether a ratio is a factor of a thousand or more, or its inverse."""
    return not 1 / THOUSAND[0] <= abs(ratio) <= THOUSAND[0]


def _factor(ratio: float) -> str:
    """The power of a thousand next to a ratio, or to its inverse."""
    power = max(round(abs(math.log10(abs(ratio) or 1e-300)) / 3), 1)
    return f"a factor of {1000**power}"


def _correlation(one: Array, other: Array) -> float:
    if np.ptp(one) == 0 or np.ptp(other) == 0:
        return 0.0
    return float(np.corrcoef(one, other)[0, 1])


def _roughness(signal: Array) -> float:
    """Second differences against the whole: a position is smooth, the force that drives it is not."""
    return float(np.std(np.diff(signal, 2)) / np.std(signal))


def _until_it_moves(position: Array) -> int:
    """The samples in which a reading (n,) moves by FLICKER steps of its scale on average, so that these do not pass for
    roughness; as few as leave FEWEST_SPACED of them."""
    step, moved = quantisation(position), float(np.mean(np.abs(np.diff(position))))
    return max(min(math.ceil(FLICKER * step / moved), position.size // FEWEST_SPACED), 1)


def _swapped(record: Record, given: set[str]) -> Iterator[str]:
    if np.ptp(record.position) == 0 or np.ptp(record.command) == 0:
        return
    moved = "reference" in given and np.ptp(record.reference) > 0
    every = 1 if moved else _until_it_moves(record.position)
    rougher = _roughness(record.position[::every]) / max(_roughness(record.command[::every]), 1e-300)
    if moved:  # a loop that stiff contacts hold by half a stroke commands what it is asked for, but not as smoothly
        position, command = (abs(_correlation(s, record.reference)) for s in (record.position, record.command))
        swapped = command > 0.9 and command > position + 0.2 and rougher > 1
    else:
        swapped = rougher > 30
    if swapped:
        yield (
            "position and command look swapped: the command is what follows the reference, or is the smoother one; "
            "map each to its column"
        )


def _against_feedback(record: Record, facts: Facts) -> Iterator[str]:
    """A command that answers the wrong way round."""
    match mistake(record, facts.pid, facts.reference_delay):
        case Mistake.SWAPPED:
            yield (
                "reference and position look swapped: the stated controller makes the logged command where the two are "
                "exchanged, and not as they are; map each to its column, or turn both by "
                '"NAME * -1" where they count against the command'
            )
        case Mistake.TURNED:
            yield (
                "the sign of the command looks turned: the stated controller makes -1 times what is logged; turn it by "
                '"NAME * -1"'
            )
        case Mistake.FEEDFORWARD:
            yield (
                "the sign of the feedforward looks turned: the stated controller makes the logged command with -1 "
                'times the feedforward, and not with it as it is; turn it by "NAME * -1"'
            )
        case Mistake.BOTH:
            yield (
                "the signs of command and feedforward look turned: the stated controller makes -1 times what is logged "
                'of both; turn each by "NAME * -1", as in "CURRENT * -42 N/A"'
            )
        case Mistake.EITHER:
            yield (
                "reference and position look swapped, or the sign of the command turned: the command falls where the "
                "reference rises, which no stable loop does; map each to its column, or "
                'turn the command by "NAME * -1"'
            )


def _against_motion(record: Record, facts: Facts) -> Iterator[str]:
    """A command that takes energy out of the axis, where the stated controller does not show its sign.

    Along a path that ends where it began all that springs and gravity take comes back, and friction takes more. Where a
    resonance lies between motor and scale they may well move against each other, and a controller pushes against what
    a scale's noise looks like, so that the slowest part of the motion counts, beside what the stated friction takes.
    """
    closed = abs(record.position[-1] - record.position[0]) <= CLOSED * np.ptp(record.position)
    if not closed or not facts.friction or facts.friction < SLIGHT * (facts.limit or 0.0):
        return
    if facts.pid is not None and is_made_by(record, facts.pid, facts.reference_delay):
        return
    widest = record.position.size // FEWEST_WINDOWS
    parts = [_put_in(record, samples, facts) for samples in (widest // 2, widest) if samples >= SMOOTHED]
    if len(parts) > 1 and all(share < TAKEN and ratio < OF_FRICTION for share, ratio in parts):
        yield (
            "the command brakes the motion: over a path that ends where it began it takes energy out of the axis; its "
            'sign looks turned, or that of position and reference; turn it by "NAME * -1"'
        )


def _put_in(record: Record, samples: int, facts: Facts) -> tuple[float, float]:
    """The work of the command but for what the mass has more at the end than at first, over all that it did in either
    direction, and over what the stated friction takes on that way [1]; smoothed over so many samples."""
    _, speed, _, force = smoothed(record, samples)
    work = (force - np.mean(force)) * speed
    moved = 0.5 * (facts.mass or 0.0) * (speed[-1] ** 2 - speed[0] ** 2) / record.sample_time
    by_friction = (facts.friction or 0.0) * float(np.sum(np.abs(speed)))
    left = float(np.sum(work)) - moved
    return left / max(float(np.sum(np.abs(work))), 1e-300), left / max(by_friction, 1e-300)


def _against_offset(record: Record, facts: Facts) -> Iterator[str]:
    """All signs turned, as where down counts as positive. The controller does not show it, as its law is the same; the
    force that the axis holds at rest does, where nothing that is stated could hold the axis against the offset."""
    rests = at_rest(record)
    if not facts.offset or facts.friction is None or not rests.any():
        return
    held = facts.friction + facts.by_place + facts.spring * float(np.max(np.abs(record.position[rests])))
    mean = float(np.mean(record.command[rests]))
    near, far = abs(mean + facts.offset), abs(mean - facts.offset)
    if abs(facts.offset) > held and near < TURNED_OFFSET_RATIO * far:
        yield (
            f"at rest the command is {show(mean, 'N', 3)} on average where the machine file has an offset of "
            f"{show(facts.offset, 'N', 3)}: all signs of the log look turned, as where down counts as positive; turn "
            'each signal but the time by "NAME * -1", or correct the sign of the offset in the machine file'
        )


def _against_reference(record: Record, facts: Facts) -> Iterator[str]:
    """A wrong unit or a turned sign between position and reference."""
    correlation = abs(_correlation(record.reference, record.position))
    if correlation <= 0.9:
        return
    slope = float(np.polyfit(record.reference, record.position, 1)[0])
    if _off(slope):
        counts = (
            facts.resolution is not None and 1 / UNIT_ERROR_RATIO < abs(slope) * facts.resolution < UNIT_ERROR_RATIO
        )
        in_counts = f"as it would in counts of {show(facts.resolution or 0.0, 'm')}"
        yield (
            f"the position moves {abs(slope):.4g} times as far as the reference, "
            f"{in_counts if counts else _factor(slope)}: the unit of "
            f"one of them is wrong; {_mark(facts.resolution if counts else None)}"
        )
    elif slope < 0:
        yield 'the position moves against the reference: a sign is wrong; turn it by "NAME * -1"'
    elif (
        correlation > CLOSELY
        and not 1 / UNIT_ERROR_RATIO < slope < UNIT_ERROR_RATIO
        and (times := _asked_for(record, facts)) > UNIT_ERROR_THRUST_RATIO
    ):
        yield (
            f"the position moves {slope:.4g} times as far as the reference, and at such an error the stated controller "
            f"would put out {times:.3g} times the command that is logged: the unit or factor of one of them is wrong; "
            'mark it, as in [mm], or correct it, as in "NAME * 1 nm"'
        )


def _mark(resolution: float | None) -> str:
    """How a unit is stated; with a resolution [m]: that of counts."""
    return "mark it, as in [mm]" if resolution is None else f'give it, as in "NAME * {show(resolution, "m")}"'


def _asked_for(record: Record, facts: Facts) -> float:
    """What the stated feedback makes of a record's error, over the command of the record: each without its constant and
    as standard deviations [1]; 0 where no feedback is stated or none acted."""
    acted = float(np.std(record.command - record.feedforward))
    if facts.pid is None or acted <= IDLE * float(np.std(record.command)):
        return 0.0
    alone = replace(record, feedforward=np.zeros(record.command.size))
    return float(np.std(replay(alone, facts.pid, facts.reference_delay)) / np.std(record.command))


def _against_scale(record: Record, facts: Facts) -> Iterator[str]:
    """Steps of the reading that are far coarser than those of the machine's scale; finer ones may be digits."""
    step = quantisation(record.position) if facts.resolution else 0.0
    if facts.resolution and step > THOUSAND[0] * facts.resolution:
        yield (
            f"the position has steps of {show(step, 'm')} where the machine's scale resolves "
            f"{show(facts.resolution, 'm')}, {_factor(step / facts.resolution)}: the position's unit is wrong; mark "
            "it, as in [mm], or correct the resolution in the machine file"
        )


def _jumps(record: Record, facts: Facts) -> Iterator[str]:
    """Steps from one sample to the next that the drive can't make: F moves M at up to sqrt(2 F/M s) over a way s."""
    if not (facts.mass and facts.limit):
        return
    speed = FASTER * math.sqrt(2 * facts.limit / facts.mass * float(np.ptp(record.position)))
    most = speed * record.sample_time + _flicker(record, facts)
    steps = np.abs(np.diff(record.position))
    beyond = np.flatnonzero(steps > most)
    if beyond.size == 0:
        return
    drive = f"{show(facts.limit, 'N')} move {show(facts.mass, 'kg')} by less than {show(most, 'm', 2)} in that time"
    if beyond.size > max(MAX_JUMPS, MAX_JUMP_SHARE * steps.size):
        yield (
            f"the position moves by up to {show(float(np.max(steps)), 'm', 3)} from one sample to the next, and "
            f"{drive}: the unit of position or time is wrong; mark it, as in [um] or [ms]"
        )
        return
    row = int(beyond[0]) + 2  # of the sample after the jump
    yield (
        f"the position jumps by {show(float(steps[row - 2]), 'm', 3)} at {show((row - 1) * record.sample_time, 's')} "
        f"after the start (row {row}, line {row + 1} of a CSV), {_times(beyond.size)}, and {drive}; "
        "cut the record there"
    )


def _gaps(record: Record, given: set[str], facts: Facts) -> Iterator[str]:
    """A step of the position amid far smaller ones while the reference moves, which the drive can't make from rest:
    samples were lost there, and the time goes on without them, as that of a count of rows does. At rest it may be
    counts that the scale lost, which are to be diagnosed."""
    if not (facts.mass and facts.limit) or "reference" not in given or record.position.size < 2 * NEIGHBOURS + 2:
        return
    steps, asked = np.abs(np.diff(record.position)), np.diff(record.reference)
    around = np.lib.stride_tricks.sliding_window_view(np.pad(steps, NEIGHBOURS, mode="edge"), 2 * NEIGHBOURS + 1)
    beside = np.maximum(around[:, :NEIGHBOURS].max(axis=1), around[:, NEIGHBOURS + 1 :].max(axis=1))
    reach = FASTER * facts.limit / facts.mass * record.sample_time**2 + _flicker(record, facts)
    lost = np.flatnonzero((steps > np.maximum(MIN_GAP_RATIO * beside, reach)) & (asked != 0))
    if lost.size == 0:
        return
    first = int(lost[0])
    step, others = show(float(steps[first]), "m", 3), show(float(beside[first]), "m", 2)
    yield (
        f"the position moves by {step} in one sample and by {others} at most in those beside it, "
        f"{show((first + 1) * record.sample_time, 's')} after the start (row {first + 2}, line {first + 3} of a CSV), "
        f"{_times(lost.size)}: samples are missing there, or the scale lost counts; map the time that was logged, or "
        "cut the record there"
    )


def _held(record: Record, given: set[str], facts: Facts) -> Iterator[str]:
    """Samples that a logger repeated: position and command stand still together while the reference goes on, and what
    was missed is made up for in one step, which is far larger than those beside it."""
    if not {"command", "reference"} <= given:
        return
    if facts.sample_time is not None and not is_at_rate(record, facts.sample_time):
        return  # between the samples of a slower log a small motion may begin and end
    steps, stands = np.abs(np.diff(record.position)), np.diff(record.command) == 0
    still = np.concatenate([[False], (steps == 0) & stands, [False]])
    begins, ends = (np.flatnonzero(np.diff(still.astype(int)) == sign) for sign in (1, -1))
    inside = (begins > 0) & (ends + 1 < steps.size) & (ends - begins + 1 >= MIN_REPEATED_SAMPLES)
    begins, ends = begins[inside], ends[inside]
    beside = np.maximum(steps[begins - 1], steps[np.minimum(ends + 1, steps.size - 1)])
    late = steps[ends] > np.maximum(MIN_CATCH_UP_RATIO * beside, _flicker(record, facts))
    late &= record.reference[ends + 1] != record.reference[begins]  # at rest it may be a count that was lost
    if not late.any():
        return
    first = int(np.argmax(late))
    begin, length = int(begins[first]), int(ends[first] - begins[first]) + 1
    yield (
        f"position and command stand still for {length} samples from {show(begin * record.sample_time, 's')} after the "
        f"start on (row {begin + 1}, line {begin + 2} of a CSV), and the position then moves by "
        f"{show(float(steps[ends[first]]), 'm', 3)} at once, {_times(int(np.count_nonzero(late)))}: the log repeats "
        "old samples; log again, or cut the record there"
    )


def _flicker(record: Record, facts: Facts) -> float:
    """By how much [m] a reading may change without a motion."""
    return FLICKER * max(facts.resolution or 0.0, quantisation(record.position))


def _times(count: int) -> str:
    return "once" if count == 1 else f"the first of {count} such jumps"


def _against_force(record: Record, facts: Facts) -> Iterator[str]:
    """A wrong unit between the command and the motion that it makes, by mass, thrust and stiffness."""
    _, speed, acceleration, force = (part[SMOOTHED:-SMOOTHED] for part in smoothed(record, SMOOTHED))
    if force.size < SMOOTHED or np.std(force) == 0:
        return
    way = float(np.ptp(record.position))
    top, wide, scatter = float(np.max(np.abs(force))), float(np.ptp(force)), float(np.std(force))
    if facts.limit and top > PEAK * facts.limit:
        yield (
            f"the command reaches {show(top, 'N', 3)} where the drive is rated for {show(facts.limit, 'N')}: the "
            'command\'s unit is wrong; mark it, as in [mN], or give its factor, as in "NAME [V] * 35 N/V"'
        )
    if facts.mass:
        yield from _against_mass(speed, acceleration, force, facts.mass)
        inertia = facts.mass * float(np.std(acceleration))
        if inertia > THOUSAND[0] * scatter and way > _flicker(record, facts):
            yield (
                f"the motion takes {show(inertia, 'N', 3)} to move {show(facts.mass, 'kg')}, and the command has "
                f"{show(scatter, 'N', 3)}, {_factor(inertia / scatter)} apart (root mean square): the unit of "
                "command or position is wrong; mark it"
            )
    against = float(np.ptp(force - (facts.mass or 0.0) * acceleration))  # what does not accelerate the axis holds it
    held = facts.stiffness
    if held and not _unmodelled(against / 2, facts) and way < min(wide, against) / held / THOUSAND[0]:
        yield (
            f"the position moves by {show(way, 'm', 3)} under commands that differ by {show(wide, 'N', 3)}, which "
            f"friction and springs as stated let it move by {show(wide / held, 'm', 3)}: the unit of command or "
            "position is wrong, mark it; or a spring holds the axis, state it as stiffness in [effects.cable_spring]"
        )


def _unmodelled(force: float, facts: Facts) -> bool:
    """Whether a force [N] may well hold the axis although the file has no such friction; see UNMODELLED."""
    if facts.friction is None or facts.limit is None:
        return False
    more, share = UNMODELLED
    return more * facts.friction < force < share * facts.limit


def _against_unit(record: Record, facts: Facts) -> Iterator[str]:
    """A command in another unit than its column says, by a factor that both the controller and the mass show."""
    if facts.pid is None or not facts.mass or np.std(record.command) == 0:
        return
    _, speed, acceleration, force = (part[SMOOTHED:-SMOOTHED] for part in smoothed(record, SMOOTHED))
    if force.size < SMOOTHED or np.std(acceleration) == 0:
        return
    made = replay(record, facts.pid, facts.reference_delay)
    shown, left = fitted_mass(speed, acceleration, force)
    for column, logged in ((made, record.command), (made - record.feedforward, record.command - record.feedforward)):
        factor, rest = _factor_of(column, logged)
        agrees = factor > 0 and 1 / UNIT_ERROR_RATIO < shown / facts.mass / factor < UNIT_ERROR_RATIO
        another = not 1 / UNIT_ERROR_FACTOR < factor < UNIT_ERROR_FACTOR and rest < MADE * float(np.std(record.command))
        if another and agrees and float(np.var(left)) < 0.5 * float(np.var(force)):
            yield (
                f"the command is {factor:.4g} times what the stated controller makes, and moves {show(shown, 'kg', 3)} "
                f"where {show(facts.mass, 'kg', 3)} are known: one of its units is {show(1 / factor, 'N', 4)}; give "
                f'the factor, as in "NAME * {show(1 / factor, "N", 4)}"'
            )
            return


def _factor_of(column: Array, logged: Array) -> tuple[float, float]:
    """The factor [1] of a column (n,) in a logged signal, a constant aside, and the deviation that is left."""
    if np.ptp(column) == 0:
        return 0.0, math.inf
    factor = float(np.cov(column, logged)[0, 1] / np.var(column, ddof=1))
    return factor, float(np.std(logged - factor * column))


def _against_mass(speed: Array, acceleration: Array, force: Array, mass: float) -> Iterator[str]:
    """A factor of 1000 between the mass that explains the command, with friction or alone, and the machine's [kg]."""
    shown, left = fitted_mass(speed, acceleration, force)
    ratio, power = abs(shown / mass), float(np.var(force))
    explained = _thousand(ratio) and float(np.var(left)) < 0.5 * power
    if explained or (shown > 0 and _off(ratio) and float(np.var(shown * acceleration)) > INERTIA * power):
        yield (
            f"the command moves a mass of {show(shown, 'kg')} where {show(mass, 'kg')} are known, "
            f"{_factor(ratio)}: the unit of command or position is wrong; mark it"
        )
