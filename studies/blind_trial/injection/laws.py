"""The laws that are injected, each in a form of its own; the force that the drive has to put out beside what it did.

A form differs from its catalogue entry on purpose: harmonics, another dependence on speed, a hardening spring, a Dahl
turn of friction in place of slipping contacts. Imports nothing of the models or the diagnosis: how long a period or
how low a speed a machine gives to a law of this name is told in numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from studies.blind_trial.injection.motion import Course, dragged, since_reversal, stretched

Array = NDArray[np.float64]
Shape = Mapping[str, float]
Ranges = Mapping[tuple[str, str], tuple[float, float]]
Draw = Callable[["Chance", Course], dict[str, float]]

INSIDE: Final = 0.1  # of a range, in its logarithm, that is left out at either end
LONGEST_PERIOD: Final = 0.5  # of the travel: a longer one does not repeat in the record


@dataclass(frozen=True)
class Chance:
    """A draw: `third` 0, 1 or 2 says from which third of its range the phase, or the first size, is drawn."""

    rng: np.random.Generator
    third: int
    ranges: Ranges

    def part(self) -> float:
        """A number 0 .. 1 in this third [1]."""
        return (self.third + float(self.rng.random())) / 3

    def phase(self) -> float:
        """A phase 0 .. 2 pi in this third [rad]."""
        return 2 * np.pi * self.part()

    def between(self, low: float, high: float, *, stratified: bool = True) -> float:
        """A size, evenly in its logarithm [its unit]."""
        share = self.part() if stratified else float(self.rng.random())
        return float(low * (high / low) ** share)

    def size_of(self, effect: str, name: str, *, most: float = np.inf, stratified: bool = True) -> float:
        """A size within the range that the machine gives to an effect's parameter, and below `most` [its unit]."""
        low, high = self.ranges[effect, name]
        low, high = (low * (high / low) ** share for share in (INSIDE, 1 - INSIDE))
        return self.between(min(low, 0.8 * most), min(high, most), stratified=stratified)


@dataclass(frozen=True)
class Injected:
    """One law: the effect's name in the catalogue, or what a reader calls an outsider; its kind as labels have it; the
    unit of its size; its form in words; how its shape is drawn; the force (n,) [N] at a size; the shape's period, if it
    has one, and which parameter of the catalogue that is."""

    key: str
    name: str
    kind: str
    unit: str
    form: str
    draw: Draw
    force: Callable[[Course, float, Shape], Array]
    period: str = ""


def _friction(path: Course, size: float) -> Array:
    return size * dragged(path.position, path.soft)


def _cogging(path: Course, size: float, shape: Shape) -> Array:
    angle = 2 * np.pi * path.position / shape["period"] + shape["phase"]
    return np.asarray(size * (np.sin(angle) + 0.3 * np.sin(3 * angle + 1.0)))


def _spring(path: Course, size: float, shape: Shape) -> Array:
    """Hardening, and much weaker on one side."""
    stretch = (path.position - path.middle) / path.length - shape["place"]
    hard = stretch * (1 + 2 * stretch**2)
    return np.asarray(size * path.length * np.where(stretch > 0, hard, 0.3 * hard))


def _along(path: Course, size: float, shape: Shape) -> Array:
    """A rounded triangle along the guide."""
    angle = 2 * np.pi * path.position / shape["period"] + shape["phase"]
    return np.asarray(_friction(path, size) * np.arcsin(0.95 * np.sin(angle)) / np.arcsin(0.95))


def _warming(path: Course, size: float, shape: Shape) -> Array:
    return np.asarray(_friction(path, size) * (1 - np.exp(-path.time / shape["time"])))


def _stribeck(path: Course, size: float, shape: Shape) -> Array:
    return np.asarray(_friction(path, size) / (1 + (path.speed / shape["speed"]) ** 2))


def _one_way(path: Course, size: float, shape: Shape) -> Array:
    return np.asarray(np.maximum(_friction(path, size) * shape["way"], 0) * shape["way"])


def _power(path: Course, size: float, shape: Shape) -> Array:
    fastest = float(np.max(np.abs(path.speed)))
    return np.asarray(_friction(path, size) * (np.abs(path.speed) / fastest) ** shape["power"])


def _ripple(path: Course, size: float, shape: Shape) -> Array:
    """What the drive has to put out more where its thrust constant is smaller."""
    angle = 2 * np.pi * path.position / shape["period"] + shape["phase"]
    weaker = size * (np.sin(angle) + 0.2 * np.sin(2 * angle + 0.5))
    return np.asarray(path.command * (1 / (1 - weaker) - 1))


def _lopsided(path: Course, size: float, shape: Shape) -> Array:
    """The amplifier is weaker one way: smoothly, over a twentieth of the largest command."""
    over = float(np.max(np.abs(path.command))) / 20
    weaker = size * 0.5 * (1 + np.tanh(shape["way"] * path.command / over))
    return np.asarray(path.command * (1 / (1 - weaker) - 1))


def _viscous(path: Course, size: float, _: Shape) -> Array:
    fastest = float(np.max(np.abs(path.speed)))
    return np.asarray(size * fastest * np.tanh(path.speed / fastest))


def _rising(path: Course, size: float, shape: Shape) -> Array:
    path_since = since_reversal(path.position, path.soft)
    return np.asarray(_friction(path, size) * (1 - np.exp(-path_since / shape["length"])))


def _bump(path: Course, size: float, shape: Shape) -> Array:
    away = (path.position - path.middle - shape["place"]) / shape["width"]
    return np.asarray(size * np.exp(-(away**2)))


def _backlash(path: Course, size: float, shape: Shape) -> Array:
    return size * stretched(path.position, shape["reach"])


def _mass(path: Course, size: float, _: Shape) -> Array:
    return size * path.acceleration


def _level(path: Course, size: float, _: Shape) -> Array:
    return _friction(path, size)


def _period_of(effect: str, name: str) -> Draw:
    def draw(chance: Chance, path: Course) -> dict[str, float]:
        most = LONGEST_PERIOD * path.length
        return {"period": chance.size_of(effect, name, most=most, stratified=False), "phase": chance.phase()}

    return draw


def _nothing(_: Chance, __: Course) -> dict[str, float]:
    return {}


def _way(chance: Chance, _: Course) -> dict[str, float]:
    return {"way": float(chance.rng.choice([-1, 1]))}


LAWS: Final = (
    Injected(
        "cogging", "cogging", "single", "N", "two harmonics along the travel", _period_of("cogging", "pitch"), _cogging,
        "pitch",
    ),
    Injected(
        "spring", "cable_spring", "single", "N/m", "hardening, three times as stiff on one side",
        lambda chance, _: {"place": 0.6 * chance.part() - 0.3}, _spring,
    ),
    Injected(
        "friction_along", "position_dependent_friction", "single", "N", "a rounded triangle along the guide",
        _period_of("position_dependent_friction", "length"), _along, "length",
    ),
    Injected(
        "friction_warming", "friction_drift", "single", "N", "rises exponentially to an end",
        lambda chance, path: {"time": float(path.time[-1]) * chance.between(0.3, 2.0)}, _warming,
    ),
    Injected(
        "low_speed", "stribeck", "single", "N", "a Lorentzian of the speed",
        lambda chance, _: {"speed": chance.size_of("stribeck", "speed")}, _stribeck,
    ),
    Injected(
        "one_way", "directional_friction", "single", "N", "one direction alone has more, after Dahl", _way, _one_way
    ),
    Injected(
        "power_of_speed", "velocity_strengthening", "single", "N", "a power of the speed",
        lambda chance, _: {"power": chance.between(0.15, 0.5)}, _power,
    ),
    Injected(
        "thrust_along", "thrust_ripple", "single", "1", "divides the command, two harmonics",
        _period_of("thrust_ripple", "pitch"), _ripple, "pitch",
    ),
    Injected("thrust_one_way", "gain_asymmetry", "single", "1", "a smooth knee at no command", _way, _lopsided),
    Injected("drag", "viscous_friction", "single", "N s/m", "levels off with the speed", _nothing, _viscous),
    Injected(
        "over_path", "friction_over_path_since_reversal", "outsider", "N", "grows over the path since the axis turned",
        lambda chance, path: {"length": path.length * chance.between(0.02, 0.3)}, _rising,
    ),
    Injected(
        "bump", "force_at_one_place", "outsider", "N", "a Gaussian at one place, the same both ways",
        lambda chance, path: {
            "place": path.length * (0.6 * chance.part() - 0.3),
            "width": path.length * chance.between(0.01, 0.05, stratified=False),
        },
        _bump,
    ),
    Injected(
        "backlash", "slipping_spring", "outsider", "N", "a long spring that slips at its ends",
        lambda chance, path: {"reach": path.length * chance.between(0.005, 0.05)}, _backlash,
    ),
    Injected("mass", "payload_mass", "parameters", "kg", "more mass", _nothing, _mass),
    Injected("level", "friction_level", "parameters", "N", "more friction, after Dahl", _nothing, _level),
)  # fmt: skip
