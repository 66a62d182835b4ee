"""HDF5 files of any layout: every data set of numbers by its path, with its unit where an attribute states one.

Data sets whose samples are in other files are refused, and links to other files are not followed. What a file states is
checked before it is read, in bounded memory, and attributes other than the unit are not read.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from models.records.tables.binary.arrays import NUMBERS, columns_of, is_wanted, names_of
from models.records.tables.sizes import Limits, RecordError, bounded_memory
from models.records.tables.table import Table

Array = NDArray[np.float64]

UNIT_ATTRIBUTES: Final = ("unit", "units", "Unit", "Units", "UNIT", "UNITS")  # attributes that state a unit
MAX_UNIT_CHARS: Final = 100  # characters of a unit


def table_of_hdf5(path: Path, limits: Limits, wanted: Collection[str] | None) -> Table:
    """The wanted columns (n,) [as the file has them], or all for None; "/group/data" is the same as "group/data".

    Raises RecordError for a file that is too large, and what h5py raises for one that is damaged.
    """
    bare = None if wanted is None else {name.removeprefix("/") for name in wanted}
    found, names, units = read_datasets(path, limits, bare)
    for name in wanted or ():
        if name.startswith("/") and name[1:] in found:
            found[name] = found[name[1:]]
            names.append(name)
            if name[1:] in units:
                units[name] = units[name[1:]]
    return Table(found, names, units)


def read_datasets(
    path: Path, limits: Limits, wanted: Collection[str] | None
) -> tuple[dict[str, Array], list[str], dict[str, str]]:
    """The wanted columns (n,) [as the file has them], or all for None; the names of all; the units that it states.

    Raises RecordError, and what h5py raises for a damaged file.
    """
    import h5py  # noqa: PLC0415 (so that only who reads such files waits for it)

    found: dict[str, Array] = {}
    names: list[str] = []
    units: dict[str, str] = {}
    objects = numbers = 0

    def visit(name: str, item: Any) -> None:
        nonlocal objects, numbers
        objects += 1
        limits.check_columns(objects // 4)  # a field of a MAT file may take some, among the references
        if not isinstance(item, h5py.Dataset) or name.startswith("#") or item.shape is None:
            return
        fields = [part for part in item.dtype.names if item.dtype[part].kind in NUMBERS] if item.dtype.names else None
        if item.dtype.names is None and item.dtype.kind not in NUMBERS:
            return
        own = names_of(name, item.shape, fields, limits)
        names.extend(own)
        limits.check_columns(len(names))
        if not is_wanted(own, wanted):
            return
        if item.external or item.is_virtual:
            raise RecordError(f"{name} keeps its samples in another file; save them in this one")
        numbers += max(int(item.size or 0), math.prod(item.chunks or ())) * len(item.dtype.names or (1,))
        limits.check_numbers(numbers)
        limits.check_samples(max(item.shape))
        found.update((column, values) for column, values in columns_of(name, item[()]) if is_wanted((column,), wanted))
        if unit := _unit(item):
            units.update(dict.fromkeys(own, unit))

    with bounded_memory(limits), h5py.File(path, "r") as file:
        file.visititems(visit)
    return found, names, units


def _unit(item: Any) -> str:
    """The unit that an attribute of a data set states as one text; "" for none."""
    from h5py import check_string_dtype  # noqa: PLC0415

    for name in UNIT_ATTRIBUTES:
        if name not in item.attrs:
            continue
        attribute = item.attrs.get_id(name)
        text = check_string_dtype(attribute.dtype)
        if text is None or math.prod(attribute.shape) != 1 or (text.length or 0) > MAX_UNIT_CHARS:
            continue  # no text, or several
        stated = np.ravel(item.attrs[name])[0]
        stated = stated.decode("utf-8", "replace") if isinstance(stated, bytes) else str(stated)
        if stated.strip() and len(stated) <= MAX_UNIT_CHARS:
            return stated.strip()
    return ""
