"""Keeps an answering process and gives it case after case, as starting one may take longer than an answer."""

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
PATIENCE: Final = 3600.0  # The timeout of one case, on cores shared with other work [s].
CASES: Final = 25  # The number of cases after which an answering process is replaced.
THREADS: Final = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "LOKY_MAX_CPU_COUNT")
"""Environment variables that limit threads (the last is joblib's): one each, as every core has a case to itself."""
ALLOCATOR_SETTINGS: Final = {"MALLOC_MMAP_THRESHOLD_": f"{2**25}", "MALLOC_TRIM_THRESHOLD_": f"{2**32}"}
"""Memory [bytes] that glibc's allocator retains: fetching large arrays anew from the kernel costs a few per cent."""


class Answerer:
    """A process that cannot open `forbidden`; it ends with its input, so no later than the process that started it."""

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
            env={**os.environ, **threads, **ALLOCATOR_SETTINGS},
        )
        self._say({"forbidden": forbidden})

    def answer(self, task: dict[str, Any]) -> dict[str, Any]:
        """The answer to a task (see answerer.py), or the placeholder of a failed one."""
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
        """Ends the process at once."""
        self._process.kill()

    def end(self) -> None:
        """Ends the process after its current case."""
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
        """The next line; empty if the process has ended, None on a timeout."""
        stream = self._process.stdout
        assert stream is not None
        until = time.monotonic() + PATIENCE
        with selectors.DefaultSelector() as selector:
            selector.register(stream, selectors.EVENT_READ)
            if not selector.select(until - time.monotonic()):
                return None
        return stream.readline()


_ALIVE: dict[tuple[str, ...], Answerer] = {}  # Of this worker, which keeps its answering process from case to case.


def ask(task: dict[str, Any], forbidden: tuple[str, ...]) -> dict[str, Any]:
    """The answer of a process that cannot open `forbidden`; the process is kept for the next case."""
    answerer = _ALIVE.get(forbidden) or Answerer(forbidden)
    _ALIVE[forbidden] = answerer
    found = answerer.answer(task)
    if answerer.left == 0 or found.get("refused"):
        del _ALIVE[forbidden]
        answerer.end()
    return found


def end_with(parent: int) -> None:
    """Ends this worker and its answering process once the process `parent`, which started it, has ended: otherwise a
    worker would finish its tasks and then wait for more.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        for answerer in list(_ALIVE.values()):
            answerer.kill()
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
