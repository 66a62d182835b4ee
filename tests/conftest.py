"""Settings for all tests."""

import os

# Before numpy is imported: the matrices are small, and threads of BLAS would wait for each other on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import settings

# The same examples in every run, and no deadline: the first call of a kernel compiles it.
settings.register_profile("reproducible", deadline=None, derandomize=True)
settings.load_profile("reproducible")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """On several cores, tests that share a quick run stay in one process, and those of a file, for its fixtures."""
    for item in items:
        shared = "quick_run" in getattr(item, "fixturenames", ())
        item.add_marker(pytest.mark.xdist_group("quick runs" if shared else str(item.path)))
