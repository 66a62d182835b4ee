"""Starts what a stranger's folder asks for: in a process of its own, bounded in time, memory and size of files."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Final

from studies.interrupt import ended_if_interrupted
from studies.manifest import ROOT
from studies.review.copying import visible

LONGEST_LINE: Final = 4096  # characters of what the process says
NOT_PASSED: Final = ("DASK_", "PYTHON", "NUMBA_", "JOBLIB_", "LOKY_")


@dataclass(frozen=True)
class Limits:
    """What a process may take: time [s] by the clock, memory of data [bytes], size of a file that it writes [bytes]."""

    seconds: float = 1800.0
    memory: int = 4 << 30
    file: int = 256 << 20


@dataclass(frozen=True)
class Ended:
    """How a process ended: its exit status, None where it was stopped at the limit of time, and its last words."""

    status: int | None
    said: str


def run(task: Mapping[str, Any], place: Path, limits: Limits, tell: Callable[[str], None]) -> Ended:
    """Does a task of studies/review/again.py with `place` as its working and temporary folder.

    The process and those that it started are gone when this returns or raises. tell: gets its lines on progress.
    """
    environment = {name: value for name, value in os.environ.items() if not name.startswith(NOT_PASSED)}
    environment |= {"PYTHONPATH": str(ROOT), "TMPDIR": str(place), "PYTHONDONTWRITEBYTECODE": "1"}
    bounds = {"seconds": limits.seconds, "memory": limits.memory, "file": limits.file}
    alive = os.pipe()  # the other end is closed with this process, however that ends
    with tempfile.TemporaryFile() as given:
        given.write(json.dumps({**task, "bounds": bounds, "alive": alive[0]}).encode())
        given.seek(0)
        process = subprocess.Popen(
            [sys.executable, "-m", "studies.review.again"],
            stdin=given,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            cwd=place,
            env=environment,
            start_new_session=True,
            pass_fds=(alive[0],),
        )
        assert process.stderr is not None
        last: list[str] = [""]
        reader = threading.Thread(target=_relay, args=(process.stderr, last, tell), daemon=True)
        reader.start()
        try:
            with ended_if_interrupted(process.pid):
                status: int | None = process.wait(limits.seconds)
        except subprocess.TimeoutExpired:
            status = None
        finally:
            _end(process)
            reader.join(5.0)
            process.stderr.close()
            for end in alive:
                os.close(end)
    return Ended(status, last[0])


def _end(process: subprocess.Popen[str]) -> None:
    """Ends the process and its children, which are in a group of their own."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _relay(stream: IO[str], last: list[str], tell: Callable[[str], None]) -> None:
    while line := stream.readline(LONGEST_LINE):
        line = visible(line.strip(), 300)
        if line.startswith("["):
            tell(line)
        elif line:
            last[0] = line
