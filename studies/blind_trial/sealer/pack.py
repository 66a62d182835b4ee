"""Writes sealed cases: records for everyone, commitments beside them, the key somewhere else."""

from __future__ import annotations

import gzip
import hashlib
import io
import json
import os
import secrets
import shutil
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from joblib import Parallel, delayed, parallel_config

from studies.blind_trial.sealer import nominal
from studies.blind_trial.sealer.draw import Plan, order, plan
from studies.blind_trial.sealer.schedule import Schedule, sequential, suite
from studies.blind_trial.sealer.simulate import simulate

COLUMNS: Final = "time_s,target_m,reference_m,feedforward_N,command_N,position_m"
EXPERIMENTS: Final = {"sequential": sequential, "suite": suite}
AGAIN: Final = ("single", "high")  # kind and severity of the cases of which every second is measured again
OTHER: Final = 1000  # from a case's seed to that of its second measurement


@dataclass(frozen=True)
class Places:
    """Where to write a pack, its key, and the second measurements of some cases (None: no second measurements)."""

    pack: Path
    key: Path
    again: Path | None = None

    @property
    def parts(self) -> Path:
        """Where the labels lie until the last case is sealed."""
        return self.key.with_name(f"{self.key.name}.parts")


def seal(count: int, seed: int, places: Places, jobs: int = -1, tell: Callable[[int, str], None] | None = None) -> None:
    """Writes a pack of `count` cases and its key. Cases that an interrupted run with the same numbers and the same
    program has sealed are kept. `tell` gets the number of cases done and the name of the last.
    """
    places.parts.mkdir(parents=True, exist_ok=True)
    for folder in (places.pack, places.again):
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(nominal.FILE, folder / "nominal.json")
    width, made_by = max(2, len(str(count))), f"{count} {seed} {_program()}"
    cases = [(f"case-{k + 1:0{width}d}", *what) for k, what in enumerate(order(count, seed))]
    secret: dict[str, Any] = {}
    with parallel_config(backend="loky", initializer=_end_with, initargs=(os.getpid(),), idle_worker_timeout=20):
        stream = Parallel(n_jobs=jobs, return_as="generator_unordered")(
            delayed(_make)(places, made_by, case, (kind, severity, entry), [seed, 1, k])
            for k, (case, kind, severity, entry) in enumerate(cases)
        )
        for case, one in stream:
            secret[case] = one
            if tell is not None:
                tell(len(secret), case)
    secret = {case: secret[case] for case in sorted(secret)}
    commitments = {case: commitment(one["nonce"], one["body"]) for case, one in secret.items()}
    (places.pack / "commitments.json").write_text(json.dumps(commitments, indent=1) + "\n", encoding="utf-8")
    places.key.write_text(json.dumps(secret, indent=1) + "\n", encoding="utf-8")
    shutil.rmtree(places.parts)


def commitment(nonce: str, body: str) -> str:
    """What is published of a label before it is opened: SHA-256 of nonce + body."""
    return hashlib.sha256((nonce + body).encode()).hexdigest()


def _end_with(parent: int) -> None:
    """Ends this worker when the process that began it is gone."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _program() -> str:
    """SHA-256 over this program's sources."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def _make(
    places: Places, made_by: str, case: str, what: tuple[str, str, int], seed: list[int]
) -> tuple[str, dict[str, str]]:
    part = places.parts / f"{case}.json"
    if part.is_file():
        before = json.loads(part.read_text(encoding="utf-8"))
        if before["made_by"] == made_by and (places.pack / case).is_dir():
            return case, before["sealed"]
    found = plan(case, *what, seed)
    write_case(places.pack / case, found)
    if places.again is not None and (found.kind, found.severity) == AGAIN and found.seed % 2 == 0:
        write_case(places.again / case, replace(found, seed=found.seed + OTHER))
    sealed = {"nonce": secrets.token_hex(16), "body": json.dumps(found.body())}
    text = json.dumps({"made_by": made_by, "sealed": sealed})
    half = part.with_suffix(".half")
    half.write_text(text, encoding="utf-8")
    half.replace(part)  # only what is whole counts after an interruption
    return case, sealed


def write_case(place: Path, found: Plan) -> None:
    """The two records of a case, and the catalogue entries that are disabled for it."""
    shutil.rmtree(place, ignore_errors=True)
    place.mkdir()
    for i, (name, schedule) in enumerate(EXPERIMENTS.items()):
        (place / f"{name}.csv.gz").write_bytes(record(found, schedule(), i))
    if found.kind == "disabled":
        names = [part.name for part in found.parts]
        (place / "disabled.json").write_text(json.dumps(names) + "\n", encoding="utf-8")


def record(found: Plan, schedule: Schedule, which: int) -> bytes:
    """One record as a compressed table; the same plan gives the same bytes."""
    table = nominal.shifted(nominal.load(), found.shift)
    changed = [part.change for part in found.parts]
    fields = {name: number for change in changed for name, number in change.fields.items()}
    signals = {name: signal for change in changed for name, signal in change.signals.items()}
    log = simulate(table, schedule, found.seed + which, fields, signals)
    time = np.arange(log.command.size) * table.sample_time
    columns = [time, schedule.target, schedule.reference, schedule.feedforward, log.command, log.reading]
    text = io.StringIO()
    text.write(COLUMNS + "\n")
    np.savetxt(text, np.stack(columns, axis=1), fmt=["%.4f", "%.9g", "%.12g", "%.10g", "%.10g", "%.9g"], delimiter=",")
    return gzip.compress(text.getvalue().encode(), compresslevel=6, mtime=0)
