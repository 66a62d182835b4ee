"""A stranger's folder: it runs nothing and reaches nothing that it should not, and no forgery passes for a result."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import socket
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from studies.catalogue import every
from studies.command import BAD_INPUT, CHECK_MISSED, DONE, to_text
from studies.command import main as run_study
from studies.deadbeat_design.__main__ import STUDY
from studies.manifest import hashes, sha256
from studies.options import BadInputError
from studies.review import again, bounded
from studies.review.__main__ import main
from studies.review.bounded import Ended, Limits
from studies.review.copying import copied, visible
from studies.review.follows import review

SECRET = "what only the reviewer knows"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A quick run without a report, as most attacks need none."""
    output = tmp_path_factory.mktemp("attacks") / "out"
    assert run_study(STUDY, ["--quick", "--no-report", "--output", str(output)]) == DONE
    return output


@pytest.fixture
def folder(made: Path, tmp_path: Path) -> Path:
    (tmp_path / "secret.toml").write_text(SECRET, encoding="utf-8")
    return Path(shutil.copytree(made, tmp_path / "out"))


Edit = Callable[[dict[str, Any]], object]


def edit(folder: Path, change: Edit) -> None:
    file = folder / "manifest.json"
    content = json.loads(file.read_text(encoding="utf-8"))
    change(content)
    file.write_text(json.dumps(content), encoding="utf-8")


def listed(folder: Path) -> None:
    """Lets the manifest list the files as they now are."""
    found = {name: one for name, one in hashes(folder).items() if name != "manifest.json"}
    edit(folder, lambda content: content.update(outputs=found))


def option(**values: object) -> Callable[[Path], None]:
    return lambda folder: edit(folder, lambda content: content["options"].update(values))


def given(name: str, path: str) -> Callable[[Path], None]:
    """The manifest says that the run was given the file of this path."""

    def change(folder: Path) -> None:
        secret = sha256(folder.parent / "secret.toml")
        one = {"option": name, "file": path.replace("FOLDER", str(folder)), "sha256": secret}
        edit(folder, lambda content: content["inputs"].update(files=[one]))

    return change


def of_trial(folder: Path) -> None:
    edit(folder, lambda content: content.update(study="blind_trial", options={"scheduler": "tcp://127.0.0.1:9"}))


def trial_with_pack(folder: Path) -> None:
    edit(folder, lambda content: content.update(study="blind_trial", options={}))
    given("pack", "models/machines")(folder)


def output_called(name: str) -> Callable[[Path], None]:
    return lambda folder: edit(folder, lambda content: content["outputs"].update({name: "0" * 64}))


def linked(name: str) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        (folder / name).unlink(missing_ok=True)
        (folder / name).symlink_to(folder.parent / "secret.toml")

    return change


def linked_folder(folder: Path) -> None:
    (folder / "figures").symlink_to(folder.parent)


def pipe(folder: Path) -> None:
    (folder / "results.json").unlink()
    os.mkfifo(folder / "results.json")


def pipe_for_manifest(folder: Path) -> None:
    (folder / "manifest.json").unlink()
    os.mkfifo(folder / "manifest.json")


def socket_in_it(folder: Path) -> None:
    here = Path.cwd()
    os.chdir(folder)  # the address of a socket is short
    with socket.socket(socket.AF_UNIX) as one:
        one.bind("s")
    os.chdir(here)


def huge(folder: Path) -> None:
    with (folder / "results.json").open("wb") as file:
        file.truncate(1 << 40)


def nested(folder: Path) -> None:
    (folder / "manifest.json").write_text('{"study":' + "[" * 100_000, encoding="utf-8")


def deep(folder: Path) -> None:
    (folder / "a/b/c/d/e/f").mkdir(parents=True)


REFUSED: dict[str, tuple[Callable[[Path], object], str]] = {
    "an address to connect to": (of_trial, "--scheduler tcp://127.0.0.1:9, which reaches outside the folder"),
    "a pack to open": (trial_with_pack, "--pack models/machines, which reaches outside"),
    "help among the options": (option(help=True), "'help', not an option"),
    "another output": (option(output="elsewhere"), "'output', not an option"),
    "overwriting": (option(overwrite=True), "'overwrite', not an option"),
    "another machine": (option(machine="/etc/passwd"), "'machine', not an option"),
    "a path for an option": (option(controller="/etc/passwd"), "--controller /etc/passwd, which reaches outside"),
    "an object for an option": (option(stroke={"a": 1}), "not a value of an option"),
    "a long text for an option": (option(stroke="9" * 501), "not a value of an option"),
    "an option for the shell": (option(**{"stroke; rm -rf ~": "1"}), "not an option"),
    "a file by its absolute path": (given("controller", "FOLDER/../secret.toml"), "lies outside the folder"),
    "a file by a path upwards": (given("controller", "../secret.toml"), "lies outside the folder"),
    "a file of the project upwards": (given("controller", "models/../../secret.toml"), "lies outside the folder"),
    "a device": (given("controller", "/dev/zero"), "lies outside the folder"),
    "another study": (lambda folder: edit(folder, lambda one: one.update(study="../x")), "is not a study"),
    "a study that is a list": (lambda folder: edit(folder, lambda one: one.update(study=[])), "not the manifest"),
    "the review itself": (lambda folder: edit(folder, lambda one: one.update(study="review")), "is not a study"),
    "no inputs": (lambda folder: edit(folder, lambda one: one.pop("inputs")), "is not the manifest"),
    "outputs that are a list": (lambda folder: edit(folder, lambda one: one.update(outputs=["a"])), "not the manifest"),
    "an absolute output": (output_called("/etc/passwd"), "'/etc/passwd', which is not a file in the folder"),
    "an output upwards": (output_called("../secret.toml"), "'../secret.toml', which is not a file in the folder"),
    "a machine elsewhere": (
        lambda folder: edit(folder, lambda one: one["inputs"]["machine"].update(copy="../secret.toml")),
        "keeps the machine elsewhere",
    ),
    "a link for results": (linked("results.json"), "results.json is a link"),
    "a link for the machine": (linked("machine.toml"), "machine.toml is a link"),
    "a link for the manifest": (linked("manifest.json"), "manifest.json is a link"),
    "a link that nobody lists": (linked("more.json"), "more.json is a link"),
    "a link to a folder": (linked_folder, "figures is a link"),
    "a pipe": (pipe, "results.json is a named pipe"),
    "a pipe for the manifest": (pipe_for_manifest, "manifest.json is a named pipe"),
    "a socket": (socket_in_it, "s is a socket"),
    "a file of a terabyte": (huge, "results.json is too large"),
    "folders in folders": (deep, "lies too deep"),
    "nesting": (nested, "is not the manifest of a study"),
}


@pytest.mark.parametrize("attack", REFUSED)
def test_what_reaches_outside_is_one_line_and_runs_nothing(
    attack: str, folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("studies.review.follows.run", lambda *_: pytest.fail("a process was begun"))
    spoil, said = REFUSED[attack]
    spoil(folder)
    assert main([str(folder)]) == BAD_INPUT
    seen = capsys.readouterr()
    errors = [line for line in seen.err.splitlines() if not line.startswith("[")]
    assert len(errors) == 1
    assert said in errors[0]
    assert SECRET not in seen.err + seen.out


def forged_controller(folder: Path) -> None:
    content = json.loads((folder / "controller.json").read_text(encoding="utf-8"))
    content["pid"]["kp_N_per_m"] *= 1.01
    (folder / "controller.json").write_text(to_text(content), encoding="utf-8")
    listed(folder)


def forged_results(change: Edit) -> Callable[[Path], None]:
    def spoil(folder: Path) -> None:
        content = json.loads((folder / "results.json").read_text(encoding="utf-8"))
        change(content)
        (folder / "results.json").write_text(json.dumps(content, indent=1, sort_keys=True), encoding="utf-8")
        listed(folder)

    return spoil


def key_twice(folder: Path) -> None:
    text = (folder / "results.json").read_text(encoding="utf-8")
    (folder / "results.json").write_text(text.replace("{", '{\n "checks": [],', 1), encoding="utf-8")
    listed(folder)


def fewer(folder: Path) -> None:
    (folder / "controller.json").unlink()
    listed(folder)


def more(folder: Path) -> None:
    (folder / "controller_v2.json").write_text("{}", encoding="utf-8")
    listed(folder)


def not_listed(folder: Path) -> None:
    (folder / "report.html").write_text("all is well", encoding="utf-8")


def kept_folder(folder: Path) -> None:
    """What blind_trial may leave beside its results is not for every study."""
    (folder / "sealed").mkdir()
    (folder / "sealed" / "report.html").write_text("all is well", encoding="utf-8")


def other_machine(folder: Path) -> None:
    text = (folder / "machine.toml").read_text(encoding="utf-8").replace('"2 um"', '"3 um"')
    (folder / "machine.toml").write_text(text, encoding="utf-8")
    true = sha256(folder / "machine.toml")
    edit(folder, lambda content: content["inputs"]["machine"].update(sha256=true))
    listed(folder)


FORGED: dict[str, tuple[Callable[[Path], object], str]] = {
    "a forged controller with its hash": (forged_controller, "controller.json holds other values"),
    "no outputs": (lambda folder: edit(folder, lambda one: one.update(outputs={})), "is not of this run"),
    "an output left out": (fewer, "controller.json is missing, which a run writes"),
    "an output more": (more, "controller_v2.json is not what a run writes"),
    "a file more": (not_listed, "report.html is not of this run"),
    "a folder more": (kept_folder, "sealed/ is not of this run"),
    "another machine": (other_machine, "the manifest says the default one"),
    "a check that holds": (
        forged_results(lambda one: one["checks"][0].update(limit=1.0)),
        "checks[0].limit",
    ),
    "a number that is none": (
        forged_results(lambda one: one["checks"][0].update(value=float("nan"))),
        "checks[0].value: nan before",
    ),
    "an infinite number": (
        forged_results(lambda one: one["checks"][0].update(value=float("inf"))),
        "checks[0].value: inf before",
    ),
    "a key twice": (key_twice, "results.json holds other values"),
    "no versions": (lambda folder: edit(folder, lambda one: one.update(versions={})), "version of python: none before"),
    "what figures are drawn from": (
        lambda folder: edit(folder, lambda one: one.update(figures={"bode": ["results.sensitivity"]})),
        "manifest.json: figures.bode",
    ),
    "words for a terminal": (
        lambda folder: edit(folder, lambda one: one["versions"].update({"numpy": "\x1b[2J\x1b]0;pwned\x07"})),
        r"version of numpy: \x1b[2J\x1b]0;pwned\x07 before",
    ),
    "a word that nobody knows": (
        lambda folder: edit(folder, lambda one: one.update(follows=True)),
        "follows is not of",
    ),
}


@pytest.mark.parametrize("attack", FORGED)
def test_no_forgery_follows(
    attack: str, folder: Path, made: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second run is the first one's: most attacks leave the inputs as they are."""

    def run_again(task: Mapping[str, Any], *_: object) -> Ended:
        shutil.copytree(made, task["output"])
        return Ended(DONE, "")

    monkeypatch.setattr("studies.review.follows.run", run_again)
    assert main([str(folder)]) == DONE
    capsys.readouterr()
    spoil, said = FORGED[attack]
    spoil(folder)
    assert main([str(folder)]) == CHECK_MISSED
    seen = capsys.readouterr().out
    assert said in seen
    assert "DOES NOT FOLLOW" in seen
    assert "\x1b" not in seen


def test_a_report_is_what_its_results_give_to_the_byte(
    quick_run: Callable[[str], tuple[Path, int]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Results that differ by rounding, as on another computer, with the report of these: equal. An edited page: not."""
    pristine, _ = quick_run("deadbeat_design")

    def run_again(task: Mapping[str, Any], place: Path, limits: Limits, tell: Callable[[str], None]) -> Ended:
        if task["do"] == "run":
            shutil.copytree(pristine, task["output"])
            return Ended(DONE, "")
        return bounded.run(task, place, limits, tell)

    monkeypatch.setattr("studies.review.follows.run", run_again)
    folder = Path(shutil.copytree(pristine, tmp_path / "out"))
    page = (folder / "report.html").read_text(encoding="utf-8").replace("holds", "holds!", 1)
    (folder / "report.html").write_text(page, encoding="utf-8")
    listed(folder)
    assert main([str(folder)]) == CHECK_MISSED
    assert "report.html is not what these results give" in capsys.readouterr().out

    results = json.loads((pristine / "results.json").read_text(encoding="utf-8"))
    results["results"]["with"]["worst_dispersion_m"] *= 1 + 1e-12
    (folder / "results.json").write_text(to_text(results), encoding="utf-8")
    listed(folder)
    assert main([str(folder)]) == CHECK_MISSED
    assert "report.html is not what these results give" in capsys.readouterr().out

    shutil.copyfile(pristine / "report.html", folder / "report.html")  # shows five digits: the same as of these results
    listed(folder)
    assert main([str(folder)]) == DONE
    assert "run again equal within 1e-09" in capsys.readouterr().out
    assert main([str(folder), "--tolerance", "1e-13"]) == CHECK_MISSED


@pytest.mark.parametrize("tolerance", ["nan", "inf", "-1", "1"])
def test_a_tolerance_that_forgives_everything_is_refused(tolerance: str, folder: Path) -> None:
    assert main([str(folder), f"--tolerance={tolerance}"]) == BAD_INPUT


def test_what_will_be_run_and_its_limits_are_said_first(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    option(stroke="30 um", settling_time="25 ms")(folder)

    def run_again(*_: object) -> Ended:
        said = capsys.readouterr().err
        assert "will run studies.deadbeat_design" in said
        assert "--settling-time 25 ms --stroke 30 um (at most 7 s, 4096 MB)" in said
        return Ended(None, "")

    monkeypatch.setattr("studies.review.follows.run", run_again)
    assert main([str(folder), "--time-limit", "7"]) == CHECK_MISSED
    assert "stopped after 7 s" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("limits", "said"), [(Limits(seconds=0.3), "stopped after 0.3 s"), (Limits(file=1000), "the disk is full")]
)
def test_a_run_ends_at_its_limits(limits: Limits, said: str, folder: Path) -> None:
    found = review(folder, 1e-9, lambda *_: None, (), limits)  # type: ignore[arg-type]
    assert found.verdict == "cannot run"
    assert said in found.reason
    assert not found.follows


def test_a_run_has_the_memory_that_it_is_given_and_no_more(folder: Path) -> None:
    found = review(folder, 1e-9, lambda *_: None, (), Limits(memory=64 << 20))  # type: ignore[arg-type]
    assert found.verdict == "cannot run"
    assert not found.follows


def test_a_file_that_the_run_was_given_is_read_only_if_the_reviewer_hands_it_over(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A controller is kept beside the results, so it takes a folder without it to ask."""
    output = tmp_path / "out"
    controller = tmp_path / "mine.json"
    controller.write_text((made / "controller.json").read_text(encoding="utf-8") + "\n", encoding="utf-8")
    arguments = ["--quick", "--no-report", "--controller", str(controller), "--output", str(output)]
    assert run_study(STUDY, arguments) == DONE
    assert main([str(output)]) == DONE
    assert "run again identical" in capsys.readouterr().out
    (output / "given_controller.json").unlink()
    assert main([str(output)]) == BAD_INPUT
    assert "lies outside the folder, where a review reads nothing; give it the file with --input mine.json" in (
        capsys.readouterr().err
    )
    assert main([str(output), "--input", str(controller)]) == CHECK_MISSED
    said = capsys.readouterr().out
    assert "given_controller.json is missing" in said
    assert "changed" not in said


def test_an_ensemble_is_based_on_no_file_outside(tmp_path: Path) -> None:
    for base in ("/etc/passwd", "../secret.toml", "sub/x.toml"):
        (tmp_path / "ensemble.toml").write_text(f'base = "{base}"\n', encoding="utf-8")
        with pytest.raises(BadInputError, match="its base lies outside the folder"):
            again.check_base(tmp_path / "ensemble.toml")
    (tmp_path / "ensemble.toml").write_text('base = "linear_motor_table.toml"\n', encoding="utf-8")
    again.check_base(tmp_path / "ensemble.toml")


def test_the_second_run_has_no_network() -> None:
    with socket.socket() as one, pytest.raises(BadInputError, match="does not use a network"):
        again.no_network("socket.connect", (one, ("127.0.0.1", 9)))
    with socket.socket(socket.AF_UNIX) as one:
        again.no_network("socket.connect", (one, "s"))


def test_too_many_files_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("studies.review.copying.FILES", 3)
    (tmp_path / "in").mkdir()
    for number in range(4):
        (tmp_path / "in" / f"{number}.svg").touch()
    with pytest.raises(BadInputError, match="more than 3 files"):
        copied(tmp_path / "in", tmp_path / "copy")


def test_a_strangers_text_stays_on_its_line() -> None:
    assert visible("a\nb\x1b[0m\u202e") == r"a\nb\x1b[0m\u202e"
    assert visible("x" * 200, 10) == "xxxxxxx..."


def test_no_option_that_reaches_outside_is_among_those_of_a_review() -> None:
    """Addresses, places to write and folders to read; a new option is not among them unless its declaration says so."""
    allowed = {
        name: {field.name for field in dataclasses.fields(study.options) if field.metadata["option"].reviewable}
        for name, study in every().items()
    }
    files = {
        field.name
        for study in every().values()
        for field in dataclasses.fields(study.options)
        if field.metadata["option"].file and field.metadata["option"].reviewable
    }
    columns = {"column", "mapping", "recipe", "trust_records"}  # of records, which only an option of those below gives
    assert allowed["blind_trial"] == {"cases", "machines", "quick", "seed", "no_report", "controller", *columns}
    assert all(
        not names & {"machine", "output", "overwrite", "pack", "key", "inject", "scheduler"}
        for names in allowed.values()
    )
    assert files == {"controller", "controller_json", "record", "hold_out", "mapping", "ensemble", "looks"}
