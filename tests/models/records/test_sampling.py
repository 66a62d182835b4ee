"""Times as loggers write them: rounded stamps are told from gaps, rows out of order and a wandering clock."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from models.quantity import show
from models.records.sampling import Sampling, sampling
from models.records.tables.sizes import RecordError

Array = NDArray[np.float64]
COUNT = 4_000


def of(time: NDArray[Any], expected: float | None = None) -> Sampling:
    other = np.sin(np.arange(time.size) / 7.0)
    return sampling({"time": time, "position": other}, {"time": "t", "position": "x"}, expected)


def rounded(sample_time: float, grid: float, *, down: bool = False, start: float = 0.0, count: int = COUNT) -> Array:
    stamps = (start + sample_time * np.arange(count)) / grid
    return np.asarray((np.floor(stamps + 1e-9) if down else np.round(stamps)) * grid)


@pytest.mark.parametrize("down", [True, False])
@pytest.mark.parametrize("start", [0.0, 0.0137, 1.7e9])
@pytest.mark.parametrize(
    ("sample_time", "grid"),
    [(250e-6, 1e-3), (125e-6, 1e-3), (1 / 3000, 1e-3), (250e-6, 1e-4), (1 / 8192, 1e-3), (62.5e-6, 1e-4)],
)
def test_rounded_stamps_are_recognised(sample_time: float, grid: float, start: float, *, down: bool) -> None:
    found = of(rounded(sample_time, grid, down=down, start=start))
    assert found.sample_time == pytest.approx(sample_time, rel=2e-3 if start > 1 else 2e-4)
    assert found.said[0].startswith(
        f"The times in 't' are rounded to {show(grid, 's')} and are those of a sample every"
    )


def test_the_machine_s_sample_time_and_round_ones_go_before_others_that_fit() -> None:
    stamps = rounded(250.004e-6, 1e-3, count=300)
    assert of(stamps).sample_time == 250e-6
    assert of(stamps, 250.004e-6).sample_time == 250.004e-6


@pytest.mark.parametrize("lost", [slice(1700, 1701), slice(1701, 1707), slice(300, 340), slice(3_950, 3_960)])
def test_samples_that_are_lost_among_rounded_stamps_are_not_rounding(lost: slice) -> None:
    time = np.delete(rounded(250e-6, 1e-3, down=True), lost)
    with pytest.raises(RecordError, match=r'map time = "row \* 250 µs"') as error:
        of(time, 250e-6)
    assert ("samples are missing" in str(error.value)) == (lost.stop - lost.start > 6)


def test_a_gap_among_rounded_stamps_is_said_with_its_row() -> None:
    time = np.delete(rounded(250e-6, 1e-3, down=True), slice(2_000, 2_040))
    says = "about 40 samples are missing, the first after row 2000 at 499 ms, where the times in 't' jump by 11 ms"
    with pytest.raises(RecordError, match=says):
        of(time, 250e-6)


def test_times_that_fall_are_refused_with_their_row() -> None:
    time = rounded(250e-6, 1e-3)
    time[2_000:2_100] = time[1_900:2_000]
    says = r"column 't' falls after row 2000, once; sort the rows, .* or, if the samples are equally spaced"
    with pytest.raises(RecordError, match=says):
        of(time)


def test_a_wandering_clock_is_refused_however_it_is_rounded() -> None:
    time = 250e-6 * np.arange(COUNT) + 1e-3 * np.sin(np.arange(COUNT) / 300.0)
    for stamps in (time, np.round(time, 3), np.round(time, 4)):
        with pytest.raises(RecordError, match="uneven sampling"):
            of(np.maximum.accumulate(stamps))


def test_a_stamp_that_is_off_alone_is_said_with_its_row() -> None:
    time = 500e-6 * np.arange(2_000)
    time[1_200] -= 185e-6
    with pytest.raises(RecordError, match=r"2 of 1999 steps of 't' are not 500 µs, the first after row 1200 \(315 µs"):
        of(time)
    twice = np.insert(500e-6 * np.arange(1_999), 1_200, 500e-6 * 1_200)
    with pytest.raises(RecordError, match=r"1 of 1999 steps of 't' is not 500 µs, the first after row 1201 \(0 s"):
        of(twice)


def test_times_that_jitter_are_not_said_to_be_rounded() -> None:
    """By a percent about the samples, their steps by two: they were "rounded to 500 us", the sample time itself."""
    jitter = np.random.default_rng(1).uniform(-0.01, 0.01, 2_000)
    found = of(500e-6 * (np.arange(2_000) + jitter), 500e-6)
    assert found.sample_time == pytest.approx(500e-6, rel=1e-9)
    assert found.said[0].startswith("The times in 't' jitter by up to 5.1 µs and are those of a sample every 500 µs")


def test_time_differences_are_summed() -> None:
    draw = np.random.default_rng(1)
    for column in (np.full(COUNT, 250e-6), 250e-6 + 1e-7 * draw.standard_normal(COUNT).clip(-3, 3)):
        found = of(column)
        assert found.sample_time == pytest.approx(250e-6, rel=1e-4)
        assert "holds time differences" in found.said[0]


def test_seconds_since_1970_with_one_row_out_of_order_are_no_differences() -> None:
    time = 1.7e9 + 250e-6 * np.arange(COUNT)
    time[50] = time[40]
    with pytest.raises(RecordError, match="falls after row 50"):
        of(time)


def test_even_times_are_taken_as_they_are() -> None:
    found = of(1.7e9 + 250e-6 * np.arange(COUNT))
    assert found.sample_time == pytest.approx(250e-6, rel=1e-6)
    assert found.said == ()
