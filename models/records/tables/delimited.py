"""CSV files, plain or compressed by gzip, in chunks: what is too large is refused before numbers are made of it."""

from __future__ import annotations

import csv
import gzip
import io
import warnings
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import IO, cast

import numpy as np
from numpy.typing import NDArray

from models.records.tables.sizes import CHUNK, Limits, RecordError
from models.records.tables.table import Table

Array = NDArray[np.float64]


def table_of_csv(path: Path, limits: Limits, wanted: Collection[str] | None) -> Table:
    """The wanted columns (n,) [as the file has them], or all for None. Raises RecordError."""
    lines = _counted(path, limits)
    with _opened(path) as file:
        first = file.readline(limits.line + 1).decode("utf-8-sig").rstrip("\r\n")
        delimiter = next((mark for mark in (";", "\t", ",") if mark in first), ",")
        names = [name.strip() for name in next(csv.reader([first], delimiter=delimiter), [])]
        limits.check_columns(len(names))
        if len(set(names)) != len(names):
            raise RecordError("two columns have one name; name each column once in the first line")
        limits.check_numbers((lines - 1) * len(names))
        kept = {i: np.empty(lines) for i, name in enumerate(names) if wanted is None or name in wanted}
        rows = 0
        for number, text in _blocks(file):
            block = _rows(text, number, delimiter, len(names))
            for i, column in kept.items():
                column[rows : rows + len(block)] = block[:, i]
            rows += len(block)
    if rows == 0:
        raise RecordError("has no rows below its first line; export the samples too")
    for column in kept.values():
        column.resize(rows, refcheck=False)
    return Table({names[i]: column for i, column in kept.items()}, names)


def _opened(path: Path) -> IO[bytes]:
    return cast("IO[bytes]", gzip.open(path, "rb")) if path.suffix.lower() == ".gz" else path.open("rb")


def _counted(path: Path, limits: Limits) -> int:
    """The lines of a file, an unfinished last one among them. Raises RecordError as soon as they are too many."""
    size = lines = begun = 0
    with _opened(path) as file:
        while block := file.read(CHUNK):
            ends = block.find(b"\n")
            if begun + (ends if ends >= 0 else len(block)) > limits.line:
                raise RecordError(
                    f"line {lines + 1} has more than {limits.line:,} characters; give text with one line a sample"
                )
            size, lines = size + len(block), lines + block.count(b"\n")
            begun = len(block) - block.rfind(b"\n") - 1 if ends >= 0 else begun + len(block)
            limits.check_samples(lines - 1, "samples, a line each")
            limits.check_text(size)
    return lines + (begun > 0)


def _blocks(file: IO[bytes]) -> Iterator[tuple[int, str]]:
    """The number of its first line, and text of whole lines, from the second line of the file on."""
    number, begun = 2, b""
    while block := file.read(CHUNK):
        head, end, rest = block.rpartition(b"\n")
        if not end:
            begun += rest
            continue
        whole = begun + head + end
        yield number, whole.decode("utf-8").replace("\r\n", "\n")
        number, begun = number + whole.count(b"\n"), rest
    if begun:
        yield number, begun.decode("utf-8").replace("\r\n", "\n")


def _rows(text: str, number: int, delimiter: str, count: int) -> Array:
    """The numbers (n, count) in lines of text, of which the first has this number in the file."""
    if delimiter == ";":
        text = text.replace(",", ".")  # where columns end in semicolons, decimals may have commas
    if not text.strip():
        return np.empty((0, count))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # a chunk of comments alone
            rows = np.loadtxt(io.StringIO(text), delimiter=delimiter, ndmin=2)
    except ValueError:
        return _with_gaps(text, number, delimiter, count)
    if rows.size and rows.shape[1] != count:
        raise RecordError(f"{rows.shape[1]} columns but {count} names in the first line; name every column")
    return rows.reshape(-1, count)


def _with_gaps(text: str, number: int, delimiter: str, count: int) -> Array:
    """The numbers in lines that have empty cells, which become NaN; what is not a number is named with its line."""
    rows = []
    for line, row in enumerate(csv.reader(io.StringIO(text), delimiter=delimiter), start=number):
        if not row:
            continue
        if len(row) != count:
            raise RecordError(f"line {line} has {len(row)} cells and the first line {count}; correct that line")
        try:
            rows.append([float(cell) if cell.strip() else np.nan for cell in row])
        except ValueError as error:
            raise RecordError(f"line {line}: {error}; write numbers only below the first line") from error
    return np.array(rows).reshape(-1, count)
