"""Structured text, run from its files by an evaluator that shares nothing with what wrote it."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

from design.deployment.structured_text import decimal, structured_text
from design.deployment.vectors import golden
from models.deployment.coefficients import Coefficients, load_coefficients
from studies.export.evaluator import Library, TextError
from tests.models.deployment.laws import KINDS, written


def known_of(kind: str, folder: Path) -> Coefficients:
    return load_coefficients(written(kind, folder), math.nan, math.nan, 5e-3 if kind == "PID" else 0.0)


def first_that_differs(library: Library) -> int:
    check = library.make("PRG_AxisCheck")
    while not check.values["bDone"]:
        check.call()
    return int(check.values["nFirstDiffering"])


def read(files: dict[str, str]) -> Library:
    library = Library()
    library.add_twincat(files["FB_AxisLaw.TcPOU"])
    library.add_twincat(files["PRG_AxisCheck.TcPOU"])
    return library


@pytest.mark.parametrize("kind", KINDS)
def test_the_test_program_agrees_to_the_bit_from_either_form_of_the_files(kind: str, tmp_path: Path) -> None:
    known = known_of(kind, tmp_path)
    files = structured_text(known, golden(known, 0))
    assert first_that_differs(read(files)) == -1
    whole = Library()
    assert whole.add_plcopen(files["axis_law.xml"]) == ["FB_AxisLaw", "PRG_AxisCheck"]
    assert first_that_differs(whole) == -1


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ("fU := fU + K_THRUST[j]", "fU := fU - K_THRUST[j]"),
        ("nNewest + 2", "nNewest + 1"),
        ("FOR j := 0 TO K_STEP_END DO", "FOR j := 0 TO K_STEP_END - 1 DO"),
        ("fLastError := fError;", "fLastError := 0.0;"),
        ("(fU + fCompensation) + fPlan", "fU + (fCompensation + fPlan) + 1.0E-13"),
        ("fZero := fForce;", "fZero := 0.0;"),
        ("K_TRACKING * fExcess", "K_TRACKING * fWanted"),
    ],
)
def test_a_planted_fault_is_caught(right: str, wrong: str, tmp_path: Path) -> None:
    known = known_of("PID", tmp_path)
    files = structured_text(known, golden(known, 0))
    assert right in files["FB_AxisLaw.TcPOU"]
    files["FB_AxisLaw.TcPOU"] = files["FB_AxisLaw.TcPOU"].replace(right, wrong)
    assert first_that_differs(read(files)) >= 0


def test_names_are_none_that_the_standard_keeps_for_itself(tmp_path: Path) -> None:
    known = known_of("PID", tmp_path)
    text = structured_text(known, golden(known, 0))["FB_AxisLaw.TcPOU"]
    declared = set(re.findall(r"^    (\w+) :", text, re.MULTILINE))
    assert len(declared) > 40
    assert not declared & {"LIMIT", "MIN", "MAX", "SEL", "MUX", "ABS", "EXP", "STEP", "AT", "R", "S", "ON", "TO", "BY"}


@pytest.mark.parametrize("number", [0.0, 1.0, -1.5e-7, 1 / 3, 5e-324, 1.7976931348623157e308, 123456789.0])
def test_numbers_are_read_back_as_they_were(number: float) -> None:
    assert float(decimal(number)) == number
    assert re.fullmatch(r"-?\d+\.\d+(E-?\d+)?", decimal(number))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x := 1.0 ? 2.0;", "not a token"),
        ("y := 1.0;", "'y' is not declared"),
        ("IF x > 1.0 THEN x := 0.0; END_IF", "'' stands where ;"),
        ("x := (1.0;", "stands where \\)"),
    ],
)
def test_what_is_not_of_the_subset_is_refused(text: str, says: str) -> None:
    unit = (
        "<TcPlcObject><POU><Declaration>FUNCTION_BLOCK F VAR x : LREAL; END_VAR</Declaration>"
        f"<Implementation><ST><![CDATA[{text}]]></ST></Implementation></POU></TcPlcObject>"
    )
    with pytest.raises(TextError, match=says):
        Library().add_twincat(unit)
