"""Records cut into motions: what kind each is, and which of them repeat each other.

A motion's kind is its stroke and its peak speed, each to within a factor of about three, or what happens at rest.
Motions of one kind repeat each other if they start from the same place in the same direction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.effects.priors import REFERENCE
from models.quantity import show
from models.records.record import Record, cut
from models.records.tables.sizes import RecordError

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# Loop times: long motions are cut into pieces of about this, so that none outweighs the others.
PIECE_LOOP_TIMES: Final = 415.0
MIN_MOTION_LOOP_TIMES: Final = 5.5  # loop times: shorter motions are joined to the one before
FEWEST: Final = 6  # motions that a diagnosis needs, because some are held out of every fit
SAME_REFERENCE_STDS: Final = 5.0  # deviations of the reading: tolerance between the references of equal motions
HALF_DECADE: Final = 10**0.5  # sizes of motions that this factor spans are of one kind
MOST: Final = 0.5  # of a record, from which on motions that repeat make it periodic
SAME_FORCE: Final = 1e-3  # tolerance between their feedforward, relative to its largest value


@dataclass(frozen=True)
class MotionKind:
    """A kind of motion: its stroke [m] and peak speed [m/s], each rounded to half a decade; both are 0 at rest, where
    `excited` says whether the feedforward excites the table. Its text is how a reader knows it.
    """

    stroke: float = 0.0
    speed: float = 0.0
    excited: bool = False

    @property
    def rests(self) -> bool:
        """Whether the reference stands still and nothing excites the table."""
        return self.stroke == 0 and not self.excited

    def __str__(self) -> str:
        if self.stroke > 0:
            return f"moves of {_within(self.stroke, 'm')} at {_within(self.speed, 'm/s')}"
        return "the excitation at rest" if self.excited else "rest"


def _within(size: float, unit: str) -> str:
    """The range of what is rounded to this size [`unit`]."""
    high = show(size * HALF_DECADE**0.5, unit, 2)
    return f"{show(size / HALF_DECADE**0.5, unit, 2, like=size * HALF_DECADE**0.5).split()[0]} to {high}"


@dataclass(frozen=True)
class Piece:
    """Samples start .. stop of record `record`, all of one motion or of one rest, with the sign of the motion and where
    it starts [m]."""

    record: int
    start: int
    stop: int
    kind: MotionKind
    direction: int
    origin: float


def pieces(records: Sequence[Record], loop: float = REFERENCE.loop) -> tuple[Piece, ...]:
    """All records cut into motions, and long motions into parts; loop [s]: the machine's `units.loop_time`."""
    found: list[Piece] = []
    for number, record in enumerate(records):
        ts = record.sample_time
        ends = [motion.start for motion in cut(record)]
        ends = sorted({0, *ends, record.position.size})
        ends = [
            end
            for i, end in enumerate(ends)
            if i == 0 or end - ends[i - 1] > MIN_MOTION_LOOP_TIMES * loop / ts or end == ends[-1]
        ]
        for start, stop in pairwise(ends):
            parts = max(1, round((stop - start) * ts / (PIECE_LOOP_TIMES * loop)))
            edges = np.linspace(start, stop, parts + 1).astype(int)
            for a, b in pairwise(edges):
                found.append(_piece(record, number, int(a), int(b)))
    return tuple(found)


def check_count(records: Sequence[Record], loop: float) -> None:
    """Raises RecordError for records with too few motions to hold some of them out of a fit; loop [s]: see `pieces`."""
    count = len(pieces(records, loop))
    if count < FEWEST:
        raise RecordError(
            f"{count} motion{'s are' if count > 1 else ' is'} too few, some have to be left out to judge what the "
            f"others show; give {FEWEST} or more"
        )


def _piece(record: Record, number: int, start: int, stop: int) -> Piece:
    reference = record.reference[start:stop]
    if start > 0 and np.ptp(reference) == 0:  # a reference that is the stepping target itself moves at the step alone
        reference = record.reference[start - 1 : stop]
    stroke = float(np.ptp(reference))
    if stroke == 0:
        excited = np.std(np.diff(record.feedforward[start:stop])) > 0 if stop - start > 2 else False
        return Piece(number, start, stop, MotionKind(excited=bool(excited)), 0, float(reference[0]))
    speed = float(np.max(np.abs(np.diff(reference)))) / record.sample_time
    decades = 10 ** (np.round(2 * np.log10([stroke, speed])) / 2)
    kind = MotionKind(float(decades[0]), float(decades[1]))
    direction = int(np.sign(reference[-1] - reference[0]))
    return Piece(number, start, stop, kind, direction, float(reference[0]))


def numbered(found: Sequence[Piece], records: Sequence[Record]) -> Integers:
    """The index (n,) of the piece that each sample belongs to, all records one after another."""
    begins = np.concatenate([[0], np.cumsum([record.position.size for record in records])])
    number = np.zeros(int(begins[-1]), np.int64)
    for i, piece in enumerate(found):
        number[begins[piece.record] + piece.start : begins[piece.record] + piece.stop] = i
    return number


def repeated(
    pieces: Sequence[Piece], records: Sequence[Record], reading: float = REFERENCE.reading
) -> tuple[tuple[int, ...], ...]:
    """Groups of equal motions, as indices of the pieces; kind, direction, origin and reference agree.

    reading [m]: deviation of the scale's reading, as no two references need to be nearer to each other.
    """
    same = SAME_REFERENCE_STDS * reading
    groups: dict[tuple[object, ...], list[int]] = {}
    for i, piece in enumerate(pieces):
        if not piece.kind.rests:
            where = round(piece.origin / same)
            alike = (piece.kind, piece.direction, where, piece.stop - piece.start)
            near = [group for group in _near(groups, alike) if _equal(pieces[group[0]], piece, records, same)]
            (near[0] if near else groups.setdefault((*alike, i), [])).append(i)
    return tuple(tuple(group) for group in groups.values() if len(group) > 1)


def periods(
    groups: Sequence[Sequence[int]], pieces: Sequence[Piece], records: Sequence[Record], least: int
) -> tuple[float, ...]:
    """The time [s] after which each record's motions repeat, `least` times or more in all; infinite where what repeats
    after the usual time from a motion to the next equal one is less than half of a record."""
    found = []
    for number, record in enumerate(records):
        starts = [[pieces[i].start for i in group if pieces[i].record == number] for group in groups]
        pairs = [pair for one in starts for pair in pairwise(one)]
        after = np.array([stop - start for start, stop in pairs])
        usual = np.abs(after - np.median(after)) <= 1 if pairs else np.zeros(0, bool)
        covered = np.zeros(record.position.size, bool)
        for (start, stop), alike in zip(pairs, usual, strict=True):
            covered[start:stop] |= alike
        often = bool(np.mean(covered) >= MOST) and record.position.size >= least * float(np.mean(after[usual]))
        found.append(float(np.mean(after[usual])) * record.sample_time if often else math.inf)
    return tuple(found)


def scatter(groups: Sequence[Sequence[int]], pieces: Sequence[Piece], signals: Sequence[Array]) -> tuple[Array, ...]:
    """The part of every record's signal (n,) [any unit] that does not repeat: its difference from the mean over equal
    motions, scaled so that its variance is that of one motion; NaN where nothing repeats."""
    apart = tuple(np.full(signal.size, np.nan) for signal in signals)
    for group in groups:
        parts = [(pieces[i].record, slice(pieces[i].start, pieces[i].stop)) for i in group]
        mean = np.mean([signals[record][part] for record, part in parts], axis=0)
        for record, part in parts:
            apart[record][part] = (signals[record][part] - mean) * (len(group) / (len(group) - 1)) ** 0.5
    return apart


def rms(parts: Sequence[Array]) -> float:
    """Root mean square over all parts (n,), NaN left out; [their unit]."""
    return float(np.sqrt(np.nanmean(np.concatenate(list(parts)) ** 2)))


def _near(groups: dict[tuple[object, ...], list[int]], alike: tuple[object, ...]) -> list[list[int]]:
    return [group for key, group in groups.items() if key[: len(alike)] == alike]


def _equal(one: Piece, other: Piece, records: Sequence[Record], same: float) -> bool:
    """Whether reference and feedforward agree; parts of a multisine agree in the reference alone."""
    a, b = (records[piece.record].part(piece.start, piece.stop) for piece in (one, other))
    largest = max(float(np.max(np.abs(a.feedforward))), float(np.max(np.abs(b.feedforward))))
    alike = float(np.max(np.abs(a.feedforward - b.feedforward))) <= SAME_FORCE * largest
    return alike and bool(np.max(np.abs(a.reference - b.reference)) < same)
