"""Candidate causes of three kinds: the compensator's design, wrong parameters, and effects that the model lacks.

A candidate maps a point u (k,) of the unit cube to one size of itself. Amplitudes, widths and shapes are uniform in
the logarithm over their prior ranges, of either sign where the effect has one; phases, exponents, weights and errors of
a parameter are uniform.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Final

from design.friction_compensation import simplify
from models.controller import Controller
from models.effects import base, catalogue
from models.friction import Friction
from models.machine import Machine, load
from models.machines.parts import USUAL_TOLERANCE
from models.quantity import declaration
from models.variation import Variation, varied, varied_friction
from studies.paper_gap.compensators import Design, compensator, number, with_compensator

Table = tuple[Machine, Controller]
Values = tuple[float, ...]

FRICTION: Final = 0.5  # The assumed largest relative error of the friction's level and of its presliding length.
BESIDE_FRICTION: Final = 0.3  # The same, where a friction is wrong beside another cause.
# The largest errors of other parameters, in standard deviations of USUAL_TOLERANCE: as far as a diagnosis re-fits them.
MASS_BOUND: Final = 20.0
BOUND: Final = 8.0
SMALLEST: Final = 20.0  # An RFM's smallest limit is at most so many times the friction's,
MIN_LARGEST_SHARE: Final = 0.25  # its largest at least this share of the friction's,
END: Final = 0.1  # and the part of the curve that it is fitted to at least this share.

COMPENSATOR, PARAMETERS, EFFECTS = "compensator", "parameters", "effects"
CANDIDATE_KINDS: Final = (COMPENSATOR, PARAMETERS, EFFECTS)


@dataclass(frozen=True)
class Range:
    """One number of a candidate, from low to high (SI): logarithmic, of either sign, or neither (uniform).

    end: the largest value that its law allows. whole: low, low + 1, ... high, all alike.
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
            return int(min(self.low + u * (self.high - self.low + 1), self.high)) if self.whole else number
        sign, place = (math.copysign(1.0, u - 0.5), abs(2 * u - 1)) if self.signed else (1.0, u)
        return sign * self.low * math.exp(place * math.log(self.high / self.low))


def nominal_friction(machine: Machine, _values: Values) -> Friction:
    """The friction that the compensator's designer believes in, where it is the table's."""
    return machine.friction


@dataclass(frozen=True)
class Candidate:
    """One possible cause. `size` is the index in `ranges` of its magnitude.

    put: what it makes of a table, the machine with its controller, which was designed without it. believed: the
    friction that the compensator's designer believes in.
    """

    name: str
    family: str
    equation: str
    ranges: tuple[Range, ...]
    size: int
    put: Callable[[Table, Values], Table]
    believed: Callable[[Machine, Values], Friction] = nominal_friction

    @property
    def kind(self) -> str:
        """One of CANDIDATE_KINDS."""
        return self.family if self.family in CANDIDATE_KINDS else EFFECTS

    def values(self, u: Sequence[float]) -> Values:
        """The numbers (SI) at a point u (k,) of the unit cube."""
        return tuple(one.at(place) for one, place in zip(self.ranges, u, strict=True))


def every() -> Mapping[str, Candidate]:
    """The candidates by name: effects in the order in which they act, then parameters, then designs."""
    found = [_of_effect(kind) for kind in catalogue.looked_for().values()]
    return {one.name: one for one in (*found, *_of_parameters(), *_of_compensators())}


def beyond(one: Candidate, most: float) -> Candidate:
    """The candidate with its size from the prior's end to `most` [1] times it, or as far as its law allows."""
    size = one.ranges[one.size]
    wider = replace(size, low=size.high, high=min(most * size.high, size.end))
    ranges = tuple(wider if i == one.size else range_ for i, range_ in enumerate(one.ranges))
    return replace(one, ranges=ranges)


def both(first: Candidate, second: Candidate) -> Candidate:
    """Two candidates at once; the first one's size counts."""
    count = len(first.ranges)

    def put(table: Table, values: Values) -> Table:
        return second.put(first.put(table, values[:count]), values[count:])

    def believed(machine: Machine, values: Values) -> Friction:
        return first.believed(machine, values[:count])

    ranges = (*first.ranges, *second.ranges)
    law = rf"{first.equation};\quad {second.equation}"
    return Candidate(f"{first.name}+{second.name}", first.family, law, ranges, first.size, put, believed)


def wrong_friction(most: float = FRICTION) -> Candidate:
    """Friction level and presliding length of the table, both wrong by up to `most` [1]."""
    level, length = Range("level", "1", -most, most, logarithmic=False), Range("length", "1", -most, most, False)

    def put(table: Table, values: Values) -> Table:
        machine, controller = table
        return varied(machine, Variation(friction_force=values[0], friction_length=values[1])), controller

    law = r"(1+e_F)\,F_i,\quad (1+e_X)\,X_i"
    return Candidate("wrong_friction", PARAMETERS, law, (level, length), 0, put)


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

    def put(table: Table, values: Values) -> Table:
        machine, controller = table
        return replace(machine, effects=catalogue.in_order((*machine.effects, kind(*values)))), controller

    size = next(i for i, one in enumerate(given) if one.role in {"amplitude", "width"})
    return Candidate(kind.name, kind.family, kind.equation, tuple(ranges), size, put)


def _of_parameters() -> tuple[Candidate, ...]:
    """Parameters that are not what the design takes them for.

    The table's are 1 + e times the design's, or larger by e. `moving_mass` is the mass that every mode moves; the
    `payload_mass` of a diagnosis is the rigid body's alone. For the friction the other way round as well: the table's
    is as published, and the one that the compensator was made of is 1 + e times that ("identified").
    """

    def off(name: str, law: str, most: float, error: Callable[[float], Variation], unit: str = "1") -> Candidate:
        def put(table: Table, values: Values) -> Table:
            return varied(table[0], error(values[0])), table[1]

        return Candidate(name, PARAMETERS, law, (Range(name, unit, -most, most, logarithmic=False),), 0, put)

    single = (
        off("moving_mass", r"(1+e)\,M", MASS_BOUND * USUAL_TOLERANCE.mass, lambda e: Variation(mass=e)),
        off(
            "mode_frequency", r"(1+e)\,\omega_{ti}", BOUND * USUAL_TOLERANCE.frequency, lambda e: Variation(frequency=e)
        ),
        off("mode_damping", r"(1+e)\,\zeta_{ti}", BOUND * USUAL_TOLERANCE.damping, lambda e: Variation(damping=e)),
        off("dead_time", r"L+e", BOUND * load().tolerances.dead_time, lambda e: Variation(dead_time=e), "s"),
    )
    return (
        off("friction_level", r"(1+e)\,K_i", FRICTION, lambda e: Variation(friction_force=e)),
        off("presliding_length", r"(1+e)\,X_i,\quad K_i/(1+e)", FRICTION, lambda e: Variation(friction_length=e)),
        wrong_friction(),
        _identified("identified_level", (FRICTION, 0.0)),
        _identified("identified_length", (0.0, FRICTION)),
        _identified("identified_friction", (FRICTION, FRICTION)),
        *single,
        _all_parameters(single),
    )


def _identified(name: str, most: tuple[float, float]) -> Candidate:
    """The compensator is made of a friction whose level and length are wrong by up to `most`."""
    varies = [bound > 0 for bound in most]
    names = ("level", "length")
    ranges = tuple(Range(names[i], "1", -most[i], most[i], logarithmic=False) for i, one in enumerate(varies) if one)

    def believed(machine: Machine, values: Values) -> Friction:
        given = iter(values)
        level, length = (next(given) if one else 0.0 for one in varies)
        return varied_friction(machine.friction, Variation(friction_force=level, friction_length=length))

    def put(table: Table, values: Values) -> Table:
        machine, controller = table
        return machine, with_compensator(controller, simplify(believed(machine, values), number(machine)))

    law = r",\quad ".join(law for law, one in zip((r"(1+e)\,\hat F_i", r"(1+e)\,\hat X_i"), varies, strict=True) if one)
    return Candidate(name, PARAMETERS, law, ranges, 0, put, believed)


def _all_parameters(single: Sequence[Candidate]) -> Candidate:
    """A wrong friction, and all other parameters wrong at once."""
    found = wrong_friction()
    for one in single:
        found = both(found, one)
    return replace(found, name="all_parameters", equation="\\text{all of these at once}")


def _of_compensators() -> tuple[Candidate, ...]:
    """Designs of the RFM other than this project's, for a friction that is known exactly."""
    spacing = Range("spacing", "1", 0.0, 1.0, logarithmic=False)
    smallest, largest = Range("smallest", "1", 1.0, SMALLEST), Range("largest", "1", MIN_LARGEST_SHARE, 1.0)
    points, end = Range("points", "1", 0.0, 1.0, logarithmic=False), Range("end", "1", END, 1.0)
    slopes = Range("slopes", "1", 0.0, 1.0, logarithmic=False)

    def of(name: str, law: str, *ranges: Range) -> Candidate:
        def put(table: Table, values: Values) -> Table:
            machine, controller = table
            design = Design(**dict(zip((one.name for one in ranges), values, strict=True)))  # type: ignore[arg-type]
            return machine, with_compensator(controller, compensator(machine, machine.friction, design))

        return Candidate(name, COMPENSATOR, law, ranges, 0, put)

    return (
        of("limit_spacing", r"\hat X_i^p \text{ in even steps}", spacing),
        of("limit_range", r"a X_1 \ldots b X_N", smallest, largest),
        of("fitted_distances", r"s_j^q \text{ in even steps}", points, end),
        of("comprehensive_slopes", r"(1-w) f(s) + w f_{12}(s)", slopes),
        of(
            "compensator_design",
            "\\text{all of these at once}",
            spacing,
            smallest,
            largest,
            points,
            end,
            slopes,
        ),
    )
