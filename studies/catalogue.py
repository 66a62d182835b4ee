"""The studies that there are: every package of this folder whose __main__ holds a STUDY."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Final

from studies.command import Study

HERE: Final = Path(__file__).parent


def names() -> tuple[str, ...]:
    """The names of all commands `python -m studies.NAME`, sorted."""
    return tuple(sorted(path.parent.name for path in HERE.glob("*/__main__.py")))


def every() -> dict[str, Study]:
    """The studies by name; commands that are none, such as review, left out."""
    modules = {name: import_module(f"studies.{name}.__main__") for name in names()}
    return {name: module.STUDY for name, module in modules.items() if isinstance(getattr(module, "STUDY", None), Study)}


def find(name: str) -> Study | None:
    """The study of this name, or None."""
    return every().get(name)
