"""What is fitted: the lines of one frequency response or of several of one machine, and the structure of the plant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.identification.modal.transfer import Array, Complex
from models.identification.response import FrequencyResponse

OPTIONAL_PARTS: Final = ("lag", "drag", "spring")  # what may be beside the modes, in the order of theta


@dataclass(frozen=True)
class Structure:
    """What is fitted beside a rigid body, a dead time and modes."""

    lag: bool = False
    drag: bool = False
    spring: bool = False

    @property
    def before(self) -> int:
        """How many of theta stand before those of the modes."""
        return 2 + len(self.parts)

    @property
    def parts(self) -> tuple[str, ...]:
        """The names of what there is, in the order of theta."""
        return tuple(name for name in OPTIONAL_PARTS if getattr(self, name))

    def index(self, part: str) -> int:
        """Which of theta stands for one of `parts`."""
        return 2 + self.parts.index(part)

    def without(self, part: str) -> Structure:
        """The same without one of `parts`."""
        return Structure(**{name: name != part for name in self.parts})


@dataclass(frozen=True)
class Lines:
    """One response: P (n,) [m/N] at f (n,) [Hz] with weights (n,), the sample time [s], for how long a command is held
    [s], and U (n,) or None; settled [s]: for how long before it the excitation was the same as in it; slope [m per
    sample]: of the straight line that was taken off the position; levelled: whether one was off the command, too."""

    f: Array
    p: Complex
    weight: Array
    ts: float
    hold: float
    command: Complex | None
    settled: float = 0.0
    slope: float = 0.0
    levelled: bool = False

    @property
    def single(self) -> bool:
        """Whether this is a single sweep, whose lines are as near each other as its length allows."""
        return self.command is not None and self.settled == 0

    @cached_property
    def back(self) -> Complex:
        """exp(-s h) (n,) [1]: a sample back."""
        return np.asarray(np.exp(-2j * math.pi * self.f * self.ts))

    @cached_property
    def held_back(self) -> Complex:
        """exp(-s h) (n,) [1] of the hold."""
        return np.asarray(np.exp(-2j * math.pi * self.f * self.hold))

    @cached_property
    def scale(self) -> Complex:
        """Weighted errors (n,) that a unit of the position's spectrum makes [1]."""
        assert self.command is not None
        return np.asarray(self.weight / self.command)

    def up_to(self, top: float) -> Lines:
        """The lines up to a frequency [Hz]."""
        return self._of(np.flatnonzero(self.f <= top))

    def thinned(self, most: int) -> Lines:
        """At most so many of the lines, as many over a decade as over another."""
        if self.f.size <= most:
            return self
        return self._of(np.unique(np.searchsorted(self.f, np.geomspace(self.f[0], self.f[-1], most))))

    def kept(self, used: NDArray[np.bool_]) -> Lines:
        """The lines that are used (n,)."""
        return self._of(np.flatnonzero(used))

    def _of(self, some: NDArray[np.intp]) -> Lines:
        command = None if self.command is None else self.command[some]
        return replace(self, f=self.f[some], p=self.p[some], weight=self.weight[some], command=command)


@dataclass(frozen=True)
class Problem:
    """Responses of one machine. known: whether the lines' variances are; else all count alike, relative to their size.
    unit: 1 / w of the highest line [s]; gain: logarithm of the median of w^2 |P| [1/kg], the rigid body's to a factor.
    spring: to ground [N/m], as it is known; a structure with a spring has its own instead.
    """

    lines: tuple[Lines, ...]
    known: bool
    unit: float
    gain: float
    spring: float = 0.0

    @property
    def size(self) -> int:
        """Real equations, two for each line."""
        return 2 * sum(one.f.size for one in self.lines)

    @property
    def band(self) -> tuple[float, float]:
        """The lowest and the highest line [Hz]."""
        return min(float(one.f[0]) for one in self.lines), max(float(one.f[-1]) for one in self.lines)

    def up_to(self, top: float) -> Problem:
        """The lines up to a frequency [Hz], with the rigid body's gain as these show it; theta means the same."""
        lines = tuple(one.up_to(top) for one in self.lines)
        lines = tuple(one for one in lines if one.f.size)
        return replace(self, lines=lines, gain=_gain(lines))

    def thinned(self, most: int) -> Problem:
        """The same with at most so many lines."""
        return replace(self, lines=tuple(one.thinned(most // len(self.lines)) for one in self.lines))


def problem_of(
    measured: Sequence[FrequencyResponse], used: Sequence[NDArray[np.bool_]], spring: float = 0.0
) -> Problem:
    """The problem that the used lines (n,) of the responses [m/N] are; spring [N/m]: as it is known."""
    known = all(bool(np.all(np.isfinite(one.variance))) for one in measured)
    lines = []
    for one, kept in zip(measured, used, strict=True):
        p = one.response[kept]
        weight = np.sqrt(2 / one.variance[kept]) if known else 1 / np.abs(p)
        command = None if one.command is None else one.command[kept]
        line = one.slope, one.levelled
        lines.append(Lines(one.frequency[kept], p, weight, one.sample_time, one.held, command, one.settled, *line))
    unit = 1 / (2 * math.pi * max(float(one.f[-1]) for one in lines))
    return Problem(tuple(lines), known, unit, _gain(lines), spring)


def _gain(lines: Sequence[Lines]) -> float:
    """The logarithm of the median of w^2 |P| [1/kg]."""
    return math.log(float(np.median([np.median(np.abs(one.p) * (2 * math.pi * one.f) ** 2) for one in lines])))
