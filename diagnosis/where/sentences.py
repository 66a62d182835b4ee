"""What was located, in sentences: each is computed from the numbers, the one that says the most comes first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

import numpy as np

from diagnosis.criteria import Criteria
from diagnosis.where.added import OMITTED, Added
from diagnosis.where.controller import Replayed
from diagnosis.where.coordinates import Explained
from diagnosis.where.energy import Shares
from diagnosis.where.locate import Where
from diagnosis.where.side import Side, force_or_reading
from models.quantity import show, span

SLOW_CLOCK: Final = 0.5  # weight of the time since the record began, which correlates with whatever changes slowly
COORDINATE_WORDS: Final = {
    "time": "The time since the record began",
    "time_in_motion": "The time since the motion began",
    "dwell": "The duration of the rest before the motion",
    "position": "The position",
    "pitch": "The position",
    "velocity": "The speed",
    "velocity_sign": "The sign of the speed",
    "acceleration": "The acceleration",
    "command": "The command",
    "since_reversal": "The distance since the reversal",
    "command_change": "The change of the command from one sample to the next",
}
PHASES: Final = {
    "start": "at the start of a motion (its first tenth)",
    "accelerate": "while the reference accelerates",
    "cruise": "while the reference moves at constant speed",
    "decelerate": "while the reference decelerates",
    "settle": "while the table settles",
    "dwell": "at rest after the settling",
    "excitation": "during the excitation at rest",
}


class Topic(StrEnum):
    """What a statement is about."""

    CONTROLLER = "controller"  # the stated controller did not make a record
    UNCHECKED = "unchecked"  # whether it did cannot be checked
    SIZE = "size"
    ENERGY = "energy"  # in which motions, phases, frequencies or wavelengths the force lies
    COORDINATE = "coordinate"  # one on which the force depends
    NO_COORDINATE = "no_coordinate"
    PARITY = "parity"
    SCATTER = "scatter"
    SPIKE = "spike"
    SIDE = "side"  # force or reading
    DRIVE = "drive"
    FLOOR = "floor"


OTHER_GAIN: Final = 1e-3  # from 1, from which on a gain is told beside a delay


@dataclass(frozen=True)
class Statement:
    """A sentence, what it is about, and how certain or large that is [1]: of the findings the heaviest comes first."""

    topic: Topic
    text: str
    weight: float = 0.0


def statements(where: Where) -> tuple[Statement, ...]:
    """The controller where it does not replay, the size, the findings in the order of their weights, and the rest."""
    first = [*_controller(where), _size(where)]
    last = [*_drive(where), _floor(where)]
    if where.is_noise:
        side = [] if force_or_reading(where.sides, where.criteria) == "neither" else [_side(where)]
        return (*first, *_spike(where), *side, *last)
    findings = [one for part in (_energy, _coordinates, _parity, _scatter) for one in part(where)]
    findings.sort(key=lambda one: -one.weight)
    return (*first, *findings, *_spike(where), _side(where), *last)


def percent(share: float) -> str:
    """A share [1] in percent; two digits below 10 %."""
    return f"{100 * share:.0f} %" if share >= 0.1 or share == 0 else f"{100 * share:.2g} %"


def _interval(low: float, high: float) -> str:
    return span(percent(low), percent(high))


def _controller(where: Where) -> Iterator[Statement]:
    for i, one in enumerate(where.controller):
        record = f"record {i + 1}" if len(where.controller) > 1 else "the record"
        if not one.checked:
            text = f"Whether the stated controller made {record} cannot be checked, because {one.why_not}."
            yield Statement(Topic.UNCHECKED, text)
        elif one.added is not None and one.replays:
            yield Statement(Topic.CONTROLLER, added_in_words(one, one.added, record, where.sample_time))
        elif one.departs is not None:
            fits = f"with {one.remedy}, {show(one.remains, 'N', 2)} (rms) would remain" if one.remedy else (
                "none of the delays, gains and filters that were tried reproduces it"
            )  # fmt: skip
            fits += f"; {one.other}" if one.other else ""
            yield Statement(
                Topic.CONTROLLER,
                f"The stated controller did not make {record}: from sample {one.departs} on, its replay differs from "
                f"the logged command by up to {show(one.largest, 'N', 3)} ({show(one.rms, 'N', 3)} rms); {fits}.",
            )


def added_in_words(one: Replayed, signal: Added, record: str, sample_time: float) -> str:
    """What was added behind the controller of a record, sampled every sample_time [s]: a sentence or two."""
    rest = (
        f"what is left then, {show(signal.leaves, 'N', 2)} (rms), is no more than the noise of the log explains "
        f"({show(signal.noise, 'N', 2)})"
    )
    if signal.mapped:
        parts = [f"times {signal.gain:.4g} instead of 1"] * (abs(signal.gain - 1) > OTHER_GAIN or not signal.delay)
        parts += [signal.shift] * bool(signal.delay)
        how = f"acts {' and '.join(parts)}" if abs(signal.gain) > OMITTED else "does not act"
        before = (
            " Or the command is logged before the feedforward is added to it; then map a column that holds their sum."
        )
        logged = before if abs(signal.gain) <= OMITTED else ""
        named = f"{signal.name}, which is mapped to the feedforward," if signal.column else signal.name
        return (
            f"The stated controller made {record}, but {named} {how}: "
            f"{rest}. As mapped, the replay differs from the logged command by up to {show(one.largest, 'N', 3)} "
            f"({show(one.rms, 'N', 3)} rms); the diagnosis takes it as it acts.{logged}"
        )
    what = (
        "It is constant between its jumps, and no column that is known shows it"
        if signal.column is None
        else f"It is {signal.name} of the file times {show(signal.gain, 'N')}"
        + (f", {signal.shift}" if signal.delay else f' (feedforward = "{signal.column} * {show(signal.gain, "N")}")')
    )
    return (
        f"Something that is not in the mapping is added to the command downstream of the stated controller of {record}"
        f": up to {show(signal.largest, 'N', 3)}, {signal.when(sample_time)}. {what}; {rest}. The diagnosis takes it "
        "as a part of the feedforward."
    )


def _drive(where: Where) -> Iterator[Statement]:
    if where.beyond_rating is not None:
        yield Statement(
            Topic.DRIVE,
            f"The drive followed commands of up to {show(where.beyond_rating, 'N', 3)}, more than the rated thrust of "
            "the machine file.",
        )


def _size(where: Where) -> Statement:
    size, least = where.deviation, where.unknown.noise
    if where.is_noise:
        return Statement(
            Topic.SIZE,
            f"At the smoothing that fits best, the unknown force that remains, {show(size, 'N', 2)} (rms), is no "
            f"larger than the scale's noise alone would make it, {show(least, 'N', 2)}: there is no force to locate.",
        )
    return Statement(
        Topic.SIZE,
        f"At the smoothing that fits best (how far uses one smoothing for all models), an unknown force of "
        f"{show(size, 'N', 3)} (rms) remains, {size / least:.1f} times what the scale's noise alone would cause "
        f"({show(least, 'N', 2)}).",
    )


def _spike(where: Where) -> Iterator[Statement]:
    if where.spike:
        yield Statement(
            Topic.SPIKE,
            f"Single samples stand out: the reading at {where.spike.sample * where.sample_time:.4g} s of record "
            f"{where.spike.record + 1} is {where.spike.deviations:.0f} standard deviations of the noise off, as if a "
            "reading had been lost or held, or something had struck the table.",
        )


def _floor(where: Where) -> Statement:
    floor = where.unknown.floor
    if floor.repeats is None:
        return Statement(
            Topic.FLOOR,
            "No motion is repeated, so repeats give no noise floor; the innovations put it at "
            f"{show(floor.position, 'm', 2)} and {show(floor.force, 'N', 2)}.",
        )
    repeats = f"{percent(floor.repeats)} of the force's variance repeats, which an effect could explain"
    if floor.repeats < where.criteria.stated_share:
        repeats = "none of the force repeats"
    groups = f"{floor.motions} in {floor.groups} group{'s' * (floor.groups > 1)}"
    noise = show(where.unknown.noise, "N", 2)
    by_noise = f"the scale's noise alone would cause {noise}"
    if floor.force < where.unknown.noise:
        by_noise = f"that is no more than the scale's noise alone would cause, {noise}"
    return Statement(
        Topic.FLOOR,
        f"Between equal motions ({groups}) {repeats}. What does not, {show(floor.force, 'N', 2)} and "
        f"{show(floor.position, 'm', 2)} of position, is this force's noise floor; {by_noise}.",
    )


def _standing_out(shares: Shares, criteria: Criteria) -> int | None:
    """The part whose share of the energy most exceeds its share of the time, if it does so clearly."""
    i = max(range(len(shares.names)), key=lambda i: float(shares.share[i] - shares.time[i]))
    least = max(criteria.stands_out * shares.time[i], criteria.stated_share)
    return i if shares.share[i] > least else None


def _part(shares: Shares, i: int, name: str) -> Statement:
    share, time, low = float(shares.share[i]), float(shares.time[i]), float(shares.low[i])
    span = _interval(low, float(shares.high[i]))
    text = f"{percent(share)} ({span}) of its energy falls {name}, over {percent(time)} of the time."
    return Statement(Topic.ENERGY, text, low - time)


def _energy(where: Where) -> Iterator[Statement]:
    motion, phase = (_standing_out(one, where.criteria) for one in (where.energy.motion, where.energy.phase))
    if motion is not None:
        yield _part(where.energy.motion, motion, f"in {where.energy.motion.names[motion]}")
    if phase is not None and where.energy.phase.names[phase] != "excitation":  # a kind of motion says the same
        yield _part(where.energy.phase, phase, PHASES[where.energy.phase.names[phase]])
    spectra = (
        (where.energy.band, "of its energy falls within"),
        (where.energy.wavelength, "of its energy while moving falls in wavelengths"),
    )
    for shares, part in spectra:
        i = shares.ranked()[0]
        if shares.low[i] > where.criteria.stated_share:
            span = _interval(float(shares.low[i]), float(shares.high[i]))
            text = f"{percent(float(shares.share[i]))} ({span}) {part} {shares.names[i]}."
            yield Statement(Topic.ENERGY, text, float(shares.low[i]) - 0.5)


def _coordinates(where: Where) -> Iterator[Statement]:
    criteria = where.criteria
    stated = [
        one
        for one in where.dependence.coordinates
        if one.is_stated(criteria) or (one.share > criteria.stated_share and one.low > criteria.certain_share)
    ]
    for one in stated:
        told = _explains(one, _longest_period(where))
        yield Statement(Topic.COORDINATE, told, one.low * (SLOW_CLOCK if one.name == "time" else 1.0))
    if not stated:
        best = where.dependence.coordinates[0]
        yield Statement(
            Topic.NO_COORDINATE,
            f"No single coordinate explains it on held-out motions: the best, {words(best.name)}, explains "
            f"{percent(best.share)} (p = {best.p:.2g}).",
        )


def _longest_period(where: Where) -> float:
    """The longest period [m] that the travel shows to repeat; 0 without travel."""
    ways = [np.ptp(one.values[where.samples.counts]) for one in where.coordinates if one.name == "position"]
    return float(max(ways, default=0.0)) / where.criteria.min_periods


def _explains(one: Explained, longest: float) -> str:
    """longest [m]: what repeats over more does not show that it does, and is told as a sine."""
    modulo = ""
    if one.pitch:
        period = show(one.pitch, "m", 3)
        few = f", as a sine with a period of {period} that the travel does not show to repeat,"
        modulo = f" modulo {period}" if one.pitch <= longest else few
    turns = ""
    if one.turning > 0.5 * one.share:
        of_it = "its change" if one.name == "command" else "motion"
        turns = f", with a sign that follows the direction of {of_it}"
    return (
        f"{COORDINATE_WORDS[one.name]}{modulo} explains {percent(one.share)} ({_interval(one.low, one.high)}) of its "
        f"variance on held-out motions{turns} (p = {one.p:.2g})."
    )


def _parity(where: Where) -> Iterator[Statement]:
    even, odd = where.dependence.parity
    criteria = where.criteria
    if max(even.share, odd.share) > criteria.stated_share and min(even.p, odd.p) < criteria.stated_p_value:
        yield Statement(
            Topic.PARITY,
            f"While the table moves, {percent(even.share)} of it is an even function of the speed (the same in both "
            f"directions) and {percent(odd.share)} an odd one (it changes sign with the speed).",
            max(even.low, odd.low),
        )


def _scatter(where: Where) -> Iterator[Statement]:
    for one in where.dependence.scatter[:1]:
        if one.is_stated(where.criteria):
            yield Statement(
                Topic.SCATTER,
                f"While the table moves, the magnitude of the innovations depends on {words(one.name)} "
                f"({percent(one.share)} of its variance, p = {one.p:.2g}).",
                one.low,
            )


def _side(where: Where) -> Statement:
    force = max(where.sides, key=lambda one: one.force)
    reading = max(where.sides, key=lambda one: one.reading)
    start = {
        "force": "It acts as a force, not as an error of the scale",
        "scale": "It acts as an error of the scale, not as a force",
        "either": "A force and an error of the scale explain it about equally well",
        "neither": "Neither a force nor an error of the scale over a single coordinate explains it",
    }[force_or_reading(where.sides, where.criteria)]
    return Statement(
        Topic.SIDE,
        f"{start}: on held-out motions, curves over {_over(force)} as a force lower chi-square by {force.force:.0f}, "
        f"curves over {_over(reading)} as an error of the reading by {reading.reading:.0f}.",
    )


def _over(side: Side) -> str:
    """The variable of a curve, within a sentence."""
    return f"the position modulo {show(side.pitch, 'm', 4)}" if side.pitch else words(side.coordinate)


def words(name: str) -> str:
    """A coordinate's name within a sentence; SI."""
    text = COORDINATE_WORDS[name]
    return text[0].lower() + text[1:]
