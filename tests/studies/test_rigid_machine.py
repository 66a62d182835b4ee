"""The shipped machine file of EMPS, a rigid axis with an offset and a PID without integral, in the studies that design:
each does its work, or says in one line what this machine lacks for its question."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

from models.machine import DEFAULT
from studies.command import BAD_INPUT, DONE, main

EMPS = DEFAULT.parent / "emps.toml"


@pytest.fixture(scope="module")
def designed(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """The folder that a study's quick run on it wrote; run once."""

    @cache
    def run(name: str) -> Path:
        output = tmp_path_factory.mktemp(name)
        study = import_module(f"studies.{name}.__main__").STUDY
        assert main(study, ["--quick", "--machine", str(EMPS), "--output", str(output)]) == DONE
        return output

    return run


@pytest.mark.parametrize("study", ["deadbeat_design", "pid_tradeoff"])
def test_a_study_designs_for_it_and_tells_of_it(study: str, designed: Callable[[str], Path]) -> None:
    machine = json.loads((designed(study) / "results.json").read_text(encoding="utf-8"))["machine"]
    assert machine["drive"]["offset_N"] == -3.1648
    page = (designed(study) / "report.html").read_text(encoding="utf-8")
    assert "drive: offset" in page
    for nonsense in (">nan<", ">inf<", "None N", "undefined"):
        assert nonsense not in page


def test_an_integral_is_found_for_it(designed: Callable[[str], Path]) -> None:
    """The PID in place has none: the size of the gains is then that of a rule."""
    results = json.loads((designed("pid_tradeoff") / "results.json").read_text(encoding="utf-8"))["results"]
    assert results["present"]["ki_N_per_ms"] == 0
    ms = results["present"]["ms"]
    assert ms == pytest.approx(1.74, abs=0.02)  # it counts as the stable loop that it is, with the drag: 1.78 without
    assert results["chosen"]["ki_N_per_ms"] > 1e6
    assert results["costs"][0]["name"] == "as it is"
    assert all(cost["ki_N_per_ms"] > 1e6 for cost in results["costs"])


@pytest.mark.parametrize(
    ("name", "options", "says"),
    [
        ("response_variation", [], "no [published] outcomes to compare with; add reversal_settling_time"),
        ("trajectory_optimisation", [], "all friction elements slip within 4 µm of a stroke of 20 mm"),
        ("trajectory_optimisation", ["--stroke", "30 um"], "--settling-time: 400 ms are 400 samples"),
    ],
)
def test_a_study_says_what_it_lacks(
    name: str, options: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study = import_module(f"studies.{name}.__main__").STUDY
    assert main(study, ["--machine", str(EMPS), "--output", str(tmp_path / "out"), *options]) == BAD_INPUT
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said.startswith("error: ")
    assert says in said
    assert not (tmp_path / "out").exists()
