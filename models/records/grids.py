"""Signals whose samples were taken at other times, on one grid of times: where the grids agree, never by interpolation.

The grid of the slowest signal is kept where all signals have samples. Of a faster signal those samples are taken that
fall on it; a signal that has none there makes the record unusable, as a value between samples would be an assumption.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.quantity import show
from models.records.tables.sizes import RecordError

Array = NDArray[np.float64]

SAME_TIME_SHARE: Final = 0.01  # of the slowest signal's step: two times that are closer are one


def on_one_grid(
    signals: Mapping[str, Array], clocks: Mapping[str, str], times: Mapping[str, Array]
) -> tuple[dict[str, Array], Array, tuple[str, ...]]:
    """The signals (n,) [as given] on the grid of the slowest, its times (n,) [s], and a sentence for each that changed.

    clocks: signal -> name of its clock. times: clock -> its times [s]. Raises RecordError where the grids do not agree.
    """
    for clock in {clocks[signal] for signal in signals}:
        if times[clock].size < 2 or not np.all(np.diff(times[clock]) > 0):
            raise RecordError(f"the times {clock!r} do not rise from sample to sample; export the file again")
    for signal in signals:
        if signals[signal].size != times[clocks[signal]].size:
            raise RecordError(
                f"the {signal} has {signals[signal].size} samples and its times {clocks[signal]!r} have "
                f"{times[clocks[signal]].size}; export the file again"
            )
    slowest = max(signals, key=lambda signal: _step(times[clocks[signal]]))
    grid = times[clocks[slowest]]
    step = _step(grid)
    first = max(times[clocks[signal]][0] for signal in signals) - SAME_TIME_SHARE * step
    last = min(times[clocks[signal]][-1] for signal in signals) + SAME_TIME_SHARE * step
    kept = grid[(grid >= first) & (grid <= last)]
    placed, said = {}, []
    for signal, column in signals.items():
        own = times[clocks[signal]]
        nearest = _nearest(own, kept)
        if kept.size < 2 or np.any(np.abs(own[nearest] - kept) > SAME_TIME_SHARE * step):
            raise RecordError(_apart(signal, own, slowest, grid))
        placed[signal] = column[nearest]
        if kept.size != own.size:
            said.append(
                f"The {signal} was sampled every {show(_step(own), 's')} at {own.size:,} times; the {kept.size:,} "
                f"samples that fall on those of all other signals are used."
            )
    return placed, kept, tuple(said)


def _step(times: Array) -> float:
    return float(np.median(np.diff(times)))


def _nearest(times: Array, wanted: Array) -> NDArray[np.intp]:
    """Where in `times` (m,) each of the wanted times (n,) is nearest."""
    behind = np.clip(np.searchsorted(times, wanted), 1, times.size - 1)
    nearest = np.where(wanted - times[behind - 1] <= times[behind] - wanted, behind - 1, behind)
    return np.asarray(nearest, np.intp)


def _apart(signal: str, own: Array, other: str, grid: Array) -> str:
    return (
        f"the {signal} is sampled every {show(_step(own), 's')} from {show(float(own[0]), 's')} on and the {other} "
        f"every {show(_step(grid), 's')} from {show(float(grid[0]), 's')} on, at other times; record both in one task, "
        "or resample them yourself"
    )
