"""Settings for all tests."""

import os

# Before numpy is imported: the matrices are small, and threads of BLAS would wait for each other on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import settings

# The same examples in every run, and no deadline: the first call of a kernel compiles it.
settings.register_profile("reproducible", deadline=None, derandomize=True)
settings.load_profile("reproducible")


@pytest.hookimpl(tryfirst=True)  # before xdist reads the groups
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """On several cores, tests that share a quick run stay in one process, and those of a file, for its fixtures.

    With pytest 9.2 and xdist 3.8 the groups have no effect: xdist writes them into a name that pytest does not read.
    The quick runs come first: begun last, the longest would keep one core busy while the others have nothing to do.
    """
    for item in items:
        item.add_marker(pytest.mark.xdist_group(f"quick run of {_study(item)}" if _shared(item) else str(item.path)))
    items.sort(key=lambda item: not _shared(item))


def _shared(item: pytest.Item) -> bool:
    return "quick_run" in getattr(item, "fixturenames", ())


def _study(item: pytest.Item) -> str:
    """The study whose quick run a test looks at: its parameter, or the one that its file is named after."""
    file = item.path.parent if item.path.stem == "test_study" else item.path
    call = getattr(item, "callspec", None)
    return str(call.params["name"]) if call and "name" in call.params else file.stem.removeprefix("test_")
