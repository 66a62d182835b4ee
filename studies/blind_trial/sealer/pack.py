"""Writes sealed cases: records for everyone, commitments beside them, the key somewhere else, perhaps later."""

from __future__ import annotations

import gzip
import hashlib
import hmac
import io
import json
import os
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import numpy as np
from joblib import Parallel, delayed, parallel_config

from studies.blind_trial.sealer import nominal
from studies.blind_trial.sealer.draw import Plan, order, plan, seed_of
from studies.blind_trial.sealer.machines import cases as drawn
from studies.blind_trial.sealer.machines import writing
from studies.blind_trial.sealer.schedule import Schedule, sequential, suite
from studies.blind_trial.sealer.simulate import simulate

COLUMNS: Final = "time_s,target_m,reference_m,feedforward_N,command_N,position_m"
EXPERIMENTS: Final = {"sequential": sequential, "suite": suite}
AGAIN: Final = ("single", "high")  # kind and severity of the cases of which every second is measured again
OTHER: Final = 1000  # from a case's seed to that of its second measurement


@dataclass(frozen=True)
class Places:
    """Where to write a pack, its key, and the second measurements of some cases (None: not wanted)."""

    pack: Path | None = None
    key: Path | None = None
    again: Path | None = None

    @property
    def parts(self) -> Path | None:
        """Where a mark lies for every case whose records are written, until the last one is."""
        return None if self.pack is None else self.pack.with_name(f"{self.pack.name}.parts")


def seal(
    count: int,
    seed: int,
    places: Places,
    jobs: int = -1,
    tell: Callable[[int, str], None] | None = None,
    machines: str = "table",
) -> None:
    """Writes what is wanted of a pack of `count` cases. Records that an interrupted run with the same numbers and the
    same program has written are kept. `tell` gets the number of cases done and the name of the last. machines: all
    cases on the one "table", or on "random" machines, which have no second measurements.
    """
    for folder in (places.pack, places.again):
        if folder is not None:
            folder.mkdir(parents=True, exist_ok=True)
            if machines == "table":
                shutil.copyfile(nominal.FILE, folder / "nominal.json")
    if places.parts is not None:
        places.parts.mkdir(exist_ok=True)
    root = _root(seed)
    made_by = f"{count} {seed} {_program()}"
    tasks = _tasks(count, seed, places, made_by) if machines == "table" else _drawn(count, seed, places)
    bodies: dict[str, str | None] = {}
    with parallel_config(backend="loky", initializer=_end_with, initargs=(os.getpid(),), idle_worker_timeout=20):
        stream = Parallel(n_jobs=jobs, return_as="generator_unordered")(tasks)
        for case, one in stream:
            bodies[case] = one
            if tell is not None:
                tell(len(bodies), case)
    secret = {case: {"nonce": nonce_of(root, case), "body": bodies[case]} for case in sorted(bodies) if bodies[case]}
    commitments = {case: commitment(str(one["nonce"]), str(one["body"])) for case, one in secret.items()}
    if places.pack is not None:
        (places.pack / "commitments.json").write_text(json.dumps(commitments, indent=1) + "\n", encoding="utf-8")
    if places.key is not None:
        places.key.write_text(json.dumps(secret, indent=1) + "\n", encoding="utf-8")
    if places.parts is not None:
        shutil.rmtree(places.parts)


def _tasks(count: int, seed: int, places: Places, made_by: str) -> Iterator[Any]:
    """What makes each case on the one table."""
    width = max(2, len(str(count)))
    for k, what in enumerate(order(count, seed)):
        yield delayed(_make)(places, made_by, f"case-{k + 1:0{width}d}", what, [seed, 1, k])


def _drawn(count: int, seed: int, places: Places) -> Iterator[Any]:
    """What makes each case on a drawn machine, whose name does not depend on their number either."""
    for k in range(count):
        yield delayed(_make_drawn)(places, f"random {seed} {_program()}", f"case-{k + 1:04d}", seed, k)


def _make_drawn(places: Places, made_by: str, case: str, seed: int, k: int) -> tuple[str, str | None]:
    """Writes a case on a drawn machine; its name and its body."""
    if places.pack is None and places.key is None:
        return case, None
    found = drawn.plan(seed, k, case)
    if places.pack is not None and not _kept(places, made_by, case):
        writing.write(places.pack / case, found)
        _mark(places, made_by, case)
    return case, json.dumps(found.body())


def commitment(nonce: str, body: str) -> str:
    """What is published of a label before it is opened: SHA-256 of nonce + body."""
    return hashlib.sha256((nonce + body).encode()).hexdigest()


def nonce_of(root: bytes, case: str) -> str:
    """The nonce of a case. It follows from the seed, so that it need not be kept anywhere until the key is opened."""
    return hmac.new(root, case.encode(), "sha256").hexdigest()


def _root(seed: int) -> bytes:
    """What all nonces of a seed follow from; slow by intent, or else trying seeds would be quicker here than by drawing
    the records, which follow from the seed as well."""
    return hashlib.scrypt(str(seed).encode(), salt=b"nonces of a blind trial", n=2**14, r=8, p=1)


def _end_with(parent: int) -> None:
    """Ends this worker when the process that began it is gone."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _program() -> str:
    """SHA-256 over this program's sources, and the versions of the libraries on which the last digit depends."""
    files = sorted(Path(__file__).parent.rglob("*.py"))
    sources = hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
    return " ".join([sources, *(version(name) for name in ("numpy", "scipy", "numba"))])


def _make(
    places: Places, made_by: str, case: str, what: tuple[str, str, int], seed: list[int]
) -> tuple[str, str | None]:
    """Writes what is wanted of a case; its name, and its body unless only second measurements are wanted."""
    kind, severity, _ = what
    again = places.again is not None and (kind, severity) == AGAIN and seed_of(seed) % 2 == 0
    wanted = places.pack is not None or places.key is not None
    if not (again or wanted):
        return case, None
    found = plan(case, *what, seed)
    if places.pack is not None and not _kept(places, made_by, case):
        write_case(places.pack / case, found)
        _mark(places, made_by, case)
    if places.again is not None and again:
        write_case(places.again / case, replace(found, seed=found.seed + OTHER))
    return case, json.dumps(found.body()) if wanted else None


def _kept(places: Places, made_by: str, case: str) -> bool:
    """Whether an interrupted run of the same program has written this case."""
    if places.pack is None or places.parts is None:
        return False
    mark = places.parts / case
    return mark.is_file() and mark.read_text(encoding="utf-8") == made_by and (places.pack / case).is_dir()


def _mark(places: Places, made_by: str, case: str) -> None:
    """Says that a case is written: only what is whole counts after an interruption."""
    if places.parts is not None:
        half = (places.parts / case).with_suffix(".half")
        half.write_text(made_by, encoding="utf-8")
        half.replace(places.parts / case)


def write_case(place: Path, found: Plan) -> None:
    """Writes the two records of a case, and the catalogue entries that are disabled for it."""
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
