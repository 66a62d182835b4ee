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
from abc import ABC
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cache
from typing import ClassVar, Final, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from models.compiled import compiled
from models.effects.parameter import Parameter, counted, parameter, period, phase, switch
from models.effects.priors import REFERENCE, USUAL, Priors
from models.effects.ranges import looked_for, stated, usual_in
from models.plant import Mode, Plant
from models.quantity import AXES

# With those of parameter.py that a file of one's own effect needs.
__all__ = [
    "FAMILIES",
    "LIMIT",
    "MOVED",
    "STIFFNESS",
    "U_LAW",
    "VISIBLE_SIGNALS",
    "Array",
    "E",
    "Effect",
    "H",
    "Hook",
    "Kind",
    "Numbers",
    "Place",
    "T",
    "U",
    "V",
    "X",
    "Z",
    "counted",
    "hook",
    "parameter",
    "parameters",
    "period",
    "phase",
    "switch",
]

Array = NDArray[np.float64]


class Numbers(Protocol):
    """An array of floats as a hook reads it, or writes to it where it is the hook's own memory."""

    size: int

    def __getitem__(self, at: int | tuple[int, int], /) -> float: ...
    def __setitem__(self, at: int, number: float, /) -> None: ...


Hook = Callable[[float, Numbers, Numbers, Numbers, Numbers], float]

T, X, V, H, U, MOVED, E, U_LAW = range(8)  # entries of `now`
Z, STIFFNESS, LIMIT = range(3)  # rows of `contact`

FAMILIES: Final = ("friction", "motor", "structure", "scale", "protocol")
# Where an effect can add something that a record of position and command shows.
VISIBLE_SIGNALS: Final = ("force", "reading")


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
    file states its sizes. beside: effects by name whose statement in a machine's file makes it one that the machine may
    have. shows_in: where it shows in a record of position and command: as a "force", in the
    scale's "reading", only in the "log" of what the controller did and when, or in "nothing"; left empty where the
    hooks tell, see `shown_in`. coordinate, parity, remembers: what kind of law it is, see `kind`; left empty, it is
    of a kind of its own. delayed_by: the parameter [s] by which a thrust acts later than its command in all but
    fast changes, if there is one. differentiates: its law follows the acceleration, in which the reading's noise is
    large, so that records of one way differ. friction_drives: its modes move under the friction alone, and not under
    the thrust. rubs_elsewhere: a part of the friction acts and moves with another part of the structure than the one
    where thrust and scale are. tabulated: its fields are measured values of one machine: a file may
    hold it, but nothing looks for it, and it has no `parameters`.
    """

    name: ClassVar[str]
    family: ClassVar[str]
    equation: ClassVar[str]
    source: ClassVar[str]
    hooks: ClassVar[Mapping[Place, Hook]] = {}
    depends_on_time: ClassVar[bool] = False
    common_on: ClassVar[tuple[str, ...]] = AXES
    beside: ClassVar[tuple[str, ...]] = ()
    shows_in: ClassVar[str] = ""
    coordinate: ClassVar[str] = ""
    parity: ClassVar[str] = ""
    remembers: ClassVar[bool] = False
    delayed_by: ClassVar[str] = ""
    differentiates: ClassVar[bool] = False
    friction_drives: ClassVar[bool] = False
    rubs_elsewhere: ClassVar[bool] = False
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
        """Vibration modes that the effect adds to the plant's, see `friction_drives`."""
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

    def at_rating(self, rated_thrust: float) -> float:
        """What part of the thrust [1] it takes at the rated one [N], of a law that is stated at another."""
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

    @classmethod
    def placed(cls, plant: Plant) -> tuple[Self, ...] | None:
        """The effect (SI) with the shapes that follow from a plant, tried in place of a grid of them: it needs a plant
        of which some follow. None: of an effect that may be in any plant."""
        return None

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
        usual = tuple(usual_in(item, priors.units) for item in usual)
    if not any(effect == kind.name for effect, _ in priors):
        return usual
    return tuple(stated(item, priors.get((kind.name, item.name))) for item in usual)


@cache
def _usual(kind: type[Effect]) -> tuple[Parameter, ...]:
    found = []
    for field in () if kind.tabulated else dataclasses.fields(kind):
        prior = field.metadata.get("prior")
        if not isinstance(prior, Parameter):
            raise TypeError(f"{kind.__name__}.{field.name}: declare it with models.effects.base.parameter")
        found.append(looked_for(replace(prior, name=field.name)))
    return tuple(found)
