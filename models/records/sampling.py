"""The sample time of a record, from a time column as loggers write it: rounded, as differences, or a count of rows.

Symbols: n samples; t_k the stamps [s]; T_s the sample time [s]; g the grid on which rounded stamps lie [s].
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from models.quantity import show
from models.records.tables.sizes import RecordError

Array = NDArray[np.float64]

UNEVEN: Final = 0.01  # of the sample time: rounding of a time column is below, a wandering clock above
ROW: Final = "row"  # what a mapping calls the count of the rows, from 0, where no column has this name
ON_GRID: Final = 0.05  # of a grid's step: by so much a stamp may be off it, as a double of seconds since 1970 is
STEP_NOISE: Final = 0.005  # of a step: steps that differ by less are the same
FEWEST_STAMPS: Final = 8  # that differ, from which rounding can be told from a wandering clock
GRID_ROUNDING: Final = 1e-3  # of the grid's step: by so much halves that are rounded to either side may exceed it
# Of the stamps: where fewer occur more or less often than the others, samples were lost.
MAX_UNEVEN_STAMP_SHARE: Final = 0.01
MAX_ODD_SHARE: Final = 0.1  # of the steps: fewer that differ from all others are counted in a refusal
DIGITS: Final = 6  # up to which a round sample time is looked for
TREND: Final = 0.1  # of the way that differences go up and down: by so much they may go up in all


@dataclass(frozen=True)
class Sampling:
    """The sample time [s] of a record, and what was made of its time column, in sentences."""

    sample_time: float
    said: tuple[str, ...] = ()


def sampling(signals: Mapping[str, Array], names: Mapping[str, str], expected: float | None = None) -> Sampling:
    """The sampling of signals (n,), time among them [SI]. Raises RecordError for NaN, gaps, uneven steps.

    names: what the file calls each signal. expected: the sample time [s] of the machine, if it is known, which rounded
    stamps may turn out to have.
    """
    time = signals["time"]
    if time.size < 16:
        raise RecordError(f"{time.size} samples are too few; give 16 at least")
    for signal, column in signals.items():
        wrong = np.flatnonzero(~np.isfinite(column))
        if wrong.size:
            raise RecordError(
                f"column {names[signal]!r} has {wrong.size} values that are not numbers, the first in row "
                f"{wrong[0] + 1}; cut the record there or export it again"
            )
    step = np.diff(time)
    if (differences := _differences(time, step)) is not None:
        text = f"Column {names['time']!r} holds time differences; their mean is taken as the sample time."
        return Sampling(differences, (text,))
    middle = float(np.median(step))
    mean = float((time[-1] - time[0]) / (time.size - 1))
    if np.any(step < 0) or mean <= 0:
        raise RecordError(_backward(signals, names, step))
    if middle > 0 and np.all(step > 0):
        _check_gaps(time, step, middle)
        if float(np.max(np.abs(step - middle))) <= UNEVEN * middle:
            return Sampling(mean)
    if (rounded := _rounded(time, step, expected)) is not None:
        return Sampling(rounded[0], (_made_again(time, step, names["time"], *rounded),))
    raise RecordError(_uneven(time, step, names["time"], expected or mean))


def _made_again(time: Array, step: Array, name: str, sample_time: float, grid: float) -> str:
    """What is said of stamps that were rounded to a grid [s], or jitter about the instants of the samples."""
    if np.all(np.round(step / grid) == 1):  # then nothing was rounded to it
        off = float(np.max(np.abs(time - time[0] - sample_time * np.arange(time.size))))
        how = f"jitter by up to {show(off, 's', 2)}"
    else:
        how = f"are rounded to {show(grid, 's')}"
    return (
        f"The times in {name!r} {how} and are those of a sample every {show(sample_time, 's')}; they are made again "
        "from the count of the samples."
    )


def counted(sample_time: float) -> str:
    """How to map the time of samples every sample_time [s] by their count, to end a refusal."""
    return f'if the samples are equally spaced all the same, map time = "{ROW} * {show(sample_time, "s", 6)}"'


def _differences(time: Array, step: Array) -> float | None:
    """The mean [s] of a column that holds differences of time: nearly equal, without a trend; None for any other."""
    middle = float(np.median(time))
    steady = middle > 0 and float(np.ptp(time)) <= 2 * UNEVEN * middle
    trend = abs(float(time[-1] - time[0])) > TREND * float(np.sum(np.abs(step)))
    return float(np.mean(time)) if steady and not trend and (np.any(step < 0) or not np.any(step)) else None


def _check_gaps(time: Array, step: Array, middle: float) -> None:
    """Raises RecordError where whole samples are missing between rising times."""
    gaps = np.flatnonzero(step > 1.5 * middle)
    even = np.abs(step - middle) <= UNEVEN * middle
    even[gaps] = np.abs(step[gaps] / middle - np.round(step[gaps] / middle)) < 2 * UNEVEN
    if gaps.size and np.all(even):
        missing = int(np.sum(np.round(step[gaps] / middle) - 1))
        raise RecordError(
            f"{missing} samples are missing in {gaps.size} gap{'s' * (gaps.size > 1)}, the first after row "
            f"{gaps[0] + 1} at {show(float(time[gaps[0]]), 's')}; give the part before or after as a record of its "
            f"own, or, {counted(middle)}"
        )


def _backward(signals: Mapping[str, Array], names: Mapping[str, str], step: Array) -> str:
    """The sentence for a time that does not rise; another column that does may have been meant."""
    for signal, column in signals.items():
        rise = np.diff(column)
        if signal != "time" and np.all(rise > 0) and np.ptp(rise) < UNEVEN * np.median(rise):
            return f"columns {names['time']!r} and {names[signal]!r} are swapped: the latter rises evenly, as time does"
    falls = np.flatnonzero(step < 0)
    if falls.size == 0:
        return f"column {names['time']!r} does not rise at all; map the right column to time"
    mean = float(np.median(step[step > 0])) if np.any(step > 0) else 1e-3
    return (
        f"column {names['time']!r} falls after row {falls[0] + 1}, {_times(falls.size)}; sort the rows, give what "
        f"follows as a record of its own, map the right column to time, or, {counted(mean)}"
    )


def _times(count: int) -> str:
    return "once" if count == 1 else f"the first of {count} times"


def _rounded(time: Array, step: Array, expected: float | None) -> tuple[float, float] | None:
    """(T_s, g) of stamps that are those of a constant sample time, rounded to a grid; None where they are not.

    Rounded to the nearest or cut off, all lie within one step of the grid about t_0 + k T_s: a lost sample leaves it.
    One lost sample may stay within; it shows where all other steps of the grid hold the same number of samples.
    """
    grid = _grid(step)
    if grid is None:
        return None
    stamps = np.round((time - time[0]) / grid)
    if np.unique(stamps[: min(stamps.size, 100_000)]).size < FEWEST_STAMPS:
        return None
    found = _under(stamps, grid, expected)
    return None if found is None else (found, grid)


def _under(stamps: Array, grid: float, expected: float | None) -> float | None:
    """The T_s [s] of stamps k T_s (n,) that were rounded to whole steps of the grid [s]; None if there is none."""
    count = np.arange(stamps.size, dtype=float)
    slope = float(np.polyfit(count, stamps, 1)[0])

    def spread(share: float) -> float:
        return float(np.ptp(stamps - share * count))

    if expected is not None and spread(expected / grid) < 1 - GRID_ROUNDING:
        return expected
    if _may_lack_some(stamps) or spread(slope) > 1.5:
        return None
    for sample_time in _candidates(slope * grid, expected):
        if spread(sample_time / grid) < 1 + GRID_ROUNDING:
            return sample_time
    most, close = 2 / stamps.size, {"xatol": 1e-7 / stamps.size}
    best = scipy.optimize.minimize_scalar(spread, bounds=(slope - most, slope + most), method="bounded", options=close)
    return float(best.x) * grid if best.fun < 1 + GRID_ROUNDING else None


def _may_lack_some(stamps: Array) -> bool:
    """Whether a few stamps are there more or less often than all others: the picture of lost samples."""
    often = np.diff(np.flatnonzero(np.diff(stamps)))  # but for the first and the last, which may be cut
    return bool(0 < np.count_nonzero(often != np.median(often)) <= MAX_UNEVEN_STAMP_SHARE * often.size)


def _candidates(estimate: float, expected: float | None) -> Iterator[float]:
    """The sample times [s] that are tried: the machine's, round ones near the estimate, the estimate itself."""
    if expected is not None:
        yield expected
    for digits in range(1, DIGITS + 1):
        yield float(f"{estimate:.{digits}g}")
    yield estimate


def _grid(step: Array) -> float | None:
    """The grid [s] on which all steps of rounded stamps lie; None where there is none."""
    rises = np.unique(step[step > 0])
    apart = np.diff(rises)
    smallest = float(min([rises[0], *apart[apart > STEP_NOISE * rises[0]]]))
    rises = step[step > 0]
    counts = np.round(rises / smallest)
    if float(np.max(np.abs(rises / smallest - counts))) > ON_GRID:
        return None
    grid = float(np.sum(rises)) / float(np.sum(counts))
    short = float(f"{grid:.3g}")
    return short if abs(short / grid - 1) < ON_GRID / float(np.max(np.cumsum(counts))) else grid


def _uneven(time: Array, step: Array, name: str, sample_time: float) -> str:
    """The sentence for times that don't belong to a constant sample time."""
    rises = np.flatnonzero(step > 0)
    apart = np.diff(time[rises + 1])
    usual = float(np.median(apart)) if apart.size else 0.0
    gaps = np.flatnonzero(apart > 1.5 * usual)
    if rises.size < step.size and 0 < gaps.size < 0.1 * apart.size:
        first = rises[gaps[0] + 1]
        missing = round(float(np.sum(apart[gaps] - usual)) / sample_time)
        return (
            f"about {missing} samples are missing, the first after row {first + 1} at {show(float(time[first]), 's')}"
            f", where the times in {name!r} jump by {show(float(step[first]), 's')}; give the part before or after as "
            f"a record of its own, or, {counted(sample_time)}"
        )
    middle = float(np.median(step))
    odd = np.flatnonzero(np.abs(step - middle) > UNEVEN * middle)
    if 0 < odd.size <= MAX_ODD_SHARE * step.size:
        return (
            f"uneven sampling: {odd.size} of {step.size} steps of {name!r} {'is' if odd.size == 1 else 'are'} not "
            f"{show(middle, 's')}, the first after row {odd[0] + 1} ({show(float(step[odd[0]]), 's')}); correct the "
            f"times there, or, {counted(sample_time)}"
        )
    return (
        f"uneven sampling: steps of {name!r} between {show(float(step.min()), 's')} and "
        f"{show(float(step.max()), 's')}; record with a fixed sample time, resample and say so, or, "
        f"{counted(sample_time)}"
    )
