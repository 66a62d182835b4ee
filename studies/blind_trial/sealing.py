"""Runs the sealer, a separate program, which draws a trial's cases, writes their records and commits to their labels.

No file holds a label before the answers are committed: whatever an answering process may open, the key is not there.
Until then the labels stand in the memory of the process that runs the trial; one that goes on after an interruption has
the sealer draw them again from the seed, and compares them with their commitments. The second measurements, which are
made of some kinds of cases only, are made then as well.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from studies.blind_trial.guard import SEALER, SEALER_FOLDER
from studies.blind_trial.packs import Pack, bodies_of, read_key, read_pack
from studies.blind_trial.scoring import KeyFileError
from studies.folder import write_at_once
from studies.options import BadInputError

ROOT: Final = Path(__file__).parents[2]
SEALING: Final = 0.1  # The share of a trial's time for sealing.

Labels = Mapping[str, Any]
Tell = Callable[[float, str], None]


@dataclass(frozen=True)
class Sealed:
    """A trial's own cases below `folder`, and their labels with the nonces (None: to be drawn again); machines:
    the one "table", or "random" ones, of which there are no second measurements."""

    folder: Path
    cases: int
    seed: int
    labels: Labels | None = None
    machines: str = "table"

    @property
    def pack(self) -> Path:
        """Records and commitments."""
        return self.folder / "pack"

    @property
    def key(self) -> Path:
        """Where the labels lie once the answers are committed."""
        return self.folder / "key.json"

    @property
    def again(self) -> Path:
        """Second measurements, once the answers to the first are committed."""
        return self.folder / "again"


def seal(cases: int, seed: int, output: Path, progress: Tell, machines: str = "table") -> Sealed:
    """The pack of this size and seed below `output`. Raises BadInputError if it cannot be written."""
    place = Sealed(output / "sealed", cases, seed, machines=machines)
    mark, made_by = place.folder / "made_by.json", _made_by(place)
    if mark.is_file() and json.loads(mark.read_text(encoding="utf-8")) == made_by:
        progress(0.0, f"{cases} cases sealed before are kept")
        return place
    progress(0.0, f"sealing {cases} cases")
    mark.unlink(missing_ok=True)
    place.key.unlink(missing_ok=True)
    shutil.rmtree(place.again, ignore_errors=True)
    shutil.rmtree(place.folder / "key.json.parts", ignore_errors=True)  # in which earlier versions kept labels
    place.folder.mkdir(parents=True, exist_ok=True)

    def tell(done: int, text: str) -> None:
        progress(SEALING * done / cases, f"sealed {text}")

    labels = json.loads(_run(place, ["--output", str(place.pack.resolve()), "--key", "/dev/stdout"], tell))
    write_at_once(mark, json.dumps(made_by) + "\n")
    return replace(place, labels=labels)


def close(sealed: Sealed) -> Sealed:
    """The same cases while they are to be answered: what an earlier run revealed of them is taken away. Raises
    BadInputError if its key is not that of the pack.
    """
    labels = sealed.labels
    if sealed.key.is_file():
        labels = read_key(sealed.key)
        _verified(labels, sealed)
        sealed.key.unlink()
    shutil.rmtree(sealed.again, ignore_errors=True)
    return replace(sealed, labels=labels)


def measure_again(sealed: Sealed) -> Pack | None:
    """The second measurements, if there are any; only for when the answers to the first are committed."""
    if sealed.machines != "table":
        return None
    mark, made_by = sealed.again / "made_by.json", _made_by(sealed)
    if not (mark.is_file() and json.loads(mark.read_text(encoding="utf-8")) == made_by):
        shutil.rmtree(sealed.again, ignore_errors=True)
        _run(sealed, ["--again", str(sealed.again.resolve())])
        write_at_once(mark, json.dumps(made_by) + "\n")
    return read_pack(sealed.again) if any(sealed.again.glob("case-*")) else None


def reveal(sealed: Sealed) -> dict[str, str]:
    """Writes the key, unless it is there, and returns the labels' bodies, verified against the commitments that were
    published before any answer; only for when the answers are committed. Raises BadInputError.
    """
    if sealed.key.is_file():
        return _verified(read_key(sealed.key), sealed)
    labels = sealed.labels or json.loads(_run(sealed, ["--key", "/dev/stdout"]))
    bodies = _verified(labels, sealed)
    write_at_once(sealed.key, json.dumps(labels, indent=1) + "\n")
    return bodies


def _verified(labels: Labels, sealed: Sealed) -> dict[str, str]:
    try:
        return bodies_of(labels, read_pack(sealed.pack))
    except KeyFileError as error:
        raise BadInputError(
            f"--output {sealed.folder.parent}: {error}; delete {sealed.folder} to have the cases sealed again"
        ) from error


def _run(sealed: Sealed, files: list[str], tell: Callable[[int, str], None] | None = None) -> str:
    """What the sealer prints. Raises BadInputError if it fails."""
    numbers = ["--cases", str(sealed.cases), "--seed", str(sealed.seed), "--machines", sealed.machines]
    command = [sys.executable, "-m", SEALER, *numbers, *files]
    said = []
    with (
        subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process,
        ThreadPoolExecutor(1) as beside,
    ):
        assert process.stdout is not None
        printed = beside.submit(process.stdout.read)
        for line in process.stderr or ():
            said.append(line)
            done = line.split(" ", 1)[0]
            if done.isdecimal() and tell is not None:
                tell(int(done), line.strip())
    if process.returncode != 0:
        raise BadInputError(
            f"the sealer ended with status {process.returncode}: {' '.join(''.join(said[-3:]).split())}"
        )
    return printed.result()


def _made_by(sealed: Sealed) -> dict[str, Any]:
    """What a pack and its labels follow from: numbers, the sealer's sources, the libraries that it computes with."""
    files = sorted(SEALER_FOLDER.rglob("*.py"))
    program = hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
    libraries = {name: version(name) for name in ("numpy", "scipy", "numba")}
    chosen = {} if sealed.machines == "table" else {"machines": sealed.machines}
    return {"cases": sealed.cases, "seed": sealed.seed, **chosen, "sealer": program, **libraries}
