"""What stands in a study's folder: replaced where an earlier run of that study wrote it, otherwise never in silence."""

from __future__ import annotations

import errno
import json
import os
import shutil
import stat
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from models.machine import DEFAULT
from studies.all import run as run_all
from studies.catalogue import every
from studies.command import BAD_INPUT, DONE, main
from studies.deadbeat_design.__main__ import STUDY
from studies.folder import EVERY, Place, atomic_folder, earlier, require_free, write_at_once
from studies.manifest import FORMAT, sha256
from studies.options import BadInputError
from studies.study import Answer

SOMEBODYS = "written by hand\n"


def place(folder: Path, *, overwrite: bool = False) -> Place:
    return Place(folder, "deadbeat_design", (*EVERY, *STUDY.writes), overwrite=overwrite)


def manifest(folder: Path, study: str = "deadbeat_design", **more: object) -> dict[str, object]:
    """The manifest of all files in the folder, as a run of the study would leave it."""
    names = [one.relative_to(folder).as_posix() for one in sorted(folder.rglob("*")) if one.is_file()]
    outputs = {name: sha256(folder / name) for name in names if name != "manifest.json"}
    return {"study": study, "options": {}, "inputs": {}, "versions": {}, "outputs": outputs, **more}


def run_in(folder: Path, names: tuple[str, ...] = ("results.json", "controller.json", "machine.toml")) -> None:
    """What a run of deadbeat_design does to its folder."""
    with atomic_folder(place(folder)) as made:
        for name in names:
            (made / name).parent.mkdir(exist_ok=True)
            (made / name).write_text("new", encoding="utf-8")
        (made / "manifest.json").write_text(json.dumps(manifest(made, format=FORMAT)), encoding="utf-8")


def files(folder: Path) -> dict[str, str]:
    return {
        one.relative_to(folder).as_posix(): one.read_text(encoding="utf-8")
        for one in folder.rglob("*")
        if one.is_file()
    }


def somebodys_manifest(folder: Path) -> None:
    (folder / "data.csv").write_text(SOMEBODYS, encoding="utf-8")
    (folder / "manifest.json").write_text('{"outputs": ["data.csv"]}', encoding="utf-8")


def manifest_of_another_format(folder: Path) -> None:
    """It has all that ours has, true hashes too, but another format."""
    (folder / "results.json").write_text(SOMEBODYS, encoding="utf-8")
    (folder / "manifest.json").write_text(json.dumps(manifest(folder, format="other/1")), encoding="utf-8")


def other_study(folder: Path) -> None:
    (folder / "results.json").write_text(SOMEBODYS, encoding="utf-8")
    (folder / "manifest.json").write_text(json.dumps(manifest(folder, "pid_tradeoff", format=FORMAT)), encoding="utf-8")


def edited_since(folder: Path) -> None:
    run_in(folder)
    (folder / "controller.json").write_text(SOMEBODYS, encoding="utf-8")


def linked(folder: Path) -> None:
    (folder.parent / "elsewhere.json").write_text(SOMEBODYS, encoding="utf-8")
    (folder / "results.json").symlink_to(folder.parent / "elsewhere.json")


def linked_figures(folder: Path) -> None:
    (folder.parent / "pictures").mkdir()
    (folder / "figures").symlink_to(folder.parent / "pictures")


def one_file(name: str) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(SOMEBODYS, encoding="utf-8")

    return write


TAKEN: dict[str, tuple[Callable[[Path], None], str]] = {
    "a manifest of somebody else": (somebodys_manifest, "manifest.json"),
    "a manifest of another format": (manifest_of_another_format, "manifest.json and 1 more"),
    "the files of another study": (other_study, "manifest.json and 1 more"),
    "a file edited since": (edited_since, "controller.json"),
    "a machine file written by hand": (one_file("machine.toml"), "machine.toml"),
    "a controller file written by hand": (one_file("controller.json"), "controller.json"),
    "a picture of one's own": (one_file("figures/table.svg"), "figures/table.svg"),
    "a file called figures": (one_file("figures"), "figures"),
    "a link": (linked, "results.json"),
    "a link instead of the folder of figures": (linked_figures, "figures"),
}


@pytest.mark.parametrize("case", TAKEN)
def test_what_is_somebody_elses_is_refused_before_the_work_and_left_alone(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(type(STUDY), "compute", lambda *_: pytest.fail("the work has begun"))
    prepare, name = TAKEN[case]
    folder = tmp_path / "out"
    folder.mkdir()
    prepare(folder)
    before = files(tmp_path)
    assert main(STUDY, ["--quick", "--no-report", "--output", str(folder)]) == BAD_INPUT
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert f"{name} in it was not written by deadbeat_design, or was edited since; give another folder" in said[0]
    assert files(tmp_path) == before


def test_what_appears_during_the_work_is_not_replaced_either(tmp_path: Path) -> None:
    def work() -> None:
        with atomic_folder(place(tmp_path)) as made:
            (made / "results.json").write_text("new", encoding="utf-8")
            (tmp_path / "results.json").write_text(SOMEBODYS, encoding="utf-8")

    with pytest.raises(BadInputError, match=r"results\.json in it"):
        work()
    assert files(tmp_path) == {"results.json": SOMEBODYS}


def test_an_earlier_run_makes_way_whole_and_other_files_stay(tmp_path: Path) -> None:
    run_in(tmp_path, ("results.json", "controller.json", "figures/bode.svg"))
    (tmp_path / "notes.txt").write_text(SOMEBODYS, encoding="utf-8")
    require_free(place(tmp_path))
    run_in(tmp_path, ("results.json", "machine.toml"))
    assert set(files(tmp_path)) == {"manifest.json", "results.json", "machine.toml", "notes.txt"}
    assert (tmp_path / "notes.txt").read_text(encoding="utf-8") == SOMEBODYS


def test_the_manifest_of_an_earlier_version_counts_with_matching_hashes(tmp_path: Path) -> None:
    (tmp_path / "results.json").write_text("old", encoding="utf-8")
    (tmp_path / "manifest.json").write_text(json.dumps(manifest(tmp_path)), encoding="utf-8")
    assert earlier(place(tmp_path)) == {"results.json", "manifest.json"}
    (tmp_path / "results.json").write_text("edited", encoding="utf-8")
    assert earlier(place(tmp_path)) == frozenset()


def test_a_manifest_of_ours_reaches_no_file_that_the_study_does_not_write(tmp_path: Path) -> None:
    """Not even with true hashes: a file above the folder, or one beside the results."""
    folder = tmp_path / "out"
    folder.mkdir()
    for file in (tmp_path / "data.csv", folder / "data.csv", folder / "results.json"):
        file.write_text(SOMEBODYS, encoding="utf-8")
    true = sha256(folder / "data.csv")
    names = ("results.json", "data.csv", "../data.csv", str(tmp_path / "data.csv"), "figures/../data.csv")
    content = manifest(folder, format=FORMAT, outputs=dict.fromkeys(names, true))
    (folder / "manifest.json").write_text(json.dumps(content), encoding="utf-8")
    assert earlier(place(folder)) == {"results.json", "manifest.json"}
    run_in(folder)
    assert (folder / "data.csv").read_text(encoding="utf-8") == SOMEBODYS
    assert (tmp_path / "data.csv").read_text(encoding="utf-8") == SOMEBODYS


def test_overwrite_replaces_files_but_follows_no_link(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    linked(folder)
    (folder / "machine.toml").write_text(SOMEBODYS, encoding="utf-8")
    with atomic_folder(place(folder, overwrite=True)) as made:
        for name in ("results.json", "machine.toml"):
            (made / name).write_text("new", encoding="utf-8")
    assert files(folder) == {"results.json": "new", "machine.toml": "new"}
    assert not (folder / "results.json").is_symlink()
    assert (tmp_path / "elsewhere.json").read_text(encoding="utf-8") == SOMEBODYS


def test_the_command_insists_with_overwrite(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(type(STUDY), "compute", lambda *_: Answer({}, ()))
    somebodys_manifest(tmp_path)
    assert main(STUDY, ["--no-report", "--overwrite", "--output", str(tmp_path)]) == DONE
    content = json.loads((tmp_path / "manifest.json").read_text(encoding="utf-8"))
    assert content["format"] == FORMAT
    assert "overwrite" not in content["options"]
    assert (tmp_path / "data.csv").read_text(encoding="utf-8") == SOMEBODYS
    assert main(STUDY, ["--no-report", "--output", str(tmp_path)]) == DONE  # what the first run wrote makes way


def test_a_machine_file_that_is_edited_meanwhile_is_kept_as_it_was_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "mine.toml"
    shutil.copyfile(DEFAULT, file)

    def edited(*_: object) -> Answer:
        file.write_text("not the machine that the study ran on\n", encoding="utf-8")
        return Answer({}, ())

    monkeypatch.setattr(type(STUDY), "compute", edited)
    assert main(STUDY, ["--no-report", "--machine", str(file), "--output", str(tmp_path / "out")]) == DONE
    given = json.loads((tmp_path / "out" / "manifest.json").read_text(encoding="utf-8"))["inputs"]["machine"]
    assert (given["file"], given["sha256"]) == ("mine.toml", sha256(DEFAULT))
    assert sha256(tmp_path / "out" / "machine.toml") == sha256(DEFAULT)


def test_all_studies_refuse_what_is_somebody_elses_unless_one_insists(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(type(STUDY), "compute", lambda *_: Answer({}, ()))
    monkeypatch.setattr("studies.rendering.render", lambda *_: ({}, {}))
    monkeypatch.setattr("studies.all.every", lambda: {"deadbeat_design": STUDY})
    (tmp_path / "index.html").write_text(SOMEBODYS, encoding="utf-8")
    assert run_all(["--output", str(tmp_path)]) == BAD_INPUT
    assert "index.html in it is not of an earlier run" in capsys.readouterr().err
    assert files(tmp_path) == {"index.html": SOMEBODYS}
    (tmp_path / "index.html").unlink()
    (tmp_path / "deadbeat_design").mkdir()
    one_file("machine.toml")(tmp_path / "deadbeat_design")
    assert run_all(["--output", str(tmp_path)]) == BAD_INPUT
    assert files(tmp_path)["deadbeat_design/machine.toml"] == SOMEBODYS
    assert run_all(["--output", str(tmp_path)]) == BAD_INPUT  # the index of the first run is no hindrance
    assert run_all(["--output", str(tmp_path), "--overwrite"]) == DONE
    assert files(tmp_path)["deadbeat_design/machine.toml"] != SOMEBODYS


@pytest.mark.parametrize("failing", range(1, 9))
def test_a_failure_while_files_are_replaced_leaves_the_earlier_ones(
    failing: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each of the eight moves, of four files aside and four into place, may be the one that fails."""
    run_in(tmp_path)
    before, move, moves = files(tmp_path), Path.rename, 0

    def rename(self: Path, target: Path) -> Path:
        nonlocal moves
        moves += 1
        if moves == failing:
            raise OSError(errno.ENOSPC, "No space left on device")
        return move(self, target)

    monkeypatch.setattr(Path, "rename", rename)
    with pytest.raises(BadInputError, match="the disk is full, nothing was written"):
        run_in(tmp_path)
    assert files(tmp_path) == before


@pytest.mark.parametrize("name", ["results.json", "controller.json", "manifest.json", "report.html"])
@pytest.mark.parametrize("error", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_is_one_line_and_leaves_nothing(
    name: str, error: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write = Path.write_text

    def full(self: Path, text: str, encoding: str) -> int:
        if self.name == name:
            write(self, text[: len(text) // 2], encoding)
            raise OSError(error, "No space left on device", str(self))
        return write(self, text, encoding)

    def render(_study: object, _whole: object, folder: Path, _progress: object) -> tuple[dict[str, object], ...]:
        (folder / "report.html").write_text("page", encoding="utf-8")
        return {}, {}

    monkeypatch.setattr(type(STUDY), "compute", lambda *_: Answer({}, (), {"controller.json": {}}))
    monkeypatch.setattr("studies.rendering.render", render)
    monkeypatch.setattr(Path, "write_text", full)
    assert main(STUDY, ["--output", str(tmp_path)]) == BAD_INPUT
    said = capsys.readouterr().err.strip().splitlines()
    assert said == [
        f"error: --output {tmp_path}: the disk is full, nothing was written; make room, or give another folder"
    ]
    assert list(tmp_path.iterdir()) == []


def test_a_program_that_fails_on_a_full_disk_is_said_to_be_that(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(tmp_path)
    monkeypatch.setattr("shutil.disk_usage", lambda _: usage._replace(free=0))
    with pytest.raises(BadInputError, match="the disk is full"), atomic_folder(place(tmp_path)):
        raise RuntimeError("pandoc ended with 1")
    monkeypatch.setattr("shutil.disk_usage", lambda _: usage._replace(free=1 << 30))
    with pytest.raises(RuntimeError), atomic_folder(place(tmp_path)):
        raise RuntimeError("pandoc ended with 1")


def test_answers_of_somebody_else_are_not_gone_on_from(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "answers.json").write_text('{"question 1": "yes"}', encoding="utf-8")
    assert main(every()["blind_trial"], ["--cases", "1", "--output", str(tmp_path)]) == BAD_INPUT
    assert "answers.json in it does not hold the answers of a trial" in capsys.readouterr().err
    assert files(tmp_path) == {"answers.json": '{"question 1": "yes"}'}


@pytest.mark.parametrize("name", sorted(every()))
def test_every_study_says_which_files_it_writes(name: str, quick_run: Callable[[str], tuple[Path, int]]) -> None:
    folder, _ = quick_run(name)
    study = every()[name]
    written = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))["outputs"]
    own = earlier(replace(place(folder), study=name, writes=(*EVERY, *study.writes)))
    assert own == {*written, "manifest.json"}


@pytest.mark.skipif(not hasattr(os, "umask"), reason="this system has no permissions to give")
def test_a_file_written_at_once_can_be_read_by_whom_others_can_be(tmp_path: Path) -> None:
    (tmp_path / "usual.txt").write_text("x", encoding="utf-8")
    write_at_once(tmp_path / "made.txt", "x")
    usual, made = (stat.S_IMODE((tmp_path / name).stat().st_mode) for name in ("usual.txt", "made.txt"))
    assert made == usual
