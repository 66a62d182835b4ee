"""Signals added behind the controller: which column, with which gain and delay, when, and that nobody is accused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from diagnosis.baseline import with_what_was_added
from diagnosis.records.motions import pieces, repeated
from diagnosis.where.added import with_the_added
from diagnosis.where.controller import added_signals, replayed, starting
from diagnosis.where.sentences import added_in_words
from models.controller import PID, References
from models.machine import Machine, load
from models.records.checks import replay
from models.records.record import Column, Record
from models.simulation.simulator import simulate
from studies.gap_diagnosis.options import DiagnosisOptions
from studies.gap_diagnosis.records import loaded
from tests.diagnosis.where.test_structure import recorded, under

Array = NDArray[np.float64]

ROOT = Path(__file__).parents[3]
DATA = ROOT.parent / "shared" / "data" / "emps" / "DATA_EMPS_PULSES.mat"
MACHINE = under(PID(3e5, 2e7, 4e3, 0.3e-3))


@pytest.fixture(scope="module")
def plain() -> Record:
    return recorded(MACHINE)


def pulses(size: int) -> Array:
    """5 during every second 200 samples, in the unit of a file."""
    return np.where(np.arange(size) // 200 % 2 == 1, 5.0, 0.0)


def pulsed(record: Record, gain: float, late: int = 0) -> Record:
    """The record of a controller behind which pulses were added."""
    return replace(record, command=record.command + gain * np.roll(pulses(record.command.size), late))


def mapped(record: Record, factor: float) -> Record:
    signal = factor * pulses(record.command.size)
    return replace(record, feedforward=signal, columns=(Column("trq", signal, mapped=True),))


@pytest.mark.parametrize("late", [0, 3, -2])
def test_the_gain_and_the_delay_of_a_mapped_column_are_found(plain: Record, late: int) -> None:
    found = replayed(MACHINE, mapped(pulsed(plain, 2.028, late), 2.0))
    assert found.added is not None
    assert (found.added.column, found.added.mapped, found.added.delay) == ("trq", True, late)
    assert found.added.gain == pytest.approx(1.014, rel=1e-9)
    assert found.replays, "the controller is not to blame"
    said = added_in_words(found, found.added, "the record", 1e-3)
    assert "the column 'trq', which is mapped to the feedforward, acts times 1.014 instead of 1" in said
    assert ("samples late" in said, "samples early" in said) == (late > 0, late < 0)
    again = with_the_added(mapped(pulsed(plain, 2.028, late), 2.0), found.added)
    assert replayed(MACHINE, again).departs is None


def test_a_feedforward_that_does_not_act_is_said_without_a_name(plain: Record) -> None:
    given = replace(plain, feedforward=2 * pulses(plain.command.size))
    found = replayed(MACHINE, given)
    assert found.added is not None
    assert found.added.gain == pytest.approx(0.0, abs=1e-9)
    told = added_in_words(found, found.added, "the record", 1e-3)
    assert "but the feedforward does not act: " in told
    assert told.endswith("is added to it; then map a column that holds their sum.")


def test_of_the_columns_that_are_not_mapped_the_one_that_was_added_is_named(plain: Record) -> None:
    draw, size = np.random.default_rng(0), plain.command.size
    given = pulsed(plain, 2.0)
    others = (
        Column("noise", draw.standard_normal(size)),
        Column("current", given.command / 31.5),
        Column("trq", pulses(size)),
        Column("state", np.full(size, 8.0)),
        Column("lost", np.full(size, np.nan)),
    )
    found = replayed(MACHINE, replace(given, columns=others))
    assert found.replays
    assert found.added is not None
    assert (found.added.column, found.added.mapped, found.added.delay) == ("trq", False, 0)
    assert found.added.gain == pytest.approx(2.0, rel=1e-9)
    assert found.added.stretches[0] == (200, 400)
    assert len(found.added.stretches) == size // 400
    said = added_in_words(found, found.added, "the record", 1e-3)
    assert "up to 10 N, in 7 stretches, the first from 200 ms to 400 ms" in said
    assert "It is the column 'trq' of the file times 2 N (feedforward = \"trq * 2 N\")" in said


@pytest.mark.parametrize("mass", [0.3, 2.0, 30.0])
def test_a_feedforward_of_the_acceleration_is_told_by_its_column(plain: Record, mass: float) -> None:
    """On a coarse log a feedforward that the log has not makes the commands to within what is rounded, too; a user
    whose column was not mapped had read of that alone."""
    coarse = replace(plain, reference=np.round(plain.reference, 8))
    speed = np.gradient(plain.reference, plain.sample_time)
    given = mass * np.gradient(speed, plain.sample_time)
    driven = replace(coarse, command=coarse.command + given)
    found = replayed(MACHINE, replace(driven, columns=(Column("I_ff", given / 500.0),)))
    assert found.replays
    assert found.added is not None
    assert found.added.column == "I_ff"
    assert found.added.gain == pytest.approx(500.0, rel=2e-3)
    assert 'feedforward = "I_ff * ' in added_in_words(found, found.added, "the record", 1e-3)
    without = replayed(MACHINE, driven)
    assert without.remedy is not None
    assert without.remedy.endswith("kg times the reference's acceleration (the log has none)")


def test_pulses_that_no_column_shows_are_told_by_the_replay_alone(plain: Record) -> None:
    given = pulsed(plain, 2.0)
    found = replayed(MACHINE, given)
    assert found.replays
    assert found.added is not None
    assert found.added.column is None
    assert found.added.largest == pytest.approx(10.0, rel=1e-6)
    assert found.added.stretches[0] == (200, 400)
    assert with_the_added(given, found.added).feedforward == pytest.approx(2 * pulses(plain.command.size), abs=1e-6)
    assert "no column that is known shows it" in added_in_words(found, found.added, "the record", 1e-3)


def test_another_law_is_not_taken_for_an_added_signal(plain: Record) -> None:
    """Neither its gains nor its filter, whatever columns the file has beside: those of the law itself fit as well."""
    error = plain.reference - plain.position
    beside = (Column("error", error), Column("speed", np.gradient(plain.position)), Column("torque", 2 * plain.command))
    for pid in (PID(3.3e5, 2e7, 4e3, 0.3e-3), PID(3e5, 2e7, 4.4e3, 0.3e-3), PID(3e5, 2e7, 4e3, 0.6e-3)):
        found = replayed(under(pid), replace(plain, columns=beside))
        assert not found.replays
        assert found.added is None


def test_a_rest_above_the_noise_accuses_the_controller_and_names_the_column(plain: Record) -> None:
    other = under(PID(3e5, 2e7, 4e3, 0.33e-3))
    found = replayed(other, mapped(pulsed(plain, 20.28), 2.0))
    assert not found.replays
    assert found.remedy is not None
    assert found.remedy.startswith("the column 'trq' times 10.1")
    assert found.remains > 0.01


def test_motions_with_other_pulses_are_not_equal() -> None:
    """Strokes to and fro of 500 samples, behind a controller that adds pulses of 400."""
    stroke = np.concatenate([np.linspace(0, 1e-3, 100), np.full(150, 1e-3)])
    reference = np.concatenate([np.zeros(100), *[stroke, 1e-3 - stroke] * 6])
    nothing = np.zeros(reference.size)
    bare = Record(MACHINE.sample_time, reference, reference, nothing, nothing, 0.999 * reference)
    quiet = replace(bare, command=replay(bare, MACHINE.control.feedback, 0))
    assert [len(group) for group in repeated(pieces([quiet]), [quiet])] == [6, 6]
    (taken,), (known,) = with_what_was_added(MACHINE, [pulsed(quiet, 2.0)])
    assert known.replays
    groups, found = repeated(pieces([taken]), [taken]), pieces([taken])
    assert groups
    for group in groups:
        assert len({found[i].start % 400 for i in group}) == 1


@pytest.fixture(scope="module")
def emps() -> Machine:
    if not DATA.is_file():
        pytest.skip("needs DATA_EMPS_PULSES.mat beside the project")
    return load(ROOT / "models" / "machines" / "emps.toml")


@pytest.mark.parametrize("by", [("feedforward=pulses_N [V] * 35.15065188248547 N/V",), ()], ids=["mapped", "unmapped"])
def test_the_pulses_of_a_measured_axis_are_found_however_they_are_mapped(emps: Machine, by: tuple[str, ...]) -> None:
    """Its authors' law plus 1.0139 times the pulses leaves 0.2 N, which the rounded reading makes."""
    (one,) = loaded(emps, DiagnosisOptions(record=(DATA,), column=by))
    assert isinstance(one.content, Record)
    found = replayed(emps, one.content)
    assert found.replays
    assert found.added is not None
    assert found.added.column == "pulses_N"
    unit = 1.0 if by else 35.15065188248547
    assert found.added.gain / unit == pytest.approx(1.0139, abs=1e-4)
    assert found.added.leaves < 0.22
    assert found.added.largest == pytest.approx(178.2, abs=0.1)
    assert len(found.added.stretches) == 25
    (with_them,), _ = with_what_was_added(emps, [one.content])
    assert not repeated(pieces([with_them]), [with_them]), "no two motions have the same pulses"


def test_pulses_that_are_mapped_as_they_act_accuse_no_controller(emps: Machine) -> None:
    """At their edges they leave more than the log's noise, in any gain: 2.1 N, where 0.2 N (rms) are left in all."""
    (one,) = loaded(emps, DiagnosisOptions(record=(DATA,), column=("feedforward=pulses_N * 35.64 N",)))
    assert isinstance(one.content, Record)
    assert replayed(emps, one.content).replays
    halting = replace(one.content, command=one.content.command + 2.0 * (np.arange(one.content.command.size) == 9000))
    assert not replayed(emps, halting).replays, "a command that departs between the edges is still told"


def test_pulses_of_a_measured_axis_are_found_without_their_column(emps: Machine) -> None:
    (one,) = loaded(emps, DiagnosisOptions(record=(DATA,)))
    assert isinstance(one.content, Record)
    found = replayed(emps, replace(one.content, columns=()))
    assert found.replays
    assert found.added is not None
    assert found.added.column is None
    assert found.added.largest == pytest.approx(178.2, abs=0.3)
    assert len(found.added.stretches) == 25


def test_a_replay_that_drifts_hands_no_step_to_a_simulation() -> None:
    """The integral of a law with another reference delay is off in proportion to the way from the start. What the
    record's commands hold beyond it begins where the replay has settled, at nothing."""
    stated = under(PID(3e5, 2e7, 4e3, 0.3e-3), reference_delay=1)
    path = np.concatenate([np.zeros(300), np.linspace(0, 50e-3, 1500), np.full(300, 50e-3)])
    record = simulate(MACHINE, MACHINE.feedback_only(), path).record
    begin = starting(stated.control.feedback, record.sample_time)
    drives = added_signals(stated, record)
    drift = float(np.ptp(drives.feedforward))
    assert drift > 0.3 * 2e7 * record.sample_time * 50e-3
    assert abs(drives.feedforward[begin] - drives.feedforward[begin - 1]) < 1e-3 * drift
    again = simulate(
        stated, stated.feedback_only(), path, given=References(path, drives.feedforward, np.zeros(path.size))
    )
    assert np.max(np.abs(again.record.position - record.position)) < 1e-7
