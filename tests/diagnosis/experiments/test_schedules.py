"""The experiments of the menu are ones that somebody would run."""

from __future__ import annotations

from dataclasses import replace

import pytest

from diagnosis.experiments.schedules import menu, suite
from models.machine import load

MACHINE = load()


@pytest.mark.parametrize("rated_speed", [2.4, 0.3, 0.03])
def test_no_experiment_takes_minutes_however_low_the_rated_speed(rated_speed: float) -> None:
    slow = replace(MACHINE, drive=replace(MACHINE.drive, rated_speed=rated_speed))
    lengths = [one.schedule.target.size * slow.sample_time for one in menu(slow)]
    assert max(lengths) < 60
    assert suite(slow).target.size * slow.sample_time < 100


def test_a_speed_is_not_tried_twice() -> None:
    slow = replace(MACHINE, drive=replace(MACHINE.drive, rated_speed=0.03))
    (ladder,) = (one for one in menu(slow) if "speed ladder" in one.words)
    (stroke,) = (one for one in menu(slow) if one.words.startswith("a slow stroke"))
    assert ladder.schedule.target.size < 4 * stroke.schedule.target.size
