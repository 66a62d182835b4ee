"""How the scale may show another position than the table's."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from models.effects.base import Effect, Numbers, Place, T, hook
from models.effects.parameter import parameter, period, phase


@hook
def _drifting(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    return value + p[0] * now[T]


@dataclass(frozen=True)
class ScaleDrift(Effect):
    """The scale's zero wanders."""

    name: ClassVar = "scale_drift"
    family: ClassVar = "scale"
    coordinate: ClassVar = "time"
    parity: ClassVar = "even"
    equation: ClassVar = r"x+r\,t"
    source: ClassVar = (
        "Bryan 1990, International status of thermal error research; at a constant rate, and sizes: assumed"
    )
    hooks: ClassVar = {Place.READING: _drifting}
    rate: float = parameter("m/s", "rate r", 1e-8, 3e-7, "amplitude", signed=True)


@hook
def _periodic(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    amplitude, length, angle = p[0], p[1], p[2]
    return value + amplitude * math.sin(2.0 * math.pi * value / length + angle)


@dataclass(frozen=True)
class ScalePeriodicError(Effect):
    """The interpolation between the scale's lines errs, with their period."""

    name: ClassVar = "scale_periodic_error"
    family: ClassVar = "scale"
    coordinate: ClassVar = "position"
    parity: ClassVar = "even"
    equation: ClassVar = r"x+e\sin(2\pi x/P+\varphi)"
    source: ClassVar = (
        "Heydemann 1981, Determination and correction of quadrature fringe measurement errors; sizes assumed"
    )
    hooks: ClassVar = {Place.READING: _periodic}
    amplitude: float = parameter("m", "amplitude e", 2e-8, 2e-7, "amplitude", at_least=0)
    period: float = period("m", "period P", 4e-6, 4e-5, "reading", linear_within=1e-5, above=0)
    phase: float = phase()


@hook
def _stretched(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    return value + p[0] * value


@dataclass(frozen=True)
class ScaleGainError(Effect):
    """The scale is too long or too short; position and thrust alone can't show it."""

    name: ClassVar = "scale_gain_error"
    family: ClassVar = "scale"
    coordinate: ClassVar = "position"
    parity: ClassVar = "odd"
    equation: ClassVar = r"x(1+e)"
    source: ClassVar = "assumed: calibration and temperature; 100 ppm are a wrong setting rather than a warm scale"
    hooks: ClassVar = {Place.READING: _stretched}
    shows_in: ClassVar = "nothing"  # a longer scale looks like a lighter table on softer contacts
    error: float = parameter("1", "relative error e", 1e-4, 5e-3, "amplitude", signed=True, above=-1)
