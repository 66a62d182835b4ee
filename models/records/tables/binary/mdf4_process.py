"""Reads an MDF4 file by asammdf, in a process that may end at a damaged one.

Raw values are read, and converted here by linear and rational conversions: a formula in the file is not evaluated.
"""

from __future__ import annotations

import io
import json
import sys
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.records.tables.binary.arrays import NUMBERS, is_wanted
from models.records.tables.sizes import Limits, RecordError, bounded_memory
from models.records.tables.table import Table

Array = NDArray[np.float64]

NONE, LINEAR, RATIONAL = 0, 1, 2  # types of conversions


def main() -> None:
    """Answers the question on the standard input, a path and what is wanted of it, by an NPZ on the standard output."""
    answer, sys.stdout = sys.stdout.buffer, sys.stderr  # what a library prints is not part of the answer
    question = json.load(sys.stdin)
    columns: dict[str, Array] = {}
    said: dict[str, Any]
    try:
        table = read_mdf4(Path(question["path"]), Limits(**question["limits"]), question["wanted"])
        columns = dict(table.columns)
        said = {"columns": [*columns], "names": [*table.names], "units": table.units, "clocks": table.clocks}
    except RecordError as error:
        said = {"refused": str(error)}
    except Exception as error:  # asammdf raises what it likes
        said = {"failed": str(error)}
    with io.BytesIO() as packed:
        np.savez(packed, np.array(json.dumps(said)), *columns.values())
        answer.write(packed.getvalue())


def read_mdf4(path: Path, limits: Limits, wanted: Collection[str] | None) -> Table:
    """The wanted columns (n,) [as the file has them, converted], or all for None, read in this process.

    Raises RecordError for a file that is too large, and what asammdf raises for one that is damaged.
    """
    from asammdf import MDF  # noqa: PLC0415 (an optional package)

    found: dict[str, Array] = {}
    units: dict[str, str] = {}
    numbers = 0
    with bounded_memory(limits), path.open("rb") as file, MDF(file, process_bus_logging=False) as content:
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
    """The values (n,) [as converted] of a channel, NaN where they are marked invalid; None where they are not numbers.

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
    record = int(content.groups[group].channel_group.samples_byte_nr)
    if int(channel.byte_offset) + (int(channel.bit_offset) + int(channel.bit_count) + 7) // 8 > record:
        raise RecordError(f"{channel.name} lies outside the file's records; export it again")
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


if __name__ == "__main__":
    main()
