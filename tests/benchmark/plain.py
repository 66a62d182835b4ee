"""The kernel as plain Python: a process of its own, as numba can be switched off only before it compiles anything.

Answers every line "time" or "error" on stdin with a line of JSON: the seconds that the loop took, or the positions [m].
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.simulation.kernel import run_one
from models.simulation.simulator import simulate
from tests.benchmark.job import default_job, prepared

Array = NDArray[np.float64]
ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Plain:
    """The process at work."""

    process: subprocess.Popen[str]

    def seconds(self) -> float:
        """How long [s] the piece of the job took once more."""
        return float(self._ask("time")[0])

    def position(self) -> Array:
        """x (n,) [m] of the job's reversal."""
        return np.array(self._ask("error"))

    def _ask(self, question: str) -> list[float]:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        print(question, file=self.process.stdin, flush=True)
        answer: list[float] = json.loads(self.process.stdout.readline())
        return answer


@contextmanager
def plain(duration: float, substeps: int = 10) -> Iterator[Plain]:
    """The process for the job's first `duration` [s]; ends with the block."""
    with subprocess.Popen(
        [sys.executable, "-m", "tests.benchmark.plain", str(duration), str(substeps)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
    ) as process:
        try:
            yield Plain(process)
        finally:
            assert process.stdin is not None
            process.stdin.close()


def _serve(duration: float, substeps: int) -> None:
    job = default_job()
    for question in sys.stdin:
        if question.strip() == "time":
            loop, run = prepared(job.first(duration), substeps)
            begin = time.process_time()
            run_one(loop, run)
            answer = [time.process_time() - begin]
        else:
            exact = job.reversal()
            answer = simulate(exact.machine, exact.controller, exact.target, substeps=substeps).position.tolist()
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    _serve(float(sys.argv[1]), int(sys.argv[2]))
