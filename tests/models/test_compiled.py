"""What is compiled is kept on disk until anything that it is made of changes, in whatever file that stands."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from models.compiled import _digest

ROOT = Path(__file__).parents[2]
PART = """
from models.compiled import inlined

@inlined
def part(x):
    return {factor} * x
"""
KERNEL = """
from far import FACTOR
from models.compiled import compiled
from near import part

@compiled
def kernel(x):
    return part(x) + FACTOR * x

print(kernel(1.0), sum(kernel.stats.cache_hits.values()))
"""


OF_A_CLASS = """
from typing import NamedTuple
from models.compiled import compiled

class {name}(NamedTuple):
    x: float

@compiled
def kernel(given):
    return given.x
"""
CALL = """
from taken import kernel, {name}

print(kernel({name}(3.0)), sum(kernel.stats.cache_hits.values()))
"""


def _said(folder: Path) -> tuple[float, int]:
    """What the kernel gives, and how often it was found on disk, in a process of its own."""
    around = {**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{ROOT}", "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "main.py"], cwd=folder, env=around, capture_output=True, text=True, check=True
    )
    result, hits = done.stdout.split()
    return float(result), int(hits)


@pytest.mark.parametrize(
    ("file", "changed", "expected"),
    [("near.py", PART.format(factor=30.0), 31.0), ("far.py", "FACTOR = 5.0\n", 7.0)],
    ids=["a part that is written out", "a number"],
)
def test_a_kernel_is_compiled_anew_where_another_file_changed(
    file: str, changed: str, expected: float, tmp_path: Path
) -> None:
    for name, text in (("near.py", PART.format(factor=2.0)), ("far.py", "FACTOR = 1.0\n"), ("main.py", KERNEL)):
        (tmp_path / name).write_text(text, encoding="utf-8")
    assert _said(tmp_path) == (3.0, 0)
    assert _said(tmp_path) == (3.0, 1)
    (tmp_path / file).write_text(changed, encoding="utf-8")
    assert _said(tmp_path) == (expected, 0)


def test_a_kernel_of_a_class_that_was_renamed_is_compiled_anew(tmp_path: Path) -> None:
    """What is on disk names the class that is no more: read, it would raise AttributeError."""
    for name in ("Before", "Afterwards"):
        for file, text in (("taken.py", OF_A_CLASS), ("main.py", CALL)):
            (tmp_path / file).write_text(text.format(name=name), encoding="utf-8")
        assert _said(tmp_path) == (3.0, 0)
        assert _said(tmp_path) == (3.0, 1)


@pytest.mark.parametrize(
    ("kind", "before", "after"),
    [
        ("a text", "FACTOR = 'a'\n", "FACTOR = 'ab'\n"),
        ("an array", "import numpy as np\nFACTOR = np.ones(1)\n", "import numpy as np\nFACTOR = np.ones(2)\n"),
    ],
)
def test_a_kernel_is_compiled_anew_where_what_it_holds_changed(
    kind: str, before: str, after: str, tmp_path: Path
) -> None:
    kernel = KERNEL.replace("part(x) + FACTOR * x", "part(x) + len(FACTOR)")
    for name, text in (("near.py", PART.format(factor=2.0)), ("far.py", before), ("main.py", kernel)):
        (tmp_path / name).write_text(text, encoding="utf-8")
    assert _said(tmp_path) == (3.0, 0), kind
    (tmp_path / "far.py").write_text(after, encoding="utf-8")
    assert _said(tmp_path) == (4.0, 0), kind


def test_a_kernel_of_a_notebook_compiles(tmp_path: Path) -> None:
    """A cell is in no file."""
    cell = tmp_path / "cell.py"
    source = "from models.compiled import compiled\n@compiled\ndef twice(x):\n    return 2.0 * x\n"
    cell.write_text(source, encoding="utf-8")
    names: dict[str, Any] = {"__name__": "cell"}
    exec(compile(source, str(cell), "exec"), names)
    assert names["twice"](2.0) == 4.0
    assert _digest(str(tmp_path / "gone.py")) == str(tmp_path / "gone.py")
