"""One quick run of each study, shared by all tests that look at what it wrote."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import pytest

from studies.catalogue import every
from studies.command import main
from studies.pid_tradeoff.published import compare


@pytest.fixture(scope="session")
def quick_run(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Path, int]]:
    """The folder that `python -m studies.NAME --quick` wrote, and its exit status; run once, not to be changed."""
    done: dict[str, tuple[Path, int]] = {}

    def run(name: str) -> tuple[Path, int]:
        if name not in done:
            output = tmp_path_factory.mktemp(name) / "out"
            done[name] = output, main(every()[name], ["--quick", "--output", str(output)])
        return done[name]

    return run


@pytest.fixture(scope="session", autouse=True)
def _published_once() -> Iterator[None]:
    """The published optima depend on no machine: found once for all runs of pid_tradeoff in these tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("studies.pid_tradeoff.compute.compare", cache(compare))
        yield
