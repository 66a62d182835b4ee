"""The command: what it writes, what it refuses, and that the review follows it."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from models.deployment.coefficients import load_coefficients
from models.machine import load
from studies.command import BAD_INPUT, DONE, main
from studies.export.__main__ import STUDY
from studies.export.compute import sizes
from studies.export.octave import PROGRAM
from tests.design.deployment.compiling import NEEDS_CC
from tests.models.deployment.laws import content_of, written

QUICK = ("--quick", "--no-report")


@pytest.fixture(scope="module")
def folder(quick_run: Callable[[str], tuple[Path, int]]) -> Path:
    output, status = quick_run("export")
    assert status == DONE
    return output


def test_without_a_controller_the_machine_s_own_design_is_exported_for_every_target(folder: Path) -> None:
    names = {file.relative_to(folder).as_posix() for file in folder.rglob("*") if file.is_file()}
    assert names >= {
        *("README.md", "controller.json", "vectors.csv", "report.html", "report.pdf"),
        *("c/axis_law.c", "c/axis_law.h", "c/axis_selftest.c", "c/axis_plant.c", "c/axis_closed_loop.c"),
        *("fmi3/axis_controller.fmu", "fmi3/axis_plant.fmu"),
        *("st/FB_AxisLaw.TcPOU", "st/PRG_AxisCheck.TcPOU", "st/axis_law.xml", "matlab/axis_law.m"),
        "cia402/profiles.csv",
    }
    assert set(zipfile.ZipFile(folder / "fmi3" / "axis_plant.fmu").namelist()) == {
        *("modelDescription.xml", "sources/buildDescription.xml"),
        *("sources/fmu_plant.c", "sources/axis_plant.c", "sources/axis_plant.h"),
    }
    page = (folder / "README.md").read_text(encoding="utf-8")
    for said in ("150 N", "500 µs", "reset(x, u)", "wipe", "-ffp-contract=off", "products a sample"):
        assert said in page
    results = content_of(folder / "results.json")["results"]
    assert isinstance(results, dict)
    whole, kept, rounded, bare = (row["slowest_s"] for row in results["drive"]["rows"])
    assert whole <= 0.025
    assert max(kept, rounded) <= 0.025 < bare


def test_the_exported_controller_is_the_file_that_was_given(tmp_path: Path) -> None:
    path = written("filters and anti-windup", tmp_path)
    assert main(STUDY, [str(path), "--target", "st", *QUICK, "--output", str(tmp_path / "no")]) == BAD_INPUT
    content = content_of(path)
    content["sample_time_s"] = 5e-4
    path.write_text(json.dumps(content), encoding="utf-8")
    assert main(STUDY, [str(path), "--target", "st", *QUICK, "--output", str(tmp_path / "out")]) in {0, 1}
    assert content_of(tmp_path / "out" / "controller.json") == content
    assert not (tmp_path / "out" / "c").exists()


@pytest.mark.parametrize(
    ("change", "arguments", "says"),
    [
        ({"d_ff": [1.0]}, (), "the sum of n_ff must be 1 and that of d_ff 0"),
        ({"sample_time_s": 1e-3}, (), "give the machine that it was designed for with --machine"),
        ({"wipe": {"distance_m": 1e-3}}, (), "'duration_s' is missing; add it"),
        ({"thrust_limit_N": -1}, (), "thrust_limit_N must be a finite number above 0"),
        ({"compensator_path_ff": []}, (), "compensator_path_ff must be a list of finite numbers"),
        ({}, ("--anti-windup", "1 us"), "--anti-windup: 1 µs is shorter than a sample"),
        ({}, ("--drive-interval", "0.7 ms"), "--drive-interval: the drive's interval must be a multiple"),
        ({}, ("--target", "c++"), "invalid choice: 'c++'"),
    ],
)
def test_what_cannot_be_exported_is_refused_in_one_line(
    change: dict[str, object],
    arguments: tuple[str, ...],
    says: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = written("PID", tmp_path)
    path.write_text(json.dumps({**content_of(path), **change}), encoding="utf-8")
    assert main(STUDY, [str(path), *arguments, *QUICK, "--output", str(tmp_path / "out")]) == BAD_INPUT
    errors = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("[")]
    assert len(errors) == 1
    assert says in errors[0]
    assert not (tmp_path / "out").exists()


def test_the_machine_beside_a_controller_is_its_machine(tmp_path: Path) -> None:
    path = written("PID", tmp_path)
    (tmp_path / "machine.toml").write_text("nonsense", encoding="utf-8")
    assert main(STUDY, [str(path), *QUICK, "--output", str(tmp_path / "out")]) == BAD_INPUT


@NEEDS_CC
@pytest.mark.parametrize(("kind", "least"), [("PID", 20), ("learning", 33)])
def test_a_short_proof_holds(kind: str, least: int, tmp_path: Path) -> None:
    path = written(kind, tmp_path)
    arguments = ["--proof", "--samples", "20000", "--duration", "2 s", "--tables", "3", "--target", "c", *QUICK]
    assert main(STUDY, [str(path), *arguments, "--output", str(tmp_path / "out")]) == DONE
    results = content_of(tmp_path / "out" / "results.json")["results"]
    assert isinstance(results, dict)
    proof = results["proof"]
    assert {row["name"]: row["ulp"] for row in proof["same"]} == {
        "C at -O0": 0,
        "C at -O2": 0,
        "C at -O3": 0,
        "C at -O2, motions without a reset": 0,
        "FMU through FMPy": 0,
        "structured text": 0,
        **({} if PROGRAM is None else {"MATLAB file in Octave": 0}),
    }
    assert proof["missed"] == []
    assert proof["planted"] >= least
    assert 0 < proof["long"]["thrust_N"] < 1e-3 * 150
    assert np.isfinite(proof["closed_loop"])
    assert (proof["tables"]["tables"], proof["tables"]["learns"]) == (3, kind == "learning")


def test_the_largest_step_leaves_room_for_a_constant_force(tmp_path: Path) -> None:
    """A vertical axis: what holds it takes its share of the thrust."""
    path = written("PID", tmp_path)
    level = sizes(load_coefficients(path, 150.0, 0.0), 0.02)
    content = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps({**content, "start": {"thrust_N": 34.0}}), encoding="utf-8")
    held = sizes(load_coefficients(path, 150.0, 0.0), 0.02)
    free = load().drive.rated_thrust - load().friction.coulomb_force
    assert held["largest_step_m"] / level["largest_step_m"] == pytest.approx(1 - 34 / free, rel=1e-2)
