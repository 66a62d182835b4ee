"""Machines that a machine file allows: every value drawn from the deviation that is stated for it, or tolerated.

Values are drawn one by one, as a file holds no correlations, so that the spread is rather too wide.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.machine import Machine, parameters
from models.variation import Variation, known, varied

Array = NDArray[np.float64]

MOST: Final = 3.0  # deviations that a draw is off at most


def machines_as_stated(machine: Machine, count: int, seed: int = 0) -> tuple[Machine, ...]:
    """`count` machines around this one (SI): values with a stated standard deviation by that, all others by the file's
    tolerances.

    >>> from models.machine import load
    >>> tables = machines_as_stated(load(), 3)
    >>> len({table.plant.mass for table in tables})
    3
    """
    rng = np.random.default_rng([seed, 31])
    return tuple(_drawn(machine, rng) for _ in range(count))


def _drawn(machine: Machine, rng: np.random.Generator) -> Machine:
    stated = [one for one in known(machine) if one.origin == "value"]
    found = varied(machine, _tolerated(machine, {one.name for one in stated}, rng))
    for one in stated:
        moved = np.array(one.numbers) + np.array(one.deviations) * _normal(rng, (len(one.numbers),))
        found = _with_value(found, machine, one.name, moved)
    return found


def _with_value(found: Machine, machine: Machine, name: str, moved: Array) -> Machine:
    """The machine with a value, which keeps its sign; as it is where the draw leaves the declared range."""
    before = np.array(next(one.number for one in parameters(machine) if one.name == name), float)
    moved = moved.reshape(before.shape)
    kept = np.where(np.sign(moved) == np.sign(before), moved, 0.05 * before)
    number = float(kept) if kept.ndim == 0 else tuple(kept.tolist())
    try:
        return found.with_value(name, number, machine.sources[name])
    except ValueError:
        return found


def _tolerated(machine: Machine, stated: set[str], rng: np.random.Generator) -> Variation:
    """Errors of the values that have no stated deviation, drawn within the file's tolerances."""
    tolerance, modes, contacts = machine.tolerance, len(machine.plant.modes), len(machine.friction.limit)

    def of(deviation: float, names: list[str]) -> tuple[float, ...]:
        drawn = np.exp(deviation * _normal(rng, (len(names),))) - 1
        return tuple(0.0 if name in stated else float(one) for name, one in zip(names, drawn, strict=True))

    numbers = [f"plant.modes.{i + 1}" for i in range(modes)]
    gain = list(of(tolerance.mode_gain, [f"{name}.gain" for name in numbers]))
    rigid = machine.plant.rigid
    gain[rigid] = of(tolerance.mass, [f"{numbers[rigid]}.gain"])[0]
    together = of(tolerance.friction_level, ["friction.stiffness"])[0]
    return Variation(
        friction_force=together,
        stiffness=of(tolerance.stiffness, ["friction.stiffness"] * contacts),
        limit=of(tolerance.limit, ["friction.limit"] * contacts),
        modal_gain=tuple(gain),
        frequency=of(tolerance.frequency, [f"{name}.frequency" for name in numbers]),
        damping=of(tolerance.damping, [f"{name}.damping" for name in numbers]),
        dead_time=0.0 if "plant.dead_time" in stated else tolerance.dead_time * float(_normal(rng, ())),
        offset=0.0 if "drive.offset" in stated else tolerance.offset * float(_normal(rng, ())),
    )


def _normal(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    return np.asarray(np.clip(rng.standard_normal(shape), -MOST, MOST), float)
