"""Settings for all tests."""

import os
from pathlib import Path

# Before numpy is imported: the matrices are small, and threads of BLAS would wait for each other on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Several processes of tests share the cores already.
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("LOKY_MAX_CPU_COUNT", "1")

import pytest
from hypothesis import settings

# The same examples in every run, and no deadline: the first call of a kernel compiles it.
settings.register_profile("reproducible", deadline=None, derandomize=True)
settings.load_profile("reproducible")


HERE = Path(__file__).parent
# What runs whole studies, diagnoses or many programs and is left out by `make test-fast`, except for what follows.
SLOW = (
    "benchmark",
    "design/pid",
    "design/trajectory",
    "diagnosis",
    "models/identification/force/test_by_elements.py",
    "models/identification/force/test_slow_records.py",
    "models/identification/modal/test_order.py",
    "models/identification/test_hysteresis.py",
    "models/identification/test_motion.py",
    "models/identification/test_pipeline.py",
    "models/identification/test_response.py",
    "models/identification/test_springs.py",
    "models/test_emps.py",
    "studies",
    "test_positioning.py",
)
QUICK = (
    "diagnosis/model",
    "diagnosis/records",
    "diagnosis/test_criteria.py",
    "diagnosis/test_verdict.py",
    "diagnosis/where/test_added.py",
    "diagnosis/where/test_sentences.py",
    "diagnosis/which/test_table.py",
    "studies/blind_trial/test_scoring.py",
    "studies/test_options.py",
)


def slow(path: Path) -> bool:
    """Whether a file of tests is left out by `make test-fast`."""

    def below(folders: tuple[str, ...]) -> bool:
        return any(path.is_relative_to(HERE / folder) for folder in folders)

    return below(SLOW) and not below(QUICK)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests that look at quick runs come first, those of one study's behind each other.

    Each of several processes begins with an unbroken part of all tests and takes from the end of another's when it has
    none left, so that one of them makes nearly all quick runs, each once, and the fixtures of most files are made once.
    """
    for item in items:
        if slow(item.path):
            item.add_marker("slow")
    items.sort(key=lambda item: (not _shared(item), _study(item) if _shared(item) else ""))


def _shared(item: pytest.Item) -> bool:
    return "quick_run" in getattr(item, "fixturenames", ())


def _study(item: pytest.Item) -> str:
    """The study whose quick run a test looks at: its parameter, or the one that its file or folder is named after."""
    file = item.path if item.path.parent.name == "studies" else item.path.parent
    call = getattr(item, "callspec", None)
    return str(call.params["name"]) if call and "name" in call.params else file.stem.removeprefix("test_")
