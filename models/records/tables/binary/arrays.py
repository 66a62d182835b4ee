"""Arrays of several dimensions as columns, the same way for every format that holds arrays.

A matrix gives one column for each of its rows or columns, whichever are longer: "log/data:1", "log/data:2" and so on.
An array of structures gives one column a field: "log.position".
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.records.tables.sizes import Limits

Array = NDArray[np.float64]
NUMBERS = "fiub"  # kinds of NumPy's types that are numbers


def names_of(name: str, shape: tuple[int, ...], fields: Collection[str] | None, limits: Limits) -> tuple[str, ...]:
    """The columns that an array of this name and shape has; none where it is not a table, but an image, say.

    fields: of its structures.
    """
    dimensions = [length for length in shape if length != 1]
    if fields is not None:
        return tuple(f"{name}.{part}" for part in fields) if len(dimensions) == 1 else ()
    if len(dimensions) == 2 and min(dimensions) <= limits.columns:
        return tuple(f"{name}:{number}" for number in range(1, min(dimensions) + 1))
    return (name,) if len(dimensions) == 1 else ()


def columns_of(name: str, array: NDArray[Any]) -> Iterator[tuple[str, Array]]:
    """The columns (n,) [as they are] of an array of numbers or of structures, in the order of `names_of`."""
    array = np.squeeze(array)
    if array.dtype.names:
        for part in array.dtype.names:
            if array.dtype[part].kind in NUMBERS:
                yield f"{name}.{part}", np.asarray(array[part], float)
    elif array.ndim == 2:
        for number, column in enumerate(array if array.shape[0] < array.shape[1] else array.T, start=1):
            yield f"{name}:{number}", np.asarray(column, float)
    elif array.ndim == 1:
        yield name, np.asarray(array, float)


def is_wanted(names: Collection[str], wanted: Collection[str] | None) -> bool:
    """Whether any of these columns is wanted; all are for None."""
    return bool(names) if wanted is None else not set(wanted).isdisjoint(names)


def check_shape(shape: tuple[int, ...], limits: Limits, others: int = 0) -> int:
    """How many numbers an array of this shape and the others have together. Raises RecordError for too many."""
    numbers = others + math.prod(shape)
    limits.check_numbers(numbers)
    limits.check_samples(max(shape, default=0))
    return numbers
