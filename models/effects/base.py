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
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, Final, Protocol, Self, cast

import numpy as np
from numpy.typing import NDArray

from models.compiled import compiled
from models.plant import Mode
from models.quantity import declaration, value

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
ROLES: Final = ("amplitude", "shape", "phase", "width", "switch")
SHOWN: Final = ("force", "reading")  # where an effect can add something that a record of position and command shows

PLACES: Final = {
    "reading": "x [m] -> what the scale shows before noise and rounding [m], once a sample",
    "control": "the law's command [N] -> the command put out and logged [N], once a sample",
    "command": "logged command [N] -> what the drive takes in [N], once a sample, before the dead time",
    "thrust": "thrust reference after dead time and limit [N] -> its mean over the substep [N]",
    "path": "x [m] -> displacement that the friction's contacts see [m], every substep",
    "limit": "1 -> factor of every X_i, every substep",
    "friction": "force of the elements [N] -> friction [N], every substep",
    "force": "0 -> external force, in newtons of thrust reference, every substep",
}
"""Where a hook acts, in the order of a sample; H is the sample time, the substep, or the time since the last call."""


@dataclass(frozen=True)
class Parameter:
    """A parameter of an effect: prior range low .. high and a typical size (SI), and the role that it plays.

    role: "amplitude" (the force or the reading is proportional to it, to first order; 0 is no effect), "shape" (a time,
    speed, length or frequency), "phase" (0 .. 2 pi of a sine), "width" (no proportional parameter; 0 is no effect) or
    "switch" (which of two laws it is: 0 or 1).
    """

    name: str
    unit: str
    meaning: str
    role: str
    low: float
    high: float
    typical: float


def parameter(
    unit: str, meaning: str, low: float, high: float, role: str, *, signed: bool = False, **limits: Any
) -> Any:
    """A field of an effect with typical sizes from low to high (SI in `unit`); signed: of either sign.

    limits: what the value must keep to in a machine file, as of models.quantity.value.
    """
    if role not in ROLES:
        raise ValueError(f"role {role!r} is unknown; give one of {', '.join(ROLES)}")
    declared = value(unit, meaning, **limits)
    typical = 1.0 if role == "phase" else math.sqrt(low * high)
    prior = (role, -high if signed else low, high, typical)
    return dataclasses.field(metadata={**declared.metadata, "prior": prior})


def phase() -> Any:
    """The field of a sine's phase, in radians; A sin(s + phi) = A cos(phi) sin(s) + A sin(phi) cos(s)."""
    return parameter("1", "phase, in radians", 0.0, 2 * math.pi, "phase")


def switch(meaning: str) -> Any:
    """The int field that tells which of two laws an effect has, 0 (the usual one) or 1; meaning: what 1 stands for."""
    declared = value("1", f"{meaning} (1) or not (0)", at_least=0, below=2)
    return dataclasses.field(metadata={**declared.metadata, "prior": ("switch", 0, 1, 0)})


def hook(law: Hook) -> Hook:
    """A law to be compiled, the first time that it is used, for the signature in the module's head; any unit, SI."""
    return compiled(law)


@dataclass(frozen=True)
class Effect(ABC):
    """One effect and the values of its parameters (SI). A subclass is a frozen dataclass whose fields are `parameter`s.

    equation: LaTeX. source: where the law and its typical sizes come from. hooks: by place, a key of PLACES. clocked:
    the law follows a time whose beginning no controller knows, rather than the table. usual: a diagnosis looks for it
    in any machine, not only where the machine file states its sizes. fine: the relative step of a fit in a width or
    period of which very many fit into the motion, 0: the usual step (a stated period has its own, `fineness` in
    diagnosis/model/fit.py). period_field: the parameter that is a period along the path, where
    diagnosis/which/scan.py has a spectrum of it (`ALONG`, `SPECTRA`). period_stated: a machine file states its range.
    shows_in: where it shows in a record of position and command: as a "force", in the scale's "reading", only in the
    "log" of what the controller did and when, or in "nothing"; left empty where the hooks tell, see `shown_in`.
    """

    name: ClassVar[str]
    family: ClassVar[str]
    equation: ClassVar[str]
    source: ClassVar[str]
    hooks: ClassVar[Mapping[str, Hook]] = {}
    clocked: ClassVar[bool] = False
    usual: ClassVar[bool] = True
    fine: ClassVar[float] = 0.0
    period_field: ClassVar[str] = ""
    period_stated: ClassVar[bool] = False
    shows_in: ClassVar[str] = ""

    @classmethod
    def shown_in(cls) -> str:
        """Where a record shows it: `shows_in`, or else by its hooks "reading", "log" (the controller's law) or "force";
        no unit."""
        if cls.shows_in or not cls.hooks:
            return cls.shows_in or "force"
        return {"reading": "reading", "control": "log"}.get(min(cls.hooks, key=list(PLACES).index), "force")

    def memory(self, elements: int) -> int:  # noqa: ARG002  # a subclass may need the number of elements
        """How many numbers the hooks keep between calls, shared by all of them, for a friction of so many elements."""
        return 0

    def modes(self) -> tuple[Mode, ...]:
        """Vibration modes that the effect adds to the plant's."""
        return ()

    @classmethod
    def typical(cls) -> Self:
        """The effect at its typical size: the geometric middle of the prior sizes, a phase of 1, no switch set."""
        return cls(**{item.name: item.typical for item in parameters(cls)})

    def off(self) -> Self:
        """The effect with every amplitude and width at 0, which is no effect; shapes, phases and switches stay."""
        roles = {item.name: item.role for item in parameters(type(self))}
        return dataclasses.replace(
            self, **{name: 0.0 for name, role in roles.items() if role in {"amplitude", "width"}}
        )

    def strength(self) -> float:
        """Its first amplitude or width [SI], without its sign."""
        sizes = (item.name for item in parameters(type(self)) if item.role in {"amplitude", "width"})
        return abs(float(getattr(self, next(sizes))))

    def values(self) -> Array:
        """The parameters (P,) [SI] in the order of the fields."""
        return np.array([getattr(self, item.name) for item in parameters(type(self))], float)


@cache
def parameters(kind: type[Effect]) -> tuple[Parameter, ...]:
    """The parameters of a class of effects, in the order of its fields."""
    found = []
    for field in dataclasses.fields(kind):
        declared, prior = declaration(field), field.metadata.get("prior")
        if declared is None or prior is None:
            raise TypeError(f"{kind.__name__}.{field.name}: declare it with models.effects.base.parameter")
        role, low, high, typical = cast(tuple[str, float, float, float], prior)
        found.append(Parameter(field.name, declared.unit, declared.meaning, role, low, high, typical))
    return tuple(found)
