"""Whether all that a thrust constant scales moved by one factor: that it is off explains them all at once."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping
from typing import Any, Final

from models.effects.base import parameters
from models.machine import Machine
from models.quantity import listed
from studies.wording import effect, in_percent

MIN_CHANGE: Final = 0.02  # change of a thrust constant that is worth a sentence [1]
MAX_SPREAD: Final = 0.15  # of their median, on logarithms, within which values moved by one factor
MAX_OTHERS_SPREAD: Final = 0.5  # of it, for values that something else moved as well, as wear does friction
MIN_MOVED_VALUES: Final = 3  # values that moved by it: two may have changed by as much by chance


def common_factor(given: Machine, better: Machine) -> dict[str, Any] | None:
    """By which factor [1] mass, friction and the forces of stated effects moved together, and the names of those that
    moved by it; None where they did not, or are too few to tell."""
    pairs = {
        "moving mass": (given.plant.mass, better.plant.mass),
        "friction": (given.friction.coulomb_force, better.friction.coulomb_force),
        **_forces(given, better),
    }
    known = {name: pair for name, pair in pairs.items() if pair != (0.0, 0.0)}
    moved = {name: math.log(now / before) for name, (before, now) in known.items() if before * now > 0}
    middle = statistics.median(moved.values()) if len(moved) == len(known) else 0.0
    alike = [name for name, one in moved.items() if abs(one - middle) <= MAX_SPREAD * abs(middle)]
    together = all(abs(one - middle) <= MAX_OTHERS_SPREAD * abs(middle) for one in moved.values())
    if abs(middle) < MIN_CHANGE or len(alike) < MIN_MOVED_VALUES or not together:
        return None
    return {"names": alike, "factor": math.exp(middle)}


def _forces(given: Machine, better: Machine) -> dict[str, tuple[float, float]]:
    """The forces per unit of what they follow, of effects that both files state once, before and now [SI]."""
    found = {}
    for before in given.effects:
        same = [one for one in (*given.effects, *better.effects) if one.name == before.name]
        sizes = [item for item in parameters(type(before)) if item.role == "amplitude" and item.unit.startswith("N")]
        if len(same) == 2 and len(sizes) == 1:
            found[before.name] = float(getattr(same[0], sizes[0].name)), float(getattr(same[1], sizes[0].name))
    return found


def told(found: Mapping[str, Any] | None) -> list[str]:
    """A sentence on it; none without one."""
    if not found:
        return []
    factor = float(found["factor"])
    change, constant = in_percent(abs(factor - 1)), in_percent(abs(1 / factor - 1))
    grown, weaker = ("larger", "smaller") if factor > 1 else ("smaller", "larger")
    names = listed([effect(name) for name in found["names"]])
    return [
        f"{names[0].upper()}{names[1:]} are all {change} {grown}, as they would be if the thrust constant were "
        f"{constant} {weaker}: check the motor's constant and the scale of its current first."
    ]
