"""Compiles exported C with the flags under which it gives the reference's bits."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from studies.options import BadInputError

FLAGS: Final = ("-std=c99", "-ffp-contract=off")


def compiled(folder: Path, sources: Sequence[str], flags: Sequence[str], output: str) -> Path:
    """The program or object file that cc makes of sources in the folder. Raises BadInputError with what cc says."""
    command = ["cc", *FLAGS, *flags, *sources, "-lm", "-o", output]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise BadInputError(f"--proof: {' '.join(command)}: {done.stderr.strip()[-300:]}")
    return folder / output
