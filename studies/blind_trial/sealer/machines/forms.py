"""The laws that are sealed on drawn machines: each effect of the catalogue in two or more forms, none of them its own.

Sizes are relative to the machine: its friction, presliding range, speeds, travel, reading, sample time. Each form has
one size, searched for between `low` and `high` from `middle` on, and a shape drawn at random.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from studies.blind_trial.sealer.machines.axis import Axis
from studies.blind_trial.sealer.machines.simulation import Change

Array = NDArray[np.float64]
Shape = Mapping[str, float]


@dataclass(frozen=True)
class Units:
    """What sizes are measured in, SI: of the machine, its friction, presliding range and reading; the experiment's
    span [m], length [s] and largest command [N].
    """

    axis: Axis
    span: float
    lasts: float
    peak: float

    @property
    def friction(self) -> float:
        """[N]"""
        return self.axis.friction

    @property
    def reach(self) -> float:
        """[m]"""
        return self.axis.reach

    @property
    def speed(self) -> float:
        """The largest [m/s] that moves over the span have."""
        return min(self.axis.speed, float(np.sqrt(self.span * self.axis.acceleration)))


Draw = tuple[float, float]
Ranges = Callable[[Units], Mapping[str, Draw]]


@dataclass(frozen=True)
class Form:
    """One law for one effect: where its size lies in `unit`, what shape it may have, and what it changes."""

    effect: str
    text: str
    unit: str
    sizes: Callable[[Units], tuple[float, float, float]]
    ranges: Ranges
    change: Callable[[float, Shape, Units], Change]
    coordinates: tuple[str, ...] = ()

    def shape(self, units: Units, rng: np.random.Generator) -> dict[str, float]:
        """Drawn evenly in the logarithm, or evenly where a range begins at 0 or below."""
        return {
            name: float(rng.uniform(low, high) if low <= 0 else np.exp(rng.uniform(np.log(low), np.log(high))))
            for name, (low, high) in self.ranges(units).items()
        }


def none(_: Units) -> Mapping[str, Draw]:
    """No shape to draw."""
    return {}


def share(low: float, middle: float, high: float) -> Callable[[Units], tuple[float, float, float]]:
    """A range of sizes without a unit: least, where the search begins, most."""
    return lambda _: (low, middle, high)


def times(
    of: Callable[[Units], float], low: float, middle: float, high: float
) -> Callable[[Units], tuple[float, float, float]]:
    """A range of sizes in units of something of the machine."""
    return lambda units: (low * of(units), middle * of(units), high * of(units))


def fields(size: str, form: float | None = None) -> Callable[[float, Shape, Units], Change]:
    """The size and every shape parameter under its name; a `sign` below 0 turns the size."""

    def change(number: float, shape: Shape, _: Units) -> Change:
        sign = -1.0 if shape.get("sign", 1.0) < 0 else 1.0
        named = {name: one for name, one in shape.items() if name != "sign"}
        chosen = {} if form is None else {f"{size}_form": form}
        return Change({size: sign * number, **chosen, **named})

    return change


TURN: Final = (0.0, 2 * np.pi)
EITHER: Final = (-1.0, 1.0)


def friction(units: Units) -> float:
    """The force [N] at which all elements slip."""
    return units.friction


def reach(units: Units) -> float:
    """The longest presliding displacement [m]."""
    return units.reach


def tick(units: Units) -> float:
    """The sample time [s]."""
    return units.axis.sample_time


def drag(units: Units) -> float:
    """The friction over the largest speed [N s/m]."""
    return units.friction / units.speed


def slope(units: Units) -> float:
    """The friction over the span [N/m]."""
    return units.friction / units.span


def rate(units: Units) -> float:
    """A reading's deviation over the length of the experiment [m/s]."""
    return units.axis.read / units.lasts


def reading(units: Units) -> float:
    """A reading's deviation [m]."""
    return units.axis.read


def mass(units: Units) -> float:
    """The mass [kg]."""
    return units.axis.mass


def pitch(units: Units) -> Draw:
    """A range of periods [m]: 1.3 to 8 of them in the span."""
    return units.span / 8, units.span / 1.3


def lines(units: Units) -> Draw:
    """A range of periods [m] of the scale, about the presliding range."""
    low = max(units.reach / 3, 40 * units.axis.read)
    return low, max(3 * units.reach, 3 * low)
