"""Logs as text, in chunks: what is too large is refused before numbers are made of it."""

from __future__ import annotations

import csv
import io
import re
import warnings
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.quantity import cut
from models.records.tables.sizes import Limits, RecordError
from models.records.tables.table import Table
from models.records.tables.text.headers import as_wanted
from models.records.tables.text.layout import LOOKED_AT, NO_ROWS, Layout, is_left_out, layout_of, number, split
from models.records.tables.text.text_stream import ENCODING_NAMES, TextFile, text_file

Array = NDArray[np.float64]


def table_of_csv(path: Path, limits: Limits, wanted: Collection[str] | None) -> Table:
    """The wanted columns (n,) [as the file has them], or all that hold numbers for None. Raises RecordError."""
    file = text_file(path, limits)
    head = file.head()
    limits.check_columns(1 + max(line.count(mark) for line in head[-LOOKED_AT:] for mark in ";\t,"))
    layout = layout_of(head)
    limits.check_columns(layout.cells)
    for name in wanted or ():
        if f"{name} (2)" in layout.headers and name not in layout.headers:
            raise RecordError(f"several columns are called {name!r}; map one of them, as in {name + ' (2)'!r}")
    names = as_wanted(layout.headers, wanted)
    kept = [j for j, name in enumerate(names) if name and (j not in layout.text if wanted is None else name in wanted)]
    for j in kept:
        if j in layout.text:
            raise RecordError(
                f"column {cut(names[j], 40)} holds text such as {cut(layout.text[j], 40)}; map one of numbers"
            )
    kept = sorted({*kept, *(layout.clocks[j] for j in kept if j in layout.clocks)})
    limits.check_numbers((file.lines - layout.first) * len(kept))
    columns = _columns(file, layout, kept) if kept else {}
    return Table(
        columns={names[j]: column for j, column in _to_their_ends(columns, layout.clocks).items()},
        names=[name for name in names if name],
        units={names[j]: unit for j, unit in layout.units.items() if names[j]},
        clocks={names[j]: names[clock] for j, clock in layout.clocks.items()},
        recognised=(ENCODING_NAMES[file.encoding], *layout.recognised()),
    )


def _columns(file: TextFile, layout: Layout, kept: Sequence[int]) -> dict[int, Array]:
    """The kept columns (n,). Raises RecordError for rows that are not as the layout says."""
    columns = {j: np.empty(file.lines - layout.first) for j in kept}
    rows = 0
    for start, text in _below(file, layout.first):
        block = _rows(text, start, layout, kept)
        for column, values in zip(columns.values(), block.T, strict=True):
            column[rows : rows + len(block)] = values
        rows += len(block)
    if rows == 0:
        raise RecordError(NO_ROWS)
    for column in columns.values():
        column.resize(rows, refcheck=False)
    return columns


def _to_their_ends(columns: Mapping[int, Array], clocks: Mapping[int, int]) -> dict[int, Array]:
    """Columns of channels that have clocks of their own and so may end before others, without the empty cells below."""
    ends = {
        clock: int(np.max(np.flatnonzero(np.isfinite(columns[clock])), initial=-1)) + 1
        for clock in set(clocks.values()) & set(columns)
    }
    return {j: column[: ends.get(clocks.get(j, j))] for j, column in columns.items()}


def _below(file: TextFile, first: int) -> Iterator[tuple[int, str]]:
    """The number of its first line, and text of whole lines, behind the first lines of a file."""
    start = 1
    for text in file.blocks():
        if start == 1 and first:
            rest = text.split("\n", first)
            yield first + 1, rest[first] if len(rest) > first else ""
        else:
            yield start, text
        start += text.count("\n")


def _rows(text: str, start: int, layout: Layout, kept: Sequence[int]) -> Array:
    """The numbers (n, kept) in lines of text, of which the first has this number in the file."""
    plain = _plain(text, layout)
    if plain is not None and not plain.strip():
        return np.empty((0, len(kept)))
    if plain is not None:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)
                return np.loadtxt(
                    io.StringIO(plain), delimiter=layout.separator, usecols=kept, ndmin=2, comments=None
                ).reshape(-1, len(kept))
        except ValueError:
            pass  # cells that are empty or wrong
    return _row_by_row(text, start, layout, kept)


def _plain(text: str, layout: Layout) -> str | None:
    """The text with decimal points, without quotation marks, comments and empty lines; None where its lines don't have
    as many cells as the layout says."""
    separator = layout.separator
    if '"' in text:
        text = text.replace('"', "") if separator != "," else re.sub(r'"([^"\n]*)"', _with_points, text)
    if layout.comma and separator != "," and "," in text:
        text = text.replace(",", ".")
    if _is_regular(text, layout):
        return text
    lines = [line for line in text.split("\n") if line and not line.isspace() and not line.startswith("#")]
    text = "\n".join(lines) + "\n" * bool(lines)
    return text if _is_regular(text, layout) else None


def _with_points(match: re.Match[str]) -> str:
    return match[1].replace(",", ".")


def _is_regular(text: str, layout: Layout) -> bool:
    """Whether all lines may have as many cells as the layout says, by how many there are together."""
    lines = text.count("\n") + bool(text and not text.endswith("\n"))
    if layout.separator is None:
        return len(text.split()) == lines * layout.cells
    return text.count(layout.separator) == lines * (layout.cells - 1)


def _row_by_row(text: str, start: int, layout: Layout, kept: Sequence[int]) -> Array:
    """The numbers in lines with empty cells, which become NaN; what is not a number is named with its line."""
    rows = []
    for line, cells in enumerate(_cells(text, layout.separator), start=start):
        if is_left_out(cells):
            continue
        row = _of_length(cells, layout)
        if row is None:
            raise RecordError(
                f"line {line} has {len(cells)} cells and the lines before {layout.cells}; correct that line"
            )
        numbers = []
        for j in kept:
            value = number(row[j], comma=layout.comma)
            if value is None:
                again = "is text as above the numbers; give two logs as two files" if _names(row, layout) else ""
                raise RecordError(
                    f"line {line}: {again}"
                    if again
                    else f"line {line}: could not convert string to float: "
                    f"{cut(row[j], 40)}; write numbers only below the first line"
                )
            numbers.append(value)
        rows.append(numbers)
    return np.array(rows, float).reshape(-1, len(kept))


def _cells(text: str, separator: str | None) -> Iterator[list[str]]:
    if separator is None:
        yield from (split(line, None) for line in text.split("\n"))
    else:
        for row in csv.reader(io.StringIO(text), delimiter=separator):
            yield [cell.strip() for cell in row]


def _of_length(cells: list[str], layout: Layout) -> list[str] | None:
    """The cells of a row, one for each column; None where others than empty ones at its end are too many or too few."""
    count = layout.cells
    if len(cells) == count - 1 and not layout.headers[-1]:
        return [*cells, ""]  # without the separator at its end, which the others have
    return cells[:count] if len(cells) >= count and not any(islice(cells, count, None)) else None


def _names(row: Sequence[str], layout: Layout) -> bool:
    """Whether a row is the line of the names once more."""
    return any(cell and header.startswith(cell) for cell, header in zip(row, layout.headers, strict=True))
