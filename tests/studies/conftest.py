"""One quick run of each study, shared by all tests that look at what it wrote."""

from __future__ import annotations

import fcntl
import json
import os
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from studies.catalogue import every
from studies.command import main
from studies.pid_tradeoff.published import compare


@pytest.fixture(scope="session")
def quick_run(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Path, int]]:
    """The folder that `python -m studies.NAME --quick` wrote, and its exit status; not to be changed. Run once, by
    whichever of the processes that share these tests asks first."""
    folder = _shared(tmp_path_factory) / "quick_runs"
    folder.mkdir(exist_ok=True)

    def run(name: str) -> tuple[Path, int]:
        output, status = folder / name / "out", folder / f"{name}.status"
        with (folder / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # another process of these tests may be at it
            if not status.exists():
                status.write_text(str(main(every()[name], ["--quick", "--output", str(output)])), encoding="utf-8")
        return output, int(status.read_text(encoding="utf-8"))

    return run


Once = Callable[[str, Callable[[], Any]], Any]


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory) -> Once:
    """What JSON keeps of what a function returns, by a name; called by whichever of the processes that share these
    tests asks first."""
    folder = _shared(tmp_path_factory) / "once"
    folder.mkdir(exist_ok=True)

    def kept(name: str, make: Callable[[], Any]) -> Any:
        file = folder / f"{name}.json"
        with file.with_suffix(".lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            if not file.exists():
                file.write_text(json.dumps(make()), encoding="utf-8")
        return json.loads(file.read_text(encoding="utf-8"))

    return kept


@pytest.fixture(scope="session", autouse=True)
def _published_once(once: Once) -> Iterator[None]:
    """The published optima depend on no machine: found once for all runs of pid_tradeoff in these tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("studies.pid_tradeoff.compute.compare", cache(lambda: once("published", compare)))
        yield


def _shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of all processes of these tests."""
    base = tmp_path_factory.getbasetemp()
    return base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
