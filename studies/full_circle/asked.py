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

MOVED: Final = 1e-3  # of a stroke: from where on a reference counts as moving
# Of a stroke, or of the largest feedforward: by how much a run may depart from its table.
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
    """The table that a record is a run of, and the part of it that is that run, with the table's target from where the
    axis stood; None where it is a run of none, or it is unclear of which. A log may begin before the table does, and
    hold no target or feedforward."""
    near = _near(record, tables)
    if not near or _several(near):
        return None
    one, part = near[0]
    begin = part.reference[0] - one.reference[0]
    return one, replace(part, target=begin + one.target[: part.position.size])


def unclear(record: Record, tables: Sequence[Asked]) -> bool:
    """Whether a record without its feedforward follows the reference of tables of several kinds, or not the same."""
    return _several(_near(record, tables))


def same(one: Asked, other: Asked) -> bool:
    """Whether two tables are as near as a run is to its table."""
    if one.reference.size != other.reference.size:
        return False
    return _departure(one.reference, one.feedforward, other) <= MAX_DEPARTURE_SHARE


def _near(record: Record, tables: Sequence[Asked]) -> list[tuple[Asked, Record]]:
    """The tables that a record may be a run of, the nearest first, each with the part that is that run."""
    found = [(one, part) for one in tables if (part := _part(record, one)) and alike(part, one)]
    return sorted(found, key=lambda row: _off(row[1], row[0]))


def _several(near: Sequence[tuple[Asked, Record]]) -> bool:
    """Whether a record without its feedforward may be a run of tables that are not the same, of one kind."""
    return any(
        not _has_feedforward(part) and not (one.kind == near[0][0].kind and same(one, near[0][0])) for one, part in near
    )


def _has_feedforward(part: Record) -> bool:
    return bool(np.ptp(part.feedforward) > 0)


def alike(part: Record, one: Asked) -> bool:
    """Whether the reference of a record's part, and its feedforward where it has one, are those of a table as long."""
    return _off(part, one) <= MAX_DEPARTURE_SHARE


def _part(record: Record, one: Asked) -> Record | None:
    """The part of a record that may be a run of the table: from the same distance before the first move."""
    begins = [_first(path, _stroke(one)) for path in (record.reference, one.reference)]
    if None in begins:
        return None
    start = begins[0] - begins[1]  # type: ignore[operator]
    stop = min(start + one.reference.size, record.position.size)
    if start < 0 or stop - start < (1 - ENDS) * one.reference.size:
        return None
    return record.part(start, stop)


def _first(path: Array, stroke: float) -> int | None:
    """The first sample at which a reference has moved by MOVED of this stroke [m]."""
    beyond = np.flatnonzero(np.abs(path - path[0]) > MOVED * stroke)
    return int(beyond[0]) if beyond.size else None


def _off(part: Record, one: Asked) -> float:
    """By how much a run departs from a table, as a share of a stroke or of the feedforward, the larger of both; of a
    log that has one of several samples, at these, where they are nearest to the table's."""
    feedforward = part.feedforward if _has_feedforward(part) else None
    samples = [slice(first, None, part.every) for first in range(part.every)]
    return min(_departure(part.reference, feedforward, one, at) for at in samples)


def _departure(reference: Array, feedforward: Array | None, one: Asked, at: slice = slice(None)) -> float:
    """By how much references (n,) [m], [N] depart from a table at some of its first n samples."""
    known, pushed = (signal[: reference.size][at] for signal in (one.reference, one.feedforward))
    moved = reference[at]
    away = float(np.max(np.abs(moved - moved[0] - known + known[0]))) / max(_stroke(one), 1e-300)
    if feedforward is None:
        return away
    off = float(np.max(np.abs(feedforward[at] - pushed)))
    return max(away, off / max(float(np.max(np.abs(one.feedforward))), 1e-300))


def _stroke(one: Asked) -> float:
    """The largest step of a table's target [m]; the way of its reference where the target rests."""
    step = float(np.max(np.abs(np.diff(one.target)), initial=0.0))
    return step or float(np.ptp(one.reference))
