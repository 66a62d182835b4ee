"""Writes the cases: a record each, nothing of what was put into it, and no file that says what the reference was."""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

import numpy as np

from models.records.record import Record

COLUMNS: Final = "time_s,target_m,reference_m,feedforward_N,command_N,position_m"
NOMINAL: Final = "nominal.toml"
FILE: Final = "record.csv.gz"


def text_of(record: Record) -> bytes:
    """A record as a compressed table of numbers to their last digit; the same record gives the same bytes."""
    time = np.arange(record.position.size) * record.sample_time
    columns = (record.target, record.reference, record.feedforward, record.command, record.position)
    text = io.StringIO()
    text.write(COLUMNS + "\n")
    np.savetxt(text, np.stack([time, *columns], axis=1), fmt=["%.9g", *["%.17g"] * len(columns)], delimiter=",")
    return gzip.compress(text.getvalue().encode(), compresslevel=4, mtime=0)


def write_pack(
    folder: Path, machine: str, cases: Iterable[tuple[str, Record]], commitments: Mapping[str, str], made_by: str
) -> None:
    """Writes a pack: the machine file's text, the record of every case, the commitments of their labels. Records that
    an interrupted run wrote from the same (`made_by`) are kept; `cases` are still drawn one after another."""
    mark = folder / "made_by"
    if not (mark.is_file() and mark.read_text(encoding="utf-8") == made_by):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        mark.write_text(made_by, encoding="utf-8")
    (folder / NOMINAL).write_text(machine, encoding="utf-8")
    (folder / "commitments.json").write_text(json.dumps(commitments, indent=1) + "\n", encoding="utf-8")
    for case, record in cases:
        place = folder / case / FILE
        content = text_of(record)
        if not (place.is_file() and _hash(place.read_bytes()) == _hash(content)):
            place.parent.mkdir(exist_ok=True)
            place.write_bytes(content)


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
