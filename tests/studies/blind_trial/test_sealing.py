"""A trial of one's own: no label is anywhere before the answers are committed; afterwards nothing can be changed."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from joblib import parallel_config
from joblib.externals.loky import get_reusable_executor

from studies.blind_trial import answering, compute, landlock, sealing
from studies.blind_trial.__main__ import STUDY
from studies.blind_trial.answering import Conditions
from studies.blind_trial.packs import Case
from studies.blind_trial.sealing import Sealed
from studies.command import BAD_INPUT, CHECK_MISSED, main
from tests.studies.blind_trial import ways
from tests.studies.blind_trial.conftest import Packer
from tests.studies.blind_trial.stand_in import to_json

WORD = "withheld_form"
BODIES = tuple(
    {
        "name": [name],
        "kind": "single",
        "severity": "high",
        "identifiable": True,
        "effects": [{"name": name, "size": 0.5, "unit": "N", "form": WORD, "distance": 120.0}],
    }
    for name in ("cogging", "stribeck")
)
STAND_IN = "tests.studies.blind_trial.stand_in"


@pytest.fixture
def asked(small_pack: Packer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What the sealer is asked for, in the place of which a pack of two stands; the first case is measured twice."""
    key = (small_pack(*BODIES, place="made").parent / "made-key.json").read_text(encoding="utf-8")
    (tmp_path / "made-key.json").unlink()
    calls: list[str] = []

    def run(_: Sealed, files: list[str], tell: Callable[[int, str], None] | None = None) -> str:
        del tell
        given = dict(zip(files[::2], files[1::2], strict=True))
        calls.append(" ".join(given))
        if "--output" in given:
            (tmp_path / "made").rename(given["--output"])
        if "--again" in given:
            again = Path(given["--again"])
            (again / "case-01").mkdir(parents=True)
            pack = again.parent / "pack"
            (again / "nominal.json").write_bytes((pack / "nominal.json").read_bytes())
            (again / "case-01" / "suite.csv.gz").write_bytes((pack / "case-02" / "suite.csv.gz").read_bytes())
        return key if "--key" in given else ""

    monkeypatch.setattr(sealing, "_run", run)
    monkeypatch.setattr(compute, "DIAGNOSIS", STAND_IN)
    return calls


@pytest.fixture
def quickly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Answers come from this process, where nobody looks for labels."""

    def answer(case: Case, _: Conditions) -> dict[str, Any]:
        return {**to_json({"outcome": "attributed", "size": len(case.records)}), "seconds": 0.25}

    monkeypatch.setattr(answering, "answer_case", answer)
    monkeypatch.setattr(compute, "shared_code", lambda *_: [])
    monkeypatch.setattr(answering, "_workers", lambda _: parallel_config(backend="sequential"))


def run(tmp_path: Path) -> int:
    return main(STUDY, ["--cases", "2", "--output", str(tmp_path / "out"), "--no-report"])


def files(tmp_path: Path) -> dict[str, bytes]:
    return {one.name: one.read_bytes() for one in (tmp_path / "out" / "sealed").iterdir() if one.is_file()}


def results(tmp_path: Path) -> Any:
    """What results.json holds of the answers and their scores, without the time of the whole trial."""
    found = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))["results"]
    del found["seconds"]["trial"]
    return found


def test_no_label_is_in_any_file_or_in_memory_that_the_kernel_shuts_while_cases_are_answered(
    asked: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    get_reusable_executor().shutdown()  # workers that an earlier test left know nothing of this environment
    monkeypatch.setattr(compute, "DIAGNOSIS", ways.__name__)
    monkeypatch.setenv(ways.FOLDER, str(tmp_path))
    monkeypatch.setenv(ways.SECRET, WORD[::-1])
    monkeypatch.setenv(ways.NOTES, str(tmp_path / "notes.json"))
    assert run(tmp_path) == CHECK_MISSED  # as the answers are wrong
    seen = json.loads((tmp_path / "notes.json").read_text(encoding="utf-8"))
    assert [one for one in seen if landlock.version() or not one.startswith("memory")] == []
    assert asked == ["--output --key", "--again"]
    assert WORD.encode() in files(tmp_path)["key.json"]
    assert results(tmp_path)["guards"]["commitments"] == 2
    assert results(tmp_path)["guards"]["refused"] == []


@pytest.mark.usefixtures("quickly")
def test_a_trial_is_gone_on_with_at_every_stage_with_the_same_key_and_answers(asked: list[str], tmp_path: Path) -> None:
    run(tmp_path)
    first, sealed = results(tmp_path), files(tmp_path)
    run(tmp_path)
    assert asked == ["--output --key", "--again"]
    assert results(tmp_path) == first
    (tmp_path / "out" / "sealed" / "key.json").unlink()  # as if interrupted before it was opened
    run(tmp_path)
    assert asked[2:] == ["--key"]
    assert results(tmp_path) == first
    assert files(tmp_path) == sealed


@pytest.mark.usefixtures("quickly")
def test_what_was_revealed_is_taken_away_while_cases_are_answered_anew(
    asked: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(tmp_path)
    sealed, answer_all = files(tmp_path), answering.answer_all
    seen: list[list[str]] = []

    def look(*arguments: Any, **named: Any) -> dict[str, Any]:
        seen.append(sorted({"key.json", "again"} & {one.name for one in (tmp_path / "out" / "sealed").iterdir()}))
        return answer_all(*arguments, **named)

    monkeypatch.setattr(compute, "answer_all", look)
    monkeypatch.setattr("studies.blind_trial.answering.program", lambda: "another program")
    run(tmp_path)
    assert seen == [[], ["again"]]
    assert asked[2:] == ["--again"]
    assert files(tmp_path)["key.json"] == sealed["key.json"]


def changed_answer(out: Path) -> Path:
    file = out / "answers.json"
    answers = json.loads(file.read_text(encoding="utf-8"))
    answers["case-02"]["verdict"]["effects"] = ["stribeck"]
    file.write_text(json.dumps(answers), encoding="utf-8")
    return file


def changed_second_answer(out: Path) -> Path:
    file = out / "sealed" / "answers_again.json"
    file.write_text(file.read_text(encoding="utf-8").replace("0.5", "0.9"), encoding="utf-8")
    return file


def changed_label(out: Path) -> Path:
    file = out / "sealed" / "key.json"
    file.write_text(file.read_text(encoding="utf-8").replace("stribeck", "cogging"), encoding="utf-8")
    return file


def no_key(out: Path) -> Path:
    file = out / "sealed" / "key.json"
    file.write_text("[]", encoding="utf-8")
    return file


def changed_commitment(out: Path) -> Path:
    file = out / "sealed" / "pack" / "commitments.json"
    file.write_text(file.read_text(encoding="utf-8").replace('": "', '": "0'), encoding="utf-8")
    return file


def no_commitments_of_answers(out: Path) -> Path:
    file = out / "sealed" / "answers_committed.json"
    file.write_text("{", encoding="utf-8")
    return file


CHANGES: dict[Callable[[Path], Path], str] = {
    changed_answer: "the answer to case-02 is not the one that was committed before the key was opened",
    changed_second_answer: "the answer to case-01 is not the one that was committed before the key was opened",
    changed_label: "case-02: its label is not the one that was committed",
    no_key: "must be a JSON object",
    changed_commitment: "its label is not the one that was committed",
    no_commitments_of_answers: "does not hold the commitments of answers",
}


@pytest.mark.usefixtures("quickly")
@pytest.mark.parametrize("change", CHANGES)
def test_what_somebody_changed_after_the_key_was_opened_is_one_line(
    change: Callable[[Path], Path], asked: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    del asked
    run(tmp_path)
    before = (tmp_path / "out" / "results.json").read_bytes()
    changed = change(tmp_path / "out")
    text = changed.read_bytes()
    capsys.readouterr()
    assert run(tmp_path) == BAD_INPUT
    (said,) = (line for line in capsys.readouterr().err.splitlines() if line.startswith("error"))
    assert CHANGES[change] in said
    assert (tmp_path / "out" / "results.json").read_bytes() == before
    assert changed.read_bytes() == text


@pytest.mark.usefixtures("quickly")
def test_answers_can_be_given_again_if_their_file_is_deleted(asked: list[str], tmp_path: Path) -> None:
    run(tmp_path)
    changed_answer(tmp_path / "out").unlink()
    run(tmp_path)
    assert asked == ["--output --key", "--again", "--again"]
    assert results(tmp_path)["guards"]["commitments"] == 2
