"""Laws that nobody put into the catalogue, for the tests of what is learned."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from models.effects.base import Effect, Numbers, Place, T, U, V, X, hook
from models.effects.parameter import parameter


@hook
def _bumping(value: float, p: Numbers, now: Numbers, _: Numbers, __: Numbers) -> float:
    return value - p[0] * math.exp(-(((now[X] - p[1]) / p[2]) ** 2))


@dataclass(frozen=True)
class Bump(Effect):
    """A force at one place of the track, the same both ways."""

    name: ClassVar = "bump"
    family: ClassVar = "structure"
    equation: ClassVar = r"-F e^{-((x-x_0)/w)^2}"
    source: ClassVar = "assumed: for a test"
    hooks: ClassVar = {Place.FORCE: _bumping}
    size: float = parameter("N", "size F", 1.0, 10.0, "amplitude")
    place: float = parameter("m", "place x_0", 1e-3, 1e-1, "shape")
    width: float = parameter("m", "width w", 1e-3, 1e-2, "shape")

    def force(self, x: float) -> float:
        """The force on the table [N] at a position [m]."""
        return -self.size * math.exp(-(((x - self.place) / self.width) ** 2))


@hook
def _leaning(value: float, p: Numbers, now: Numbers, _: Numbers, __: Numbers) -> float:
    bent = (now[X] - p[1]) / p[2]
    if bent > 30.0:
        return value - p[0] * p[2] * bent
    return value - p[0] * p[2] * math.log(1.0 + math.exp(bent))


@dataclass(frozen=True)
class OneSided(Effect):
    """A spring that the table leans on from one place on, with a rounded beginning."""

    name: ClassVar = "one_sided"
    family: ClassVar = "structure"
    equation: ClassVar = r"-k w \ln(1 + e^{(x-x_0)/w})"
    source: ClassVar = "assumed: for a test"
    hooks: ClassVar = {Place.FORCE: _leaning}
    stiffness: float = parameter("N/m", "stiffness k", 10.0, 1e4, "amplitude")
    place: float = parameter("m", "place x_0", 1e-3, 1e-1, "shape")
    width: float = parameter("m", "width w", 1e-4, 1e-2, "shape")

    def force(self, x: float) -> float:
        """The force on the table [N] at a position [m]."""
        return -self.stiffness * self.width * math.log1p(math.exp((x - self.place) / self.width))


@hook
def _rubbing(value: float, p: Numbers, now: Numbers, _: Numbers, __: Numbers) -> float:
    return value * (1.0 + p[0] * math.exp(-(((now[X] - p[1]) / p[2]) ** 2)))


@dataclass(frozen=True)
class Joint(Effect):
    """More friction at one place of the guide, where two rails meet."""

    name: ClassVar = "joint"
    family: ClassVar = "friction"
    equation: ClassVar = r"F(1 + a e^{-((x-x_0)/w)^2})"
    source: ClassVar = "assumed: for a test"
    hooks: ClassVar = {Place.FRICTION: _rubbing}
    part: float = parameter("1", "part a", 0.1, 1.0, "amplitude")
    place: float = parameter("m", "place x_0", 1e-3, 1e-1, "shape")
    width: float = parameter("m", "width w", 1e-4, 1e-2, "shape")

    def force(self, x: float, coulomb: float) -> float:
        """The force on the table [N] at a position [m] in motion forwards; coulomb: the friction elsewhere [N]."""
        return -coulomb * self.part * math.exp(-(((x - self.place) / self.width) ** 2))


@hook
def _braking(value: float, p: Numbers, now: Numbers, _: Numbers, __: Numbers) -> float:
    return value - p[0] * now[V] * math.exp(-(((now[X] - p[1]) / p[2]) ** 2))


@dataclass(frozen=True)
class Brake(Effect):
    """A drag at one place of the track, as of a magnet beside it."""

    name: ClassVar = "brake"
    family: ClassVar = "structure"
    equation: ClassVar = r"-c v e^{-((x-x_0)/w)^2}"
    source: ClassVar = "assumed: for a test"
    hooks: ClassVar = {Place.FORCE: _braking}
    drag: float = parameter("N s/m", "drag c", 1.0, 1e3, "amplitude")
    place: float = parameter("m", "place x_0", 1e-3, 1e-1, "shape")
    width: float = parameter("m", "width w", 1e-3, 1e-2, "shape")

    def coefficient(self, x: float) -> float:
        """The force on the table per speed [N s/m] at a position [m]."""
        return -self.drag * math.exp(-(((x - self.place) / self.width) ** 2))


@hook
def _fading(value: float, p: Numbers, now: Numbers, _: Numbers, __: Numbers) -> float:
    return value - p[0] * (1.0 - math.exp(-now[T] / p[1])) * now[U]


@dataclass(frozen=True)
class Fade(Effect):
    """A motor that gives less thrust as it warms up."""

    name: ClassVar = "fade"
    family: ClassVar = "structure"
    equation: ClassVar = r"-a(1-e^{-t/\tau})u"
    source: ClassVar = "assumed: for a test"
    hooks: ClassVar = {Place.FORCE: _fading}
    part: float = parameter("1", "part a", 0.01, 1.0, "amplitude")
    constant: float = parameter("s", "time constant tau", 0.1, 100.0, "shape")

    def share(self, time: float) -> float:
        """The force on the table per thrust reference [1] at a time [s] after the record began."""
        return -self.part * (1.0 - math.exp(-time / self.constant))
