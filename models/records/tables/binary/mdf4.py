"""MDF4 files (ASAM), by the optional package asammdf: every channel with its unit, and its group's times as its clock.

Raw values are read and converted here, by the linear and rational conversions: a formula in the file is not evaluated.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import suppress
from functools import wraps
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from models.records.tables.binary.arrays import NUMBERS, is_wanted
from models.records.tables.binary.extras import optional, unlogged
from models.records.tables.sizes import Limits, RecordError, bounded_memory
from models.records.tables.table import Table

Array = NDArray[np.float64]

HEADS: Final = (b"MDF     ", b"UnFinMF ")  # how finished and unfinished files begin
NONE, LINEAR, RATIONAL = 0, 1, 2  # types of conversions


def table_of_mdf4(path: Path, limits: Limits, wanted: Collection[str] | None) -> Table:
    """The wanted columns (n,) [as the file has them, converted], or all for None.

    A channel is called by its name, or "group/name" where several have it; a group is called by its acquisition, or its
    number from 0 on. Raises RecordError for a file that is too large, and what asammdf raises for one that is spoiled.
    """
    library = _library()
    with path.open("rb") as file:
        head = file.read(16)
    if head[:8] not in HEADS or head[8:9] != b"4":
        version = head[8:16].decode("ascii", "replace").strip(" \0")
        raise RecordError(
            f"is an MDF file of version {version}; convert it to version 4"
            if head[:8] in HEADS
            else "is not an MDF file, whatever its name ends in; give the one that the logger wrote"
        )
    found: dict[str, Array] = {}
    units: dict[str, str] = {}
    numbers = 0
    with (
        unlogged(),
        bounded_memory(limits),
        path.open("rb") as file,
        library.MDF(file, process_bus_logging=False) as content,
    ):
        names = _names(content, limits)
        clocks = {
            name: names[group, content.masters_db[group]]
            for (group, index), name in names.items()
            if content.masters_db.get(group, index) != index
        }
        also = None if wanted is None else {clocks[name] for name in wanted if name in clocks}
        for (group, index), name in names.items():
            if not is_wanted((name,), wanted if wanted is None or also is None else {*wanted, *also}):
                continue
            count = int(content.groups[group].channel_group.cycles_nr)
            numbers += count
            limits.check_numbers(numbers)
            limits.check_samples(count)
            column = _column(content, group, index, needed=wanted is not None)
            if column is None:
                continue
            found[name] = column
            if unit := _unit(content.groups[group].channels[index]) or ("s" if name in clocks.values() else ""):
                units[name] = unit
    clocks = {name: clock for name, clock in clocks.items() if name in found and clock in found}
    return Table(found, list(names.values()), units, clocks)


def _library() -> Any:
    """The package asammdf. What it has read of a spoiled file it closes when it is deleted, and would fail at that."""
    kind = optional("asammdf.blocks.mdf_v4", "asammdf", "MDF4").MDF4
    if not hasattr(kind.__del__, "__wrapped__"):
        given = kind.__del__

        @wraps(given)
        def closed(self: Any) -> None:
            with suppress(AttributeError):
                given(self)

        kind.__del__ = closed
    return optional("asammdf", "asammdf", "MDF4")


def _names(content: Any, limits: Limits) -> dict[tuple[int, int], str]:
    """(number of the group, of the channel in it) -> the name of its column. Raises RecordError."""
    channels = dict[tuple[int, int], str]()
    for at, group in enumerate(content.groups):
        limits.check_columns(len(channels) + len(group.channels))
        channels |= {(at, index): str(channel.name) for index, channel in enumerate(group.channels)}
    groups = [str(group.channel_group.acq_name or at) for at, group in enumerate(content.groups)]
    several, alike = Counter(channels.values()), Counter(groups)

    def called(at: int, name: str) -> str:
        return name if several[name] == 1 else f"{groups[at] if alike[groups[at]] == 1 else at}/{name}"

    names = {(at, index): called(at, name) for (at, index), name in channels.items()}
    twice = [name for name, count in Counter(names.values()).items() if count > 1]
    return {key: name for key, name in names.items() if name not in twice}


def _unit(channel: Any) -> str:
    return str(getattr(channel.conversion, "unit", "") or channel.unit or "").strip()


def _column(content: Any, group: int, index: int, *, needed: bool) -> Array | None:
    """The values (n,) [as converted] of a channel, NaN where they are marked invalid; None for what are no numbers.

    Raises RecordError for another conversion if the channel is needed.
    """
    channel = content.groups[group].channels[index]
    kind = NONE if channel.conversion is None else int(channel.conversion.conversion_type)
    if kind not in (NONE, LINEAR, RATIONAL):
        if needed:
            raise RecordError(
                f"{channel.name} is converted by a table or formula in the file, which is not evaluated; export it "
                "with its physical values"
            )
        return None
    samples, invalid = content.get(group=group, index=index, raw=True, samples_only=True)
    if samples.dtype.kind not in NUMBERS or samples.ndim != 1:
        return None
    column = np.asarray(samples, float)
    if kind == LINEAR:
        column = channel.conversion.a * column + channel.conversion.b
    elif kind == RATIONAL:
        above, below = _polynomials(channel.conversion)
        column = np.polyval(above, column) / np.polyval(below, column)
    if invalid is not None:
        column = np.where(np.asarray(invalid, bool), np.nan, column)
    return np.asarray(column, np.float64)


def _polynomials(conversion: Any) -> Iterator[list[float]]:
    """Coefficients of the numerator and the denominator of a rational conversion, the highest power first."""
    for part in ((1, 2, 3), (4, 5, 6)):
        yield [float(getattr(conversion, f"P{number}")) for number in part]
