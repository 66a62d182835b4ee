"""Tables of references that were asked for, and which of them a record is a run of."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.records.record import Record
from studies.folder import write_at_once

Array = NDArray[np.float64]

MOVED: Final = 1e-3  # of the way: from where on a reference counts as moving
# Of the way, or of the largest feedforward: by how much a run may depart from its table.
MAX_DEPARTURE_SHARE: Final = 0.01
ENDS: Final = 0.02  # of a table that a record may lack at its end


@dataclass(frozen=True)
class Asked:
    """A table of references (n,) [m], [N] for the design of this kind ("current" or "redesign"), or for an
    experiment ("suite" or "next_experiment"); key: of its text."""

    kind: str
    key: str
    target: Array
    reference: Array
    feedforward: Array


def asked(kind: str, text: str) -> Asked:
    """The table in a text of four columns (SI)."""
    rows = np.loadtxt(io.StringIO(text), delimiter=",", skiprows=1, ndmin=2)
    return Asked(kind, hashlib.sha256(text.encode()).hexdigest()[:16], rows[:, 1], rows[:, 2], rows[:, 3])


def keep(folder: Path, kind: str, text: str) -> Asked:
    """Keeps a table that is asked for, so that its record is known also once another one is asked for."""
    one = asked(kind, text)
    file = folder / f"{one.key}.json"
    if not file.is_file():
        write_at_once(file, json.dumps({"kind": kind, "table": text}) + "\n")
    return one


def kept(folder: Path) -> tuple[Asked, ...]:
    """The tables that were ever asked for; what is damaged is left out."""
    found = []
    for file in sorted(folder.glob("*.json")):
        try:
            content = json.loads(file.read_text(encoding="utf-8"))
            found.append(asked(content["kind"], content["table"]))
        except (OSError, ValueError, LookupError, TypeError):
            continue
    return tuple(found)


def ran(record: Record, tables: Sequence[Asked]) -> tuple[Asked, Record] | None:
    """The table that a record is a run of, and the part of it that is that run, with the table's target; None where it
    is a run of none. A log may begin before the table does, and hold no target or feedforward."""
    found = [(distance, one, part) for one in tables if (part := _part(record, one)) for distance in [_off(part, one)]]
    near = [row for row in found if row[0] <= MAX_DEPARTURE_SHARE]
    if not near:
        return None
    _, one, part = min(near, key=lambda row: row[0])
    return one, replace(part, target=one.target[: part.position.size].copy())


def alike(part: Record, one: Asked) -> bool:
    """Whether the reference of a record's part, and its feedforward where it has one, are those of a table as long."""
    return _off(part, one) <= MAX_DEPARTURE_SHARE


def _part(record: Record, one: Asked) -> Record | None:
    """The part of a record that may be a run of the table: from the same distance before the first move."""
    begins = [_first(path) for path in (record.reference, one.reference)]
    if None in begins:
        return None
    start = begins[0] - begins[1]  # type: ignore[operator]
    stop = min(start + one.reference.size, record.position.size)
    if start < 0 or stop - start < (1 - ENDS) * one.reference.size:
        return None
    return record.part(start, stop)


def _first(path: Array) -> int | None:
    """The first sample at which a reference has moved."""
    moved = np.abs(path - path[0])
    beyond = np.flatnonzero(moved > MOVED * max(float(np.ptp(path)), 1e-300))
    return int(beyond[0]) if beyond.size and np.ptp(path) > 0 else None


def _off(part: Record, one: Asked) -> float:
    """By how much a run departs from a table, as a share of the way or of the feedforward, the larger of both; of a log
    that has one of several samples, at these, where they are nearest to the table's."""
    return min(_off_at(part, one, slice(first, part.position.size, part.every)) for first in range(part.every))


def _off_at(part: Record, one: Asked, at: slice) -> float:
    reference, feedforward = part.reference[at], part.feedforward[at]
    known = one.reference[: part.position.size][at]
    away = float(np.max(np.abs(reference - reference[0] - known + known[0])))
    away /= max(float(np.ptp(one.reference)), 1e-300)
    if not np.ptp(part.feedforward) > 0:
        return away
    pushed = float(np.max(np.abs(feedforward - one.feedforward[: part.position.size][at])))
    return max(away, pushed / max(float(np.max(np.abs(one.feedforward))), 1e-300))
