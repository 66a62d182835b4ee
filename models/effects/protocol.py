"""How the controller may differ from the law that it is taken for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from models.effects.base import U_LAW, Effect, Numbers, Place, hook
from models.effects.parameter import parameter


@hook
def _mismatched(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:
    return value + p[0] * now[U_LAW]


@dataclass(frozen=True)
class ControllerMismatch(Effect):
    """The feedback acts more or less than the law says. Seen in the logged command against the logged error only."""

    name: ClassVar = "controller_mismatch"
    family: ClassVar = "protocol"
    coordinate: ClassVar = "control error"
    parity: ClassVar = "odd"
    equation: ClassVar = r"u_M=(1+a)\,u_{fb}+u_{ff}+u_{rf}"
    source: ClassVar = "assumed: a gain that was changed, or another unit of it"
    hooks: ClassVar = {Place.CONTROL: _mismatched}
    excess: float = parameter("1", "excess a of the feedback", 0.01, 0.1, "amplitude", signed=True, above=-1)
