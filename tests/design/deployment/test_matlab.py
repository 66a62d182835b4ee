"""The MATLAB files: no MATLAB runs here, so their numbers are read back, and their steps compared with the C."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from design.deployment.matlab import matlab_files, vectors_csv
from design.deployment.vectors import golden
from models.deployment.coefficients import load_coefficients
from tests.models.deployment.laws import KINDS, written


@pytest.mark.parametrize("kind", KINDS)
def test_the_numbers_are_the_law_s(kind: str, tmp_path: Path) -> None:
    known = load_coefficients(written(kind, tmp_path), math.nan, math.nan)
    text = matlab_files(known, "a test")["axis_law.m"]
    found = dict(re.findall(r"^k\.(\w+) = (.*);$", text, re.MULTILINE))

    def row(name: str) -> list[float]:
        return [float(one) for one in found[name].strip("[]").replace(";", ",").split(",") if one.strip()]

    assert row("position") == list(known.position)
    assert row("path") == list(known.path)
    assert row("thrust") == list(known.thrust)
    assert row("limit") == list(known.limit)
    assert float(found["thrust_limit"]) == known.thrust_limit
    if known.law is None:
        assert float(found["ki"]) == known.pid.ki
    else:
        assert row("reset") == list(known.law.reset)
        assert found["a"].count("[") == len(known.law.a) + 1
    opened = len(re.findall(r"^\s*(?:if|for|function|while)\b(?!.*\bend\s*$)", text, re.MULTILINE))
    assert opened == len(re.findall(r"^\s*end\s*$", text, re.MULTILINE))


def test_the_vectors_are_read_back_as_they_are(tmp_path: Path) -> None:
    known = load_coefficients(written("PID", tmp_path), math.nan, math.nan)
    vectors = golden(known, 0)
    path = tmp_path / "vectors.csv"
    path.write_text(vectors_csv(vectors), encoding="utf-8")
    read = np.genfromtxt(path, delimiter=",", skip_header=1)
    assert np.array_equal(read[:, 1:3], vectors.given, equal_nan=True)
    assert np.array_equal(read[:, 3], vectors.thrust)
    assert path.read_text(encoding="utf-8").count("\n") == vectors.asked.size + 1
