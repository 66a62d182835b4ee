"""TDMS files of LabVIEW and DIAdem: every channel as "group/channel", with its unit and its clock where it states them.

Channels of waveforms state when they begin and at which rate they are sampled: that is their clock. Only the file
itself is opened, not the index that may lie beside it.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from models.records.tables.binary.arrays import NUMBERS, is_wanted
from models.records.tables.binary.extras import unlogged
from models.records.tables.sizes import Limits, RecordError, bounded_memory
from models.records.tables.table import Table

Array = NDArray[np.float64]

UNIT_PROPERTIES: Final = ("unit_string", "NI_UnitDescription", "unit", "units", "Unit")  # properties that state a unit
MOST_SCALES: Final = 100  # steps from a raw value to the scaled one


def table_of_tdms(path: Path, limits: Limits, wanted: Collection[str] | None) -> Table:
    """The wanted columns (n,) [as the file has them, scaled], or all for None; clocks in seconds.

    Raises RecordError for a file that is too large, and what npTDMS raises for one that is damaged.
    """
    from nptdms import TdmsFile  # noqa: PLC0415 (so that only who reads such files waits for it)

    found: dict[str, Array] = {}
    units: dict[str, str] = {}
    names: list[str] = []
    clocks: dict[str, str] = {}
    numbers = 0
    with unlogged(), bounded_memory(limits), path.open("rb") as file, TdmsFile.open(file) as content:
        channels = [channel for group in content.groups() for channel in group.channels()]
        limits.check_columns(len(channels))
        for one in (content, *content.groups(), *channels):
            _check_scales(one.properties)
        kept = _clocks(channels)
        for channel in channels:
            name = f"{channel.group_name}/{channel.name}"
            kind = channel.dtype.kind
            if kind not in f"{NUMBERS}M":
                continue  # text
            names.append(name)
            if not is_wanted((name,), wanted):
                continue
            limits.check_samples(len(channel))
            numbers += len(channel)
            limits.check_numbers(numbers)
            found[name] = _seconds(channel[:]) if kind == "M" else np.asarray(channel[:], float)
            if unit := "s" if kind == "M" else _unit(channel.properties):
                units[name] = unit
            if name in kept:
                clocks[name], begin, step = kept[name]
                found[clocks[name]] = begin + step * np.arange(len(channel), dtype=np.float64)
                units[clocks[name]] = "s"
        names += sorted({clock for clock, _, _ in kept.values()})
        cut_off = content.file_status.incomplete_final_segment
    if len(set(names)) != len(names):
        raise RecordError("two channels have one name; name each channel of a group once")
    return Table(found, names, units, clocks, ("the last part of the file is incomplete",) if cut_off else ())


def _unit(properties: Mapping[str, Any]) -> str:
    stated = (properties.get(name) for name in UNIT_PROPERTIES)
    return next((text.strip() for text in stated if isinstance(text, str) and text.strip()), "")


def _begin(properties: Mapping[str, Any]) -> np.datetime64 | None:
    time = properties.get("wf_start_time")
    return time if isinstance(time, np.datetime64) and not np.isnat(time) else None


def _clocks(channels: Sequence[Any]) -> dict[str, tuple[str, float, float]]:
    """Channel -> (name of its clock, time of its first sample [s] since the earliest of the file, step [s]), if any.

    A clock is called "time" if it is the only one, else after the first channel that it belongs to.
    """
    first = min((time for channel in channels if (time := _begin(channel.properties)) is not None), default=None)
    stated = {
        f"{channel.group_name}/{channel.name}": (*waveform, len(channel))
        for channel in channels
        if (waveform := _waveform(channel.properties, first)) is not None
    }
    called = dict[tuple[float, float, int], str]()
    for name, clock in stated.items():
        called.setdefault(clock, "time" if len(set(stated.values())) == 1 else f"time of {name}")
    return {name: (called[clock], *clock[:2]) for name, clock in stated.items()}


def _waveform(properties: Mapping[str, Any], first: np.datetime64 | None) -> tuple[float, float] | None:
    """(the time of the first sample [s] since `first`, the step [s]) of a waveform; None for any other channel."""
    step, offset = properties.get("wf_increment"), properties.get("wf_start_offset", 0.0)
    if not isinstance(step, float) or not isinstance(offset, float) or not step > 0:
        return None
    begin = _begin(properties)
    since = 0.0 if begin is None or first is None else float((begin - first) / np.timedelta64(1, "us")) * 1e-6
    return since + offset, step


def _seconds(times: NDArray[Any]) -> Array:
    """Seconds since the first of the time stamps (n,)."""
    return np.asarray((times - times[:1]) / np.timedelta64(1, "ns"), float) * 1e-9


def _check_scales(properties: Mapping[str, Any]) -> None:
    """Raises RecordError for counts, stated in a channel's properties, that would keep the reader busy for long."""
    for name, value in properties.items():
        counts = name == "NI_Number_Of_Scales" or (name.startswith("NI_Scale[") and name.endswith("_Size"))
        if counts and not (isinstance(value, int | np.integer) and 0 <= value <= MOST_SCALES):
            raise RecordError(f"states {value} for {name}; {MOST_SCALES} is the most that is read")
