"""Runs the sealer, a separate program, to make a pack, unless the folder already holds that very pack."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from studies.blind_trial.guard import SEALER, SEALER_FOLDER
from studies.folder import write_at_once
from studies.options import BadInputError

ROOT: Final = Path(__file__).parents[2]
SEALING: Final = 0.1  # The share of a trial's time for sealing.


@dataclass(frozen=True)
class Sealed:
    """Where a pack lies, its key, and the second measurements of some of its cases."""

    pack: Path
    key: Path
    again: Path

    @property
    def forbidden(self) -> tuple[Path, ...]:
        """What no answering process may open."""
        return (self.key, self.key.with_name(f"{self.key.name}.parts"))


def places(output: Path) -> Sealed:
    """Where a trial below `output` keeps its pack; the key is not in the pack."""
    return Sealed(output / "sealed" / "pack", output / "sealed" / "key.json", output / "sealed" / "again")


def seal(cases: int, seed: int, output: Path, progress: Callable[[float, str], None]) -> Sealed:
    """The pack of this size and seed below `output`, with its key. Raises BadInputError if it cannot be written."""
    place, mark = places(output), output / "sealed" / "made_by.json"
    made_by = {"cases": cases, "seed": seed, "sealer": _program()}
    if mark.is_file() and json.loads(mark.read_text(encoding="utf-8")) == made_by and place.key.is_file():
        progress(0.0, f"{cases} cases sealed before are kept")
        return place
    progress(0.0, f"sealing {cases} cases")
    numbers = ["--cases", str(cases), "--seed", str(seed)]
    files = ["--output", str(place.pack.resolve()), "--key", str(place.key.resolve())]
    files += ["--again", str(place.again.resolve())]
    mark.parent.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", SEALER, *numbers, *files]
    said = []
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True) as process:
        for line in process.stderr or ():
            said.append(line)
            done = line.split(" ", 1)[0]
            if done.isdecimal():
                progress(SEALING * int(done) / cases, f"sealed {line.strip()}")
    if process.returncode != 0:
        raise BadInputError(
            f"the sealer ended with status {process.returncode}: {' '.join(''.join(said[-3:]).split())}"
        )
    write_at_once(mark, json.dumps(made_by) + "\n")
    return place


def _program() -> str:
    """SHA-256 over the sealer's sources."""
    files = sorted(SEALER_FOLDER.glob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
