"""Machines that a machine file allows: every value drawn from the deviation that is stated for it, or tolerated.

Values are drawn together where the file states what their deviations have in common: friction elements that stand in
for each other, a lag and a dead time, of which the sum is far surer than each. All others are drawn one by one, so that
the spread is rather too wide.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.machine import Machine, parameters
from models.machines.normal_within import normal_within
from models.variation import Known, Variation, known, root_of, varied

Array = NDArray[np.float64]

MAX_STDS: Final = 3.0  # deviations that a draw is off at most
SMALLEST: Final = 0.05  # of a value that keeps its sign: the least that is drawn
THRUST: Final = "plant.thrust_constant"  # drawn as an error of the whole machine: it moves more than its own value


def machines_as_stated(machine: Machine, count: int, seed: int = 0) -> tuple[Machine, ...]:
    """`count` machines around this one (SI): values with a stated standard deviation by that, all others by the file's
    tolerances. What has a deviation of its own is in newtons of the thrust reference, as records show it: another
    thrust constant moves only what is known in newtons.

    >>> from models.machine import load
    >>> tables = machines_as_stated(load(), 3)
    >>> len({table.plant.mass for table in tables})
    3
    """
    rng = np.random.default_rng([seed, 31])
    stated = [one for one in known(machine) if one.origin == "value" and one.name in machine.sources]
    alone = [one for one in stated if not one.shares and one.name != THRUST]
    shared = [one for one in stated if one.shares and one.name != THRUST]
    together = _together(machine, shared, count, np.random.default_rng([seed, 37]))
    return tuple(_drawn(machine, alone, shared, moved, rng) for moved in together)


def _drawn(
    machine: Machine, alone: Sequence[Known], shared: Sequence[Known], together: Array, rng: np.random.Generator
) -> Machine:
    """The machine with other numbers for the values with a stated deviation, of those that share it together (N,) [SI],
    and within the tolerances of all others."""
    found = varied(machine, _tolerated(machine, {one.name for one in (*alone, *shared)}, rng))
    for one in alone:
        before = np.array(one.numbers)
        moved = before + np.array(one.deviations) * _normal(rng, before.shape)
        kept = np.where(np.sign(moved) == np.sign(before), moved, SMALLEST * before)
        found = _with_value(found, machine, one.name, kept)
    ends = np.cumsum([len(one.numbers) for one in shared])[:-1]
    for one, numbers in zip(shared, np.split(together, ends), strict=False):
        moved = _with_forces(numbers, machine, found) if one.name == "friction.limit" else numbers
        found = _with_value(found, machine, one.name, moved)
    return found


def _together(machine: Machine, shared: Sequence[Known], count: int, rng: np.random.Generator) -> Array:
    """The numbers (count, N) [SI] of values that share their deviations; one that has a sign by its nature keeps it."""
    if not shared:
        return np.zeros((count, 0))
    numbers = np.array([number for one in shared for number in one.numbers])
    wide = np.array([std for one in shared for std in one.deviations])
    signed = np.array([not _may_turn(machine, one) for one in shared for _ in one.numbers], bool)
    far = np.divide((SMALLEST - 1) * numbers, wide, out=np.zeros(wide.size), where=wide > 0)
    low, high = np.where(signed & (numbers >= 0), far, -np.inf), np.where(signed & (numbers < 0), far, np.inf)
    root = root_of(tuple(row for one in shared for row in one.shares))
    return np.asarray(numbers + wide * normal_within(root, low, high, count, rng))


def _with_forces(moved: Array, machine: Machine, found: Machine) -> Array:
    """The limits (N,) [m] that move each element's force, k z, as far as moved ones (N,) [m] do to the first order: for
    stiffnesses that are open by a half the forces would else have a sum that is less sure than stated."""
    softer, before = np.divide(machine.friction.stiffness, found.friction.stiffness), np.array(machine.friction.limit)
    return np.asarray(np.maximum(before + (moved - before) * softer, SMALLEST * before))


def _may_turn(machine: Machine, one: Known) -> bool:
    """Whether a file may have a value with the other sign."""
    before = next(row.number for row in parameters(machine) if row.name == one.name)
    turned = tuple(-number for number in one.numbers)
    try:
        machine.with_value(one.name, turned if isinstance(before, tuple) else turned[0], machine.sources[one.name])
    except ValueError:
        return False
    return any(one.numbers)


def _with_value(found: Machine, machine: Machine, name: str, moved: Array) -> Machine:
    """The machine with a value [SI]; as it is where the draw leaves the declared range."""
    before = next(one.number for one in parameters(machine) if one.name == name)
    number = tuple(moved.tolist()) if isinstance(before, tuple) else float(moved[0])
    try:
        return found.with_value(name, number, machine.sources[name])
    except ValueError:
        return found


def _tolerated(machine: Machine, stated: set[str], rng: np.random.Generator) -> Variation:
    """Errors of the values that have no stated deviation, drawn within the file's tolerances."""
    tolerance, modes, contacts = machine.tolerances, len(machine.plant.modes), len(machine.friction.limit)

    def of(deviation: float, names: list[str]) -> tuple[float, ...]:
        drawn = np.exp(deviation * _normal(rng, (len(names),))) - 1
        return tuple(0.0 if name in stated else float(one) for name, one in zip(names, drawn, strict=True))

    numbers = [f"plant.modes.{i + 1}" for i in range(modes)]
    gain = list(of(tolerance.mode_gain, [f"{name}.gain" for name in numbers]))
    rigid = machine.plant.rigid
    gain[rigid] = of(tolerance.mass, [f"{numbers[rigid]}.gain"])[0]
    together = of(tolerance.friction_level, ["friction.stiffness"])[0]
    thrust = next((one.relative[0] for one in known(machine) if one.name == THRUST), 0.0)
    return Variation(
        friction_force=together,
        stiffness=of(tolerance.stiffness, ["friction.stiffness"] * contacts),
        limit=of(tolerance.limit, ["friction.limit"] * contacts),
        modal_gain=tuple(gain),
        frequency=of(tolerance.frequency, [f"{name}.frequency" for name in numbers]),
        damping=of(tolerance.damping, [f"{name}.damping" for name in numbers]),
        dead_time=0.0 if "plant.dead_time" in stated else tolerance.dead_time * float(_normal(rng, ())),
        offset=0.0 if "drive.offset" in stated else tolerance.offset * float(_normal(rng, ())),
        thrust_constant=of(thrust, [THRUST])[0] if thrust else 0.0,
    )


def _normal(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    return np.asarray(np.clip(rng.standard_normal(shape), -MAX_STDS, MAX_STDS), float)
