"""The experiments of the menu are ones that somebody would run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.experiments.menu import menu
from diagnosis.experiments.schedules import PEAK_ACCELERATION, SUITE_SAMPLES, Move, schedule, suite
from models.machine import DEFAULT, Machine, load
from studies.gap_diagnosis.options import MOST_SAMPLES
from tests.models.feedback.axis import CASCADE, axis

MACHINE = load()
EMPS = load(Path(DEFAULT).parent / "emps.toml")


@pytest.mark.parametrize("rated_speed", [2.4, 0.3, 0.03])
@pytest.mark.parametrize("travel", [0.0, 0.8])
def test_no_experiment_takes_minutes_however_low_the_rated_speed(rated_speed: float, travel: float) -> None:
    slow = replace(MACHINE, drive=replace(MACHINE.drive, rated_speed=rated_speed, travel=travel))
    lengths = [one.schedule.target.size * slow.sample_time for one in menu(slow)]
    assert max(lengths) < 60
    assert suite(slow).target.size * slow.sample_time < 100


def test_a_speed_is_not_tried_twice() -> None:
    slow = replace(MACHINE, drive=replace(MACHINE.drive, rated_speed=0.03))
    (ladder,) = (one for one in menu(slow) if "speed ladder" in one.words)
    (stroke,) = (one for one in menu(slow) if one.words.startswith("a slow stroke"))
    assert ladder.schedule.target.size < 4 * stroke.schedule.target.size


@pytest.mark.parametrize("machine", [MACHINE, EMPS], ids=["default", "EMPS"])
@pytest.mark.parametrize("sample_time", [62.5e-6, 125e-6, 250e-6, 500e-6, 1e-3, 2e-3])
def test_a_suite_that_is_to_be_run_is_one_that_a_diagnosis_takes(machine: Machine, sample_time: float) -> None:
    """With room for other records, and with motions within the ratings, from rest to rest where it began."""
    sampled = replace(machine, control=replace(machine.control, sample_time=sample_time))
    asked = suite(sampled, SUITE_SAMPLES)
    assert asked.target.size <= SUITE_SAMPLES < MOST_SAMPLES
    path, force = asked.given.position, asked.given.feedforward
    assert np.ptp(path) >= 0.09 * sampled.specification.stroke  # the least stroke of the suite
    assert path[0] == 0.0
    assert path[-1] == pytest.approx(0.0, abs=1e-9)
    assert np.abs(force).max() <= sampled.drive.rated_thrust
    assert np.abs(np.diff(path)).max() <= sampled.drive.rated_speed * sample_time


def test_a_suite_within_the_limit_is_the_whole_one() -> None:
    np.testing.assert_array_equal(suite(MACHINE, SUITE_SAMPLES).given.position, suite(MACHINE).given.position)


def test_the_more_samples_a_suite_may_have_the_longer_it_is() -> None:
    fine = replace(MACHINE, control=replace(MACHINE.control, sample_time=125e-6))
    sizes = [suite(fine, most).target.size for most in (40_000, 90_000, 150_000, 1_000_000)]
    assert sizes == sorted(set(sizes))
    assert sizes[-1] == suite(fine).target.size


def test_what_depends_on_the_place_is_looked_at_over_half_of_a_stated_travel() -> None:
    """Covers 105 to 147 mm apart were to be seen by strokes of 24 mm, 600 presliding distances, of 800 mm."""
    table = load()
    for travel, least in ((0.8, 0.36), (0.02, 0.018), (0.0, 0.0)):
        machine = replace(table, drive=replace(table.drive, travel=travel))
        (along,) = (one for one in menu(machine) if "position" in one.coordinates)
        way = float(np.ptp(along.schedule.target))
        assert way >= least * 0.999
        assert travel == 0.0 or way <= machine.drive.room * 1.001


@pytest.mark.parametrize(("travel", "places"), [(0.0, 6), (2e-3, 6), (1e-3, 1)])
def test_moves_that_leave_no_room_for_other_places_are_made_at_one(travel: float, places: int) -> None:
    """A piezo stage of 400 nm was to make them "at 6 places 0 m apart"."""
    machine = replace(MACHINE, drive=replace(MACHINE.drive, travel=travel))
    (fast,) = (one for one in menu(machine) if one.words.startswith("fast moves"))
    assert fast.words.endswith("6 times at one place" if places == 1 else "apart")
    assert " 0 m " not in fast.words
    rests = fast.schedule.target[np.flatnonzero(np.diff(fast.schedule.target))]
    assert np.unique(rests.round(9)).size == 2 * places
    assert np.count_nonzero(np.diff(fast.schedule.target) > 0) >= 6


def test_what_a_cascade_feeds_forward_by_itself_is_not_in_the_references_too() -> None:
    """The strokes for a die bonder's axis of 6 kg with its own acceleration feedforward had pushed twice."""
    plain, own = axis(replace(CASCADE, acceleration_feedforward=0.0)), axis()
    half = axis(replace(CASCADE, acceleration_feedforward=0.5 * plain.plant.mass))
    step = Move(1e-3, 0.02, 0.05)
    whole, none, rest = (schedule("a move", one, [step], lead=0.1).given.feedforward for one in (plain, own, half))
    assert np.abs(whole).max() == pytest.approx(12.0 * PEAK_ACCELERATION * 1e-3 / 0.02**2, rel=1e-3)
    assert np.abs(none).max() < 1e-9
    np.testing.assert_allclose(rest, 0.5 * whole)
