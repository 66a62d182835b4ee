"""Candidate causes unknown to the design of the paper's table: the effects of the catalogue, and wrong parameters.

A candidate maps a point u (k,) of the unit cube to one size of itself. Amplitudes, widths and shapes are uniform in
the logarithm over their prior ranges, of either sign where the effect has one; phases and errors of a parameter are
uniform.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Final

from models.effects import base, catalogue
from models.machine import Machine, Tolerance
from models.quantity import declaration
from models.variation import Variation, varied

FRICTION: Final = 0.3  # The assumed largest relative error of the identified friction.
USUAL: Final = Tolerance()
BOUND: Final = 3.0  # The largest error of another parameter, in standard deviations of USUAL.


@dataclass(frozen=True)
class Range:
    """One number of a candidate, from low to high (SI): logarithmic, of either sign, or neither (uniform).

    end: the largest value that its law allows. whole: 0 or 1.
    """

    name: str
    unit: str
    low: float
    high: float
    logarithmic: bool = True
    signed: bool = False
    end: float = math.inf
    whole: bool = False

    def at(self, u: float) -> float:
        """The number (SI) at u, 0 .. 1; a signed one is negative in the lower half, largest at both ends."""
        if not self.logarithmic:
            number = self.low + u * (self.high - self.low)
            return round(number) if self.whole else number
        sign, place = (math.copysign(1.0, u - 0.5), abs(2 * u - 1)) if self.signed else (1.0, u)
        return sign * self.low * math.exp(place * math.log(self.high / self.low))


@dataclass(frozen=True)
class Candidate:
    """One possible cause. `size` is the index in `ranges` of its magnitude."""

    name: str
    family: str
    equation: str
    ranges: tuple[Range, ...]
    size: int
    put: Callable[[Machine, tuple[float, ...]], Machine]

    def values(self, u: Sequence[float]) -> tuple[float, ...]:
        """The numbers (SI) at a point u (k,) of the unit cube."""
        return tuple(one.at(place) for one, place in zip(self.ranges, u, strict=True))


def every() -> Mapping[str, Candidate]:
    """The candidates by name: effects in the order in which they act, then parameters."""
    found = [_of_effect(kind) for kind in catalogue.looked_for().values()]
    return {one.name: one for one in (*found, *_of_parameters())}


def beyond(one: Candidate, most: float) -> Candidate:
    """The candidate with its size from the prior's end to `most` [1] times it, or as far as its law allows."""
    size = one.ranges[one.size]
    wider = replace(size, low=size.high, high=min(most * size.high, size.end))
    ranges = tuple(wider if i == one.size else range_ for i, range_ in enumerate(one.ranges))
    return replace(one, ranges=ranges)


def both(first: Candidate, second: Candidate) -> Candidate:
    """Two candidates at once; the first one's size counts."""
    count = len(first.ranges)

    def put(machine: Machine, values: tuple[float, ...]) -> Machine:
        return first.put(second.put(machine, values[count:]), values[:count])

    ranges = (*first.ranges, *second.ranges)
    law = rf"{first.equation};\quad {second.equation}"
    return Candidate(f"{first.name}+{second.name}", first.family, law, ranges, first.size, put)


def wrong_friction() -> Candidate:
    """Friction level and presliding length, both wrong."""
    found = every()
    return both(found["friction_level"], found["presliding_length"])


def _of_effect(kind: type[base.Effect]) -> Candidate:
    given = base.parameters(kind)
    declared = {field.name: declaration(field) for field in fields(kind)}
    ranges = []
    for one in given:
        below = getattr(declared[one.name], "below", None)
        end = math.inf if below is None else 0.99 * below
        signed = one.low < 0
        least = one.typical**2 / one.high if signed else one.low  # the typical size is the geometric middle
        ranges.append(
            Range(
                one.name,
                one.unit,
                least,
                one.high,
                one.role not in {"phase", "switch"},
                signed,
                end,
                one.role == "switch",
            )
        )

    def put(machine: Machine, values: tuple[float, ...]) -> Machine:
        return replace(machine, effects=catalogue.in_order((*machine.effects, kind(*values))))

    size = next(i for i, one in enumerate(given) if one.role in {"amplitude", "width"})
    return Candidate(kind.name, kind.family, kind.equation, tuple(ranges), size, put)


def _of_parameters() -> tuple[Candidate, ...]:
    """Parameters that the design may have wrong: the table's is 1 + e times the design's, or larger by e."""

    def off(name: str, law: str, most: float, error: Callable[[float], Variation], unit: str = "1") -> Candidate:
        ranges = (Range(name, unit, -most, most, logarithmic=False),)
        return Candidate(name, "parameters", law, ranges, 0, lambda machine, values: varied(machine, error(values[0])))

    return (
        off("friction_level", r"(1+e)\,K_i", FRICTION, lambda e: Variation(friction_force=e)),
        off("presliding_length", r"(1+e)\,X_i,\quad K_i/(1+e)", FRICTION, lambda e: Variation(friction_length=e)),
        off("payload_mass", r"(1+e)\,M", BOUND * USUAL.mass, lambda e: Variation(mass=e)),
        off("mode_frequency", r"(1+e)\,\omega_{ti}", BOUND * USUAL.frequency, lambda e: Variation(frequency=e)),
        off("mode_damping", r"(1+e)\,\zeta_{ti}", BOUND * USUAL.damping, lambda e: Variation(damping=e)),
        off("dead_time", r"L+e", BOUND * USUAL.dead_time, lambda e: Variation(dead_time=e), "s"),
    )
