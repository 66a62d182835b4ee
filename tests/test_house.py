"""The rules of the house: which way imports run, what a public docstring says, what the lock pins."""

from __future__ import annotations

import ast
import inspect
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
MAY_IMPORT = {
    "models": {"models"},
    "design": {"models", "design"},
    "diagnosis": {"models", "diagnosis"},
    "reports": {"reports"},
    "studies": {"models", "design", "diagnosis", "reports", "studies"},
}
# What carries a physical quantity in or out of a function; with one of these, a docstring gives units in brackets.
QUANTITIES = re.compile(r"\b(float|Array|ArrayLike|NDArray)\b")


def modules(package: str) -> Iterator[Path]:
    yield from sorted((ROOT / package).rglob("*.py"))


@pytest.mark.parametrize("package", sorted(MAY_IMPORT))
def test_imports_run_one_way(package: str) -> None:
    for path in modules(package):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            for name in names:
                part = name.partition(".")[0]
                assert part not in MAY_IMPORT or part in MAY_IMPORT[package], f"{path} imports {name}"


def test_the_rule_would_find_a_wrong_import() -> None:
    assert "design" not in MAY_IMPORT["models"]
    assert any("models" in path.read_text(encoding="utf-8") for path in modules("design"))


def public(package: str) -> Iterator[tuple[str, Any]]:
    for path in modules(package):
        if path.name == "__main__.py":
            continue
        name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        module: ModuleType = __import__(name, fromlist=["_"])
        yield name, module
        for item in vars(module).values():
            original = getattr(item, "py_func", getattr(item, "__wrapped__", item))
            if getattr(original, "__module__", None) != name or not hasattr(original, "__name__"):
                continue  # of another module, or a value
            if not original.__name__.startswith("_"):
                yield f"{name}.{original.__name__}", original


@pytest.mark.parametrize("package", ["models", "design", "diagnosis", "studies", "reports"])
def test_everything_public_has_a_docstring(package: str) -> None:
    missing = [name for name, item in public(package) if not inspect.getdoc(item) and not name.endswith("__init__")]
    assert missing == []


@pytest.mark.parametrize("package", ["models", "design", "diagnosis"])
def test_docstrings_of_functions_with_quantities_give_units(package: str) -> None:
    silent = [
        name
        for name, item in public(package)
        if inspect.isfunction(item)
        and QUANTITIES.search(str(inspect.signature(item)))
        and not re.search(r"\[[^\]]+\]|SI\b|coefficients", f"{inspect.getdoc(item)}")
    ]
    assert silent == []


def test_the_lock_pins_with_hashes_and_names_no_index() -> None:
    text = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    pinned = re.findall(r"^[\w.-]+==", text, re.MULTILINE)
    assert len(pinned) > 20
    assert text.count("--hash=sha256:") > len(pinned)
    assert "://" not in text
    wanted = re.findall(r"^[\w-]+", (ROOT / "requirements.in").read_text(encoding="utf-8"), re.MULTILINE)
    locked = {name.removesuffix("==").replace("-", "_") for name in pinned}
    assert {name.replace("-", "_") for name in wanted} <= locked


def test_a_diagnosis_does_not_wait_for_what_only_designs_and_reports_use() -> None:
    script = "import sys, diagnosis.evidence; print(*sorted({'control', 'matplotlib'} & set(sys.modules)))"
    found = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=True)
    assert found.stdout.split() == []
