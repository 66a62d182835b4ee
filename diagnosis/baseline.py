"""What every effect is judged against: the nominal machine re-fitted, and what the same search gains by chance."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache as once
from functools import cached_property, partial
from operator import call
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from diagnosis.criteria import Criteria
from diagnosis.friction_curve import with_finer_friction
from diagnosis.model.fit import Fit, weights
from diagnosis.model.parallel import on_single_blas_thread, parallel_map
from diagnosis.model.parameters import parameters
from diagnosis.null import Null, StartedNull, start_null
from diagnosis.records.motions import Piece, numbered, pieces
from diagnosis.records.units import loop_time, with_units
from diagnosis.refit import CALLED, rough_records, weighed, within_rating
from diagnosis.where.added import with_the_added
from diagnosis.where.controller import Replayed, added_signals, replayed, reproduces
from models.machine import Machine
from models.records.record import Record
from models.records.tables.sizes import RecordError

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class Baseline:
    """The re-fitted nominal machine, the records and their pieces, what the search gains on tables where nothing is
    missing, and the criteria of all that follows.

    known_replays: of the controller on the records as they were logged, where signals that were added behind the
    controller have gone into their feedforward. given: the machine as its file has it, where it has fewer friction
    elements than the records show. interpolated: whether records are rough, but none more so than interpolation between
    the samples of their logs makes those of a complete model."""

    nominal: Fit
    records: tuple[Record, ...]
    pieces: tuple[Piece, ...]
    null: Null
    criteria: Criteria = Criteria()
    known_replays: tuple[Replayed, ...] = ()
    given: Machine | None = None
    interpolated: bool = False

    @property
    def machine(self) -> Machine:
        """The machine as its file states it, but for a rated thrust that the drive was seen to exceed, and for friction
        elements that act as one."""
        nominal = self.nominal.candidate.nominal
        tolerance = self.given.tolerance if self.given else nominal.tolerance
        return replace(nominal, priors=nominal.priors.stated, tolerance=tolerance)

    @property
    def delivered(self) -> Machine:
        """The same with the file's friction elements."""
        return replace(self.given, priors=self.given.priors.stated) if self.given else self.machine

    @cached_property
    def segment(self) -> NDArray[np.int64]:
        """The number of the motion that each sample of all records belongs to (n,)."""
        return numbered(self.pieces, self.records)

    @cached_property
    def replays(self) -> tuple[Replayed, ...]:
        """By record, whether the stated controller, replayed, made its commands."""
        if self.known_replays:
            return self.known_replays
        return tuple(replayed(self.machine, record, self.criteria) for record in self.records)

    @cached_property
    def driving(self) -> tuple[Record, ...]:
        """The records as they drive a simulated closed loop; see `driving_record`."""
        pairs = zip(self.records, self.replays, strict=True)
        return tuple(driving_record(self.machine, record, found) for record, found in pairs)

    @cached_property
    def biased(self) -> Mapping[str, float]:
        """The nominal values that the re-fit moves where nothing is wrong, by how many of their tolerances [1], the
        farthest first: where contacts slip within less than the scale can tell, friction along a smoothed path is
        another one. Of a drive that is rougher than its model, none: its values are moved by what makes it rough."""
        if self.nominal.candidate.rough and not self.interpolated:
            return {}
        names = [name for name in self.nominal.candidate.layout.names if name != "initial_friction_state"]
        largest: dict[str, float] = {}
        for name, size in zip(names, self.null.bias().tolist(), strict=False):
            called = CALLED.get(name, name)
            if abs(size) > max(self.criteria.null_bias, abs(largest.get(called, 0.0))):
                largest[called] = size
        return dict(sorted(largest.items(), key=lambda one: -abs(one[1])))

    @cached_property
    def thresholds(self) -> dict[str, float]:
        """By effect, the chi-square [1] on held-out motions that is more than chance gains."""
        return self.null.thresholds(self.criteria)

    @property
    def spike(self) -> float:
        """Standard deviations [1] beyond which a single innovation stands out."""
        return self.null.spike(self.criteria)

    @property
    def floors(self) -> Array:
        """The noise floor: chi-square (draws,) [1] that complete models leave of the records. On a drive that is
        rougher than its model, whose weights are fitted to the records, it is the number of samples."""
        if self.nominal.candidate.rough:
            return np.maximum(self.null.floors(self.records), float(np.sum(weights(self.records))))
        return self.null.floors(self.records)


def driving_record(machine: Machine, record: Record, found: Replayed) -> Record:
    """A record as it drives a simulated closed loop: where the stated controller alone did not make the commands, with
    all that they hold beyond its law as feedforward, since no model of the plant can answer to what it is not given."""
    return record if found.replays and found.added is None else added_signals(machine, record)


@on_single_blas_thread
def refit_and_null(
    machine: Machine,
    records: Sequence[Record],
    *,
    criteria: Criteria = Criteria(),
    progress: Progress | None = None,
    cache: Path | None = None,
) -> Baseline:
    """The nominal model re-fitted to the records, and beside it the thresholds: what chance gains on simulated tables.

    cache: a folder in which the simulated gains are kept for other records of the same machine and references. Raises
    RecordError for a log that has one of several samples where the commands jump more than these show.
    """
    say = progress or (lambda _share, _text: None)
    say(0.02, "re-fitting the nominal parameters; simulating what the search gains by chance")
    records, known = with_what_was_added(machine, records, criteria)
    criteria = criteria.of_a_log(max(record.every for record in records))
    machine = with_units(machine, records)
    layout = parameters(machine, len(records))
    told = partial(say, 0.1)
    smooth, first = parallel_map(
        call,
        (lambda: within_rating(machine, records), lambda: start_null(layout, records, cache=cache, say=told)),
    )
    motions = pieces(records, loop_time(machine))
    finer = with_finer_friction(smooth, records, numbered(motions, records), criteria)
    usual = once(first.usual)
    nominal = weighed(finer, records, criteria, usual)
    rough, by_log = rough_records(finer, records, criteria, usual)
    if nominal.candidate.rough or finer is not smooth:  # what chance gains depends on the roughness and on the elements
        del first, usual  # their columns are large
        candidate = nominal.candidate
        first = start_null(candidate.layout, records, cache=cache, say=told, roughness=candidate.roughness)
    _require_smooth(records, first, criteria)
    chance = first.completed(told)
    given = smooth.candidate.nominal if finer is not smooth else None
    interpolated = bool(rough.any() and by_log[rough].all())
    return Baseline(nominal, tuple(records), motions, chance, criteria, known, given, interpolated)


def _require_smooth(records: Sequence[Record], null: StartedNull, criteria: Criteria) -> None:
    """Raises RecordError where interpolation leaves much of a machine with nothing wrong: values would bend to it."""
    filled = [i for i, record in enumerate(records) if record.every > 1]
    if not filled:
        return
    usual = null.usual()
    worst = max(filled, key=lambda i: usual[i])
    if usual[worst] > criteria.filled_most_left:
        raise RecordError(
            f"record {worst + 1}: has one of {records[worst].every} samples of the controller, and its commands jump "
            "more than these show, along a reference that steps or as the loop answers the noise of every reading: "
            f"interpolation leaves {usual[worst]:.2g} times what the scale's noise does where nothing is wrong, of "
            f"{criteria.filled_most_left:g} at most; log all of the samples or more of them, for a shorter time or of "
            "fewer signals, or state less noise of the scale if its readings have less"
        )


def with_what_was_added(
    machine: Machine, records: Sequence[Record], criteria: Criteria = Criteria()
) -> tuple[Sequence[Record], tuple[Replayed, ...]]:
    """The records with the signals that were added behind the controller in their feedforward, so that simulations have
    them and motions that differ in them do not count as equal; and the replays, where there was such a signal."""
    if all(reproduces(machine, record, criteria) for record in records):
        return records, ()
    known = tuple(replayed(machine, record, criteria) for record in records)
    if not any(one.is_mostly_added(criteria) for one in known):
        return records, ()
    return tuple(
        with_the_added(record, one.added) if one.added and one.is_mostly_added(criteria) else record
        for record, one in zip(records, known, strict=True)
    ), known
