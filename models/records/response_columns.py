"""What a file with a frequency response says beside magnitude and phase: deviations, and whether the axis rolled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.records.columns import Columns
from models.records.tables.sizes import RecordError

Array = NDArray[np.float64]

ABSOLUTE: Final = "deviation_m_per_N"
ROLLED: Final = "rolled"
ALSO: Final = (ABSOLUTE, ROLLED)  # columns that are read besides those of models.records.columns
HINTS: Final = ("deviation", "std", "sigma", "uncertainty", "variance")  # in the name of a column that may be one
USE: Final = (
    'map it by deviation = "NAME [m/N]" (absolute) or "NAME [1]" (relative to the magnitude) in the machine file\'s '
    "[record] or by --column, or leave the column out"
)


def deviation(table: Mapping[str, Array], names: Sequence[str], columns: Columns, magnitude: Array) -> Array:
    """Standard deviations (n,) [m/N] of the lines of magnitude (n,) [m/N]; NaN where the file states none.

    names: of all columns of the file. Raises RecordError for a mapped column that is missing, for values that are no
    deviations, and for a column that looks like deviations without being used.
    """
    source = columns.source("deviation")
    mapped = columns.deviation != Columns().deviation
    found: Array | None = None
    used = source.name
    if source.name in table:
        found = table[source.name] * source.factor * (1.0 if source.absolute else magnitude)
    elif mapped:
        raise RecordError(f"column {source.name!r} for the deviation is missing; correct its name, or leave it out")
    elif ABSOLUTE in table:
        used, found = ABSOLUTE, table[ABSOLUTE]
    if found is None:
        known = {columns.source(signal).name for signal in ("frequency", "magnitude", "phase")}
        like = [name for name in names if name not in known and any(hint in name.lower() for hint in HINTS)]
        if like:
            raise RecordError(f"column {like[0]!r} looks like a deviation, and is not used; {USE}")
        return np.full(magnitude.size, np.nan)
    if not (np.all(np.isfinite(found)) and np.all(found > 0)):
        raise RecordError(f"column {used!r} has deviations that are not above 0; leave out those lines, or the column")
    return np.asarray(found, np.float64)


def rolled(table: Mapping[str, Array]) -> bool:
    """Whether a column "rolled" says of all lines, by 1, that the axis rolled in one direction meanwhile; 0 of all, or
    no such column, says that it did not. Raises RecordError for one that says both [-]."""
    if ROLLED not in table:
        return False
    said = table[ROLLED]
    if not (np.all(said == 1) or np.all(said == 0)):
        raise RecordError(f"column {ROLLED!r} must be 1 for all lines, or 0 for all; give other lines in another file")
    return bool(np.all(said == 1))
