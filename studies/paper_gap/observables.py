"""Observables of an experiment: departures of reading and command from the prediction of the table's model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.experiments.schedules import Schedule

Array = NDArray[np.float64]

MOVES: Final = ("reversal up", "inching up", "reversal down", "inching down")  # of a rung
# Settling times after the settling of x_T*: the window over which a motion's departure is averaged.
WINDOW: Final = (0.2, 0.6)


@dataclass(frozen=True)
class Plan:
    """A schedule, and where its motions begin: `moves` (sample, direction, settling of x_T* [s]), rung by rung.

    strokes: of the rungs [m].
    """

    schedule: Schedule
    moves: tuple[tuple[int, int, float], ...] = ()
    strokes: tuple[float, ...] = ()


@dataclass(frozen=True)
class Departure:
    """Readings (n,) [m] and commands (n,) [N] with the candidate minus those without, over a plan.

    settling: the specified settling time [s].
    """

    plan: Plan
    sample_time: float
    settling: float
    reading: Array
    command: Array

    def of_moves(self) -> Array:
        """The mean reading (rungs, 4) [m] in WINDOW behind the settling of x_T*, positive where the table is too far.

        Columns: MOVES. The first of a rung follows another rung's rest and stroke, so it is not used.
        """
        found = []
        for start, direction, settling in self.plan.moves:
            begin, end = (start + round((settling + after * self.settling) / self.sample_time) for after in WINDOW)
            found.append(direction * float(np.mean(self.reading[begin:end])))
        return np.array(found).reshape(-1, len(MOVES))

    def halves(self) -> tuple[Array, Array]:
        """The commands (n,) [N] of the middle eight tenths of the way there and back, by place."""
        path = self.plan.schedule.given.position
        top, span = int(np.argmax(path)), float(np.max(path))
        there = (path > 0.1 * span) & (path < 0.9 * span) & (np.arange(path.size) < top)
        back = (path > 0.1 * span) & (path < 0.9 * span) & (np.arange(path.size) > top)
        return self.command[there], self.command[back][::-1]


@dataclass(frozen=True)
class Observable:
    """A number read from an experiment's departures; unit "m" or "N"."""

    name: str
    unit: str
    read: Callable[[Departure], float]


def _inching_of(seen: Departure) -> Array:
    """Of each rung [m]."""
    return np.asarray(seen.of_moves()[:, [1, 3]].mean(axis=1))


def _reversal_of(seen: Departure) -> Array:
    """Of each rung [m]."""
    return seen.of_moves()[:, 2]


def _inching_first_last(seen: Departure) -> float:
    return float(_inching_of(seen)[0] - _inching_of(seen)[-1])


def _reversal_first_last(seen: Departure) -> float:
    return float(_reversal_of(seen)[0] - _reversal_of(seen)[-1])


def _up_down(seen: Departure) -> float:
    return float(np.mean(seen.of_moves()[:, 1] - seen.of_moves()[:, 3]))


def _up_down_first(seen: Departure) -> float:
    return float(seen.of_moves()[0, 1] - seen.of_moves()[0, 3])


def _up_down_last(seen: Departure) -> float:
    return float(seen.of_moves()[-1, 1] - seen.of_moves()[-1, 3])


def _inching_reversal(seen: Departure) -> float:
    return float(np.mean(_inching_of(seen) - _reversal_of(seen)))


def _inching_last(seen: Departure) -> float:
    return float(_inching_of(seen)[-1])


def _inching_stroke(seen: Departure) -> float:
    return float(_inching_of(seen)[-1] - _ratio(seen) * _inching_of(seen)[0])


def _reversal_stroke(seen: Departure) -> float:
    return float(_reversal_of(seen)[-1] - _ratio(seen) * _reversal_of(seen)[0])


def _second_half(seen: Departure) -> slice:
    """After the motion and half of the rest."""
    return slice(seen.command.size // 2, seen.command.size)


def _reading(seen: Departure) -> float:
    return float(np.sqrt(np.mean(seen.reading**2)))


def _hold_reading(seen: Departure) -> float:
    return float(np.sqrt(np.mean(seen.reading[_second_half(seen)] ** 2)))


def _hold_command(seen: Departure) -> float:
    first = round(0.5 / seen.sample_time)  # the motion itself
    middle = seen.command.size // 2
    return float(np.mean(seen.command[middle:]) - np.mean(seen.command[first:middle]))


def _slow_odd(seen: Departure) -> float:
    there, back = seen.halves()
    return float(np.mean(there) - np.mean(back)) / 2


def _slow_even(seen: Departure) -> float:
    there, back = seen.halves()
    return float(np.mean(there) + np.mean(back)) / 2


def _slow_place(seen: Departure) -> float:
    there, back = seen.halves()
    far = [float(np.mean(way[way.size // 2 :]) - np.mean(way[: way.size // 2])) for way in (there, back)]
    return sum(far) / 2


def _ratio(seen: Departure) -> float:
    """Of the largest stroke to the smallest."""
    return seen.plan.strokes[-1] / seen.plan.strokes[0]


RESTS: Final = (
    Observable("inching: after the shortest rest less after the longest", "m", _inching_first_last),
    Observable("reversal: after the shortest rest less after the longest", "m", _reversal_first_last),
    Observable("all rests: up less down", "m", _up_down),
    Observable("all rests: inching less reversal", "m", _inching_reversal),
)
STROKES: Final = (
    Observable("inching: the largest stroke less the smallest times their ratio", "m", _inching_stroke),
    Observable("reversal: the largest stroke less the smallest times their ratio", "m", _reversal_stroke),
    Observable("largest stroke: up less down", "m", _up_down_last),
)
TIMES: Final = (
    Observable("inching: the shortest time less the longest", "m", _inching_first_last),
    Observable("reversal: the shortest time less the longest", "m", _reversal_first_last),
    Observable("shortest time: up less down", "m", _up_down_first),
    Observable("longest time: inching", "m", _inching_last),
)
HOLD: Final = (
    Observable("reading: rms", "m", _hold_reading),
    Observable("command: second half less first", "N", _hold_command),
)
SLOW_STROKES: Final = (
    Observable("command: half the difference there and back", "N", _slow_odd),
    Observable("command: half the sum there and back", "N", _slow_even),
    Observable("command: second half of the way less first", "N", _slow_place),
    Observable("reading: rms", "m", _reading),
)
