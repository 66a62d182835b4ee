"""The study as a command: packs with and without a key, what it writes, what it refuses."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from studies.blind_trial import compute
from studies.blind_trial.__main__ import STUDY
from studies.blind_trial.options import TrialOptions
from studies.command import BAD_INPUT, CHECK_MISSED, DONE, main
from studies.study import Progress
from tests.studies.blind_trial.conftest import Packer

BODIES: tuple[dict[str, object], ...] = (
    {
        "name": ["cogging"],
        "kind": "single",
        "severity": "high",
        "identifiable": True,
        "effects": [{"name": "cogging", "size": 0.5, "unit": "N", "form": "three harmonics", "distance": 120.0}],
    },
    {"name": ["play"], "disabled": ["play"], "kind": "disabled", "identifiable": True},
    {"name": [], "kind": "clean"},
    {"name": ["stribeck"], "kind": "single", "severity": "low", "identifiable": False},
)


@pytest.fixture(autouse=True)
def _stand_in(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compute, "DIAGNOSIS", "tests.studies.blind_trial.stand_in")


TIME = "time of the whole trial, on two cores"


def run(*options: Any) -> int:
    return main(STUDY, [str(option) for option in options])


def results(folder: Path) -> Any:
    return json.loads((folder / "results.json").read_text(encoding="utf-8"))


def test_without_a_key_it_answers_and_says_that_their_accuracy_is_unknown(small_pack: Packer, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert run("--pack", small_pack(*BODIES), "--output", out) == DONE
    found = results(out)["results"]
    assert not found["scored"]
    assert results(out)["machine"]["plant"]["modes"][0]["gain_per_kg"] == pytest.approx(0.02207505518763797)
    assert found["outcomes"]["attributed"] == 3
    assert found["outcomes"]["none_of_these"] == 1
    answers = json.loads((out / "answers.json").read_text(encoding="utf-8"))
    assert sorted(answers) == ["case-01", "case-02", "case-03", "case-04"]
    text = (out / "report.html").read_text(encoding="utf-8")
    assert "is unknown without the key" in " ".join(text.split())
    assert (out / "report.pdf").stat().st_size > 10_000


def test_with_its_key_the_answers_given_before_are_scored(small_pack: Packer, tmp_path: Path) -> None:
    pack, out = small_pack(*BODIES), tmp_path / "out"
    run("--pack", pack, "--output", out, "--no-report")
    first = json.loads((out / "answers.json").read_text(encoding="utf-8"))
    assert run("--pack", pack, "--key", tmp_path / "pack-key.json", "--output", out) == CHECK_MISSED
    assert json.loads((out / "answers.json").read_text(encoding="utf-8")) == first
    whole = results(out)
    rates = {name: (rate["hits"], rate["tries"]) for name, rate in whole["results"]["rates"].items()}
    assert rates["right_name"] == (1, 1)  # The low one is not identifiable.
    assert rates["false_accusation"] == (1, 1)
    assert rates["abstention_disabled"] == (1, 1)
    missed = {check["name"] for check in whole["checks"] if not check["holds"]}
    assert "false accusation, nothing wrong or parameters only" in missed
    assert "median closure of right answers" in missed
    text = (out / "report.html").read_text(encoding="utf-8")
    assert "MISSED" in text
    assert "three harmonics" in text


def test_a_changed_label_stops_the_scoring(
    small_pack: Packer, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pack, key = small_pack(*BODIES), tmp_path / "pack-key.json"
    key.write_text(key.read_text(encoding="utf-8").replace("cogging", "stribeck"), encoding="utf-8")
    out = tmp_path / "out"
    assert run("--pack", pack, "--key", key, "--output", out) == BAD_INPUT
    assert "is not the one that was committed" in capsys.readouterr().err
    assert not (out / "results.json").exists()


def test_a_label_leaked_in_the_pack_is_a_missed_check(small_pack: Packer, tmp_path: Path) -> None:
    pack, out = small_pack(*BODIES), tmp_path / "out"
    (pack / "case-01" / "notes.txt").write_text("it is cogging", encoding="utf-8")
    run("--pack", pack, "--key", tmp_path / "pack-key.json", "--output", out, "--no-report")
    (check,) = [check for check in results(out)["checks"] if check["name"] == "labels in the pack"]
    assert not check["holds"]


@pytest.fixture
def sealed_before(small_pack: Packer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A trial of its own cases has them at hand, so that only what follows their sealing takes time."""
    pack, key = small_pack(*BODIES[:1], place="own"), tmp_path / "own-key.json"
    trial = compute._trial

    def at_hand(options: TrialOptions, output: Path, progress: Progress) -> Any:
        given = options if options.pack else replace(options, pack=pack, key=key, cases=None)
        return trial(given, output, progress)

    monkeypatch.setattr(compute, "_trial", at_hand)


@pytest.mark.usefixtures("sealed_before")
def test_a_full_trial_is_held_to_its_time_unless_an_earlier_run_did_a_part(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(compute, "FULL", 1)
    monkeypatch.setattr(compute, "cpu_count", lambda: compute.CORES)
    for held in (True, False):
        run("--cases", "1", "--seed", "3", "--output", tmp_path / "out", "--no-report")
        whole = results(tmp_path / "out")
        checks = [check for check in whole["checks"] if check["name"] == TIME]
        assert [check["limit"] for check in checks] == [compute.A_CASE] * held
        assert [check["value"] for check in checks] == [whole["results"]["seconds"]["trial"]] * held
        assert all(0 < check["value"] < 600 for check in checks)


@pytest.mark.usefixtures("sealed_before")
def test_the_time_of_fewer_cases_of_more_cores_or_of_a_given_pack_is_not_checked(
    small_pack: Packer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def held(*options: Any) -> bool:
        run(*options, "--no-report")
        return TIME in {check["name"] for check in results(options[-1])["checks"]}

    monkeypatch.setattr(compute, "cpu_count", lambda: compute.CORES)
    assert not held("--cases", "1", "--output", tmp_path / "few")
    monkeypatch.setattr(compute, "FULL", 1)
    assert held("--cases", "1", "--output", tmp_path / "enough")
    assert not held(
        "--pack", small_pack(*BODIES[:1]), "--key", tmp_path / "pack-key.json", "--output", tmp_path / "given"
    )
    monkeypatch.setattr(compute, "cpu_count", lambda: 8)
    assert not held("--cases", "1", "--output", tmp_path / "many")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--cases", "0"), "must be a whole number from 1 on"),
        (("--machine", "models/machines/emps.toml"), "--machine: a trial runs on the nominal.json of its pack"),
        (("--cases", "two"), "--cases"),
        (("--pack", "nowhere"), "is not a folder"),
        (("--key", "key.json"), "--key"),
        (("--pack", "here", "--cases", "3"), "leave one of them out"),
        (("--pack", "here", "--key", "nowhere.json"), "is not a file"),
    ],
)
def test_bad_input_is_one_line(
    options: tuple[str, ...], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(*options, "--output", tmp_path / "out") == BAD_INPUT
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert error.startswith("error: ")
    assert said in error
    assert not (tmp_path / "out" / "results.json").exists()
