"""Small text files that somebody else may have written, read without trusting their size."""

from __future__ import annotations

from pathlib import Path
from typing import Final

MAX_FILE_BYTES: Final = 4_000_000  # bytes: machine files have up to 20 kB, a controller with effects up to 200 kB


def text_of(path: Path) -> str:
    """The UTF-8 text of a file. Raises OSError, and ValueError for a file that is too large or is not text."""
    with path.open("rb") as file:
        content = file.read(MAX_FILE_BYTES + 1)
    if len(content) > MAX_FILE_BYTES:
        raise ValueError(f"it is larger than {MAX_FILE_BYTES // 1_000_000} MB")
    return content.decode("utf-8")


def brief(error: Exception) -> str:
    """What an error says, for a message of one line: at most 200 characters."""
    said = " ".join(str(error).split())
    return said if len(said) <= 200 else f"{said[:200]} ..."
