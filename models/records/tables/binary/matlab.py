"""MAT files, v4 to v7 and v7.3 (HDF5): what they say that they hold is checked, and they are read in bounded memory.

The parts of v5 to v7 are also counted, since SciPy follows structures within structures until its stack is exhausted,
which ends the process, and takes a microsecond for each of millions of empty cells (MathWorks, MAT-File Format).
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from models.records.tables.binary.arrays import NUMBERS, columns_of, names_of
from models.records.tables.binary.hdf5 import read_datasets
from models.records.tables.sizes import Limits, bounded_memory
from models.records.tables.table import Table

Array = NDArray[np.float64]

HEADER_BYTES: Final = 128  # bytes before the first variable
MATRIX, COMPRESSED = 14, 15
HOLDING: Final = {1, 2, 3}  # classes of arrays whose members are arrays: cells, structures, objects


def table_of_mat(path: Path, limits: Limits, wanted: Collection[str] | None) -> Table:
    """The wanted columns (n,) [as the file has them], or all for None, of the arrays that `_arrays` finds.

    Raises RecordError for a file that is too large, and what SciPy or h5py raise for one that is damaged.
    """
    found = _arrays(path, limits)
    limits.check_samples(max((column.size for column in found.values()), default=0))
    return Table({name: column for name, column in found.items() if wanted is None or name in wanted}, list(found))


def _arrays(path: Path, limits: Limits) -> dict[str, Array]:
    """Every numeric array of a MAT file [as the file has it]; fields of structures as dotted names: data.t, data.x."""
    from scipy.io import loadmat, whosmat  # noqa: PLC0415

    with path.open("rb") as file:
        head = file.read(HEADER_BYTES)
        newer = 0 not in head[:4] and len(head) == HEADER_BYTES
        order = "<" if head[126:] == b"IM" else ">"
        if newer and head[125 if order == "<" else 124] == 2:
            return {name.replace("/", "."): column for name, column in read_datasets(path, limits, None)[0].items()}
        with bounded_memory(limits):
            if newer:
                _check_parts(file, order, limits)
            variables = whosmat(path)
            limits.check_columns(len(variables))
            limits.check_numbers(sum(math.prod(shape) for _, shape, _ in variables))
            content = loadmat(path, squeeze_me=True, struct_as_record=False)
            return _flat({name: item for name, item in content.items() if not name.startswith("__")}, "", limits)


def _flat(content: Mapping[str, Any], where: str, limits: Limits) -> dict[str, Array]:
    """Structures as dotted names, data.t and data.x; the columns of a matrix as in every other format."""
    found: dict[str, Array] = {}
    for name, item in content.items():
        if hasattr(item, "_fieldnames"):  # SciPy's structure
            found |= _flat(vars(item), f"{where}{name}.", limits)
        elif isinstance(item, np.ndarray) and item.dtype.kind in NUMBERS:
            whole = f"{where}{name}"
            found |= dict(columns_of(whole, item)) if names_of(whole, item.shape, None, limits) else {}
            limits.check_columns(len(found))
    return found


def _check_parts(file: IO[bytes], order: str, limits: Limits) -> None:
    """Raises RecordError where the variables from here on have too many parts, or expand to too many bytes."""
    parts = size = 0
    while len(tag := file.read(8)) == 8:
        kind, length = struct.unpack(f"{order}II", tag)
        content = tag + file.read(length)
        if kind == COMPRESSED:
            content = zlib.decompressobj().decompress(content[8:], 8 * limits.numbers + 8 - size)
        size += len(content)
        limits.check_numbers(size // 8)
        at, holding = 0, False
        while at + 8 <= len(content):
            parts += 1
            limits.check_columns(parts // 8)  # a variable or field has eight at most
            kind, length = struct.unpack_from(f"{order}II", content, at)
            short = kind >> 16  # the length of data that are within the tag
            if holding:  # the shape: a place is made for each member, even where it is empty
                shape = np.frombuffer(content, f"{order}i4", (short or length) // 4, at + (4 if short else 8))
                limits.check_columns(math.prod(shape.tolist()))
            holding = kind == MATRIX and length > 0 and content[at + (16 if order == "<" else 19)] in HOLDING
            if kind == MATRIX:  # its parts follow, behind 16 bytes with its class
                at += 24 if length else 8
            else:
                at += 8 if short else 8 + length + -length % 8
