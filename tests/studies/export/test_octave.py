"""The MATLAB file, run in Octave."""

from __future__ import annotations

import json
import math
import subprocess
from pathlib import Path

import numpy as np
import pytest

from design.deployment.matlab import matlab_files, vectors_csv
from design.deployment.vectors import answered, golden
from models.deployment.coefficients import load_coefficients
from models.deployment.running_law import LEARNING, STEP
from studies.export.octave import PROGRAM, in_octave
from tests.models.deployment.laws import LEARNING as SMALL
from tests.models.deployment.laws import content_of, written

NEEDS_OCTAVE = pytest.mark.skipif(PROGRAM is None, reason="there is no octave-cli, so that no exported MATLAB is run")


@NEEDS_OCTAVE
def test_a_law_that_learns_answers_to_the_bit(tmp_path: Path) -> None:
    path = written("learning", tmp_path)
    short = {**SMALL, "rounds": 1, "motions_per_round": 2, "length_candidates": [0.8, 1.0, 1.25]}
    path.write_text(json.dumps({**content_of(path), "learning": short}), encoding="utf-8")
    known = load_coefficients(path, math.nan, math.nan)
    vectors = golden(known, 0)
    thrust, status = in_octave(tmp_path / "octave", known, vectors)
    steps = vectors.asked == STEP
    assert np.array_equal(thrust[steps], vectors.thrust[steps])
    assert np.array_equal(status[steps], vectors.status[steps])
    assert np.any(vectors.status & LEARNING)


@NEEDS_OCTAVE
def test_the_check_that_is_exported_names_the_first_row_that_differs(tmp_path: Path) -> None:
    known = load_coefficients(written("filters and anti-windup", tmp_path), math.nan, math.nan)
    whole = golden(known, 0)
    few = answered(known, whole.asked[:400], whole.given[:400])
    wrong = few.thrust.copy()
    wrong[300] += 1e-9
    (tmp_path / "matlab").mkdir()
    for name, text in matlab_files(known, "a test").items():
        (tmp_path / "matlab" / name).write_text(text, encoding="utf-8")
    for thrust, first, said in ((few.thrust, "0", "0 of 400"), (wrong, "301", "1 of 400")):
        (tmp_path / "vectors.csv").write_text(
            vectors_csv(type(few)(few.asked, few.given, thrust, few.status)), encoding="utf-8"
        )
        command = [str(PROGRAM), "--norc", "--quiet", "--eval", "first = axis_check(); printf('%d', first)"]
        done = subprocess.run(command, cwd=tmp_path / "matlab", capture_output=True, text=True, check=True)
        assert said in done.stdout
        assert done.stdout.endswith(first)
