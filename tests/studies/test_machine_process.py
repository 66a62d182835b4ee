"""A machine as a process: what it runs, what is never asked of it, and programs that do not keep to the protocol."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.experiments.schedules import Move, Schedule, schedule
from models.controller import References
from models.machine import load
from models.nominal_file import load as nominal_machine
from studies.blind_trial.sealer import on_request
from studies.machine_process import (
    Left,
    Limits,
    MachineProcess,
    MachineProcessError,
    Ran,
    Refused,
    Tripped,
    beyond,
    started,
)
from tests.studies.stand_in_axis import LIMITS, TRIPPED

SAMPLE_TIME = load().sample_time
Start = Callable[..., MachineProcess]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """Starts the stand-in in one of its ways."""
    with ExitStack() as stack:
        command = [sys.executable, "-m", "tests.studies.stand_in_axis"]
        yield lambda way: stack.enter_context(started([*command, way], tmp_path))


def moves(distance: float = 20e-6, duration: float = 0.1) -> Schedule:
    return schedule("moves", load(), [Move(distance, duration, 0.1), Move(-distance, duration, 0.1)])


def test_it_runs_references_and_ends_with_its_input(tmp_path: Path) -> None:
    asked = moves()
    with started([sys.executable, "-m", "tests.studies.stand_in_axis", "clean"], tmp_path) as machine:
        assert machine.nominal is None
        first, second = (machine.run(asked, SAMPLE_TIME) for _ in range(2))
        assert isinstance(first, Ran)
        assert isinstance(second, Ran)
        assert np.allclose(first.record.reference, asked.given.position, rtol=1e-8, atol=0)
        assert np.abs(first.record.position - asked.given.position).max() < 20e-6
        assert not np.array_equal(first.record.position, second.record.position)
        seconds = asked.target.size * SAMPLE_TIME
        assert second.left.machine_time == pytest.approx(LIMITS["machine_time_s"] - 2 * seconds)
        assert second.left.records == machine.left.records == LIMITS["records"] - 2
    assert (tmp_path / "machine" / "ended.txt").is_file()


def test_a_refusal_and_a_trip_are_answers(start: Start) -> None:
    refused = start("refuses").run(moves(), SAMPLE_TIME)
    assert isinstance(refused, Refused)
    assert refused.why == "the door is open"
    assert refused.left.records == LIMITS["records"]


def test_a_trip_takes_its_time(start: Start) -> None:
    tripped = start("trips").run(moves(), SAMPLE_TIME)
    assert isinstance(tripped, Tripped)
    assert (tripped.why, tripped.left.records) == (TRIPPED, LIMITS["records"] - 1)


@pytest.mark.parametrize(
    ("way", "said"),
    [
        ("no JSON", "answered 'done', which is not JSON"),
        ("ends", "has ended"),
        ("no record", "its record can't be used"),
        ("ends at once", "ended before it had written limits.json; it said: no axis here"),
        ("no limits", "limits.json must give distance_m as a number"),
        ("no way", "limits.json must give distance_m as more than 0: no experiment stays within that"),
        ("stray byte", "which is not JSON"),
    ],
)
def test_a_program_that_breaks_the_protocol_is_named_with_what_is_wrong(start: Start, way: str, said: str) -> None:
    with pytest.raises(MachineProcessError) as caught:
        start(way).run(moves(), SAMPLE_TIME)
    assert said in str(caught.value)
    assert f"stand_in_axis {way}" in str(caught.value).replace("'", "")


def test_a_program_is_told_to_stop_where_its_use_ends_in_an_error(tmp_path: Path) -> None:
    """By a signal, and not by the end of its input, at which an axis may finish what it does."""
    with (
        pytest.raises(RuntimeError),
        started([sys.executable, "-m", "tests.studies.stand_in_axis", "clean"], tmp_path),
    ):
        raise RuntimeError
    assert not (tmp_path / "machine" / "ended.txt").exists()


@pytest.mark.parametrize(
    ("command", "said"), [(" ", "is empty"), ("/no/such/axis", "can't be started"), ("axis 'one", "can't be read")]
)
def test_a_command_that_is_none_is_refused(command: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(MachineProcessError, match=said), started(command, tmp_path):
        pass


def _with_force(planned: Schedule, force: float) -> Schedule:
    given = planned.given
    return replace(planned, given=References(given.position, np.full(planned.target.size, force), given.compensation))


def test_what_is_beyond_the_limits_is_never_asked(start: Start, tmp_path: Path) -> None:
    machine = start("clean")
    for name, asked in {
        "distance": moves(0.06, 10.0),
        "speed": moves(0.04, 0.1),
        "feedforward": _with_force(moves(), 101.0),
        "machine time": moves(20e-6, 25.0),
    }.items():
        refused = machine.run(asked, SAMPLE_TIME)
        assert isinstance(refused, Refused)
        assert name in refused.why
    assert not list(tmp_path.glob("asked-*"))
    assert machine.left.records == LIMITS["records"]


def test_what_is_at_the_limits_is_within_them() -> None:
    """To the last of the digits that references are written with; a target or a first step beyond them is found."""
    still = np.zeros(10)
    ramp = np.linspace(0.0, 9e-3, 10)
    limits = Limits(9e-3, 2.0, 5.0, 5e-3, 1)
    whole = Left(limits.machine_time, limits.records)
    clipped = Schedule("clipped", still, References(still, still + float(f"{1.000000006:.9g}"), still))
    assert beyond(clipped, 5e-4, replace(limits, feedforward=1.000000006), whole) == ""
    assert "feedforward" in beyond(clipped, 5e-4, replace(limits, feedforward=0.99999999), whole)
    asked = Schedule("ramp", ramp, References(ramp, still + 5.0, still))
    assert beyond(asked, 5e-4, limits, whole) == ""
    assert "records" in beyond(asked, 5e-4, limits, replace(whole, records=0))
    assert "speed" in beyond(replace(asked, given=References(ramp + 2e-3, still, still)), 5e-4, limits, whole)
    assert "distance" in beyond(replace(asked, target=ramp + 1e-3), 5e-4, limits, whole)
    assert "feedforward" in beyond(
        replace(asked, given=References(ramp, still + 5.0, still + 0.1)), 5e-4, limits, whole
    )


def test_a_sealed_machine_answers_the_same_client(tmp_path: Path) -> None:
    """It is told its seed first, says what it is in nominal.json, and takes the experiments in its own sizes."""
    command = [sys.executable, "-m", on_request.__name__]
    with started(command, tmp_path, first="5 6") as machine:
        assert machine.nominal is not None
        known = nominal_machine(machine.nominal)
        asked = schedule("moves", known, [Move(0.1 * machine.limits.distance, 1.0, 0.2)])
        ran = machine.run(asked, known.sample_time)
        assert isinstance(ran, Ran)
        assert ran.left.records == machine.limits.records - 1
        assert ran.record.sample_time == pytest.approx(known.sample_time)
