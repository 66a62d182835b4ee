"""A law that was measured rather than named: a table of forces over one coordinate, piecewise linear between knots.

It is written as [effects.measured] in a machine file and is not a candidate of the catalogue: nothing of it is fitted.
Beyond its first and its last knot the force stays what it is there, as nothing was measured further out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from types import MappingProxyType
from typing import ClassVar, Final, Literal

import numpy as np
from numpy.typing import NDArray

from models.effects.base import LIMIT, STIFFNESS, Effect, H, Hook, Numbers, Place, T, U, V, X, Z, hook
from models.quantity import value

Array = NDArray[np.float64]

UNITS: Final = MappingProxyType(
    {
        "time": "s",
        "position": "m",
        "speed": "m/s",
        "acceleration": "m/s^2",
        "command": "N",
        "rest": "s",
        "path": "m",
    }
)
"""The coordinates and their units: time since the record's start, position, speed, acceleration, thrust reference as it
acts, time for which the table has rested, path since the last reversal."""
SYMMETRIES: Final = ("plain", "even", "odd", "directional", "drag", "thrust")
FORCE_UNITS: Final = MappingProxyType(dict.fromkeys(SYMMETRIES, "N") | {"drag": "N s/m", "thrust": "1"})
"""The units of a table's numbers: of a drag they are per speed, of a part of the thrust reference without a unit."""
OF_A_SIGN: Final = ("even", "odd")
IN_PROPORTION: Final = ("drag", "thrust")  # to speed or thrust: over these themselves a plain law is the same
SIGNED: Final = ("speed", "acceleration", "command")  # coordinates with a sign that a law may be even or odd in
MOST_KNOTS: Final = 200  # each takes time in every substep
MAX_MAGNITUDE: Final = 1e9
BECAUSE: Final = "beyond, numbers lose their meaning"

# By what the hooks know the coordinates and symmetries, in their order; and where a table's numbers stand in p.
POSITION, SPEED, ACCELERATION, COMMAND, REST, PATH = range(1, 7)
EVEN, ODD, DIRECTIONAL, DRAG, THRUST = range(1, 6)
HEAD: Final = 6  # coordinate, symmetry, turn, slow, period, number of knots; then knots, forces
KEPT: Final = 5  # numbers kept beside one for each friction element: started, three of the coordinate, the force


@hook
def _acting(  # noqa: PLR0912  # a hook calls nothing, so that it can be translated into C
    value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers
) -> float:
    which, symmetry, count = int(p[0]), int(p[1]), int(p[5])
    s = now[T]
    if which == POSITION:
        s = now[X]
    if which == SPEED:
        s = now[V]
    if which == COMMAND:
        s = now[U]
    if which == ACCELERATION:
        s = 0.0
        if memory[0] > 0.5 and now[H] > 0.0:
            s = (now[V] - memory[1]) / now[H]
        memory[1] = now[V]
    if which == REST:
        if memory[0] < 0.5 or abs(now[V]) > p[3]:
            memory[1] = now[T]
        s = now[T] - memory[1]
    if which == PATH:  # kept: where it last turned, the farthest since then, and the direction
        if memory[0] < 0.5:
            memory[1], memory[2], memory[3] = now[X], now[X], 0.0
        gone = now[X] - memory[2]
        if memory[3] * gone > 0.0:
            memory[2] = now[X]
        if memory[3] * gone <= 0.0 and abs(gone) > p[2]:
            memory[1] = memory[2]
            memory[2] = now[X]
            memory[3] = 1.0 if gone > 0.0 else -1.0
        s = abs(now[X] - memory[1])
    memory[0] = 1.0
    sign = -1.0 if symmetry == ODD and s < 0.0 else 1.0
    if EVEN <= symmetry <= ODD:
        s = abs(s)
    if p[4] > 0.0:
        s = s - p[4] * math.floor((s - p[HEAD]) / p[4])
    force = p[HEAD + count]
    for i in range(count - 1):
        low, high = p[HEAD + i], p[HEAD + i + 1]
        if s >= low:
            part = min((s - low) / (high - low), 1.0)
            force = p[HEAD + count + i] + part * (p[HEAD + count + i + 1] - p[HEAD + count + i])
    memory[4] = force
    if symmetry == DRAG:
        force = force * now[V]
    if symmetry == THRUST:
        force = force * now[U]
    return value if symmetry == DIRECTIONAL else value + sign * force


@hook
def _turning(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    held, most = 0.0, 0.0
    for i in range(memory.size - KEPT):
        held = held + contact[STIFFNESS, i] * contact[Z, i]
        most = most + contact[STIFFNESS, i] * contact[LIMIT, i]
    return value - memory[4] * held / most if most > 0.0 else value


@dataclass(frozen=True)
class Measured(Effect):
    """A force on the table that was measured over one coordinate, whatever its cause.

    A "plain" law is the force over the coordinate; an "even" or "odd" one that over its size, which turns with its sign
    where odd; a "directional" one is the force of motion forwards, which turns with the friction: it is multiplied by
    what the contacts hold over what they can hold. A "drag" is a force per speed and a "thrust" a part of the thrust
    reference as it acts, each over the coordinate: what brakes in a zone, a motor that fades. period: over which the
    curve repeats (0: it does not). slow [m/s]: below it the table rests; turn [m]: by so much it has to come back for
    a reversal.
    """

    name: ClassVar = "measured"
    family: ClassVar = "structure"
    equation: ClassVar = r"F(s)=F_i+(F_{i+1}-F_i)\frac{s-s_i}{s_{i+1}-s_i}"
    source: ClassVar = "assumed: a table of values in place of a law"
    shows_in: ClassVar = "force"
    tabulated: ClassVar = True
    coordinate: Literal["time", "position", "speed", "acceleration", "command", "rest", "path"] = value(  # type: ignore[misc]
        "1", "coordinate that the force is a function of"
    )
    knots: tuple[float, ...] = value(
        "1",
        "values of the coordinate",
        unit_by=("coordinate", UNITS),
        at_least=-MAX_MAGNITUDE,
        at_most=MAX_MAGNITUDE,
        because=BECAUSE,
        most=MOST_KNOTS,
    )
    force: tuple[float, ...] = value(
        "N",
        "force on the table at the knots",
        unit_by=("symmetry", FORCE_UNITS),
        at_least=-MAX_MAGNITUDE,
        at_most=MAX_MAGNITUDE,
        because=BECAUSE,
        most=MOST_KNOTS,
    )
    symmetry: Literal["plain", "even", "odd", "directional", "drag", "thrust"] = value(
        "1", "how the force turns with the coordinate or the direction, or what it is in proportion to", default="plain"
    )
    period: float = value(
        "1",
        "period of the curve (0: none)",
        unit_by=("coordinate", UNITS),
        at_least=0,
        at_most=MAX_MAGNITUDE,
        default=0.0,
    )
    slow: float = value("m/s", "speed below which the table rests", at_least=0, at_most=MAX_MAGNITUDE, default=0.0)
    turn: float = value("m", "way back that makes a reversal", at_least=0, at_most=MAX_MAGNITUDE, default=0.0)

    def __post_init__(self) -> None:
        """Raises ValueError unless it is a table of a function of the coordinate."""
        if self.coordinate not in UNITS:
            raise ValueError(f"coordinate {self.coordinate!r} is unknown; give one of {', '.join(UNITS)}")
        if len(self.knots) != len(self.force):
            raise ValueError(f"{len(self.knots)} knots and {len(self.force)} forces; give one force for each knot")
        if len(self.knots) < 2 or any(after <= before for before, after in pairwise(self.knots)):
            raise ValueError("knots must be two or more that increase; sort them and give each once")
        self._check_symmetry()
        if self.coordinate == "rest" and self.slow == 0:
            raise ValueError("slow is missing; give the speed below which the table rests")
        if self.period > 0 and not math.isclose(self.period, self.knots[-1] - self.knots[0], rel_tol=1e-6):
            raise ValueError("period must be the distance of the last knot from the first; correct one of them")

    def _check_symmetry(self) -> None:
        signed = self.coordinate in SIGNED
        allowed = [one for one in SYMMETRIES if one not in (IN_PROPORTION if signed else OF_A_SIGN)]
        if self.symmetry not in allowed:
            raise ValueError(
                f"symmetry {self.symmetry!r} does not go with {self.coordinate}; give one of {', '.join(allowed)}"
            )
        if self.symmetry in ("even", "odd") and self.knots[0] < 0:
            raise ValueError(f"knots of an {self.symmetry} law are sizes; begin them at 0 or above")
        if self.symmetry == "odd" and self.force[0] != 0 and self.knots[0] == 0:
            raise ValueError("an odd law has no force at 0; give 0 as the first force")

    @property
    def hooks(self) -> Mapping[Place, Hook]:  # type: ignore[override]
        """The force's, and the friction's where a directional law turns with it: nothing else has to be computed."""
        acting: dict[Place, Hook] = {Place.FORCE: _acting}
        return acting if self.symmetry != "directional" else {Place.FRICTION: _turning, **acting}

    @property
    def depends_on_time(self) -> bool:  # type: ignore[override]
        """Whether it is a function of time, whose beginning no controller knows."""
        return self.coordinate == "time"

    def memory(self, elements: int) -> int:
        """What `_acting` keeps, and as many numbers as there are friction elements, which tells `_turning` their
        count."""
        return KEPT + elements

    def off(self) -> Measured:
        """The same table with no force."""
        return replace(self, force=(0.0,) * len(self.force))

    def strength(self) -> float:
        """The largest number of the table [N, or as FORCE_UNITS has it], without its sign."""
        return max(abs(force) for force in self.force)

    def values(self) -> Array:
        """What the hooks read (P,) [SI]."""
        which, symmetry = list(UNITS).index(self.coordinate), SYMMETRIES.index(self.symmetry)
        head = (which, symmetry, self.turn, self.slow, self.period, len(self.knots))
        return np.array([*head, *self.knots, *self.force], float)
