"""Steps whose results are kept with the hash of all that they were made from, so that an unchanged one is reused."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from studies.command import plain
from studies.folder import write_at_once
from studies.manifest import ROOT, SUFFIXES, lock_hash, tree_hash

MADE_BY: Final = ("models", "design", "diagnosis")
SHOWN_BY: Final = ("report.py", "figures.py")  # of a study, whose other modules a step's answer may be from


@dataclass(frozen=True)
class Steps:
    """The folder of the kept steps; program: what identifies the sources that make them."""

    folder: Path
    program: str

    def done(self, name: str, used: Mapping[str, Any], work: Callable[[], Any]) -> tuple[Any, bool]:
        """What `work` returns as JSON holds it, and whether it was kept from an earlier run, made from the same."""
        found = self.kept(name, used)
        return (self.keep(name, used, work()), False) if found is None else (found, True)

    def kept(self, name: str, used: Mapping[str, Any]) -> Any:
        """What an earlier run kept of a step that was made from the same; None where it kept nothing."""
        content = _read(self.folder / f"{name}.json")
        return content.get("found") if content.get("of") == self.mark(used) else None

    def keep(self, name: str, used: Mapping[str, Any], found: Any) -> Any:
        """Keeps what a step found, and gives it back as JSON holds it."""
        text = json.dumps({"of": self.mark(used), "used": plain(used), "found": plain(found)}, indent=1, sort_keys=True)
        write_at_once(self.folder / f"{name}.json", text + "\n")
        return json.loads(text)["found"]

    def mark(self, used: Mapping[str, Any]) -> str:
        """SHA-256 over what a step is made from and the program."""
        made = json.dumps(plain({"program": self.program, **used}), sort_keys=True)
        return hashlib.sha256(made.encode()).hexdigest()


def program() -> str:
    """SHA-256 over all that a step's results follow from, the pinned versions too; a change of a report changes no
    step."""
    return f"{tree_hash(sources())} {lock_hash()}"


def sources() -> list[Path]:
    """The files of the program that a step's results follow from."""
    files = [one for part in MADE_BY for one in (ROOT / part).rglob("*") if one.suffix in SUFFIXES]
    return sorted([*files, *(one for one in (ROOT / "studies").rglob("*.py") if one.name not in SHOWN_BY)])


def _read(file: Path) -> Mapping[str, Any]:
    """What a file holds; nothing where it is missing or damaged, so that the step is made again."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}
