"""The quick run that the tests of this study look at."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from studies.command import DONE


@pytest.fixture(scope="module")
def quick(quick_run: Callable[[str], tuple[Path, int]]) -> Path:
    folder, status = quick_run("gap_diagnosis")
    assert status == DONE
    return folder


@pytest.fixture(scope="module")
def results(quick: Path) -> dict[str, Any]:
    return dict(json.loads((quick / "results.json").read_text(encoding="utf-8"))["results"])
