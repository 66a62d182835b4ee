"""What can't be diagnosed is refused before anything is fitted, for whoever calls from Python as for the study."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Sequence

from diagnosis.model.motions import check_count
from diagnosis.model.units import loop_time
from models.machine import Machine
from models.records.checks import (
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


def check(machine: Machine, records: Sequence[Record], disabled: Collection[str], *, trusted: bool) -> None:
    """Raises ValueError, a sentence, for records or effects that a diagnosis of this machine can't take.

    disabled: names of effects. trusted: records that only look wrong, in a unit or a sign say, are taken as they are.
    """
    if isinstance(records, Record) or not all(isinstance(one, Record) for one in records):
        raise ValueError("records: must be a list of Records; read each file with read_record")
    if not records:
        raise ValueError("a diagnosis needs at least one record")
    check_names(disabled, machine)
    names = [f"record {i}" for i in range(1, len(records) + 1)]
    for name, record in zip(names, records, strict=True):
        try:
            check_signals(record)
            check_sample_time(record, machine.sample_time)
        except RecordError as error:
            raise RecordError(f"{name}: {error}") from error
    check_length(records)
    if not trusted:
        _check_doubts(machine, records, names)
    check_count(records, loop_time(machine))


def _check_doubts(machine: Machine, records: Sequence[Record], names: Sequence[str]) -> None:
    facts = Facts(**known_of(machine))
    for name, record in zip(names, records, strict=True):
        if (doubt := next(doubts(record, set(SIGNALS), facts), None)) is not None:
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
