"""What was located, in sentences: each is computed from the numbers, the one that says the most comes first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from diagnosis.where.coordinates import SURE, Explained
from diagnosis.where.energy import Shares
from diagnosis.where.locate import Where
from diagnosis.where.side import Side, force_or_reading
from models.quantity import show

LEAST: Final = 0.02  # share below which a finding is not worth a sentence
CERTAIN: Final = 0.2  # lower end of a share's interval from which on it is stated even if few motions make p large
SLOW_CLOCK: Final = 0.5  # weight of the time since the record began, which correlates with whatever changes slowly
MORE: Final = 1.3  # ratio of a part's share of the energy to its share of the time from which on it stands out
COORDINATES: Final = {
    "time": "The time since the record began",
    "time_in_motion": "The time since the motion began",
    "dwell": "The rest before the motion",
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
    "start": "while a motion starts (the first tenth of it)",
    "accelerate": "while the reference accelerates",
    "cruise": "while the reference moves at constant speed",
    "decelerate": "while the reference decelerates",
    "settle": "while the table settles",
    "dwell": "at rest behind the settling",
    "excitation": "under the excitation at rest",
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
        side = [] if force_or_reading(where.sides) == "neither" else [_side(where)]
        return (*first, *_spike(where), *side, *last)
    findings = [one for part in (_energy, _coordinates, _parity, _scatter) for one in part(where)]
    findings.sort(key=lambda one: -one.weight)
    return (*first, *findings, *_spike(where), _side(where), *last)


def percent(share: float) -> str:
    """A share [1] in percent; two digits below 10 %."""
    return f"{100 * share:.0f} %" if share >= 0.1 or share == 0 else f"{100 * share:.2g} %"


def _interval(low: float, high: float) -> str:
    return f"{percent(low)} to {percent(high)}"


def _controller(where: Where) -> Iterator[Statement]:
    for i, one in enumerate(where.controller):
        record = f"record {i + 1}" if len(where.controller) > 1 else "the record"
        if not one.checked:
            text = f"Whether the stated controller made {record} can't be checked: it has no reference."
            yield Statement(Topic.UNCHECKED, text)
        elif one.departs is not None:
            fits = f"with {one.remedy}, {show(one.remains, 'N', 2)} (rms) would be left" if one.remedy else (
                "no shift, delay or gain that was tried makes it fit"
            )  # fmt: skip
            yield Statement(
                Topic.CONTROLLER,
                f"The stated controller did not make {record}: replayed, it departs from sample {one.departs} on, by "
                f"up to {show(one.largest, 'N', 3)} ({show(one.rms, 'N', 3)} rms); {fits}.",
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
            f"What is left as an unknown force, {show(size, 'N', 2)} (rms), is no more than the scale's noise leaves "
            f"of the forces, {show(least, 'N', 2)}: there is no force to locate.",
        )
    return Statement(
        Topic.SIZE,
        f"An unknown force of {show(size, 'N', 3)} (rms) is left, {size / least:.1f} times what the scale's noise "
        f"would leave ({show(least, 'N', 2)}).",
    )


def _spike(where: Where) -> Iterator[Statement]:
    if where.spike:
        yield Statement(
            Topic.SPIKE,
            f"Single samples stand out: the reading at {where.spike.sample * where.sample_time:.4g} s of record "
            f"{where.spike.record + 1} is {where.spike.deviations:.0f} deviations of noise off, as where a reading was "
            "lost or held, or something struck the table.",
        )


def _floor(where: Where) -> Statement:
    floor = where.unknown.floor
    if floor.repeats is None:
        return Statement(
            Topic.FLOOR,
            "No motion repeats another, so there is no floor from repeats; beside a force that may follow anything, "
            f"the readings leave {show(floor.position, 'm', 2)} and {show(floor.force, 'N', 2)}.",
        )
    repeats = f"{percent(floor.repeats)} of the force's variance repeats: a mean, which an effect can close"
    if floor.repeats < LEAST:
        repeats = "nothing of the force repeats"
    groups = f"{floor.motions} in {floor.groups} group{'s' * (floor.groups > 1)}"
    return Statement(
        Topic.FLOOR,
        f"Between equal motions ({groups}) {repeats}. What does not, {show(floor.force, 'N', 2)} and "
        f"{show(floor.position, 'm', 2)} of position, is variance; the scale's noise would leave "
        f"{show(where.unknown.noise, 'N', 2)}.",
    )


def _standing_out(shares: Shares) -> int | None:
    """The part whose share of the energy most exceeds its share of the time, if it does so clearly."""
    i = max(range(len(shares.names)), key=lambda i: float(shares.share[i] - shares.time[i]))
    return i if shares.share[i] > max(MORE * shares.time[i], LEAST) else None


def _part(shares: Shares, i: int, name: str) -> Statement:
    share, time, low = float(shares.share[i]), float(shares.time[i]), float(shares.low[i])
    span = _interval(low, float(shares.high[i]))
    text = f"{percent(share)} ({span}) of its energy lies {name}, which is {percent(time)} of the time."
    return Statement(Topic.ENERGY, text, low - time)


def _energy(where: Where) -> Iterator[Statement]:
    motion, phase = _standing_out(where.energy.motion), _standing_out(where.energy.phase)
    if motion is not None:
        yield _part(where.energy.motion, motion, f"in {where.energy.motion.names[motion]}")
    if phase is not None and where.energy.phase.names[phase] != "excitation":  # a kind of motion says the same
        yield _part(where.energy.phase, phase, PHASES[where.energy.phase.names[phase]])
    for shares, verb in ((where.energy.band, "at"), (where.energy.wavelength, "while moving, in waves")):
        i = shares.ranked()[0]
        if shares.low[i] > LEAST:
            span = _interval(float(shares.low[i]), float(shares.high[i]))
            text = f"{percent(float(shares.share[i]))} ({span}) of its energy lies {verb} {shares.names[i]}."
            yield Statement(Topic.ENERGY, text, float(shares.low[i]) - 0.5)


def _coordinates(where: Where) -> Iterator[Statement]:
    stated = [one for one in where.dependence.coordinates if one.share > LEAST and (one.p < SURE or one.low > CERTAIN)]
    for one in stated:
        yield Statement(Topic.COORDINATE, _explains(one), one.low * (SLOW_CLOCK if one.name == "time" else 1.0))
    if not stated:
        best = where.dependence.coordinates[0]
        yield Statement(
            Topic.NO_COORDINATE,
            f"No single coordinate explains it on motions left out: the best, {words(best.name)}, explains "
            f"{percent(best.share)} (p = {best.p:.2g}).",
        )


def _explains(one: Explained) -> str:
    modulo = f" modulo {show(one.pitch, 'm', 3)}" if one.pitch else ""
    turns = ""
    if one.turning > 0.5 * one.share:
        turns = ", turning with the direction of motion"
    return (
        f"{COORDINATES[one.name]}{modulo} explains {percent(one.share)} ({_interval(one.low, one.high)}) of its "
        f"variance on motions left out{turns} (p = {one.p:.2g})."
    )


def _parity(where: Where) -> Iterator[Statement]:
    even, odd = where.dependence.parity
    if max(even.share, odd.share) > LEAST and min(even.p, odd.p) < SURE:
        yield Statement(
            Topic.PARITY,
            f"While the table moves, {percent(even.share)} of it is an even function of the speed (the same both ways) "
            f"and {percent(odd.share)} an odd one (it turns with the speed).",
            max(even.low, odd.low),
        )


def _scatter(where: Where) -> Iterator[Statement]:
    for one in where.dependence.scatter[:1]:
        if one.p < SURE and one.share > LEAST:
            yield Statement(
                Topic.SCATTER,
                f"While the table moves, the size of what is left from sample to sample depends on {words(one.name)} "
                f"({percent(one.share)} of its variance, p = {one.p:.2g}), whatever its sign.",
                one.low,
            )


def _side(where: Where) -> Statement:
    force = max(where.sides, key=lambda one: one.force)
    reading = max(where.sides, key=lambda one: one.reading)
    start = {
        "force": "It acts as a force, not in the scale",
        "scale": "It is in the scale's reading, not a force",
        "either": "A force and an error of the scale explain it about equally",
        "neither": "Neither a force nor an error of the scale over one coordinate explains it",
    }[force_or_reading(where.sides)]
    return Statement(
        Topic.SIDE,
        f"{start}: on motions left out, curves over {_over(force)} as a force take {force.force:.0f} off chi-square, "
        f"over {_over(reading)} as an addition to the reading {reading.reading:.0f}.",
    )


def _over(side: Side) -> str:
    """The variable of a curve, within a sentence."""
    return f"the position modulo {show(side.pitch, 'm', 4)}" if side.pitch else words(side.coordinate)


def words(name: str) -> str:
    """A coordinate's name within a sentence; SI."""
    text = COORDINATES[name]
    return text[0].lower() + text[1:]
