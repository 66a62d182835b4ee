"""Parameter: one number of an effect's law, its unit, its usual sizes and the role that it plays.

The fields of an effect are declared with `parameter`, `period`, `phase` and `switch`.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

from models.effects.priors import Powers, Range
from models.quantity import value

MAX_SIZE_FACTOR: Final = 1e6  # A size may be so many times its usual ones: axes differ by less,
MAX_SCALED_FACTOR: Final = 1e12  # but in lengths and forces by more: from piezo stages and micromotors to gantries.
ROLES: Final = ("amplitude", "shape", "period", "phase", "width", "switch")
POSITIVE: Final = ("shape", "period", "width")  # roles of sizes that are above 0 and differ by factors: see Parameter
COORDINATES: Final = {"position": "m", "reading": "m", "command": "N", "time": "s"}
"""What a law can be periodic in, with its unit: the table's position, the scale's reading, the command, the time."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect: prior range low .. high and a typical size (SI), and the role that it plays.

    role: "amplitude" (the force or the reading is proportional to it, to first order; 0 for none), "shape" (a time,
    speed, length or frequency), "period" (of what repeats along `periodic_in`, a key of COORDINATES; or its frequency,
    by the unit), "phase" (0 .. 2 pi of a sine), "width" (no proportional parameter; 0 for none; with `periodic_in`
    the width of a step of a staircase) or "switch" (which of its laws it is: 0, 1, ... high).

    points: that many between low and high are near enough to each other that one of them resembles any other size;
    0 for a period: so many periods lie in a record that no grid does, only a spectrum. points_per_decade: the same for
    each decade. linear_within: the relative change [1] to which the law's response is linear, where it is far below the
    size as there are very many periods in a record; 0: some per cent. stated: a machine states the range in place of
    the usual one. counted_in: the machine's quantities that the usual range is in proportion to; else by BY_UNIT.
    Of several, the one that makes the least counts for its lower end and the one that makes the most for its upper.
    sought: of a period along the way or the scale, or of the frequency of a mode, that no machine states, where it is
    looked for.
    """

    name: str
    unit: str
    meaning: str
    role: str
    low: float
    high: float
    typical: float
    periodic_in: str = ""
    points: int = 0
    points_per_decade: int = 0
    linear_within: float = 0.0
    stated: bool = False
    counted_in: tuple[Powers, ...] = ()
    sought: Range = ()

    @property
    def is_resonance(self) -> bool:
        """Whether it is the natural frequency of a mode."""
        return self.role == "shape" and self.unit == "Hz"

    @property
    def is_step(self) -> bool:
        """Whether it is the width of a staircase's steps."""
        return self.role == "width" and bool(self.periodic_in)

    @property
    def widest(self) -> Range:
        """The least and the greatest size [SI] that is looked for."""
        return self.sought or (self.low, self.high)

    @property
    def is_frequency(self) -> bool:
        """Whether a period is given by its frequency, as its unit says."""
        return self.role == "period" and self.unit != COORDINATES[self.periodic_in]


def parameter(
    unit: str,
    meaning: str,
    low: float,
    high: float,
    role: str,
    *,
    signed: bool = False,
    points: int = 0,
    points_per_decade: int = 0,
    **limits: Any,
) -> Any:
    """A field of an effect with typical sizes from low to high (SI in `unit`) in the reference table; signed: of either
    sign.

    points, points_per_decade: see `Parameter`. limits: what the value must keep to in a machine file, as of
    models.quantity.value, and the default of a field that a file may leave out. Raises ValueError for a role that does
    not exist, or needs a declaration of its own.
    """
    if role not in ROLES:
        raise ValueError(f"role {role!r} is unknown; give one of {', '.join(ROLES)}")
    if role in {"period", "switch"}:
        raise ValueError(f"role {role!r}: declare it with models.effects.base.{role}")
    typical = 1.0 if role == "phase" else math.sqrt(low * high)
    prior = Parameter("", unit, meaning, role, -high if signed else low, high, typical)
    return _field(replace(prior, points=points, points_per_decade=points_per_decade), **limits)


def counted(size: Any, *powers: Mapping[str, int]) -> Any:
    """A `parameter` whose usual range is in proportion to a product of powers of `Units` [1], whatever its unit; of
    several products to whichever makes it wider."""
    prior = replace(size.metadata["prior"], counted_in=tuple(tuple(one.items()) for one in powers))
    return dataclasses.field(default=size.default, metadata={**size.metadata, "prior": prior})


def period(
    unit: str,
    meaning: str,
    low: float,
    high: float,
    periodic_in: str,
    *,
    role: str = "period",
    points: int = 0,
    linear_within: float = 0.0,
    **limits: Any,
) -> Any:
    """The field of a period along a coordinate, a key of COORDINATES, or of its frequency (SI in `unit`).

    role: "width" for the step of a staircase. points, linear_within: see `Parameter`; without points, a period is found
    by a spectrum. limits: as of models.quantity.value. Raises ValueError for a coordinate that does not exist, or a
    unit that is neither its own nor that of its frequency.
    """
    if periodic_in not in COORDINATES:
        raise ValueError(f"periodic_in={periodic_in!r} is unknown; give one of {', '.join(COORDINATES)}")
    if unit not in _units_of(periodic_in):
        raise ValueError(f"a period in {periodic_in} has the unit {' or '.join(_units_of(periodic_in))}, not {unit}")
    prior = Parameter("", unit, meaning, role, low, high, math.sqrt(low * high), periodic_in)
    return _field(replace(prior, points=points, linear_within=linear_within), **limits)


def _units_of(coordinate: str) -> tuple[str, str]:
    """The units of a period along a coordinate, and of its frequency."""
    unit = COORDINATES[coordinate]
    return unit, "Hz" if unit == "s" else f"1/{unit}"


def phase() -> Any:
    """The field of a sine's phase, in radians; A sin(s + phi) = A cos(phi) sin(s) + A sin(phi) cos(s)."""
    return parameter("1", "phase, in radians", 0.0, 2 * math.pi, "phase")


def switch(meaning: str, *others: str) -> Any:
    """The int field that tells which of its laws an effect has, 0 (the usual one), 1 or more; meaning, others: what 1,
    2, ... stand for."""
    laws = ", ".join([f"{meaning} (1)", *(f"{one} ({number})" for number, one in enumerate(others, 2))])
    most = 1 + len(others)
    prior = Parameter("", "1", f"{laws} or {'none of these' if others else 'not'} (0)", "switch", 0, most, 0)
    return _field(prior, at_least=0, below=most + 1)


def _field(prior: Parameter, **limits: Any) -> Any:
    if prior.role not in {"phase", "switch"}:
        limits = {**_far(prior, limits), **limits}
    declared = value(prior.unit, prior.meaning, **limits)
    return dataclasses.field(default=declared.default, metadata={**declared.metadata, "prior": prior})


def _far(prior: Parameter, limits: Mapping[str, Any]) -> dict[str, Any]:
    """How far a size may be from its usual ones in a machine file: beyond, a law's numbers lose their meaning."""
    is_scaled = any(unit in {"m", "N", "kg"} for unit in re.split(r"[^a-zA-Z]+", prior.unit))
    factor = MAX_SCALED_FACTOR if is_scaled else MAX_SIZE_FACTOR
    most = factor * max(abs(prior.low), abs(prior.high))
    far: dict[str, Any] = {"because": f"more than a factor of {factor:.0e} from its usual sizes"}
    if "below" not in limits:
        far["at_most"] = most
    if prior.role in {"shape", "period"} and prior.low > 0:
        far["at_least"] = prior.low / factor
    elif "above" not in limits:
        far["at_least"] = -most
    return far
