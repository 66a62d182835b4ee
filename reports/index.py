"""The page that links every report, with the state of all checks at a glance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

LAYOUT = Path(__file__).parent


@dataclass(frozen=True)
class Entry:
    """One report: its `folder` below the index, how many checks hold, and the names of those that do not.

    `failure`: why there is no report, one line; empty if there is one.
    """

    folder: str
    question: str
    holding: int = 0
    missed: tuple[str, ...] = ()
    failure: str = ""


def write_index(entries: Sequence[Entry], path: Path, note: str = "") -> None:
    """Writes the index of `entries` to `path`: one self-contained page that links both reports of each."""
    environment = Environment(loader=FileSystemLoader(LAYOUT), undefined=StrictUndefined, autoescape=True)
    style = (LAYOUT / "page.css").read_text(encoding="utf-8")
    page = environment.get_template("index.html").render(entries=entries, style=style, note=note)
    path.write_text(page, encoding="utf-8")
