"""--continue: what is run is a diagnosis of all records, and only of records that are as they were."""

from __future__ import annotations

import argparse
import json
import shutil
from pathlib import Path

import pytest

from diagnosis.experiments.schedules import strokes
from models.effects.friction_laws import ViscousFriction
from models.machine_file import to_toml
from studies.command import BAD_INPUT, CHECK_MISSED, DONE, parser_of
from studies.gap_diagnosis import __main__ as command
from tests.diagnosis.tables import recorded, table
from tests.studies.gap_diagnosis.test_study import write

Asked = list[argparse.Namespace]


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a machine file, two records of it that have drag, and `out`, the diagnosis of the first."""
    folder, machine = tmp_path_factory.mktemp("first"), table()
    (folder / "axis.toml").write_text(to_toml(machine), encoding="utf-8")
    for name, seed in (("one", 1), ("two", 2)):
        (record,) = recorded(
            machine, (strokes(machine, 20e-3, (0.1,), passes=4),), [ViscousFriction(40.0)], seed=seed, wrong=0.0
        )
        write(record, folder / f"{name}.csv")
    given = [str(folder / "one.csv"), "--machine", str(folder / "axis.toml"), "--disable", "cogging"]
    assert command.main([*given, "--seed", "3", "--no-report", "--output", str(folder / "out")]) in {DONE, CHECK_MISSED}
    return folder


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> Asked:
    """What the study is asked, instead of running it."""
    seen: Asked = []

    def drafted(given: argparse.Namespace) -> int:
        seen.append(given)
        return DONE

    monkeypatch.setattr(command, "_drafted", drafted)
    return seen


def error_of(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert command.main(list(arguments)) == BAD_INPUT
    (said,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error:")]
    return said


def test_it_asks_what_all_records_at_once_would_be_asked(first: Path, asked: Asked) -> None:
    """The machine is the copy in the earlier folder, whatever has become of the file since."""
    out, two = first / "out", first / "two.csv"
    assert command.main([str(two), "--continue", str(out), "--no-report"]) == DONE
    once = [str(first / "one.csv"), str(two), "--machine", str(out / "machine.toml"), "--disable", "cogging"]
    more = ["--looked", "1", "--seed", "3", "--no-report", "--output", str(out)]
    assert asked == [parser_of(command.STUDY).parse_args([*once, *more])]


def test_what_is_given_now_goes_before_what_was_given_then_and_lists_add_up(
    first: Path, asked: Asked, tmp_path: Path
) -> None:
    shutil.copytree(first / "out", tmp_path / "elsewhere")  # the run that is left out would write it
    more = ["--seed", "4", "--disable", "play", "--output", str(tmp_path / "elsewhere")]
    assert command.main([str(first / "two.csv"), "--continue", str(first / "out"), *more]) == DONE
    (given,) = asked
    assert (given.seed, given.disable, given.output) == (4, ["cogging", "play"], tmp_path / "elsewhere")


def test_the_answer_is_told_beside_the_earlier_one(
    first: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Which it replaces, so that another record goes on from there."""

    def drafted(given: argparse.Namespace) -> int:
        whole = json.loads((given.output / "results.json").read_text(encoding="utf-8"))
        whole["results"]["records"] *= len(given.record)
        whole["results"]["verdict"] |= {"outcome": "none_of_these", "effects": []}
        whole["results"]["asked"] = {"reason": "no effect is named"}
        (given.output / "results.json").write_text(json.dumps(whole), encoding="utf-8")
        return CHECK_MISSED

    shutil.copytree(first / "out", tmp_path / "out")
    monkeypatch.setattr(command, "_drafted", drafted)
    assert command.main([str(first / "two.csv"), "--continue", str(tmp_path / "out")]) == CHECK_MISSED
    before, now, sure = capsys.readouterr().out.splitlines()[-3:]
    assert before.startswith("before the new record: attributed: viscous_friction (")
    assert now.startswith("and with: none of these; the unknown force is ")
    assert sure == "no effect is named"


def test_a_record_that_is_not_new_or_missing_is_refused(first: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(first / "out")
    assert error_of(capsys, "--continue", out).endswith("needs the record that was made since; give it as well")
    assert "one.csv of the earlier run; give the records made since" in error_of(
        capsys, str(first / "one.csv"), "--continue", out
    )


def test_records_and_machines_that_are_not_as_they_were_are_refused(
    first: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, two = tmp_path / "out", str(first / "two.csv")
    shutil.copytree(first / "out", out)
    manifest = (out / "manifest.json").read_text(encoding="utf-8")
    (out / "manifest.json").write_text(manifest.replace("one.csv", "gone.csv"), encoding="utf-8")
    assert "gone.csv: of the run in " in error_of(capsys, two, "--continue", str(out))
    (out / "manifest.json").write_text(manifest.replace("one.csv", "two.csv"), encoding="utf-8")
    assert "two.csv: has changed since the run in " in error_of(capsys, two, "--continue", str(out))
    (out / "manifest.json").write_text(manifest, encoding="utf-8")
    (out / "machine.toml").write_text("", encoding="utf-8")
    assert "machine.toml in it has changed since; give --machine" in error_of(capsys, two, "--continue", str(out))


def test_a_folder_of_something_else_is_refused(first: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    two = str(first / "two.csv")
    assert "has no manifest.json" in error_of(capsys, two, "--continue", str(tmp_path))
    manifest = json.loads((first / "out" / "manifest.json").read_text(encoding="utf-8"))
    without = {"options": {}, "inputs": {**manifest["inputs"], "files": []}}
    for changes, says in (
        ({}, "results.json in it can't be read"),
        ({"options": []}, "is not the manifest of a study"),
        ({"study": "export", **without}, "was not written by gap_diagnosis"),
        (without, "diagnosed simulated records"),
    ):
        (tmp_path / "manifest.json").write_text(json.dumps({**manifest, **changes}), encoding="utf-8")
        assert says in error_of(capsys, two, "--continue", str(tmp_path))
