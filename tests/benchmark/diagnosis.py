"""`python -m tests.benchmark.diagnosis`: how long `gap_diagnosis` takes by command on sealed tables, start to end."""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from models.effects.catalogue import every
from studies.blind_trial.packs import Case, read_pack
from studies.blind_trial.scoring import label_of
from studies.blind_trial.sealing import reveal, seal

ROOT = Path(__file__).parents[2]
TARGET = 30.0  # s, with the null's thresholds still to be found


@dataclass(frozen=True)
class Time:
    """A sealed table: its kind, what the diagnosis said, the wall times [s] with no thresholds kept, and with them."""

    case: str
    kind: str
    said: str
    first: float
    kept: float

    def __str__(self) -> str:
        verdict = "reached" if self.first <= TARGET else "MISSED"
        return (
            f"{self.case}  {self.kind:<11}{self.said:<20}{self.first:6.1f} s{self.kept:8.1f} s   "
            f"target {TARGET:g} s: {verdict}"
        )


def times(cases: int, seed: int, folder: Path, say: Callable[[str], None]) -> Iterator[Time]:
    """Each table of a freshly sealed pack below `folder`, diagnosed twice."""
    sealed = seal(cases, seed, folder, lambda _share, text: say(text))
    pack = read_pack(sealed.pack)
    labels = {name: label_of(name, body, tuple(every())) for name, body in reveal(sealed).items()}
    for case in pack.cases:
        say(f"diagnosing {case.name}")
        place = folder / case.name
        place.mkdir()
        first, kept = diagnosed(case, place), diagnosed(case, place)
        verdict = json.loads((place / "out" / "results.json").read_text(encoding="utf-8"))["results"]["verdict"]
        yield Time(case.name, labels[case.name].kind, str(verdict["outcome"]), first, kept)


def diagnosed(case: Case, place: Path) -> float:
    """Wall time [s] of the command, without pages, in a folder that keeps the thresholds. Raises RuntimeError."""
    command = [sys.executable, "-m", "studies.gap_diagnosis", *map(str, case.records), "--no-report"]
    command += ["--machine", str(case.nominal), "--output", str(place / "out")]
    for name in case.disabled:
        command += ["--disable", name]
    around = {**os.environ, "PYTHONPATH": str(ROOT)}
    begin = time.perf_counter()
    run = subprocess.run(command, cwd=place, env=around, capture_output=True, text=True, check=False)
    if run.returncode != 0:
        raise RuntimeError(f"{case.name}: {' '.join(command[1:])} ended with {run.returncode}: {run.stderr[-500:]}")
    return time.perf_counter() - begin


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints a row a table; 0 whatever the times."""
    parser = argparse.ArgumentParser(prog="tests.benchmark.diagnosis", description=__doc__)
    parser.add_argument("--cases", type=int, default=12, metavar="N", help="tables to seal (default: 12)")
    parser.add_argument("--seed", type=int, default=1, metavar="S", help="of the tables (default: 1)")
    options = parser.parse_args(arguments)
    print("table     kind       answer              nothing kept   kept   (wall time, imports included)")
    with tempfile.TemporaryDirectory() as folder:
        for row in times(options.cases, options.seed, Path(folder), lambda text: print(text, file=sys.stderr)):
            print(row, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
