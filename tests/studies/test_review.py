"""A reviewer alone with a folder: every way in which a report can fail to follow from its inputs is found and said."""

from __future__ import annotations

import importlib
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from models.machine import DEFAULT
from studies import catalogue
from studies.all import run as run_all
from studies.command import BAD_INPUT, CHECK_MISSED, DONE, FAULT
from studies.command import main as run_study
from studies.deadbeat_design.__main__ import STUDY
from studies.manifest import SOURCES, lock_hash, sha256, versions
from studies.review.__main__ import main
from studies.review.bounded import Ended
from studies.review.differences import differences

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A quick run of the main job, on a machine file given by its path."""
    folder = tmp_path_factory.mktemp("review")
    shutil.copyfile(DEFAULT, folder / "axis.toml")
    run_study(STUDY, ["--quick", "--machine", str(folder / "axis.toml"), "--output", str(folder / "out")])
    return folder / "out"


@pytest.fixture(scope="module")
def repeated(written: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the study writes when it is run again as a review does."""
    output = tmp_path_factory.mktemp("again") / "out"
    run_study(STUDY, ["--quick", "--machine", str(written / "machine.toml"), "--output", str(output)])
    return output


@pytest.fixture
def folder(written: Path, tmp_path: Path) -> Path:
    """A copy of that run to spoil."""
    return Path(shutil.copytree(written, tmp_path / "out"))


@pytest.fixture
def spoilt(folder: Path, repeated: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Such a copy whose machine stays as it is, so that its second run may be one for all of these tests."""

    def run_again(task: Mapping[str, Any], *_: object) -> Ended:
        assert sha256(Path(task["machine"])) == sha256(repeated / "machine.toml")
        shutil.copytree(repeated, task["output"])
        return Ended(DONE, "")

    monkeypatch.setattr("studies.review.follows.run", run_again)
    return folder


def test_an_untouched_report_is_reproduced_byte_for_byte(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(folder)]) == DONE
    said = capsys.readouterr().out
    assert "run again identical" in said
    assert f"{folder} follows from its inputs" in said


def test_an_edited_figure_is_found(spoilt: Path, capsys: pytest.CaptureFixture[str]) -> None:
    figure = spoilt / "figures" / "responses.svg"
    figure.write_text(figure.read_text(encoding="utf-8").replace("</svg>", "<g/></svg>"), encoding="utf-8")
    assert main([str(spoilt)]) == CHECK_MISSED
    said = capsys.readouterr().out
    assert "edited    figures/responses.svg is not as the run wrote it" in said
    assert "DOES NOT FOLLOW" in said


def test_results_newer_than_the_report_are_found(spoilt: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results = json.loads((spoilt / "results.json").read_text(encoding="utf-8"))
    results["results"]["with"]["worst_dispersion_m"] *= 0.5
    (spoilt / "results.json").write_text(json.dumps(results), encoding="utf-8")
    assert main([str(spoilt)]) == CHECK_MISSED
    said = capsys.readouterr().out
    assert "the report is not made from these results" in said
    assert re.search(r"results\.with\.worst_dispersion_m: .* before, .* now \(relative difference 0\.5\)", said)


def test_a_changed_parameter_is_named_with_what_it_does(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    machine = folder / "machine.toml"
    text = machine.read_text(encoding="utf-8")
    machine.write_text(re.sub(r'(kp = { value =) "[^"]*"', r'\1 "1.5e6 N/m"', text), encoding="utf-8")
    assert main([str(folder)]) == CHECK_MISSED
    said = capsys.readouterr().out
    assert re.search(r"changed   machine: control\.pid\.kp_N_per_m: \d+ before, 1500000 now", said)
    assert "run again different" in said


def test_another_version_source_or_lock_is_named(spoilt: Path, capsys: pytest.CaptureFixture[str]) -> None:
    manifest = json.loads((spoilt / "manifest.json").read_text(encoding="utf-8"))
    manifest["versions"]["numpy"] = "1.0.0"
    manifest["inputs"]["source"]["sha256"] = "0" * 64
    manifest["inputs"]["lock"]["sha256"] = "0" * 64
    (spoilt / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    assert main([str(spoilt)]) == CHECK_MISSED
    said = capsys.readouterr().out
    for part in (
        "version of numpy: 1.0.0 before",
        "source: another",
        "requirements.lock: other",
        "run again identical",
    ):
        assert part in said


def test_a_missing_output_is_found(spoilt: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (spoilt / "report.pdf").unlink()
    assert main([str(spoilt)]) == CHECK_MISSED
    assert "report.pdf is missing" in capsys.readouterr().out


def test_numbers_within_the_tolerance_are_equal_and_beyond_it_different() -> None:
    before, after = {"a": [1.0, 2.0], "b": {"c": 3.0, "d": True}}, {"a": [1.0, 2.0 + 2e-9], "b": {"c": 3.0, "d": False}}
    found = list(differences(before, after))
    assert [one.where for one in found] == ["a[1]", "b.d"]
    assert found[0].relative == pytest.approx(1e-9)
    assert found[1].relative is None
    assert list(differences(before, before)) == []
    assert next(differences({"a": 1}, {})).after == "absent"


def test_two_designs_side_by_side(written: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = DEFAULT.read_text(encoding="utf-8").replace('tolerance = { value = "2 um"', 'tolerance = { value = "0.1 um"')
    (tmp_path / "strict.toml").write_text(text, encoding="utf-8")
    arguments = [
        "--quick",
        "--no-report",
        "--machine",
        str(tmp_path / "strict.toml"),
        "--output",
        str(tmp_path / "after"),
    ]
    assert run_study(STUDY, arguments) == CHECK_MISSED
    assert main([str(written), str(tmp_path / "after"), "--output", str(tmp_path / "change")]) == CHECK_MISSED
    said = capsys.readouterr().out
    assert "parameters that differ: 1" in said
    assert "turned    settling with compensation, positive motions" in said
    page = (tmp_path / "change" / "report.html").read_text(encoding="utf-8")
    assert "checks turn" in page
    assert "Grey: before" in page
    assert (tmp_path / "change" / "report.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize("name", sorted(catalogue.every()))
def test_no_check_turns_from_a_report_to_itself(
    name: str, quick_run: Callable[[str], tuple[Path, int]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every figure of every study can be laid over another, and its caption stands alone."""
    folder, _ = quick_run(name)
    assert main([str(folder), str(folder), "--output", str(tmp_path)]) == DONE
    assert "parameters that differ: 0" in capsys.readouterr().out
    drawn = {path.name for path in (folder / "figures").iterdir()}
    assert {path.name for path in (tmp_path / "figures").iterdir()} == drawn


def test_a_folder_among_the_inputs_has_one_hash(tmp_path: Path) -> None:
    (tmp_path / "case-1").mkdir()
    (tmp_path / "case-1" / "record.csv").write_text("1", encoding="utf-8")
    before = sha256(tmp_path)
    assert sha256(tmp_path) == before
    (tmp_path / "case-1").rename(tmp_path / "case-2")
    assert sha256(tmp_path) != before
    (tmp_path / "case-2").rename(tmp_path / "case-1")
    (tmp_path / "case-1" / "record.csv").write_text("2", encoding="utf-8")
    assert sha256(tmp_path) != before


def test_every_package_that_a_study_may_use_is_among_the_sources() -> None:
    packages = {path.parent.name for path in ROOT.glob("*/__init__.py")} - {"tests"}
    assert packages <= set(SOURCES)


@pytest.mark.parametrize("arguments", [["nowhere"], []])
def test_a_folder_without_a_report_is_bad_input(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == BAD_INPUT
    assert capsys.readouterr().err.startswith("error: ")


def test_every_study_is_in_the_catalogue() -> None:
    assert {"deadbeat_design", "response_variation"} <= set(catalogue.every())
    assert "review" in catalogue.names()
    assert "review" not in catalogue.every()


@pytest.mark.parametrize("name", sorted(catalogue.every()))
def test_every_study_has_its_parts_where_its_command_looks_for_them(name: str) -> None:
    study = catalogue.every()[name]
    assert study.name == name
    assert callable(importlib.import_module(f"studies.{name}.compute").compute)
    assert callable(importlib.import_module(f"studies.{name}.report").tell)


def test_asking_for_help_imports_no_part_of_a_study() -> None:
    code = """
import sys
from studies.catalogue import every
parts = {f"studies.{name}.{part}" for name in every() for part in ("compute", "report")}
print(*sorted(({"numpy", "matplotlib", "casadi"} | parts) & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_all_reports_are_linked_with_their_checks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("studies.all.every", lambda: {"deadbeat_design": STUDY})
    assert run_all(["--quick", "--output", str(tmp_path)]) == DONE
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "deadbeat_design/report.html" in page
    results = json.loads((tmp_path / "deadbeat_design" / "results.json").read_text(encoding="utf-8"))
    assert f"all {len(results['checks'])} hold" in page
    assert (tmp_path / "deadbeat_design" / "report.pdf").is_file()


def test_a_study_that_cannot_run_stops_no_other_and_is_on_the_index(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = replace(STUDY, name="broken")  # there is no package of that name
    monkeypatch.setattr("studies.all.every", lambda: {"broken": broken, "deadbeat_design": STUDY})
    assert run_all(["--quick", "--output", str(tmp_path)]) == FAULT
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "NO REPORT" in page
    assert "broken/report.html" not in page
    assert "deadbeat_design/report.html" in page


def test_what_was_installed_without_its_lock_names_its_packages_all_the_same(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("studies.manifest.ROOT", tmp_path)
    monkeypatch.setattr("importlib.metadata.requires", lambda _: ["numpy>=2", "casadi"])
    assert lock_hash() is None
    assert set(versions()) == {"python", "numpy", "casadi"}


def test_a_package_that_is_not_installed_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "requirements.in").write_text("numpy\nno-such-package-anywhere\n", encoding="utf-8")
    monkeypatch.setattr("studies.manifest.ROOT", tmp_path)
    assert versions()["no-such-package-anywhere"] == "not installed"
    assert versions()["numpy"] != "not installed"
