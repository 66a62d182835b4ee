"""What can't be diagnosed is refused before anything is fitted, for whoever calls from Python as for the study."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Final

from diagnosis.records.motions import check_count
from diagnosis.records.units import loop_time
from models.machine import Machine
from models.machine_file import loaded
from models.quantity import show
from models.records.checks import (
    SAME_TIME,
    SIGNALS,
    DoubtfulError,
    Facts,
    check_length,
    check_movement,
    check_one_machine,
    check_sample_time,
    check_signals,
)
from models.records.files import known_of
from models.records.plausible import doubts
from models.records.record import Record
from models.records.tables.sizes import RecordError

# Loop times from one sample of a log to the next, at most: what happens within is smooth.
MAX_SAMPLE_LOOP_TIMES: Final = 1.0


def with_all_samples(machine: Machine, record: Record) -> Record:
    """The record with all samples of the machine's controller (SI): of a log that has one of several, those between are
    interpolated, and its `every` says so. Raises RecordError for one that has too few, or whose samples are not of the
    controller's rate."""
    every = round(record.sample_time / machine.sample_time)
    if every < 2 or abs(record.sample_time / (every * machine.sample_time) - 1) > SAME_TIME:
        check_sample_time(record, machine.sample_time)
        return record
    most = MAX_SAMPLE_LOOP_TIMES * loop_time(machine)
    if record.sample_time > most:
        raise RecordError(
            f"has a sample every {show(record.sample_time, 's')}, one of {every} of the machine's controller; these "
            f"are too few to interpolate the others, as the loop acts within {show(loop_time(machine), 's', 2)}: log "
            f"a sample every {show(most, 's', 2)} or more often, for a shorter time or of fewer signals"
        )
    return record.filled(every)


def checked(
    machine: Machine, records: Sequence[Record], disabled: Collection[str], *, trusted: bool
) -> tuple[Record, ...]:
    """The records with all samples of the controller. Raises ValueError, a sentence, for a machine that no file could
    state, and for records or effects that a diagnosis of this machine can't take.

    disabled: names of effects. trusted: records that only look wrong, in a unit or a sign say, are taken as they are.
    """
    if not isinstance(machine, Machine):
        raise ValueError("machine: must be a Machine, before the records; read it with load_machine")
    loaded(machine, Path(machine.name))  # one made in a program may have what the file handed over could not state
    if isinstance(records, Record) or not all(isinstance(one, Record) for one in records):
        raise ValueError("records: must be a list of Records; read each file with read_record")
    if not records:
        raise ValueError("a diagnosis needs at least one record")
    check_names(disabled, machine)
    names, whole = [f"record {i}" for i in range(1, len(records) + 1)], list[Record]()
    for name, record in zip(names, records, strict=True):
        try:
            check_signals(record)
            whole.append(with_all_samples(machine, record))
        except RecordError as error:
            raise RecordError(f"{name}: {error}") from error
    check_length(records)
    if not trusted:
        _check_doubts(machine, records, names)
    check_count(whole, loop_time(machine))
    return tuple(whole)


def _check_doubts(machine: Machine, records: Sequence[Record], names: Sequence[str]) -> None:
    facts = Facts(**known_of(machine))
    for name, record in zip(names, records, strict=True):
        if (doubt := next(doubts(record, set(SIGNALS), facts.seen_in(record)), None)) is not None:
            raise DoubtfulError(f"{name}: {doubt}")
    check_movement(records, machine.friction)
    check_one_machine(records, names, 2 * max(machine.friction.limit))


def check_names(names: Collection[str], machine: Machine) -> None:
    """Raises ValueError for a name that is no effect which is looked for in this machine, with what may be meant."""
    if isinstance(names, str):
        raise ValueError(f'disabled: must be a list of names; give ["{names}"]')
    known = list(machine.kinds)
    for name in names:
        if name not in known:
            close = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
            hint = f"did you mean {close[0]}?" if close else f"known: {', '.join(known)}"
            raise ValueError(f"{name}: is not an effect that is looked for; {hint}")
