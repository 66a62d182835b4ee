"""The range of force and speed of a machine's records: in its file, and what a design needs beyond it."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from design.controller import default_controller
from design.judging.known_range import covered_by, excess, excess_of, with_covered
from design.validation import validate
from models.machine import Machine, from_table, load
from models.machine_file import to_toml
from models.machines.parts import Covered
from models.records.record import Record
from tests.design.machines import quicker


def record(speed: float, force: float, sample_time: float = 5e-4) -> Record:
    """A table that moves at one speed [m/s] under one force [N], read in steps of 0.1 um."""
    time = np.arange(400) * sample_time
    position = np.round(speed * time / 1e-7) * 1e-7
    return Record(sample_time, position, position, np.zeros(time.size), np.full(time.size, -force), position)


@pytest.fixture(scope="module")
def machine() -> Machine:
    return with_covered(load(), [record(0.01, 20.0), record(0.002, 46.0)], "test of two records")


def test_the_range_is_that_of_all_records_and_not_of_the_scales_steps(machine: Machine) -> None:
    assert machine.covered is not None
    assert machine.covered.force == 46.0
    assert machine.covered.speed == pytest.approx(0.01, rel=0.01)
    slow = covered_by([record(1e-6, 5.0)], load())
    assert slow is not None
    assert slow.speed <= 1e-7 / (10 * 5e-4)


def test_a_command_beyond_the_rating_counts_up_to_it() -> None:
    found = covered_by([record(0.01, 900.0)], load())
    assert found is not None
    assert found.force == load().drive.rated_thrust
    assert covered_by([], load()) is None


def test_it_is_read_again_from_the_file_with_its_source(machine: Machine) -> None:
    again = from_table(tomllib.loads(to_toml(machine)), Path("machine.toml"))
    assert again.covered == machine.covered
    assert again.sources["covered.force"].detail == "test of two records"


def test_a_design_within_the_range_is_not_warned_of_and_one_beyond_is(machine: Machine) -> None:
    assert excess(machine, 46.0, 0.01) == ()
    assert [(one.what, one.needed, one.covered) for one in excess(machine, 89.0, 0.005)] == [("force", 89.0, 46.0)]
    assert [one.what for one in excess(machine, 89.0, 0.5)] == ["force", "speed"]
    assert excess(load(), 89.0, 0.5) == ()


def test_motions_need_their_largest_thrust_and_the_speed_of_their_reference() -> None:
    table = load()
    small = table.with_part("covered", Covered(10.0, 1e-4), {})
    judged = validate(small, default_controller(small), periods=2)
    reference = judged.response.record.reference
    by_what = {one.what: one.needed for one in excess_of(judged)}
    assert by_what["force"] == min(judged.peak_thrust, table.drive.rated_thrust)
    apart = round(0.25 * table.specification.reference_settling_time / table.sample_time)
    moved = np.max(np.abs(reference[apart:] - reference[:-apart]))
    assert by_what["speed"] * apart * table.sample_time == pytest.approx(moved)


@pytest.mark.parametrize("times", [1.0, 10.0])
def test_what_was_run_is_within_its_own_record(times: float) -> None:
    """Its record's speed was taken over ten samples and its reference's over one, which is another speed."""
    table = quicker(load(), times)
    judged = validate(table, default_controller(table), periods=2)
    known = with_covered(table, [judged.response.record], "its own record")
    again = validate(known, default_controller(known), periods=2)
    assert excess_of(again) == ()
