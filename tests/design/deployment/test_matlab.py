"""The MATLAB file is the structured text in another language: its numbers and its statements, one by one."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from design.deployment.matlab import matlab_files, statements, vectors_csv
from design.deployment.structured_text import Unit, Variable
from design.deployment.vectors import golden
from models.deployment.coefficients import load_coefficients
from tests.models.deployment.laws import KINDS, written

VARIABLES = (
    Variable("VAR_INPUT", "nAsked", "DINT"),
    Variable("VAR_OUTPUT", "nStatus", "DINT"),
    Variable("VAR CONSTANT", "K_END", "DINT"),
    Variable("VAR", "aRow", "LREAL", 3),
    Variable("VAR", "nNewest", "DINT"),
    Variable("VAR", "bOn", "BOOL"),
    Variable("VAR", "i", "DINT"),
)


def unit(body: str) -> Unit:
    return Unit("FB", "FUNCTION_BLOCK", VARIABLES, body)


@pytest.mark.parametrize("kind", KINDS)
def test_the_numbers_are_the_law_s(kind: str, tmp_path: Path) -> None:
    known = load_coefficients(written(kind, tmp_path), math.nan, math.nan)
    text = matlab_files(known, "a test")["axis_law.m"]
    found = dict(re.findall(r"^k\.(\w+) = (.*);$", text, re.MULTILINE))

    def row(name: str) -> list[float]:
        return [float(one) for one in found[name].strip("[]").split(",")]

    assert row("K_POSITION") == list(known.position)
    assert row("K_PATH") == list(known.path)
    assert row("K_THRUST") == list(known.thrust)
    assert float(found["K_THRUST_LIMIT"]) == known.thrust_limit
    assert ("K_LENGTH" in found) == (known.learning is not None)
    if known.law is None:
        assert float(found["K_KP"]) == known.pid.kp
    else:
        assert row("K_RESET") == list(known.law.reset)
    opened = len(re.findall(r"^\s*(?:if|for|function)\b(?!.*\bend\s*$)", text, re.MULTILINE))
    assert opened == len(re.findall(r"^\s*end\s*$", text, re.MULTILINE))


@pytest.mark.parametrize(
    ("text", "matlab"),
    [
        ("nStatus := nStatus + 1;", "law.status = law.status + 1;"),
        ("aRow[i] := -1.0E-3;", "law.aRow(1 + i) = -1.0E-3;"),
        ("nNewest := (nNewest + 2) MOD (K_END + 1);", "law.nNewest = mod((law.nNewest + 2), (k.K_END + 1));"),
        ("FOR i := nAsked TO K_END DO", "for i = nAsked:k.K_END"),
        ("IF NOT (i <> 2) AND i >= 1 THEN", "if ~(i ~= 2) && i >= 1"),
        ("ELSIF i = 2 OR bOn THEN", "elseif i == 2 || law.bOn"),
        ("bOn := FALSE;", "law.bOn = false;"),
        ("(* A word. *)", "% A word."),
    ],
)
def test_a_statement_says_the_same_in_matlab(text: str, matlab: str) -> None:
    assert [line.strip() for line in statements(unit(text))] == [matlab]


def test_blocks_are_indented_and_ended() -> None:
    body = "IF bOn THEN\ni := 1;\nELSE\nFOR i := 0 TO 1 DO\naRow[i] := 0.0;\nEND_FOR;\nEND_IF;"
    assert list(statements(unit(body))) == [
        "if law.bOn",
        "    i = 1;",
        "else",
        "    for i = 0:1",
        "        law.aRow(1 + i) = 0.0;",
        "    end",
        "end",
    ]


def test_what_is_no_statement_of_the_subset_is_refused() -> None:
    with pytest.raises(ValueError, match="is not a statement"):
        list(statements(unit("WHILE bOn DO")))


def test_the_vectors_are_read_back_as_they_are(tmp_path: Path) -> None:
    known = load_coefficients(written("PID", tmp_path), math.nan, math.nan)
    vectors = golden(known, 0)
    path = tmp_path / "vectors.csv"
    path.write_text(vectors_csv(vectors), encoding="utf-8")
    read = np.genfromtxt(path, delimiter=",", skip_header=1)
    assert np.array_equal(read[:, 1:3], vectors.given, equal_nan=True)
    assert np.array_equal(read[:, 3], vectors.thrust)
    assert path.read_text(encoding="utf-8").count("\n") == vectors.asked.size + 1
