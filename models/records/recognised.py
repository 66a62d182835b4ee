"""What was recognised of a record's file, as a table for the user to check before the work."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from models.identification.response import FrequencyResponse
from models.quantity import rotary, show
from models.records.columns import UNITS, Columns
from models.records.record import Record
from models.records.tables.table import Table

HEADINGS = ("quantity", "column", "unit", "one is")
MAX_CELL_CHARS = 40  # characters of a cell


def recognised(
    table: Table,
    columns: Columns,
    names: Mapping[str, str],
    content: Record | FrequencyResponse,
    *,
    turns: bool | None = None,
) -> tuple[str, ...]:
    """Lines of text: the file's layout, each signal's column with its unit and its value in SI, and the samples [-].

    names: the column of each signal that the file gave, which for the time may be one that the mapping doesn't name.
    turns: whether the axis is rotary; None where nobody said, and the columns' own units tell.
    """
    if turns is None:
        turns = any(columns.source(signal, table.units.get(name, "")).rotary for signal, name in names.items())
    rows = [row for signal, name in names.items() for row in _rows(table, columns, signal, name, turns=turns)]
    layout = [", ".join(table.recognised)] if table.recognised else []
    return (*layout, *_aligned([HEADINGS, *rows]), _samples(content))


def _rows(table: Table, columns: Columns, signal: str, name: str, *, turns: bool) -> Iterator[tuple[str, ...]]:
    """The row of a signal, or one for each column of its sum; name: of its only column, or of the first."""
    first, *rest = columns.terms(signal)
    yield _row(table, first, signal, name, turns=turns)
    for one in rest:
        yield "", *_row(table, one, signal, one.source(signal).name, turns=turns)[1:]


def _row(table: Table, columns: Columns, signal: str, name: str, *, turns: bool) -> tuple[str, ...]:
    stated = table.units.get(name, "")
    source = columns.source(signal, stated)
    unit = source.unit or stated or ("none stated" if source.factor == 1 else "")
    wanted = rotary(UNITS[signal]) if turns else UNITS[signal]
    si = "" if wanted == "1" else f" {wanted}"
    return signal, _shown(name), _shown(unit), "20 log10" if source.decibels else f"{source.factor:.10g}{si}"


def _shown(text: str) -> str:
    """A text of the file in a cell: short, and without characters that act on a terminal."""
    plain = "".join(one if one.isprintable() else "?" for one in text)
    return plain if len(plain) <= MAX_CELL_CHARS else f"{plain[: MAX_CELL_CHARS - 3]}..."


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return ["  " + "  ".join(f"{cell:<{w}}" for cell, w in zip(row, widths, strict=True)).rstrip() for row in rows]


def _samples(content: Record | FrequencyResponse) -> str:
    if isinstance(content, FrequencyResponse):
        low, high = (show(float(content.frequency[i]), "Hz") for i in (0, -1))
        return f"  {content.frequency.size:,} lines from {low} to {high}"
    duration = content.position.size * content.sample_time
    return f"  {content.position.size:,} samples every {show(content.sample_time, 's')}, {show(duration, 's')} in all"
