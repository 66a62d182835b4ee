"""Unusable packs and keys, resuming after an interruption, and a cluster."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from joblib import parallel_config

from studies.blind_trial import answering
from studies.blind_trial.answering import Conditions, answer_all, answer_case, read_answers, write_answers
from studies.blind_trial.cluster import Cluster
from studies.blind_trial.packs import Case, open_key, read_pack
from studies.options import BadInputError
from tests.studies.blind_trial.conftest import Packer
from tests.studies.blind_trial.stand_in import SLOW

ROOT = Path(__file__).parents[3]
STAND_IN = Conditions(diagnosis="tests.studies.blind_trial.stand_in", program="stand-in")
BODIES: tuple[dict[str, object], ...] = (
    {"name": ["cogging"]},
    {"name": ["play"], "disabled": ["play"], "kind": "disabled"},
    {"name": []},
)


def quiet(_: float, __: str) -> None:
    """No progress."""


def outcomes(answers: dict[str, Any]) -> list[str]:
    return [answers[name]["verdict"]["outcome"] for name in sorted(answers)]


def test_every_case_is_answered_and_kept(small_pack: Packer, tmp_path: Path) -> None:
    pack, file = read_pack(small_pack(*BODIES)), tmp_path / "out" / "answers.json"
    answers = answer_all(pack, file, STAND_IN, quiet)
    assert outcomes(answers) == ["attributed", "none_of_these", "attributed"]
    assert read_answers(file) == answers
    assert all({"verdict", "where", "which", "how_far", "seconds"} <= set(one) for one in answers.values())
    assert not list(file.parent.glob(".answers-*"))


def test_what_is_answered_is_not_done_again(small_pack: Packer, tmp_path: Path) -> None:
    pack, file = read_pack(small_pack(*BODIES)), tmp_path / "answers.json"
    answers = answer_all(pack, file, STAND_IN, quiet)
    marked = {name: {**one, "seconds": -1.0} for name, one in answers.items()}
    del marked["case-02"]
    write_answers(file, marked)
    again = answer_all(pack, file, STAND_IN, quiet)
    assert [one["seconds"] == -1.0 for one in again.values()] == [True, False, True]


def test_another_record_seed_or_entry_to_leave_out_is_answered_anew(small_pack: Packer, tmp_path: Path) -> None:
    folder, file = small_pack(*BODIES), tmp_path / "answers.json"
    answers = answer_all(read_pack(folder), file, STAND_IN, quiet)
    write_answers(file, {name: {**one, "seconds": -1.0} for name, one in answers.items()})
    (folder / "case-01" / "disabled.json").write_text('["cogging"]', encoding="utf-8")
    (folder / "case-02" / "suite.csv.gz").write_bytes((folder / "case-03" / "suite.csv.gz").read_bytes())
    again = answer_all(read_pack(folder), file, STAND_IN, quiet)
    assert [one["seconds"] == -1.0 for one in again.values()] == [False, False, True]


def test_a_killed_run_goes_on_without_losing_or_redoing_a_case(
    small_pack: Packer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, file = small_pack(*({"name": []} for _ in range(6))), tmp_path / "answers.json"
    program = (
        "from pathlib import Path; from tests.studies.blind_trial import test_answering as t;"
        f"t.answer_all(t.read_pack(Path({str(folder)!r})), Path({str(file)!r}), t.STAND_IN, t.quiet, jobs=1)"
    )
    monkeypatch.setenv(SLOW, "0.5")
    process = subprocess.Popen([sys.executable, "-c", program], cwd=ROOT, start_new_session=True)
    until = time.monotonic() + 120
    while len(read_answers(file)) < 2 and time.monotonic() < until:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    kept = json.loads(file.read_text(encoding="utf-8"))
    assert 2 <= len(kept) < 6
    write_answers(file, {name: {**one, "seconds": -1.0} for name, one in kept.items()})
    monkeypatch.setenv(SLOW, "0")
    answers = answer_all(read_pack(folder), file, STAND_IN, quiet)
    assert len(answers) == 6
    assert {name for name, one in answers.items() if one["seconds"] == -1.0} == set(kept)


@pytest.mark.skipif(not Path("/proc/self/environ").exists(), reason="looks processes up in /proc")
def test_all_processes_end_when_their_parent_is_killed(
    small_pack: Packer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Workers and answering processes end by themselves when it does.

    The test's name stands in the parent's command, as part of a path: it must not hold the word that is counted.
    """
    folder, file = small_pack(*({"name": []} for _ in range(4))), tmp_path / "answers.json"
    program = (
        "from pathlib import Path; from tests.studies.blind_trial import test_answering as t;"
        f"t.answer_all(t.read_pack(Path({str(folder)!r})), Path({str(file)!r}), t.STAND_IN, t.quiet, jobs=2)"
    )
    monkeypatch.setenv(SLOW, "20")
    mark = tmp_path.name  # stands in the environment of all that it begins
    process = subprocess.Popen([sys.executable, "-c", program], cwd=ROOT, env={**os.environ, "TRIAL_MARK": mark})
    wait_for(lambda: len(marked(mark, "answerer")) == 2)
    process.kill()
    process.wait()
    wait_for(lambda: not marked(mark, "answerer") and not marked(mark, "loky.backend.popen"))


def wait_for(what: Callable[[], bool]) -> None:
    """Fails after five minutes, which a busy machine may take to begin a process."""
    until = time.monotonic() + 300
    while not what():
        assert time.monotonic() < until
        time.sleep(0.2)


def marked(mark: str, command: str) -> list[str]:
    """Processes with this mark in their environment and this word in their command."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if f"TRIAL_MARK={mark}".encode() in (place / "environ").read_bytes():
                found += [place.name] if command.encode() in (place / "cmdline").read_bytes() else []
    return found


@pytest.mark.parametrize(("in_turn", "most"), [(True, 1), (False, 3)])
def test_cases_in_turn_are_begun_when_the_one_before_is_answered(
    small_pack: Packer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, in_turn: bool, most: int
) -> None:
    at_once, seen = [0], []

    def answer(_: Case, __: Conditions) -> dict[str, Any]:
        at_once[0] += 1
        time.sleep(0.3)
        seen.append(at_once[0])
        time.sleep(0.3)
        at_once[0] -= 1
        return {"verdict": {"outcome": "attributed"}}

    monkeypatch.setattr(answering, "answer_case", answer)
    monkeypatch.setattr(answering, "_workers", lambda _: parallel_config(backend="threading"))
    pack = read_pack(small_pack(*BODIES))
    answers = answer_all(pack, tmp_path / "answers.json", STAND_IN, quiet, jobs=3, in_turn=in_turn)
    assert outcomes(answers) == ["attributed"] * 3
    assert max(seen) == most


def test_a_truncated_file_of_answers_is_ignored(tmp_path: Path) -> None:
    file = tmp_path / "answers.json"
    file.write_text('{"case-01": {"verd', encoding="utf-8")
    assert read_answers(file) == {}


def test_a_case_that_can_not_be_answered_spoils_no_other(small_pack: Packer, tmp_path: Path) -> None:
    folder = small_pack(*BODIES)
    (folder / "case-01" / "suite.csv.gz").write_bytes(b"no record")
    answers = answer_all(read_pack(folder), tmp_path / "answers.json", STAND_IN, quiet)
    assert outcomes(answers) == ["failed", "none_of_these", "attributed"]
    assert "suite.csv.gz" in answers["case-01"]["error"]


def test_a_process_that_dies_is_a_failed_answer(small_pack: Packer) -> None:
    (case,) = read_pack(small_pack({"name": []})).cases
    found = answer_case(case, Conditions(diagnosis="no_such_module"))
    assert found["verdict"]["outcome"] == "failed"
    assert "no_such_module" in found["error"]


def test_a_cluster_of_two_workers_gives_the_same_answers(small_pack: Packer, tmp_path: Path) -> None:
    cluster = pytest.importorskip("distributed")
    pack = read_pack(small_pack(*BODIES))
    with cluster.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50) as two:
        there = answer_all(pack, tmp_path / "there.json", STAND_IN, quiet, cluster=Cluster(two.scheduler_address))
    here = answer_all(pack, tmp_path / "here.json", STAND_IN, quiet)
    timeless = {"seconds": 0, "cpu_seconds": 0}
    assert [{**one, **timeless} for one in there.values()] == [{**one, **timeless} for one in here.values()]


def test_a_key_that_matches_its_commitments_is_accepted(small_pack: Packer, tmp_path: Path) -> None:
    pack = read_pack(small_pack(*BODIES))
    bodies = open_key(tmp_path / "pack-key.json", pack)
    assert json.loads(bodies["case-01"])["name"] == ["cogging"]


def test_a_label_that_somebody_changed_is_found(small_pack: Packer, tmp_path: Path) -> None:
    pack, file = read_pack(small_pack(*BODIES)), tmp_path / "pack-key.json"
    key = json.loads(file.read_text(encoding="utf-8"))
    key["case-03"]["body"] = key["case-03"]["body"].replace("[]", '["cogging"]')
    file.write_text(json.dumps(key), encoding="utf-8")
    with pytest.raises(BadInputError, match="case-03: its label is not the one that was committed"):
        open_key(file, pack)


def test_a_nonce_that_somebody_changed_is_found(small_pack: Packer, tmp_path: Path) -> None:
    pack, file = read_pack(small_pack(*BODIES)), tmp_path / "pack-key.json"
    key = json.loads(file.read_text(encoding="utf-8"))
    key["case-01"]["nonce"] += "0"
    file.write_text(json.dumps(key), encoding="utf-8")
    with pytest.raises(BadInputError, match="case-01"):
        open_key(file, pack)


@pytest.mark.parametrize("missing", ["nominal.json", "commitments.json"])
def test_a_pack_without_its_files_is_said(missing: str, small_pack: Packer, tmp_path: Path) -> None:
    folder = small_pack(*BODIES)
    (folder / missing).unlink()
    with pytest.raises(BadInputError, match=r"nominal\.json|commitment"):
        open_key(tmp_path / "pack-key.json", read_pack(folder))


def test_folders_that_are_no_packs_are_said(tmp_path: Path, small_pack: Packer) -> None:
    with pytest.raises(BadInputError, match="is not a folder"):
        read_pack(tmp_path / "nowhere")
    folder = small_pack({"name": []})
    (folder / "case-01" / "suite.csv.gz").unlink()
    with pytest.raises(BadInputError, match="case-01 has no records"):
        read_pack(folder)
    (folder / "case-01").rmdir()
    with pytest.raises(BadInputError, match=r"no case-\* folder"):
        read_pack(folder)


def test_a_key_that_is_none_is_said(tmp_path: Path, small_pack: Packer) -> None:
    pack, file = read_pack(small_pack({"name": []})), tmp_path / "other.json"
    for content in ("{", "[]", "{}", '{"case-01": "x"}'):
        file.write_text(content, encoding="utf-8")
        with pytest.raises(BadInputError, match="--key"):
            open_key(file, pack)
