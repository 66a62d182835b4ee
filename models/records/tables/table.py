"""What every reader of a file format returns: the columns of one file as the file has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Table:
    """The columns of one file, under its names and in its units.

    columns: name -> samples (n,) of the columns that were read [as the file has them].
    names: of all columns that the file has, read or not; without their units, as in `columns`.
    units: name -> unit as the file states it ("mm"), for those columns for which it states one.
    clocks: name -> name of the column that holds the times of its samples, where the file says so (several time
    columns, groups with a rate of their own); a reader returns the clocks of the wanted columns among `columns`.
    recognised: one phrase for each thing about the layout that the file does not state and that the reader decided
    ("the data begin in line 7", "decimal comma").
    """

    columns: Mapping[str, Array]
    names: Sequence[str]
    units: Mapping[str, str] = field(default_factory=dict)
    clocks: Mapping[str, str] = field(default_factory=dict)
    recognised: tuple[str, ...] = ()
