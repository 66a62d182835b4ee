"""ROS 2 bags (MCAP, or SQLite as .db3), by the optional package rosbags: every number in every message of a topic.

A column is called "topic/field.of.field", an element of a list "topic/field:1". The clock of a topic is its
header.stamp or stamp, or the time at which the bag received it. rosbags makes code of a bag's message types, which is
not used here: its parser gives the types' fields, and the messages are read by these.
"""

from __future__ import annotations

import sqlite3
import struct
from array import array
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from models.records.tables.binary.extras import check_installed
from models.records.tables.sizes import Limits, RecordError, bounded_memory
from models.records.tables.table import Table

Array = NDArray[np.float64]

MAX_DEFINITION_CHARS: Final = 100_000  # characters of a definition of messages
VISITS: Final = 20_000  # fields of one message
EMPTY: Final = (("structure_needs_at_least_one_member", (1, ("uint8", 0))),)
BASE, NAME, ARRAY, SEQUENCE = 1, 2, 3, 4  # kinds of fields, as rosbags numbers them
FORMATS: Final = {
    "bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i",
    "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
STAMPS: Final = ("header.stamp", "stamp")

Types = Mapping[str, Any]


def table_of_rosbag(path: Path, limits: Limits, wanted: Collection[str] | None) -> Table:
    """The wanted columns (n,) [as the messages have them], or all for None; clocks in seconds since the first of them.

    Raises RecordError for a bag that is too large or has views, and what rosbags raises for one that is damaged.
    """
    check_installed("rosbags", "a ROS 2 bag")
    from rosbags import typesys as store  # noqa: PLC0415 (an optional package)
    from rosbags.rosbag2 import Reader  # noqa: PLC0415

    known = store.get_typestore(store.Stores.ROS2_HUMBLE).fielddefs
    _check_database(path)
    found: dict[str, Array] = {}
    names: list[str] = []
    clocks: dict[str, str] = {}
    times: dict[str, tuple[bool, list[int]]] = {}
    with bounded_memory(limits), Reader(path) as bag:
        limits.check_columns(len(bag.connections))
        topics: dict[str, list[Any]] = {}
        for connection in bag.connections:
            topics.setdefault(str(connection.topic).strip("/"), []).append(connection)
        for topic, connections in topics.items():
            needed = wanted is None or any(name.startswith(f"{topic}/") for name in wanted)
            try:
                types = {**known, **_types(store, connections[0])}
                read = _topic(bag, connections, types, limits, first_only=not needed)
            except _NotATableError as error:
                if needed and wanted is not None:
                    raise RecordError(f"the messages of {topic} {error}") from error
                continue
            names += [f"{topic}/{name}" for name in read.columns]
            if needed and read.times:
                found |= {f"{topic}/{name}": np.array(column) for name, column in read.columns.items()}
                clocks |= {f"{topic}/{name}": f"{topic}/time" for name in read.columns}
                times[f"{topic}/time"] = read.stamped, read.times
            limits.check_columns(len(names))
            limits.check_numbers(sum(column.size for column in found.values()))
    firsts = {
        kind: min((t[0] for stamped, t in times.values() if stamped == kind), default=0) for kind in (True, False)
    }
    for name, (stamped, stamps) in times.items():
        found[name] = np.array([stamp - firsts[stamped] for stamp in stamps], float) * 1e-9
    said = tuple(
        f"times of {name.removesuffix('/time')}: its stamps" for name, (stamped, _) in times.items() if stamped
    )
    return Table(found, [*names, *times], dict.fromkeys(times, "s"), clocks, said)


class _NotATableError(Exception):
    """Messages that do not give one number a column each; says why."""


@dataclass(frozen=True)
class _Topic:
    """Columns of a topic, its times [ns], and whether they are its stamps."""

    columns: dict[str, array[float]]
    times: list[int]
    stamped: bool


def _topic(bag: Any, connections: list[Any], types: Types, limits: Limits, *, first_only: bool) -> _Topic:
    """The messages of one topic, or the first of them, whose names are those of all. Raises _NotATableError."""
    columns: dict[str, array[float]] = {}
    received, stamps = list[int](), list[int]()
    stamped = ""
    for connection, time, data in bag.messages(connections=connections):
        message = _Message(data, types, limits.columns)
        row = list(message.fields((NAME, connection.msgtype), ""))
        if not received:
            columns = {name: array("d") for name, _ in row}
            stamped = next((name for name in STAMPS if {f"{name}.sec", f"{name}.nanosec"} <= columns.keys()), "")
        if [name for name, _ in row] != list(columns):
            raise _NotATableError("do not have as many numbers each; record lists of one length")
        for name, value in row:
            columns[name].append(value)
        received.append(time)
        if stamped:
            values = dict(row)
            stamps.append(int(values[f"{stamped}.sec"]) * 10**9 + int(values[f"{stamped}.nanosec"]))
        limits.check_samples(len(received), "messages of one topic")
        limits.check_numbers(len(received) * len(columns))
        if first_only:
            break
    if not any(stamps):
        return _Topic(columns, received, False)
    order = sorted(range(len(stamps)), key=stamps.__getitem__)  # messages may overtake each other on their way
    return _Topic(
        {name: array("d", (column[at] for at in order)) for name, column in columns.items()}, sorted(stamps), True
    )


def _types(store: Any, connection: Any) -> Types:
    """The fields of the types that a bag defines for a connection. Raises _NotATableError for too long a definition."""
    definition = connection.msgdef
    if len(definition.data) > MAX_DEFINITION_CHARS:
        raise _NotATableError(f"are defined in more than {MAX_DEFINITION_CHARS:,} characters")
    kind = definition.format.name
    if kind == "MSG":
        return dict(store.get_types_from_msg(definition.data, connection.msgtype))
    return dict(store.get_types_from_idl(definition.data)) if kind == "IDL" else {}


class _Message:
    """One message in CDR, the serialisation of ROS 2 (OMG, DDS-RTPS 2.5, 10.2): numbers aligned to their own size."""

    def __init__(self, data: bytes, types: Types, most: int) -> None:
        if len(data) < 4 or data[0] != 0 or data[1] not in (0, 1):
            raise _NotATableError("are not serialised as plain CDR")
        self.content, self.order = memoryview(data)[4:], "<" if data[1] else ">"
        self.types, self.most = types, most
        self.at = self.visits = 0

    def number(self, code: str) -> Any:
        """The next number."""
        size = struct.calcsize(f"={code}")
        self.at += -self.at % size
        if self.at + size > len(self.content):
            raise _NotATableError("end before their last field")
        (value,) = struct.unpack_from(f"{self.order}{code}", self.content, self.at)
        self.at += size
        return value

    def fields(self, described: Any, name: str) -> Iterator[tuple[str, Any]]:
        """The names and values of all numbers in a field of this description; text is passed over."""
        kind, what = described
        self.visits += 1
        if self.visits > VISITS:
            raise _NotATableError("have too many fields")
        if kind == NAME:
            if what not in self.types:
                raise _NotATableError(f"have a field of the type {what!r}, which the bag does not define")
            for part, inner in self.types[what][1] or EMPTY:
                yield from self.fields(inner, f"{name}.{part}" if name else part)
        elif kind in (ARRAY, SEQUENCE):
            count = int(what[1]) if kind == ARRAY else int(self.number("I"))
            if count > self.most:
                raise _NotATableError(f"have lists of more than {self.most:,} elements")
            for number in range(1, count + 1):
                yield from self.fields(what[0], f"{name}:{number}")
        elif what[0] == "string":
            length = int(self.number("I"))
            self.at += length
        elif what[0] in FORMATS:
            yield name, self.number(FORMATS[what[0]])
        else:
            raise _NotATableError(f"have a field of the type {what[0]!r}, which is not read")


def _check_database(path: Path) -> None:
    """Raises RecordError for a database with more than tables and indexes, as it can't be foreseen what that runs."""
    if path.suffix.lower() != ".db3":
        return
    if set(path.name) & set("?#%"):
        raise RecordError("has one of ?, #, % in its name, which SQLite reads as options; rename it")
    with sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True) as database:
        made = database.execute("SELECT type, upper(coalesce(sql, '')) FROM sqlite_master").fetchall()
    database.close()
    if any(kind not in ("table", "index") or sql.startswith("CREATE VIRTUAL") for kind, sql in made):
        raise RecordError("is a database with views, triggers or virtual tables, which no bag has; export it again")
