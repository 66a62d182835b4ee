"""The values of a machine file that a re-fit moved farther than the file knows them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from models.machine import Machine, parameters
from models.variation import known

TWICE: Final = 2.0  # tolerances beyond which a value is not within them
OVERRUN: Final = 10.0  # of the deviations that the file states of a value: moved farther, it may stand in for a law


@dataclass(frozen=True)
class Overrun:
    """A value that a file was moved away from: what it was, with the standard deviation that the file states of it, and
    what it is now (all in its unit)."""

    name: str
    unit: str
    before: float
    std: float
    now: float

    @property
    def deviations(self) -> float:
        """By how many of the stated deviations it was moved [1]."""
        return abs(self.now - self.before) / self.std


def overrun(delivered: Machine, improved: Machine, least: float) -> tuple[Overrun, ...]:
    """The values of a machine file that an improved one has elsewhere by more than `least` [1] of the deviations that
    the file states beside them, the mass first and then the farthest; of a list the number that is the farthest. Where
    the model lacks something, they stand in for it."""
    mass = _gain_of_mass(delivered)
    moved = _moved(delivered, improved)
    far = [one for origin, one in moved if origin == "value" and one.deviations > least]
    return tuple(sorted(far, key=lambda one: (one.name != mass, -one.deviations)))


def beyond_tolerance(delivered: Machine, improved: Machine) -> dict[str, str]:
    """How far the values were moved that have no deviation of their own in the file, in words, by name: in tolerances
    that the file states, or usual ones. Those moved by less than TWICE are left out."""
    words = {"tolerance": "tolerances", "usual": "usual tolerances"}
    return {
        one.name: f"{one.deviations:.2g} {words[origin]}"
        for origin, one in _moved(delivered, improved)
        if origin != "value" and one.deviations > TWICE
    }


def _moved(delivered: Machine, improved: Machine) -> Iterator[tuple[str, Overrun]]:
    """Every value of a machine file that is known in some way, or the number of a list that moved the farthest,
    after the origin of that knowledge."""
    after = {one.name: one.number for one in parameters(improved) if not isinstance(one.number, str)}
    for one in known(delivered):
        if np.size(after.get(one.name, ())) != len(one.numbers):  # as elements that were halved
            continue
        rows = zip(one.numbers, one.deviations, np.atleast_1d(after[one.name]).tolist(), strict=True)
        each = [Overrun(one.name, one.unit, *row) for row in rows if row[1] > 0]
        if each:
            yield one.origin, max(each, key=lambda row: row.deviations)


def as_reported(one: Overrun, machine: Machine) -> Overrun:
    """The value as an engineer reads it: the gain of the rigid body as the mass [kg], any other as it is."""
    if one.name != _gain_of_mass(machine):
        return one
    return Overrun("plant.mass", "kg", 1 / one.before, one.std / one.before**2, 1 / one.now)


def _gain_of_mass(machine: Machine) -> str:
    """The name of the gain of the rigid body; empty where there is none."""
    rigid = next((i for i, mode in enumerate(machine.plant.modes, 1) if mode.frequency == 0), 0)
    return f"plant.modes.{rigid}.gain" if rigid else ""
