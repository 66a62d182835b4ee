"""Exported C in a folder, compiled and run."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import pytest

CC: Final = shutil.which("cc")
NEEDS_CC: Final = pytest.mark.skipif(CC is None, reason="there is no C compiler (cc), so that no exported C is run")
STRICT: Final = ("-std=c99", "-Wall", "-Wextra", "-pedantic", "-Wconversion", "-Werror", "-ffp-contract=off")


def put(folder: Path, files: Mapping[str, str]) -> Path:
    """Writes the files into the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


def compiled(folder: Path, sources: Sequence[str], flags: Sequence[str] = (), output: str = "program") -> Path:
    """The program made of the sources, or with -c the object."""
    assert CC is not None
    subprocess.run([CC, *STRICT, *flags, *sources, "-o", output], cwd=folder, check=True)
    return folder / output


def run(program: Path) -> tuple[int, str]:
    """Exit status and what was printed."""
    done = subprocess.run([str(program)], capture_output=True, text=True, check=False, timeout=60)
    return done.returncode, done.stdout
