"""A reviewer alone with a folder: every way in which a report can fail to follow from its inputs is found and said."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest

from models.machine import DEFAULT
from studies import catalogue
from studies.all import run as run_all
from studies.command import BAD_INPUT, CHECK_MISSED, DONE
from studies.command import main as run_study
from studies.deadbeat_design.__main__ import STUDY
from studies.review.__main__ import main
from studies.review.differences import differences


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A quick run of the main job, on a machine file given by its path."""
    folder = tmp_path_factory.mktemp("review")
    shutil.copyfile(DEFAULT, folder / "axis.toml")
    run_study(STUDY, ["--quick", "--machine", str(folder / "axis.toml"), "--output", str(folder / "out")])
    return folder / "out"


@pytest.fixture
def folder(written: Path, tmp_path: Path) -> Path:
    """A copy of that run to spoil."""
    return Path(shutil.copytree(written, tmp_path / "out"))


def test_what_nobody_touched_follows_byte_for_byte(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(folder)]) == DONE
    said = capsys.readouterr().out
    assert "run again identical" in said
    assert f"{folder} follows from its inputs" in said


def test_an_edited_figure_is_found(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    figure = folder / "figures" / "responses.svg"
    figure.write_text(figure.read_text(encoding="utf-8").replace("</svg>", "<g/></svg>"), encoding="utf-8")
    assert main([str(folder)]) == CHECK_MISSED
    said = capsys.readouterr().out
    assert "edited    figures/responses.svg is not as the run wrote it" in said
    assert "DOES NOT FOLLOW" in said


def test_results_newer_than_the_report_are_found(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    results["results"]["with"]["worst_dispersion_m"] *= 0.5
    (folder / "results.json").write_text(json.dumps(results), encoding="utf-8")
    assert main([str(folder)]) == CHECK_MISSED
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


def test_another_version_source_or_lock_is_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    manifest["versions"]["numpy"] = "1.0.0"
    manifest["inputs"]["source"]["sha256"] = "0" * 64
    manifest["inputs"]["lock"]["sha256"] = "0" * 64
    (folder / "manifest.json").write_text(json.dumps(manifest), encoding="utf-8")
    assert main([str(folder)]) == CHECK_MISSED
    said = capsys.readouterr().out
    for part in (
        "version of numpy: 1.0.0 before",
        "source: another",
        "requirements.lock: other",
        "run again identical",
    ):
        assert part in said


def test_a_missing_output_is_found(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "report.pdf").unlink()
    assert main([str(folder)]) == CHECK_MISSED
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
    text = DEFAULT.read_text(encoding="utf-8").replace(
        'tolerance = { value = "2 um"', 'tolerance = { value = "0.02 um"'
    )
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


@pytest.mark.parametrize("arguments", [["nowhere"], []])
def test_what_is_no_report_is_said(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == BAD_INPUT
    assert capsys.readouterr().err.startswith("error: ")


def test_every_study_is_in_the_catalogue() -> None:
    assert {"deadbeat_design", "response_variation"} <= set(catalogue.every())
    assert "review" in catalogue.names()
    assert "review" not in catalogue.every()


def test_all_reports_are_linked_with_their_checks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("studies.all.every", lambda: {"deadbeat_design": STUDY})
    assert run_all(["--quick", "--output", str(tmp_path)]) == DONE
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert "deadbeat_design/report.html" in page
    assert "all 9 hold" in page
    assert (tmp_path / "deadbeat_design" / "report.pdf").is_file()
