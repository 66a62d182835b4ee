"""What the tests of the diagnosis share."""

from __future__ import annotations

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def null_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for the thresholds of machines and references, which are slow to simulate: one for all tests of a run in
    whichever process they run. What is kept there goes by a hash of all that it depends on.
    """
    base = tmp_path_factory.getbasetemp()
    return (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "null"
