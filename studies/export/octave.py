"""Runs the exported MATLAB file in GNU Octave, which reads the same language."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.deployment.matlab import matlab_files
from design.deployment.vectors import Vectors
from models.deployment.coefficients import Coefficients

Array = NDArray[np.float64]

PROGRAM: Final = shutil.which("octave-cli")
SCRIPT: Final = """
in = fopen('asked.bin'); rows = fread(in, [3, Inf], 'double')'; fclose(in);
[thrust, status] = axis_replay(rows(:, 1), rows(:, 2), rows(:, 3));
out = fopen('answered.bin', 'w'); fwrite(out, [thrust, status]', 'double'); fclose(out);
"""


class OctaveError(RuntimeError):
    """Octave could not run the file; the message is its own."""


def in_octave(folder: Path, known: Coefficients, vectors: Vectors) -> tuple[Array, Array]:
    """Thrust (n,) [N] and status (n,) that the MATLAB file answers to the vectors, run in a folder of its own.

    Raises OctaveError where Octave is missing or fails.
    """
    if PROGRAM is None:
        raise OctaveError("there is no octave-cli; install GNU Octave")
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in matlab_files(known, "a proof").items():
        (folder / name).write_text(text, encoding="utf-8")
    (folder / "replay_file.m").write_text(SCRIPT, encoding="utf-8")
    np.column_stack([vectors.asked, vectors.given]).astype(float).tofile(folder / "asked.bin")
    command = [PROGRAM, "--norc", "--quiet", "replay_file.m"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise OctaveError(f"{' '.join(command)}: {done.stderr.strip()[-300:]}")
    thrust, status = np.ascontiguousarray(np.fromfile(folder / "answered.bin").reshape(-1, 2).T)
    return thrust, status
