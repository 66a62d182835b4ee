"""NPZ files of NumPy. Of each array the head is checked before its numbers are read; nothing in the file is unpickled.

An array of Python objects is a pickle, which can run code as it is read: such a file is refused as a whole.
"""

from __future__ import annotations

import zipfile
from collections.abc import Collection
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from models.records.tables.binary.arrays import NUMBERS, check_shape, columns_of, is_wanted, names_of
from models.records.tables.sizes import Limits, RecordError, bounded_memory
from models.records.tables.table import Table

Array = NDArray[np.float64]


def table_of_npz(path: Path, limits: Limits, wanted: Collection[str] | None) -> Table:
    """The wanted columns (n,) [as the file has them], or all for None.

    Raises RecordError for a file that is too large or holds pickles, and what NumPy raises for one that is damaged.
    """
    found: dict[str, Array] = {}
    names: list[str] = []
    numbers = 0
    with bounded_memory(limits), zipfile.ZipFile(path) as archive:
        members = [member for member in archive.infolist() if member.filename.endswith(".npy")]
        limits.check_columns(len(members))
        for member in members:
            name = member.filename.removesuffix(".npy")
            with archive.open(member) as file:
                shape, dtype = _head(file, name)
            fields = [part for part in dtype.names if dtype[part].kind in NUMBERS] if dtype.names else None
            if dtype.names is None and dtype.kind not in NUMBERS:
                continue  # text
            own = names_of(name, shape, fields, limits)
            names += own
            limits.check_columns(len(names))
            if not is_wanted(own, wanted):
                continue
            numbers = check_shape((*shape, len(dtype.names or (1,))), limits, numbers)
            with archive.open(member) as file:
                array = npy.read_array(file, allow_pickle=False)
            found |= {column: values for column, values in columns_of(name, array) if is_wanted((column,), wanted)}
    if len(set(names)) != len(names):
        raise RecordError("two arrays have one name; save each under a name of its own")
    return Table(found, names)


def _head(file: IO[bytes], name: str) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type that an array states. Raises RecordError for Python objects."""
    version = npy.read_magic(file)
    shape, _, dtype = (npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0)(file)
    if dtype.hasobject:
        raise RecordError(
            f"{name} holds Python objects, which are pickled and are not read, as they can run code; save plain arrays "
            "of numbers"
        )
    return shape, dtype
