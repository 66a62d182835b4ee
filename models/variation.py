"""A machine that is a little off: every way in which a real one may depart from its file, said once.

Two errors of the inertia have two names, because they are two things. A *payload* that lies on the table adds to the
rigid body alone; the vibration modes keep their gains. A wrong *mass*, or a wrong thrust constant, scales the gains of
all modes, the rigid body's and the others'.

The friction may be off in two ways, which multiply: as a whole, by its force and its presliding length, or contact by
contact, by stiffness and limit. How far off a machine is likely to be, `known` tells for each of its values.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from models.friction import Friction, elements
from models.machine import Machine, parameters
from models.machines.provenance import Shares
from models.plant import Mode, Plant

MOST_DAMPING: Final = 0.99  # a mode stays below critical damping, which the closed forms of the plant need

ABSOLUTE: Final = ("dead_time", "offset", "contact_damping")  # errors in a unit of their own
ELEMENTS: Final = ("friction.stiffness", "friction.limit")  # values with a number for each friction element

Array = NDArray[np.float64]
Each = float | tuple[float, ...]  # one number for all, or one for each mode or contact in the machine's order


@dataclass(frozen=True)
class Variation:
    """What a machine is off by: relative errors [1], above -1, unless a unit is given; 0 is as the file has it.

    friction_force, friction_length: every force, and every presliding length, of the friction. stiffness, limit: of the
    contacts, one number for all or one for each. payload: the rigid body's mass alone. mass: the mass that every mode
    moves. modal_gain: the flexible modes' gains; with one number for each mode the rigid body's as well. frequency,
    damping: of the flexible modes, one number for all or one for each mode, whose number for the rigid body is without
    effect. dead_time [s] and offset [N] are added to the file's. thrust_constant: of the thrust that a command makes;
    what the file knows in newtons of thrust, friction and offset, takes so much less of the thrust reference.
    contact_damping [s]: added to the damping of every contact over its stiffness.

    >>> pos.Variation(mass=0.03, dead_time=50e-6)
    Variation(mass=0.03, dead_time=5e-05)
    """

    friction_force: float = 0.0
    friction_length: float = 0.0
    stiffness: Each = 0.0
    limit: Each = 0.0
    payload: float = 0.0
    mass: float = 0.0
    modal_gain: Each = 0.0
    frequency: Each = 0.0
    damping: Each = 0.0
    dead_time: float = 0.0
    offset: float = 0.0
    thrust_constant: float = 0.0
    contact_damping: float = 0.0

    def __repr__(self) -> str:
        shown = [f"{one.name}={getattr(self, one.name)!r}" for one in fields(self) if np.any(getattr(self, one.name))]
        return f"Variation({', '.join(shown) or 'none'})"

    def __post_init__(self) -> None:
        """Takes lists and arrays for tuples. Raises ValueError for an error of -1 or below, which leaves nothing, and
        for one that is no finite number."""
        for one in fields(self):
            given = getattr(self, one.name)
            if np.ndim(given) > 1:
                raise ValueError(f"{one.name}: must be one number, or a row of one for each")
            if np.ndim(given) == 1 and not isinstance(given, tuple):
                object.__setattr__(self, one.name, tuple(float(number) for number in given))
            numbers = np.atleast_1d(np.asarray(given, float))
            relative = one.name not in ABSOLUTE
            if not np.all(np.isfinite(numbers)) or (relative and np.any(numbers <= -1)):
                wanted = "a relative error above -1" if relative else "a finite number"
                raise ValueError(f"{one.name}: must be {wanted}, not {given}")


def varied(machine: Machine, variation: Variation) -> Machine:
    """The machine that is off by the variation; the constant force [N] is added to the file's.

    Raises ValueError for a list that is not as long as the machine has modes or contacts.

    >>> heavier = pos.varied(machine, pos.Variation(payload=0.1, dead_time=20e-6))
    >>> round(heavier.plant.mass / machine.plant.mass, 6)
    1.1
    """
    return replace(
        machine,
        drive=replace(machine.drive, offset=machine.drive.offset / (1 + variation.thrust_constant) + variation.offset),
        plant=varied_plant(machine.plant, variation),
        friction=varied_friction(machine.friction, variation),
    )


def varied_plant(plant: Plant, variation: Variation) -> Plant:
    """The plant with the variation's errors of modes and dead time [s], which stays at 0 or above.

    Raises ValueError for a list that is not as long as the plant has modes.
    """
    count, mass = len(plant.modes), 1 + variation.mass
    gains, frequencies, dampings = (
        _each(error, count, "mode") for error in (variation.modal_gain, variation.frequency, variation.damping)
    )

    def moved(mode: Mode, gain: float, frequency: float, damping: float) -> Mode:
        rigid = mode.frequency == 0
        if rigid and not isinstance(variation.modal_gain, tuple):
            gain = 0.0  # one number for all is of the flexible modes
        return Mode(
            mode.gain * (1 + gain) / mass / (1 + variation.payload if rigid else 1.0),
            mode.frequency * (1 + frequency),
            min(mode.damping * (1 + damping), max(MOST_DAMPING, mode.damping)),
        )

    modes = tuple(moved(*one) for one in zip(plant.modes, gains, frequencies, dampings, strict=True))
    constant, dead_time = 1 + variation.thrust_constant, max(plant.dead_time + variation.dead_time, 0.0)
    return replace(plant, thrust_constant=plant.thrust_constant * constant, modes=modes, dead_time=dead_time)


def varied_friction(friction: Friction, variation: Variation) -> Friction:
    """The friction with the variation's errors of force, lengths, stiffnesses and limits, and of the thrust constant;
    its damping [N s/m] stays but for the latter and its own error, and at 0 or above.

    Raises ValueError for a list that is not as long as the friction has contacts.
    """
    count, length = len(friction.limit), 1 + variation.friction_length
    constant = 1 + variation.thrust_constant
    stiffness, limit = (np.array(_each(error, count, "contact")) for error in (variation.stiffness, variation.limit))
    return elements(
        np.array(friction.stiffness) / constant * (1 + variation.friction_force) / length * (1 + stiffness),
        np.array(friction.limit) * length * (1 + limit),
        np.maximum(np.array(friction.damping) + variation.contact_damping * np.array(friction.stiffness), 0.0)
        / constant,
    )


def at_mode(plant: Plant, index: int, error: float) -> tuple[float, ...]:
    """A relative error [1] of one of the plant's modes, as a number for each: `Variation(frequency=at_mode(...))`."""
    return tuple(error if i == index else 0.0 for i in range(len(plant.modes)))


def drawn(machine: Machine, within: Variation, count: int, seed: int) -> list[Machine]:
    """`count` machines around this one: each error uniform and independent between plus and minus that of `within`.

    A mode's gain, frequency and damping and a contact's stiffness and limit have an error of their own each. Errors
    that are 0 in `within` stay 0. The same seed gives the same machines.

    >>> tables = drawn(machine, Variation(mass=0.03, frequency=0.03), count=100, seed=1)
    >>> len(tables), all(abs(table.plant.mass / machine.plant.mass - 1) < 0.031 for table in tables)
    (100, True)
    """
    rng = np.random.default_rng(seed)
    return [varied(machine, _draw(machine, within, rng)) for _ in range(count)]


def _draw(machine: Machine, within: Variation, rng: np.random.Generator) -> Variation:
    """One variation; drawn in the order of the fields, so that a seed goes on giving the same machines."""
    lengths = dict.fromkeys(("modal_gain", "frequency", "damping"), len(machine.plant.modes))
    lengths |= dict.fromkeys(("stiffness", "limit"), len(machine.friction.limit))
    found: dict[str, Each] = {}
    for field in fields(Variation):
        most, count = getattr(within, field.name), lengths.get(field.name)
        if np.any(most):
            wide = np.array(most, float)
            number = rng.uniform(-wide, wide, count)
            found[field.name] = float(number) if count is None else tuple(number.tolist())
    return replace(Variation(), **found)  # type: ignore[arg-type]


def _each(error: Each, count: int, name: str) -> tuple[float, ...]:
    """The error [1] of each of `count` modes or contacts."""
    if not isinstance(error, tuple):
        return (error,) * count
    if len(error) != count:
        raise ValueError(f"a variation has {len(error)} numbers for {count} {name}s; give one for all or one for each")
    return error


Origin = Literal["value", "tolerance", "usual"]


@dataclass(frozen=True)
class Known:
    """How well one entry of a machine file is known: its numbers and their standard deviations, both in its unit (SI),
    and where the latter are from: stated beside the "value" itself, by the file's [tolerance], or the "usual" one.
    shares: of each number, what its deviation has in common with others; see `models.machines.provenance.Shares`.

    >>> from models.machine import load
    >>> next(one for one in known(load()) if one.name == "plant.dead_time").deviations
    (2e-05,)
    """

    name: str
    unit: str
    numbers: tuple[float, ...]
    deviations: tuple[float, ...]
    origin: Origin
    shares: Shares = ()

    @property
    def relative(self) -> tuple[float, ...]:
        """The deviations over the sizes of their numbers [1]; infinite where a number is 0."""
        pairs = zip(self.deviations, self.numbers, strict=True)
        return tuple(std / abs(number) if number else np.inf for std, number in pairs)


def known(machine: Machine) -> tuple[Known, ...]:
    """How well each value is known that this machine may be off in, in the order of its file (SI).

    A standard deviation that the file states beside a value goes before its tolerance. "friction.level" is the force of
    all contacts together, a factor, where the stiffnesses have no deviations of their own, or where the file states
    what these have in common: their sum may be far surer than each.

    >>> from models.machine import load
    >>> {one.origin for one in known(load())}
    {'usual'}
    """
    found, rows = list(_nominal(machine)), parameters(machine)
    listed = {one.name for one in found}
    for one in rows:
        if one.name not in listed and not one.name.startswith(("tolerance.", "priors.")):
            numbers = _numbers(one.number) if not isinstance(one.number, str) else ()
            std = _stated(machine, one.name, len(numbers))
            shares = _shares(machine, one.name, len(numbers))
            found += [Known(one.name, one.unit, numbers, std, "value", shares)] if std else []
    order = {one.name: i for i, one in enumerate(rows)}
    return tuple(sorted(found, key=lambda one: order.get(one.name.replace(".level", ".stiffness"), -1)))


def known_apart(machine: Machine) -> tuple[Known, ...]:
    """As `known`, for errors that are taken one by one (SI): friction elements whose deviations have errors in common
    are then known by the tolerance, as each of them may be uncertain by a half where their sum is sure.

    >>> from models.machine import load
    >>> known_apart(load()) == known(load())
    True
    """
    together = {name for name in ELEMENTS if name in machine.sources and machine.sources[name].shares}
    sources = {name: source for name, source in machine.sources.items() if name not in together}
    return known(replace(machine, sources=sources))


def _nominal(machine: Machine) -> Iterator[Known]:
    """How well the values are known that a machine file states a tolerance for."""
    plant, friction, tolerance = machine.plant, machine.friction, machine.tolerances

    def entry(name: str, unit: str, numbers: tuple[float, ...], by: str, *, share: bool = True) -> Known:
        std, unit = _stated(machine, name, len(numbers)), machine.unit(unit)
        if std:
            return Known(name, unit, numbers, std, "value", _shares(machine, name, len(numbers)))
        size = float(getattr(tolerance, by))
        origin: Origin = "tolerance" if f"tolerance.{by}" in machine.sources else "usual"
        return Known(name, unit, numbers, tuple(size * abs(one) if share else size for one in numbers), origin)

    for i, mode in enumerate(plant.modes, start=1):
        rigid = mode.frequency == 0
        yield entry(f"plant.modes.{i}.gain", "1/kg", (mode.gain,), "mass" if rigid else "mode_gain")
        if not rigid:
            yield entry(f"plant.modes.{i}.frequency", "Hz", (mode.frequency,), "frequency")
            yield entry(f"plant.modes.{i}.damping", "1", (mode.damping,), "damping")
    if tolerance.thrust_constant > 0 or _stated(machine, "plant.thrust_constant", 1):
        yield entry("plant.thrust_constant", "1", (plant.thrust_constant,), "thrust_constant")
    yield entry("plant.dead_time", "s", (plant.dead_time,), "dead_time", share=False)
    yield entry("drive.offset", "N", (machine.drive.offset,), "offset", share=False)
    stiffness = entry("friction.stiffness", "N/m", friction.stiffness, "stiffness")
    limit = entry("friction.limit", "m", friction.limit, "limit")
    if stiffness.origin != "value":
        yield entry("friction.level", "1", (1.0,), "friction_level")
    elif stiffness.shares and limit.shares:
        yield Known("friction.level", "1", (1.0,), (_of_sum(stiffness, limit),), "value")
    yield stiffness
    yield limit


def _of_sum(stiffness: Known, limit: Known) -> float:
    """The relative deviation [1] of the elements' force together, of whose parts the shares are known."""
    stiff, far = np.array(stiffness.numbers), np.array(limit.numbers)
    moved = np.concatenate([far * np.array(stiffness.deviations), stiff * np.array(limit.deviations)])
    return float(np.linalg.norm(moved @ root_of((*stiffness.shares, *limit.shares))) / (stiff @ far))


def root_of(shares: Shares) -> Array:
    """The matrix (N, K) [1] of rank-one errors that so many numbers are made up of, in parts of their deviations: those
    that they have in common, and an error of its own for each."""
    common = np.zeros((len(shares), max(map(len, shares), default=0)))
    for row, one in zip(common, shares, strict=True):
        row[: len(one)] = one
    own = np.sqrt(np.maximum(1 - np.sum(common**2, axis=1), 0.0))
    return np.hstack([common, np.diag(own)])


def _stated(machine: Machine, name: str, count: int) -> tuple[float, ...]:
    """The deviations (count,) [SI] beside a value of the file; empty where it states none, or not one for each."""
    source = machine.sources.get(name)
    std = () if source is None or source.std is None else _numbers(source.std)
    return std if len(std) == count and np.all(np.isfinite(std)) else ()


def _shares(machine: Machine, name: str, count: int) -> Shares:
    """What the deviations beside a value of the file have in common with others; empty unless there is one of each."""
    source = machine.sources.get(name)
    return source.shares if source is not None and len(source.shares) == count else ()


def _numbers(value: float | tuple[float, ...]) -> tuple[float, ...]:
    return value if isinstance(value, tuple) else (float(value),)
