"""--column of the studies that read records: which column is which signal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from models.machine import Machine
from models.records.columns import Columns
from studies.options import BadInputError


def columns_of(machine: Machine, entries: Sequence[str]) -> Columns:
    """The machine file's mapping with --column's entries put in. Raises BadInputError."""
    changes = {}
    for entry in entries:
        signal, _, text = entry.partition("=")
        if signal not in Columns.__dataclass_fields__:
            raise BadInputError(f"--column {entry}: {signal!r} is not a signal; known: {', '.join(vars(Columns()))}")
        changes[signal] = text
    try:
        return replace(machine.record or Columns(), **changes)
    except ValueError as error:
        raise BadInputError(f"--column {error}") from error
