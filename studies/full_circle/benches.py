"""Withheld machines as processes, and the process that works on one, which asks for its runs here."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np

from diagnosis.experiments.schedules import Schedule
from models.controller import References
from models.nominal_file import load
from studies.blind_trial.guard import SEALER_FOLDER
from studies.machine_process import MachineProcess, Ran, Refused, started
from studies.manifest import ROOT

SEALED: Final = (sys.executable, "-m", "studies.blind_trial.sealer.on_request")
OPENED: Final = (sys.executable, "-m", "studies.blind_trial.sealer.opened")
WORKER: Final = (sys.executable, "-m", "studies.full_circle.worker")
THREADS: Final = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "LOKY_MAX_CPU_COUNT")
MAX_BENCHES: Final = 8  # benches of a machine


class Benches:
    """One withheld machine, "SEED CASE", on as many benches as are asked for, each a process with its own limits."""

    def __init__(self, machine: str, folder: Path, stack: ExitStack) -> None:
        self._machine, self._folder, self._stack = machine, folder, stack
        self._known: dict[str, MachineProcess] = {}
        self.refused = 0  # requests beyond the limits, on all benches together

    def of(self, name: str) -> MachineProcess:
        """The bench of this name. Raises ValueError for more than MAX_BENCHES of them, or a name that is not a plain
        word."""
        if name not in self._known:
            if len(self._known) >= MAX_BENCHES or not name.replace("-", "").isalnum():
                raise ValueError(f"there is no bench {name[:40]!r}")
            place = self._folder / name
            place.mkdir()
            self._known[name] = self._stack.enter_context(started(list(SEALED), place, first=self._machine))
        return self._known[name]

    def run(self, asked: Mapping[str, Any], sample_time: float) -> dict[str, Any]:
        """The answer to a request of the working process, as the machine's protocol has it; sample_time [s]."""
        bench = self.of(str(asked["bench"]))
        references = _references(Path(asked["table"]))
        controller = None if asked["controller"] is None else Path(asked["controller"])
        found = bench.run(references, sample_time, controller)
        if isinstance(found, Ran):
            return {"record": str(found.file)}
        self.refused += isinstance(found, Refused)
        return {"refused" if isinstance(found, Refused) else "tripped": found.why}


def _references(file: Path) -> Schedule:
    rows = np.loadtxt(file, delimiter=",", skiprows=1, ndmin=2)
    return Schedule(file.stem, rows[:, 1], References(rows[:, 2], rows[:, 3], np.zeros(len(rows))))


@contextmanager
def benches(machine: str, folder: Path) -> Iterator[Benches]:
    """The benches of a machine, all of which end with the block."""
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        yield Benches(machine, folder, stack)


def answered(machine: str, folder: Path, task: Mapping[str, Any]) -> dict[str, Any]:
    """What the working process answers for a machine; task: {"terms", "disabled", "seed", "cache"}. Of what lies beside
    its folder, where other answers and the truths of an earlier run are, it may open the cache alone."""
    with benches(machine, folder) as found:
        main = found.of("main")
        assert main.nominal is not None  # a sealed machine says what is known of it
        limits = {
            "distance": main.limits.distance,
            "speed": main.limits.speed,
            "feedforward": main.limits.feedforward,
            "machine_time": main.limits.machine_time,
        }
        whole = {
            **task,
            "nominal": str(main.nominal),
            "limits": limits,
            "disabled": [*task["disabled"], *_names(main.folder / "disabled.json")],
            "folder": str(folder),
            "forbidden": [str(SEALER_FOLDER), *_others(folder, Path(task["cache"]))],
        }
        return {**_worked(whole, found, load(main.nominal).sample_time), "beyond": found.refused}


def _others(folder: Path, cache: Path) -> list[str]:
    """What lies beside the folder of an answer, but the cache."""
    return [str(one) for one in sorted(folder.parent.iterdir()) if one not in (folder, cache)]


def _names(file: Path) -> list[str]:
    """The names in a file; none where there is none."""
    return list(json.loads(file.read_text(encoding="utf-8"))) if file.is_file() else []


def _worked(task: Mapping[str, Any], found: Benches, sample_time: float) -> dict[str, Any]:
    with (Path(task["folder"]) / "worker.txt").open("wb") as errors:
        process = subprocess.Popen(
            list(WORKER),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            cwd=ROOT,
            env={**os.environ, **dict.fromkeys(THREADS, "1")},
        )
        assert process.stdin is not None
        assert process.stdout is not None
        with process.stdin, process.stdout:
            _say(process, task)
            for line in process.stdout:
                told = json.loads(line)
                if "done" in told:
                    process.stdin.close()
                    process.wait()
                    return dict(told["done"])
                try:
                    answer = found.run(told["run"], sample_time)
                except ValueError as error:
                    answer = {"refused": str(error)}
                _say(process, answer)
        process.wait()
    said = (Path(task["folder"]) / "worker.txt").read_text(encoding="utf-8", errors="replace").split()
    return {"failed": f"its process ended: {' '.join(said)[-300:]}"}


def _say(process: subprocess.Popen[str], content: Mapping[str, Any]) -> None:
    assert process.stdin is not None
    process.stdin.write(json.dumps(content) + "\n")
    process.stdin.flush()


def truth(machine: str, file: Path) -> dict[str, Any]:
    """The truth of a machine, from its sealer; only for answers that are committed."""
    file.parent.mkdir(parents=True, exist_ok=True)
    subprocess.run([*OPENED, "--file", str(file)], input=machine + "\n", text=True, cwd=ROOT, check=True)
    content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return content
