"""Signals with times of their own come onto one grid where their samples coincide; others are refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from models.records.grids import on_one_grid
from models.records.tables.sizes import RecordError


def placed(slow: Any, fast: Any) -> Any:
    """Two signals whose values are their times, so that it shows which samples are taken."""
    times = {"a": np.asarray(slow), "b": np.asarray(fast)}
    return on_one_grid({"position": times["a"], "command": times["b"]}, {"position": "a", "command": "b"}, times)


def test_every_fourth_sample_of_the_faster_signal_is_taken_where_both_were_recorded() -> None:
    slow, fast = 1e-3 * np.arange(3, 60), 0.25e-3 * np.arange(200)
    signals, grid, said = placed(slow, fast)
    np.testing.assert_allclose(grid, 1e-3 * np.arange(3, 50), rtol=1e-12)
    np.testing.assert_allclose(signals["position"], grid, rtol=1e-12)
    np.testing.assert_allclose(signals["command"], grid, rtol=1e-12)
    assert said[1].startswith("The command was sampled every 250 µs at 200 times; the 47 samples that fall on")


def test_equal_grids_are_left_alone() -> None:
    grid = 1e-3 * np.arange(50)
    signals, times, said = placed(grid, grid + 5e-6)  # half a percent of a step later
    np.testing.assert_array_equal(times, grid)
    np.testing.assert_array_equal(signals["command"], grid + 5e-6)
    assert said == ()


@pytest.mark.parametrize(
    ("slow", "fast", "says"),
    [
        (1e-3 * np.arange(50), 1e-3 * np.arange(50) + 0.3e-3, "command is sampled every 1 ms from 300 µs on and the"),
        (1e-3 * np.arange(50), 0.4e-3 * np.arange(120), "at other times; record both in one task, or resample"),
        (1e-3 * np.arange(50), 1 + 1e-3 * np.arange(50), "at other times"),
        (1e-3 * np.arange(50), np.delete(0.25e-3 * np.arange(200), 40), "at other times"),
        (1e-3 * np.arange(50), np.zeros(50), "the times 'b' do not rise"),
    ],
)
def test_grids_that_do_not_agree_are_refused(slow: Any, fast: Any, says: str) -> None:
    with pytest.raises(RecordError, match=says):
        placed(slow, fast)


def test_a_signal_without_as_many_times_is_refused() -> None:
    times = {"a": np.arange(20.0)}
    with pytest.raises(RecordError, match="the command has 19 samples and its times 'a' have 20"):
        on_one_grid({"command": np.zeros(19)}, {"command": "a"}, times)
