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
    """Tests that look at quick runs come first, those of one study's behind each other.

    Each of several processes begins with an unbroken part of all tests and takes from the end of another's when it has
    none left, so that one of them makes nearly all quick runs, each once, and the fixtures of most files are made once.
    """
    items.sort(key=lambda item: (not _shared(item), _study(item) if _shared(item) else ""))


def _shared(item: pytest.Item) -> bool:
    return "quick_run" in getattr(item, "fixturenames", ())


def _study(item: pytest.Item) -> str:
    """The study whose quick run a test looks at: its parameter, or the one that its file is named after."""
    file = item.path.parent if item.path.stem == "test_study" else item.path
    call = getattr(item, "callspec", None)
    return str(call.params["name"]) if call and "name" in call.params else file.stem.removeprefix("test_")
