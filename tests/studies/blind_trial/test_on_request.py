"""A sealed machine on request: it runs what its limits allow, and no way round them or to its label is open."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models import nominal_file
from models.records import files as record_file
from models.records.record import Record
from studies.blind_trial.sealer import on_request
from studies.blind_trial.sealer.effects import CATALOGUE
from studies.blind_trial.sealer.machines import cases
from studies.blind_trial.sealer.machines.strangers import STRANGERS
from studies.blind_trial.sealer.on_request import COLUMNS, RECORDS, SECONDS, limits_of, main, serve

SEED, CASE = 5, 6  # of which the machine is drawn fast, and has a slow controller


@pytest.fixture(scope="module")
def sealed() -> cases.Plan:
    return cases.plan(SEED, CASE, "sealed")


def asked(path: Path, sample_time: float, reference: np.ndarray, force: float = 0.0, late: float = 1.0) -> str:
    """The path of a table of references that steps from 0 to the first reference and follows it."""
    time = late * sample_time * np.arange(reference.size)
    rows = np.column_stack([time, reference, reference, np.full(reference.size, force)])
    np.savetxt(path, rows, delimiter=",", header=COLUMNS, comments="", fmt="%.12g")
    return f"{path}\n"


@pytest.fixture
def moves(sealed: cases.Plan, tmp_path: Path) -> str:
    """A slow cosine over half the machine's distance, of 2 s."""
    ts, most = sealed.bench.axis.sample_time, limits_of(sealed.bench).distance
    phase = np.linspace(0, 2 * np.pi, round(2 / ts))
    return asked(tmp_path / "moves.csv", ts, 0.1 * most * (1 - np.cos(phase)))


def answers(sealed: cases.Plan, folder: Path, requests: Iterator[str]) -> list[dict[str, Any]]:
    folder.mkdir()
    told: list[str] = []
    serve(sealed, folder, requests, told.append)
    assert (folder / "log.jsonl").read_text(encoding="utf-8").splitlines() == told
    return [json.loads(one) for one in told]


def test_it_runs_references_and_every_run_is_another(sealed: cases.Plan, moves: str, tmp_path: Path) -> None:
    """The record is one that the project reads, of what was asked; the axis follows; the noise is another each time."""
    first, second = answers(sealed, tmp_path / "bench", iter([moves, moves]))
    assert first["left"] == {"machine_time_s": pytest.approx(SECONDS - 2), "records": RECORDS - 1}
    assert second["left"]["records"] == RECORDS - 2
    assert nominal_file.load(tmp_path / "bench" / "nominal.json").sample_time == sealed.bench.axis.sample_time
    one, two = (record_file.load(Path(answer["record"])).content for answer in (first, second))
    assert isinstance(one, Record)
    assert isinstance(two, Record)
    assert np.array_equal(one.reference, two.reference)
    assert np.abs(one.position - one.reference).max() < 0.2 * np.ptp(one.reference)
    assert not np.array_equal(one.position, two.position)


def test_what_is_beyond_its_limits_is_refused_in_one_line_and_takes_nothing(
    sealed: cases.Plan, moves: str, tmp_path: Path
) -> None:
    """limits.json may say what it likes."""
    ts, most = sealed.bench.axis.sample_time, limits_of(sealed.bench)
    still = np.zeros(200)
    requests = {
        "distance": asked(tmp_path / "far.csv", ts, np.linspace(0, 1.1 * most.distance, round(20 / ts))),
        "speed": asked(tmp_path / "fast.csv", ts, np.append(still, 1.2 * most.speed * ts * np.arange(3))),
        "feedforward": asked(tmp_path / "strong.csv", ts, still, force=1.1 * most.feedforward),
        "machine time": asked(tmp_path / "long.csv", ts, np.zeros(round(1.1 * SECONDS / ts))),
        "one row every": asked(tmp_path / "late.csv", ts, still, late=1.01),
        "100 rows": asked(tmp_path / "short.csv", ts, still[:50]),
        "cannot be read": f"{tmp_path / 'nowhere.csv'}\n",
    }
    folder = tmp_path / "bench"

    def widened() -> Iterator[str]:
        generous = dict.fromkeys(most.to_json(), 1e9)
        (folder / "limits.json").write_text(json.dumps(generous), encoding="utf-8")
        yield from requests.values()
        yield moves

    told = answers(sealed, folder, widened())
    for name, one in zip(requests, told, strict=False):
        assert name in one["refused"], one
        assert "\n" not in one["refused"]
        assert one["left"] == {"machine_time_s": SECONDS, "records": RECORDS}
    assert "record" in told[-1]
    assert len(list(folder.glob("record-*.csv"))) == 1


def test_its_records_are_counted(sealed: cases.Plan, moves: str, tmp_path: Path) -> None:
    *ran, last = answers(sealed, tmp_path / "bench", iter([moves] * (RECORDS + 1)))
    assert all("record" in one for one in ran)
    assert last["refused"].startswith("records: 7 is beyond the limit of 6")


def test_a_run_that_leaves_the_drive_s_range_is_spent(
    sealed: cases.Plan, moves: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def trip(*_: object) -> None:
        raise ArithmeticError("the command left the drive's range")

    monkeypatch.setattr(cases.Plan, "run", trip)
    (one,) = answers(sealed, tmp_path / "bench", iter([moves]))
    assert one["tripped"] == "the command left the drive's range; the machine time is spent"
    assert one["left"] == {"machine_time_s": pytest.approx(SECONDS - 2), "records": RECORDS - 1}


def test_as_a_process_it_has_its_label_nowhere_and_starts_once(
    sealed: cases.Plan, moves: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not in a file, in what it says, or on its command line, which holds no seed either."""
    folder = tmp_path / "bench"
    command = [sys.executable, "-m", on_request.__name__, "--folder", str(folder)]
    done = subprocess.run(
        command,
        input=f"{SEED} {CASE}\n{moves}",
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[3],
        check=True,
    )
    assert "record" in json.loads(done.stdout)
    texts = [done.stdout, done.stderr, *(one.read_text(encoding="utf-8") for one in folder.iterdir())]
    labels = {*CATALOGUE, *(one.effect for one in STRANGERS), *(part.name for part in sealed.parts)}
    assert not [label for label in labels for text in texts if label in text]
    assert (folder / "record-1.csv").read_text(encoding="utf-8") != ""
    assert main(["--folder", str(folder)]) == 2
    assert "a machine starts once only" in capsys.readouterr().err
    monkeypatch.setattr("sys.stdin", io.StringIO("no seed\n"))
    assert main(["--folder", str(tmp_path / "other")]) == 2
    assert 'must be "SEED CASE"' in capsys.readouterr().err
    assert not (tmp_path / "other").exists()


def controller_file(path: Path, axis: Any, gains: dict[str, float], **changes: Any) -> str:
    """A controller.json with a PID of the machine's own gains, some of them times a factor."""
    own = {name: axis.control[name] * gains.get(name, 1.0) for name in ("kp", "ki", "kd", "tau")}
    pid = {key: own[name] for name, key in on_request.GAINS.items()}
    content = {"sample_time_s": axis.sample_time, "reference_delay_samples": axis.delay, "pid": pid} | changes
    path.write_text(json.dumps(content), encoding="utf-8")
    return str(path)


def with_controller(moves: str, controller: str) -> str:
    return json.dumps({"references": moves.strip(), "controller": controller}) + "\n"


@pytest.fixture(scope="module")
def pid_machine() -> cases.Plan:
    """A machine with a plain PID."""
    found = cases.plan(11, 4, "sealed")
    assert found.bench.axis.style == "PID"
    return found


@pytest.fixture
def its_moves(pid_machine: cases.Plan, tmp_path: Path) -> str:
    ts, most = pid_machine.bench.axis.sample_time, limits_of(pid_machine.bench).distance
    return asked(tmp_path / "its_moves.csv", ts, 0.05 * most * (1 - np.cos(np.linspace(0, 2 * np.pi, round(2 / ts)))))


def test_it_runs_with_another_pid_for_one_run(pid_machine: cases.Plan, its_moves: str, tmp_path: Path) -> None:
    """With its own gains in the file it does what it does without; with half of them it is further off; and its own
    controller is back in the run after."""
    axis = pid_machine.bench.axis
    same = controller_file(tmp_path / "same.json", axis, {})
    half = controller_file(tmp_path / "half.json", axis, {"kp": 0.5, "ki": 0.5})
    told = answers(pid_machine, tmp_path / "one", iter([with_controller(its_moves, half), its_moves]))
    again = answers(pid_machine, tmp_path / "two", iter([with_controller(its_moves, same), its_moves]))
    plain = answers(pid_machine, tmp_path / "three", iter([its_moves, its_moves]))

    def off(answer: dict[str, Any]) -> float:
        content = record_file.load(Path(answer["record"])).content
        assert isinstance(content, Record)
        return float(np.sqrt(np.mean((content.position - content.reference) ** 2)))

    assert off(again[0]) == off(plain[0])
    assert off(told[0]) > 1.2 * off(plain[0])
    assert off(told[1]) == off(plain[1])


def test_a_pid_that_cannot_be_kept_trips_the_drive_and_spends_the_run(
    pid_machine: cases.Plan, its_moves: str, tmp_path: Path
) -> None:
    """The limits are those of the machine's own simulation: an unstable loop asks for more than the drive has."""
    wild = controller_file(tmp_path / "wild.json", pid_machine.bench.axis, {"kp": 300.0, "kd": 300.0})
    (one,) = answers(pid_machine, tmp_path / "bench", iter([with_controller(its_moves, wild)]))
    assert one["tripped"].startswith("the command left the drive's range")
    assert one["left"] == {"machine_time_s": pytest.approx(SECONDS - 2), "records": RECORDS - 1}


def test_a_controller_that_is_none_is_refused_and_takes_nothing(
    pid_machine: cases.Plan, its_moves: str, tmp_path: Path
) -> None:
    axis = pid_machine.bench.axis
    files = {
        "must run every": controller_file(tmp_path / "slow.json", axis, {}, sample_time_s=2 * axis.sample_time),
        "a gain is negative": controller_file(tmp_path / "negative.json", axis, {"kp": -1.0}),
        "a plain PID": controller_file(tmp_path / "law.json", axis, {}, law={"a": []}),
        "0 to 1000 samples late": controller_file(tmp_path / "late.json", axis, {}, reference_delay_samples=-1),
        "cannot be read": str(tmp_path / "nowhere.json"),
    }
    requests = [with_controller(its_moves, file) for file in files.values()]
    told = answers(pid_machine, tmp_path / "bench", iter([*requests, '{"controller": 1}\n']))
    for says, one in zip([*files, "a request must be a path"], told, strict=True):
        assert says in one["refused"], one
        assert one["left"] == {"machine_time_s": SECONDS, "records": RECORDS}


def test_limits_hold_whatever_the_controller(pid_machine: cases.Plan, tmp_path: Path) -> None:
    axis, most = pid_machine.bench.axis, limits_of(pid_machine.bench)
    far = asked(
        tmp_path / "far.csv", axis.sample_time, np.linspace(0, 1.1 * most.distance, round(20 / axis.sample_time))
    )
    same = controller_file(tmp_path / "same.json", axis, {})
    (one,) = answers(pid_machine, tmp_path / "bench", iter([with_controller(far, same)]))
    assert one["refused"].startswith("distance")
