"""Effect: one thing that a model may leave out; its law acts through hooks, compiled functions of one signature.

    hook(value, p (P,), now (8,), memory (K,), contact (3, N)) -> value

p: the effect's parameters (SI) in the order of its fields. now: time T [s], position X [m], speed V [m/s], the time H
[s] over which the value holds, the thrust reference U [N], MOVED [m] since the last call, control error E [m], feedback
U_LAW [N]. memory: the effect's own, zeros at the start. contact, to be read only, by hooks on path, limit and friction:
rows displacement Z [m], STIFFNESS [N/m] and LIMIT [m] of the friction elements.

The same hooks serve the closed loop and the replay along a measured path (kernel.py), where E and U_LAW are 0.
"""

from __future__ import annotations

import dataclasses
import math
from abc import ABC
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cache
from typing import Any, ClassVar, Final, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from models.compiled import compiled
from models.effects.priors import REFERENCE, USUAL, Powers, Priors, Range, Units
from models.plant import Mode
from models.quantity import AXES, value

Array = NDArray[np.float64]


class Numbers(Protocol):
    """An array of floats as a hook reads it, or writes to it where it is the hook's own memory."""

    size: int

    def __getitem__(self, at: int | tuple[int, int], /) -> float: ...
    def __setitem__(self, at: int, number: float, /) -> None: ...


Hook = Callable[[float, Numbers, Numbers, Numbers, Numbers], float]

T, X, V, H, U, MOVED, E, U_LAW = range(8)  # entries of `now`
Z, STIFFNESS, LIMIT = range(3)  # rows of `contact`

FAR: Final = 1e6  # A size may be so many times its usual ones: axes differ by less.
FAMILIES: Final = ("friction", "motor", "structure", "scale", "protocol")
ROLES: Final = ("amplitude", "shape", "period", "phase", "width", "switch")
POSITIVE: Final = ("shape", "period", "width")  # roles of sizes that are above 0 and differ by factors: see Parameter
COORDINATES: Final = {"position": "m", "reading": "m", "command": "N", "time": "s"}
"""What a law can be periodic in, with its unit: the table's position, the scale's reading, the command, the time."""
BY_UNIT: Final[Mapping[str, Powers]] = {
    "N": (("force", 1),),
    "m": (("contact", 1),),
    "s": (("loop", 1),),
    "Hz": (("loop", -1),),
    "1/s": (("loop", -1),),
    "s^2": (("loop", 2),),
    "1/m": (("contact", -1),),
    "1/N": (("force", -1),),
    "m/s": (("contact", 1), ("loop", -1)),
    "N/m": (("force", 1), ("contact", -1)),
    "N s/m": (("force", 1), ("loop", 1), ("contact", -1)),
    "kg": (("mass", 1),),
    "1/kg": (("mass", -1),),
}
"""What sizes of a unit are counted in, where their declaration does not say; those of other units stay as they are."""
# The shortest period that is looked for along the travel has so many in it, and the longest one of a scale so many.
MOST_PERIODS, FEWEST_PERIODS = 120, 15
MOST_OF_NYQUIST: Final = 0.8  # up to which a frequency is looked for
DENSEST: Final = 3  # times the points of a grid over the reference's travel, up to which a longer one has a grid
SHOWN: Final = ("force", "reading")  # where an effect can add something that a record of position and command shows


class Place(IntEnum):
    """Where a hook acts, in the order of a sample; `now[H]` is then the sample time or the substep, or, for what acts
    on the friction, the time since the last call."""

    READING = 0
    """x [m] -> what the scale shows before noise and rounding [m], once a sample."""
    CONTROL = 1
    """The law's command [N] -> the command put out and logged [N], once a sample."""
    COMMAND = 2
    """Logged command [N] -> what the drive takes in [N], once a sample, before the dead time."""
    THRUST = 3
    """Thrust reference after dead time and limit [N] -> its mean over the substep [N]."""
    PATH = 4
    """x [m] -> displacement that the friction's contacts see [m], every substep."""
    LIMIT = 5
    """1 -> factor of every X_i, every substep."""
    FRICTION = 6
    """Force of the elements [N] -> friction [N], every substep."""
    FORCE = 7
    """0 -> external force, in newtons of thrust reference, every substep."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect: prior range low .. high and a typical size (SI), and the role that it plays.

    role: "amplitude" (the force or the reading is proportional to it, to first order; 0 for none), "shape" (a time,
    speed, length or frequency), "period" (of what repeats along `periodic_in`, a key of COORDINATES; or its frequency,
    by the unit), "phase" (0 .. 2 pi of a sine), "width" (no proportional parameter; 0 for none; with `periodic_in`
    the width of a step of a staircase) or "switch" (which of two laws it is: 0 or 1).

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


def switch(meaning: str) -> Any:
    """The int field that tells which of two laws an effect has, 0 (the usual one) or 1; meaning: what 1 stands for."""
    return _field(Parameter("", "1", f"{meaning} (1) or not (0)", "switch", 0, 1, 0), at_least=0, below=2)


def _field(prior: Parameter, **limits: Any) -> Any:
    if prior.role not in {"phase", "switch"}:
        limits = {**_far(prior, limits), **limits}
    declared = value(prior.unit, prior.meaning, **limits)
    return dataclasses.field(default=declared.default, metadata={**declared.metadata, "prior": prior})


def _far(prior: Parameter, limits: Mapping[str, Any]) -> dict[str, Any]:
    """How far a size may be from its usual ones in a machine file: beyond, a law's numbers lose their meaning."""
    most = FAR * max(abs(prior.low), abs(prior.high))
    far: dict[str, Any] = {"because": f"more than a factor of {FAR:.0e} from its usual sizes"}
    if "below" not in limits:
        far["at_most"] = most
    if prior.role in {"shape", "period"} and prior.low > 0:
        far["at_least"] = prior.low / FAR
    elif "above" not in limits:
        far["at_least"] = -most
    return far


def hook(law: Hook) -> Hook:
    """A law to be compiled, the first time that it is used, for the signature in the module's head; any unit, SI."""
    return compiled(law)


@dataclass(frozen=True)
class Kind:
    """What kind of law an effect has, whatever its form: the coordinate that it is a function of; its parity, "odd"
    where the force turns with the direction of the motion (of the command, for an amplifier's law), else "even";
    whether it has a memory; and the side where it shows: "force", "reading" or "log"."""

    coordinate: str
    parity: str
    memory: bool
    side: str


@dataclass(frozen=True)
class Effect(ABC):
    """One effect and the values of its parameters (SI). A subclass is a frozen dataclass whose fields are `parameter`s.

    equation: LaTeX. source: where the law and its typical sizes come from. hooks: by the Place where they act.
    depends_on_time: the law follows a clock whose beginning no controller knows, rather than the table. common_on:
    the axes, "linear" or "rotary", any of which may have it; in others it is considered only where the machine's
    file states its sizes. shows_in: where it shows in a record of position and command: as a "force", in the
    scale's "reading", only in the "log" of what the controller did and when, or in "nothing"; left empty where the
    hooks tell, see `shown_in`. coordinate, parity, remembers: what kind of law it is, see `kind`; left empty, it is
    of a kind of its own. delayed_by: the parameter [s] by which a thrust acts later than its command in all but
    fast changes, if there is one. differentiates: its law follows the acceleration, in which the reading's noise is
    large, so that records of one way differ. tabulated: its fields are measured values of one machine: a file may
    hold it, but nothing looks for it, and it has no `parameters`.
    """

    name: ClassVar[str]
    family: ClassVar[str]
    equation: ClassVar[str]
    source: ClassVar[str]
    hooks: ClassVar[Mapping[Place, Hook]] = {}
    depends_on_time: ClassVar[bool] = False
    common_on: ClassVar[tuple[str, ...]] = AXES
    shows_in: ClassVar[str] = ""
    coordinate: ClassVar[str] = ""
    parity: ClassVar[str] = ""
    remembers: ClassVar[bool] = False
    delayed_by: ClassVar[str] = ""
    differentiates: ClassVar[bool] = False
    tabulated: ClassVar[bool] = False

    @classmethod
    def kind(cls) -> Kind:
        """The kind of its law, which laws of other forms share."""
        return Kind(cls.coordinate or cls.name, cls.parity, cls.remembers, cls.shown_in())

    @classmethod
    def shown_in(cls) -> str:
        """Where a record shows it: `shows_in`, or else by its hooks "reading", "log" (the controller's law) or "force";
        no unit."""
        if cls.shows_in or not cls.hooks:
            return cls.shows_in or "force"
        return {Place.READING: "reading", Place.CONTROL: "log"}.get(min(cls.hooks), "force")

    def memory(self, elements: int) -> int:
        """How many numbers the hooks keep between calls, shared by all of them, for a friction of so many elements."""
        return 0

    def modes(self) -> tuple[Mode, ...]:
        """Vibration modes that the effect adds to the plant's."""
        return ()

    def input_delay(self) -> float:
        """By how much later it makes a thrust act [s], see `delayed_by`."""
        return float(getattr(self, self.delayed_by)) if self.delayed_by else 0.0

    def lag(self) -> float:
        """Of its input delay, what is a lag of first order [s], tau u' + u = command."""
        return 0.0

    def viscous_drag(self) -> float:
        """Of its friction, what grows in proportion to the speed [N s/m], alike in both directions."""
        return 0.0

    def spring_to_ground(self) -> float:
        """Of its force, what pulls back in proportion to the position, everywhere alike [N/m]."""
        return 0.0

    def larger_forwards(self) -> tuple[float, float]:
        """How much larger than the mean of both directions friction is forwards: by a part of all other friction [1],
        and by a drag [N s/m]."""
        return 0.0, 0.0

    @classmethod
    def typical(cls, priors: Priors = USUAL) -> Self:
        """The effect at its typical size [SI]: the geometric middle of the prior sizes, a phase of 1, no switch set; of
        several amplitudes the first alone."""
        sizes = {item.name: item.typical for item in parameters(cls, priors)}
        further = [item.name for item in parameters(cls, priors) if item.role == "amplitude"][1:]
        return cls(**{name: 0.0 if name in further else size for name, size in sizes.items()})

    def off(self) -> Self:
        """The effect with every amplitude and width at 0, which has no effect; shapes, phases and switches stay."""
        roles = {item.name: item.role for item in parameters(type(self))}
        return replace(self, **{name: 0.0 for name, role in roles.items() if role in {"amplitude", "width"}})

    def strength(self) -> float:
        """Its first amplitude or width [SI], without its sign."""
        sizes = (item.name for item in parameters(type(self)) if item.role in {"amplitude", "width"})
        return abs(float(getattr(self, next(sizes))))

    def values(self) -> Array:
        """The parameters (P,) [SI] in the order of the fields."""
        return np.array([getattr(self, item.name) for item in parameters(type(self))], float)


@cache
def parameters(kind: type[Effect], priors: Priors = USUAL) -> tuple[Parameter, ...]:
    """The parameters of a class of effects, in the order of its fields, with their ranges in a machine of these priors
    [SI]."""
    usual = _usual(kind)
    if priors.units != REFERENCE:
        usual = tuple(_counted(item, priors.units) for item in usual)
    if not any(effect == kind.name for effect, _ in priors):
        return usual
    return tuple(_ranged(item, priors.get((kind.name, item.name))) for item in usual)


def _counted(item: Parameter, units: Units) -> Parameter:
    """The parameter with the sizes that are usual in a machine of these units."""
    if item.role in {"phase", "switch"}:
        return item
    if item.role == "period" and item.periodic_in in {"position", "reading"}:
        return _along(item, units)
    powers = item.counted_in or (BY_UNIT.get(item.unit, ()),)
    if item.unit == "m/s" and item.role == "shape":  # contacts are of one length and the ways of another
        powers = (*powers, (("travel", 1), ("loop", -1)))
    factors = [units.over(REFERENCE, one) for one in powers]
    low, high = item.low * min(factors), item.high * max(factors)
    if len(factors) == 1 and item.unit != "Hz":
        return replace(item, low=low, high=high, typical=item.typical * factors[0])
    if item.unit == "Hz":
        low, high = _below_nyquist(low, high, units)
    return replace(item, low=low, high=high, typical=math.sqrt(low * high), sought=_rings(item, low, high, units))


def _below_nyquist(low: float, high: float, units: Units) -> tuple[float, float]:
    """A range of frequencies [Hz], moved to where a record shows them."""
    most = MOST_OF_NYQUIST / 2 / units.sample
    return min(low, most * low / high), min(high, most)


def _rings(item: Parameter, low: float, high: float, units: Units) -> Range:
    """Where a mode is looked for, whose usual range is low .. high [Hz]: a structure rings wherever its records show
    it, however slow its loop is."""
    return (low, max(high, MOST_OF_NYQUIST / 2 / units.sample)) if item.is_resonance else ()


def _along(item: Parameter, units: Units) -> Parameter:
    """A period along the way or the scale: from what the shorter of two lengths would make the least to what the longer
    would make the most, as magnets and scales go by neither; none beyond the travel, where it would draw any curve."""
    contact, way = units.contact / REFERENCE.contact, units.travel / REFERENCE.travel
    reading = units.reading / REFERENCE.reading
    longest, shortest = (max(contact, reading), reading) if item.periodic_in == "reading" else (way, way)
    low, high = item.low * min(contact, shortest), item.high * longest
    denser = way * (1 / low - 1 / high) / (1 / item.low - 1 / item.high)
    points = max(round(item.points * denser), 2) if item.points and denser <= DENSEST else 0
    return replace(
        item,
        low=low,
        high=high,
        typical=math.sqrt(low * high),
        points=points,
        linear_within=item.linear_within * high / item.high / way,
        sought=_sought(item, low, high, units.travel),
    )


def _sought(item: Parameter, low: float, high: float, travel: float) -> Range:
    """Where a spectrum looks for a period along the way, whose usual range is low .. high [m]: a screw's lead or a
    motor's teeth are shorter than the magnets that a grid of periods is for, and a magnetic scale's pole pairs longer
    than an optical one's lines."""
    if item.periodic_in == "reading":
        return low, max(high, travel / FEWEST_PERIODS)
    return (min(low, travel / MOST_PERIODS) if item.points else low), high


def _ranged(item: Parameter, ends: tuple[float, ...] | None) -> Parameter:
    """The parameter with the sizes that a machine states; one that may have either sign may still."""
    if ends is None:
        return item
    low, high = ends
    typical = (low * high) ** 0.5
    return replace(item, low=-high if item.low < 0 else low, high=high, typical=typical, stated=True, sought=())


@cache
def _usual(kind: type[Effect]) -> tuple[Parameter, ...]:
    found = []
    for field in () if kind.tabulated else dataclasses.fields(kind):
        prior = field.metadata.get("prior")
        if not isinstance(prior, Parameter):
            raise TypeError(f"{kind.__name__}.{field.name}: declare it with models.effects.base.parameter")
        if prior.role == "period" and prior.periodic_in in {"position", "reading"}:
            prior = replace(prior, sought=_sought(prior, prior.low, prior.high, REFERENCE.travel))
        elif prior.unit == "Hz":
            prior = replace(prior, sought=_rings(prior, prior.low, prior.high, REFERENCE))
        found.append(replace(prior, name=field.name))
    return tuple(found)
