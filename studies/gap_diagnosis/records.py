"""The records of a diagnosis: read, and refused with one sentence where they cannot be diagnosed."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Final

from diagnosis.records.diagnosable import check_names, with_all_samples
from diagnosis.records.motions import check_count
from diagnosis.records.units import loop_time
from diagnosis.where.controller import reproduces
from models.identification.recognise import read
from models.machine import Machine
from models.records.checks import (
    DoubtfulError,
    check_length,
    check_movement,
    check_one_machine,
    derivative_of_error,
)
from models.records.files import Loaded, with_columns
from models.records.record import Record
from models.records.tables.sizes import LIMITS, RecordError
from studies.gap_diagnosis.options import DiagnosisOptions
from studies.options import BadInputError
from studies.record_columns import mapped

Progress = Callable[[float, str], None]

MEMORY: Final = "21 kB of memory"
# Of a record that is too long; not to decimate it, as the controller is replayed on its own samples.
LONGER: Final = (
    "cut it into shorter records, each with its controller's own samples, or give --most-samples where there are "
    f"{MEMORY} for each"
)


def loaded(
    machine: Machine, options: DiagnosisOptions, progress: Progress = lambda _share, _text: None
) -> tuple[Loaded, ...]:
    """The records that were given; progress is told how each was read.

    Raises BadInputError for one that can't be read or diagnosed.
    """
    return loaded_of(machine, options, options.record, progress)


def held_out(
    machine: Machine, options: DiagnosisOptions, progress: Progress = lambda _share, _text: None
) -> tuple[Loaded, ...]:
    """The records of --hold-out; progress is told how each was read.

    Raises BadInputError for one that can't be read or diagnosed, and for one that is fitted to as well.
    """
    if not options.hold_out:
        return ()
    if not options.record:
        raise BadInputError("--hold-out: needs records to fit to; give them as well")
    fitted = {path.resolve() for path in options.record}
    for path in options.hold_out:
        if path.resolve() in fitted:
            raise BadInputError(f"--hold-out {path}: is among the records that are fitted to; give it once")
    return loaded_of(machine, options, options.hold_out, progress)


def loaded_of(
    machine: Machine, options: DiagnosisOptions, paths: Sequence[Path], progress: Progress
) -> tuple[Loaded, ...]:
    """These records, which the columns of the options' records are mapped for; progress is told how each was read.

    Raises BadInputError for one that can't be read or diagnosed.
    """
    mapping, control = mapped(machine, options, (*options.record, *options.hold_out)), machine.control
    for note in mapping.notes:
        progress(0.02, note)
    found, most = list[Loaded](), options.most_samples
    limits = replace(LIMITS, samples=most, remedy=LONGER)
    for path in paths:
        columns = mapping.columns(path)
        with _refused():
            one = read(machine, path, columns, trusted=options.trust_records, limits=limits)
        if not isinstance(one.content, Record):
            raise BadInputError(
                f"{path}: is a frequency response; a diagnosis needs records over time (identify_machine takes it)"
            )
        with _refused(str(path)):
            one = filled(machine, one)
        content = one.content
        assert isinstance(content, Record)
        if columns.derivative == "position":
            content = derivative_of_error(content, control.pid, control.reference_delay)
            one = replace(one, content=content)
        if content.every == 1 and not reproduces(machine, content):
            one = with_columns(one, path, columns, limits)
        found.append(one)
        progress(0.02, "\n".join([f"read {path}", *one.recognised]))
        if sum(map(_samples, found)) > most:
            names, least = ", ".join(map(str, paths)), math.ceil(sum(map(_samples, found)) / 1000) * 1000
            further = " or more" if len(found) < len(paths) else ""
            raise BadInputError(
                f"{names}: hold more than {most:,} samples together{_between(found)}; leave a record out, or give "
                f"--most-samples {least}{further}, which takes {MEMORY} for each sample"
            )
    records = [one.content for one in found if isinstance(one.content, Record)]
    doubts = check(machine, records, paths, trusted=options.trust_records)
    return (replace(found[0], findings=(*doubts, *found[0].findings)), *found[1:])


def filled(machine: Machine, one: Loaded) -> Loaded:
    """A record with all samples of the controller, with what is said of it where its log has fewer. Raises
    RecordError."""
    assert isinstance(one.content, Record)
    content = with_all_samples(machine, one.content)
    if content.every == 1:
        return one
    said = (
        f"It has one of {content.every} samples of the controller; those between are interpolated, so that the "
        "controller can't be replayed."
    )
    return replace(one, content=content, findings=(*one.findings, said))


def _samples(one: Loaded) -> int:
    return one.content.position.size if isinstance(one.content, Record) else 0


def _between(found: Sequence[Loaded]) -> str:
    """What is said of samples of the controller that no log has, which count as well."""
    contents = [one.content for one in found if isinstance(one.content, Record)]
    logged = sum(math.ceil(one.position.size / one.every) for one in contents)
    return (
        f", with those interpolated between the {logged:,} of the logs"
        if any(one.every > 1 for one in contents)
        else ""
    )


def disabled(names: Sequence[str], machine: Machine) -> tuple[str, ...]:
    """The effects of --disable. Raises BadInputError for one that is not searched for in this machine."""
    try:
        check_names(names, machine)
    except ValueError as error:
        raise BadInputError(f"--disable {error}") from error
    return tuple(names)


def check(
    machine: Machine, records: Sequence[Record], paths: Sequence[Path], *, trusted: bool = False
) -> tuple[str, ...]:
    """Raises BadInputError for records in which nothing moves, which are too short, or not of one machine.

    machine: its control loop says how short a motion may be. trusted: what only looks so is returned in sentences
    instead.
    """
    names = [str(path) for path in paths]
    with _refused(", ".join(names)):
        check_length(records)
        still = _doubts(lambda: check_movement(records, machine.friction), trusted=trusted)
        check_count(records, loop_time(machine))
    presliding = 2 * max(machine.friction.limit)
    with _refused():
        return (*still, *_doubts(lambda: check_one_machine(records, names, presliding), trusted=trusted))


def _doubts(look: Callable[[], None], *, trusted: bool) -> tuple[str, ...]:
    """What looks wrong about records that are trusted, as a sentence; raises RecordError for others."""
    try:
        look()
    except DoubtfulError as error:
        if not trusted:
            raise
        return (f"Not refused, as the records are trusted: {error.doubt}.",)
    return ()


@contextmanager
def _refused(name: str | None = None) -> Iterator[None]:
    """What is wrong with a record as bad input, with the file's name before it where the sentence lacks it."""
    try:
        yield
    except RecordError as error:
        raise BadInputError(f"{name}: {error}" if name else str(error)) from error
