"""Parquet files, of which only the wanted columns are read, after a look at what their pages expand to.

A column is stored in compressed pages. The file's footer states how many rows there are, and each page's head its size
(Apache Parquet, parquet.thrift); Arrow makes room for the latter, so it is added up first.
"""

from __future__ import annotations

import io
from collections.abc import Collection
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from models.records.sizes import Limits, RecordError

Array = NDArray[np.float64]

LARGEST_HEAD: Final = 1 << 16  # bytes of a page's head, which has a hundred or so
DEEPEST: Final = 8  # of the structures in it
EXPANDED, STORED = 2, 3  # fields of a page's head: its bytes after and before decompression
STOP, TRUE, FALSE, BYTE, DOUBLE, BINARY, LIST, SET, STRUCT = 0, 1, 2, 3, 7, 8, 9, 10, 12  # types of a field
INTEGERS: Final = (4, 5, 6)


def columns_of_parquet(
    path: Path, limits: Limits, wanted: Collection[str] | None
) -> tuple[dict[str, Array], list[str]]:
    """The wanted columns (n,) [as the file has them], or all that hold no text for None, and the names of all.

    Raises RecordError for a file that is too large, and what Arrow raises for one that is spoiled.
    """
    try:
        from pyarrow import parquet  # noqa: PLC0415
    except ImportError as error:
        raise RecordError("Parquet needs the package pyarrow; install it, or save as CSV") from error
    with path.open("rb") as file:
        table = parquet.ParquetFile(file)
        schema = table.schema_arrow
        limits.check_columns(len(schema.names))
        limits.check_samples(table.metadata.num_rows)
        names = [
            field.name
            for field in schema
            if "string" not in str(field.type) and (wanted is None or field.name in wanted)
        ]
        limits.check_numbers(table.metadata.num_rows * len(names))
        _check_pages(file, table.metadata, set(names), limits)
        found = {name: np.asarray(table.read([name]).column(name).to_numpy(), float) for name in names}
    return found, schema.names


def _check_pages(file: IO[bytes], metadata: Any, names: Collection[str], limits: Limits) -> None:
    """Raises RecordError for columns whose pages expand to more than is read."""
    expanded = 0
    for group in range(metadata.num_row_groups):
        part = metadata.row_group(group)
        for i in range(part.num_columns):
            column = part.column(i)
            if column.path_in_schema.partition(".")[0] not in names:
                continue
            first = column.dictionary_page_offset
            at = column.data_page_offset if not first else min(first, column.data_page_offset)
            end = at + column.total_compressed_size
            while at < end:
                head, size, stored = _page(file, at)
                at, expanded = at + head + stored, expanded + size
                if expanded > 8 * limits.numbers:
                    limits.check_numbers(expanded // 8)


def _page(file: IO[bytes], at: int) -> tuple[int, int, int]:
    """Bytes of a page's head, of the page after decompression, and of the page as it is stored."""
    file.seek(at)
    head = io.BytesIO(file.read(LARGEST_HEAD))
    sizes = _struct(head, 0)
    size, stored = sizes.get(EXPANDED, -1), sizes.get(STORED, -1)
    if size < 0 or stored < 0:
        raise ValueError("a page has no size")
    return head.tell(), size, stored


def _struct(head: io.BytesIO, depth: int) -> dict[int, int]:
    """The integers among the fields of a structure in Thrift's compact protocol, by their numbers."""
    if depth > DEEPEST:
        raise ValueError("a page's head is nested too deeply")
    found, number = dict[int, int](), 0
    while (byte := _byte(head)) != STOP:
        kind, ahead = byte & 0xF, byte >> 4
        number = number + ahead if ahead else _integer(head)
        if kind in INTEGERS:
            found[number] = _integer(head)
        elif kind not in (TRUE, FALSE):
            _over(head, kind, depth)
    return found


def _over(head: io.BytesIO, kind: int, depth: int) -> None:
    """Skips a value of this type."""
    if kind == STRUCT:
        _struct(head, depth + 1)
    elif kind in (LIST, SET):
        first = _byte(head)
        count = first >> 4 if first >> 4 < 15 else _varint(head)
        for _ in range(count):
            _over(head, first & 0xF, depth + 1)
    elif kind in INTEGERS:
        _integer(head)
    elif kind in (TRUE, FALSE, BYTE, DOUBLE, BINARY):
        size = {DOUBLE: 8, BINARY: -1}.get(kind, 1)
        size = _varint(head) if size < 0 else size
        if len(head.read(size)) < size:
            raise ValueError("a page's head is not complete")
    else:
        raise ValueError("a page's head has a value of an unknown type")


def _byte(head: io.BytesIO) -> int:
    got = head.read(1)
    if not got:
        raise ValueError("a page's head is not complete")
    return got[0]


def _varint(head: io.BytesIO) -> int:
    value = shift = 0
    while shift < 64:
        byte = _byte(head)
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value
        shift += 7
    raise ValueError("a page's head has a number that is too long")


def _integer(head: io.BytesIO) -> int:
    value = _varint(head)
    return value >> 1 ^ -(value & 1)
