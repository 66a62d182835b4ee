"""The comments of exported sources in the units of an axis that turns; their code knows no units."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from models.quantity import turned

_COMMENT: Final = {
    "c": re.compile(r"/\*.*?\*/", re.DOTALL),
    "h": re.compile(r"/\*.*?\*/", re.DOTALL),
    "m": re.compile(r"^\s*%.*$", re.MULTILINE),
}


def turned_comments(sources: Mapping[str, str]) -> dict[str, str]:
    """The sources by file name, units [-] in the comments of C and MATLAB as a rotary axis has them."""
    return {name: _turned(name, text) for name, text in sources.items()}


def _turned(name: str, text: str) -> str:
    """One source; those of other languages have no units in their comments."""
    comment = _COMMENT.get(name.rpartition(".")[2])
    return text if comment is None else comment.sub(lambda found: turned(found[0]), text)
