"""The studies that there are: every package of this folder whose __main__ holds a STUDY."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Final

from studies.study import Study

HERE: Final = Path(__file__).parent


def names() -> tuple[str, ...]:
    """The names of all commands `python -m studies.NAME`, sorted."""
    return tuple(sorted(path.parent.name for path in HERE.glob("*/__main__.py")))


def every() -> dict[str, Study]:
    """The studies by name; commands that are not studies, such as review, are left out."""
    modules = {name: import_module(f"studies.{name}.__main__") for name in names()}
    return {name: module.STUDY for name, module in modules.items() if isinstance(getattr(module, "STUDY", None), Study)}


class Studies:
    """The studies as attributes, each called like a function: `pos.studies.deadbeat_design(machine, quick=True)`.

    >>> pos.studies.deadbeat_design
    deadbeat_design: Which N_ff(z), D_ff(z) suit this machine, and do they meet the specification?
    >>> answer = pos.studies.deadbeat_design(machine, settling_time=20e-3, quick=True)
    >>> all(check.holds for check in answer.checks)
    True
    """

    def __getattr__(self, name: str) -> Study:
        study = None if name.startswith("_") else every().get(name)
        if study is None and name in names():
            raise AttributeError(f"{name} is a command and no study; run python -m studies.{name}")
        if study is None:
            raise AttributeError(f"there is no study {name!r}; there are {', '.join(every())}")
        return study

    def __dir__(self) -> list[str]:
        return list(every())

    def __repr__(self) -> str:
        return f"studies: {', '.join(every())}"


STUDIES: Final = Studies()


def find(name: str) -> Study | None:
    """The study of this name, or None."""
    return every().get(name)
