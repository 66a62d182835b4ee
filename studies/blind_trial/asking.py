"""Asks an answerer's process, which answers one case after another: to begin one takes longer than many an answer."""

from __future__ import annotations

import json
import os
import selectors
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, Final

from studies.blind_trial.answerer import failed

ROOT: Final = Path(__file__).parents[2]
PATIENCE: Final = 3600.0  # for one case, on cores that others use too [s]
CASES: Final = 25  # that one process answers
THREADS: Final = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "LOKY_MAX_CPU_COUNT")
"""Settings of how many threads a process may have (the last is joblib's): one, as the next core has its own case."""
KEPT: Final = {"MALLOC_MMAP_THRESHOLD_": f"{2**25}", "MALLOC_TRIM_THRESHOLD_": f"{2**32}"}
"""Memory [bytes] that GNU's allocator keeps: large arrays anew from the kernel cost a few per cent of the time."""


class Answerer:
    """One process that can't open `forbidden`; it ends with the one that began it, as its input does."""

    def __init__(self, forbidden: tuple[str, ...]) -> None:
        self.left = CASES
        self._errors = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")  # noqa: SIM115, closed in `end`
        threads = dict.fromkeys(THREADS, "1")
        self._process = subprocess.Popen(
            [sys.executable, "-m", "studies.blind_trial.answerer"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            cwd=ROOT,
            env={**os.environ, **threads, **KEPT},
        )
        self._say({"forbidden": forbidden})

    def answer(self, task: dict[str, Any]) -> dict[str, Any]:
        """The answer to a task (see answerer.py), or what stands for one where there is none."""
        self.left -= 1
        line = self._say(task) and self._line()
        try:
            found: dict[str, Any] = json.loads(line or "")
        except ValueError:
            self.left = 0
            self._process.kill()
            self._errors.seek(0)
            said = " ".join(self._errors.read().split())[-300:]
            return failed(f"no answer in {PATIENCE:g} s" if line is None else f"its process ended: {said}")
        return found

    def kill(self) -> None:
        """Ends the process, whatever it does."""
        self._process.kill()

    def end(self) -> None:
        """Lets the process go."""
        if self._process.stdin is not None and not self._process.stdin.closed:
            self._process.stdin.close()
        self._process.wait(timeout=60)
        self._errors.close()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def _say(self, task: dict[str, Any]) -> bool:
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(task) + "\n")
            self._process.stdin.flush()
        except BrokenPipeError:
            return False
        return True

    def _line(self) -> str | None:
        """The next line; empty where the process has ended, None where it takes too long."""
        stream = self._process.stdout
        assert stream is not None
        until = time.monotonic() + PATIENCE
        with selectors.DefaultSelector() as selector:
            selector.register(stream, selectors.EVENT_READ)
            if not selector.select(until - time.monotonic()):
                return None
        return stream.readline()


_ALIVE: dict[tuple[str, ...], Answerer] = {}  # of this process: a worker keeps its answerer from case to case


def ask(task: dict[str, Any], forbidden: tuple[str, ...]) -> dict[str, Any]:
    """The answer of a process that can't open `forbidden`; the process is kept for the next."""
    answerer = _ALIVE.get(forbidden) or Answerer(forbidden)
    _ALIVE[forbidden] = answerer
    found = answerer.answer(task)
    if answerer.left == 0 or found.get("refused"):
        del _ALIVE[forbidden]
        answerer.end()
    return found


def end_with(parent: int) -> None:
    """Lets this worker and its answerer end when the process `parent`, which began it, has ended: a worker by itself
    would finish what it was told, and then wait.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        for answerer in list(_ALIVE.values()):
            answerer.kill()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
