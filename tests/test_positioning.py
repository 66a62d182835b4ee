"""The public API: every name resolves, type checkers see the same names, and importing it is quick."""

from __future__ import annotations

import ast
import inspect
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import positioning as pos

ROOT = Path(__file__).parents[1]


def test_every_name_is_what_its_module_calls_so() -> None:
    for name in pos.__all__:
        item: Any = getattr(pos, name)
        assert getattr(item, "__module__", "").partition(".")[0] in {
            "models",
            "design",
            "diagnosis",
            "studies",
            "reports",
        }
    assert set(pos.__all__) <= set(dir(pos))
    assert set(pos.__all__) == set(pos._WHERE)
    with pytest.raises(AttributeError, match="no attribute 'Machin'"):
        _ = pos.Machin  # type: ignore[attr-defined]


def test_a_type_checker_sees_the_same_names_from_the_same_places() -> None:
    tree = ast.parse(Path(inspect.getfile(pos)).read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    seen = {
        alias.asname or alias.name: (node.module, alias.name)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert seen == {
        name: (place.partition(":")[0], place.partition(":")[2] or name) for name, place in pos._WHERE.items()
    }


def test_it_is_imported_from_any_folder_without_what_it_leads_to(tmp_path: Path) -> None:
    said = "import sys, positioning as pos; print(*(name.partition('.')[0] for name in sys.modules)); pos.Machine"
    around = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", said], cwd=tmp_path, env=around, capture_output=True, text=True, check=True
    )
    assert not {"numpy", "casadi", "models", "design", "diagnosis", "studies"} & set(done.stdout.split())
