"""Writes the cases of drawn machines: a nominal.json and two records each."""

from __future__ import annotations

import gzip
import io
import json
import shutil
from pathlib import Path
from typing import Final

import numpy as np

from studies.blind_trial.sealer.loop import Log
from studies.blind_trial.sealer.machines.cases import Plan
from studies.blind_trial.sealer.machines.motions import Schedule

COLUMNS: Final = "time_s,target_m,reference_m,feedforward_N,command_N,position_m"
RECORDS: Final = ("first", "second")
FORMATS: Final = ["%.7g", "%.10g", "%.13g", "%.10g", "%.10g", "%.10g"]


def write(place: Path, found: Plan) -> None:
    """Writes a case's nominal machine, records, and the catalogue entries that are disabled for it."""
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    nominal = found.bench.axis.nominal(f"drawn machine {found.bench.number + 1}")
    (place / "nominal.json").write_text(json.dumps(nominal, indent=1) + "\n", encoding="utf-8")
    for which, name in enumerate(RECORDS):
        (place / f"{name}.csv.gz").write_bytes(record(found, which))
    disabled(place, found)


def disabled(place: Path, found: Plan) -> None:
    """Writes which catalogue entries the diagnosis may not use, where there are any."""
    if found.kind == "disabled":
        names = [part.name for part in found.parts]
        (place / "disabled.json").write_text(json.dumps(names) + "\n", encoding="utf-8")


def record(found: Plan, which: int) -> bytes:
    """One record as a compressed table; the same plan gives the same bytes."""
    text = table(found.bench.axis.sample_time, found.bench.schedules[which], found.log(which))
    return gzip.compress(text.encode(), compresslevel=6, mtime=0)


def table(sample_time: float, schedule: Schedule, log: Log) -> str:
    """A record as comma-separated columns; SI."""
    time = np.arange(log.command.size) * sample_time
    columns = [time, schedule.target, schedule.reference, schedule.feedforward, log.command, log.reading]
    text = io.StringIO()
    text.write(COLUMNS + "\n")
    np.savetxt(text, np.stack(columns, axis=1), fmt=FORMATS, delimiter=",")
    return text.getvalue()
