"""A machine and its records in other units of mass, length and time: the same machine, told in other numbers."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, replace
from typing import Any

from models.effects.base import parameters
from models.effects.catalogue import every
from models.effects.priors import Priors
from models.machine import Machine
from models.quantity import declaration
from models.records.record import Record

POWERS = {
    "kg": (1, -1, 2),
    "m": (0, 1, 0),
    "s": (0, 0, 1),
    "Hz": (0, 0, -1),
    "N": (1, 0, 0),
    "W": (1, 1, -1),
    "s^2": (0, 0, 2),
}


@dataclass(frozen=True)
class Change:
    """Factors [1] of all forces, lengths and times."""

    force: float = 1.0
    length: float = 1.0
    time: float = 1.0

    def factor(self, unit: str) -> float:
        """By which a number of a unit changes: "N s/m", "N/m^3"."""
        over, _, under = unit.partition("/")
        total = 1.0
        for names, sign in ((over, 1), (under.strip("()"), -1)):
            for name in names.split():
                one, _, power = (name, "", "1") if name in POWERS else name.partition("^")
                force, length, time = (0, 0, 0) if one == "1" else POWERS[one]
                total *= (self.force**force * self.length**length * self.time**time) ** (sign * int(power or 1))
        return total

    def machine(self, machine: Machine) -> Machine:
        """The machine with every quantity that a unit is declared for."""
        changed = self._part(machine)
        assert isinstance(changed, Machine)
        kinds = every()
        rows = {
            (name, item): tuple(end * self.factor(_unit(kinds[name], item)) for end in ends)
            for (name, item), ends in machine.priors.items()
        }
        return replace(changed, priors=Priors.of(rows))

    def record(self, one: Record) -> Record:
        """The record with its signals."""
        length, force = ("target", "reference", "position"), ("feedforward", "command")
        signals = {name: getattr(one, name) * self.length for name in length}
        signals |= {name: getattr(one, name) * self.force for name in force}
        return replace(one, sample_time=one.sample_time * self.time, **signals)

    def _part(self, part: Any) -> Any:
        if isinstance(part, tuple):
            return tuple(map(self._part, part))
        if not dataclasses.is_dataclass(part) or isinstance(part, type | Priors):
            return part
        changed = {}
        for field in dataclasses.fields(part):
            declared, number = declaration(field), getattr(part, field.name)
            if declared is None:
                changed[field.name] = self._part(number)
            elif isinstance(number, tuple):
                changed[field.name] = tuple(one * self.factor(declared.unit) for one in number)
            elif isinstance(number, float):
                changed[field.name] = number * self.factor(declared.unit)
        return replace(part, **changed)


def _unit(kind: Any, name: str) -> str:
    return next(item.unit for item in parameters(kind) if item.name == name)
