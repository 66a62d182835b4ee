"""The values of a machine file whose change takes most of the gap, by what each of them does alone.

How many of its tolerances a value was moved says nothing of the gap: 2 % of mass is within the usual tolerance, and all
that a record shows where its noise is a thousandth of the thrust. So each value of the file is moved to where it was
fitted, by itself and then beside those that take more: the energy of the unknown force that it takes off is its share.
Values that stand in for each other are moved together: dead time and lag, a mode's three numbers, the contacts.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.model.fit import Fit
from diagnosis.model.parameters import OF_MODES, bounded
from diagnosis.model.residual import Candidate, smooth
from diagnosis.model.unknown_force import unknown_force
from diagnosis.records.motions import rms
from models.effects.base import Effect
from models.effects.base import parameters as parameters_of
from models.effects.catalogue import named, paired
from models.machine import Machine
from models.records.record import Record

Array = NDArray[np.float64]

MIN_SHARE: Final = 0.05  # of the gap, below which a value is not among those that take most of it
START: Final = "initial_friction_state"
CONTACTS: Final = ("friction_level", "presliding_stiffness", "presliding_limit")
MOVED_ALONE: Final = {"payload_mass": "kg", "thrust_constant": "1", "amplifier_offset": "N", "contact_damping": "s"}


@dataclass(frozen=True)
class Number:
    """A number of the file before and now, in its unit; what it is where the value has several."""

    name: str
    unit: str
    before: float
    now: float


@dataclass(frozen=True)
class MovedMost:
    """A value of the file, or several that stand in for each other; share [1]: of the gap that it takes off; kinds: the
    names in theta, or of effects of the file, that it covers."""

    name: str
    share: float
    kinds: tuple[str, ...]
    numbers: tuple[Number, ...]

    def to_json(self) -> dict[str, Any]:
        """As results.json has it."""
        return asdict(self)


@dataclass(frozen=True)
class _Group:
    """What is moved together: entries of theta with their values [SI and logarithms], and effects of the file, by name
    as in its paths."""

    theta: Mapping[int, float]
    kinds: tuple[str, ...]
    numbers: tuple[Number, ...]
    effects: Mapping[str, Effect] = field(default_factory=dict)


def moved_most(fitted: Fit, records: Sequence[Record], floor: float) -> tuple[MovedMost, ...]:
    """The values that take most of the gap between the file, as delivered, and a floor of force [N], the one that takes
    the most first, as long as a further one takes MIN_SHARE of it."""
    groups = _groups(fitted.candidate, fitted.paths[0].path.sample_time)

    def energy(names: Sequence[str]) -> float:
        partly = _with(fitted.candidate, [groups[name] for name in names])
        return rms(unknown_force(partly, records, smooth(partly, records, fitted.paths))) ** 2

    left = energy([])
    gap, found = left - floor**2, list[MovedMost]()
    while gap > 0 and len(found) < len(groups):
        taken = [one.name for one in found]
        each = {name: energy([*taken, name]) for name in groups if name not in taken}
        most = min(each.values()) + MIN_SHARE * gap  # of those that take as much, the one with the fewest values
        best = min(
            (name for name in each if each[name] <= most), key=lambda name: (len(groups[name].theta), each[name])
        )
        share = (left - each[best]) / gap
        if share < MIN_SHARE:
            break
        found.append(MovedMost(best, min(share, 1.0), groups[best].kinds, groups[best].numbers))
        left = each[best]
        if left - floor**2 < MIN_SHARE * gap:
            break
    return tuple(sorted(found, key=lambda one: -one.share))


def _with(fitted: Candidate, groups: Sequence[_Group]) -> Candidate:
    """The machine of the file, at the starts of the fit, with these groups as they were fitted; contacts after their
    level, which they include."""
    layout = fitted.layout
    theta = np.where(np.array(layout.names) == START, fitted.theta, 0.0)
    for group in sorted(groups, key=lambda one: len(one.theta)):
        theta[list(group.theta)] = list(group.theta.values())
    other = {name: effect for group in groups for name, effect in group.effects.items()}
    effects = tuple(other.get(path, effect) for path, effect in named(fitted.nominal.effects).items())
    return Candidate(layout, bounded(layout, theta), effects)


def _groups(fitted: Candidate, sample_time: float) -> dict[str, _Group]:
    """All that may be moved, by name; sample_time [s]: of the records, half of which the hold takes."""
    before, after = fitted.nominal, fitted.machine
    found = dict[str, _Group]()
    for name, unit in MOVED_ALONE.items():
        number = Number("", before.unit(unit), *(_alone(name, one) for one in (before, after)))
        found[name] = _Group(_of(fitted, name), (name,), (number,))
    stated = _stated(fitted)
    late = {path: pair for path, pair in stated.items() if pair[0].delayed_by}
    found |= _delay(fitted, late, sample_time) | _contacts(fitted) | _modes(fitted)
    kinds = dict.fromkeys(pair[0].name for path, pair in stated.items() if path not in late)
    for kind in kinds:  # such as a cogging's harmonics, which go together
        pairs = {path: pair for path, pair in stated.items() if pair[0].name == kind}
        numbers = tuple(itertools.chain.from_iterable(_of_effect(*pair) for pair in pairs.values()))
        found[kind] = _Group({}, (kind,), numbers, {path: now for path, (_, now) in pairs.items()})
    return {name: one for name, one in found.items() if one.effects or any(one.theta.values())}


def _of(fitted: Candidate, name: str) -> dict[int, float]:
    return {int(place): float(fitted.theta[place]) for place in fitted.layout.of(name)}


def _alone(name: str, machine: Machine) -> float:
    """The number of a value that is moved alone [SI]."""
    plant, friction = machine.plant, machine.friction
    return {
        "payload_mass": plant.mass * plant.thrust_constant,
        "thrust_constant": plant.thrust_constant,
        "amplifier_offset": machine.drive.offset,
        "contact_damping": sum(friction.damping) / max(sum(friction.stiffness), 1e-300),
    }[name]


def _stated(fitted: Candidate) -> dict[str, tuple[Effect, Effect]]:
    """The effects of the file that are other than they were, as they were and as they were fitted, by name as in its
    paths."""
    pairs = paired(fitted.nominal.effects, fitted.effects)
    return {path: (before, now) for path, (before, now) in pairs.items() if now != before}


def _of_effect(before: Effect, after: Effect) -> tuple[Number, ...]:
    """The numbers of an effect that moved, but for the choice between laws."""
    rows = [(item, getattr(before, item.name), getattr(after, item.name)) for item in parameters_of(type(before))]
    return tuple(
        Number(item.name, item.unit, float(then), float(now))
        for item, then, now in rows
        if item.role != "switch" and now != then
    )


def _delay(fitted: Candidate, late: Mapping[str, tuple[Effect, Effect]], sample_time: float) -> dict[str, _Group]:
    """The dead time and the lags of the file, which records show as one: the whole input delay [s]."""
    if not late:
        number = Number("", "s", fitted.nominal.plant.dead_time, fitted.machine.plant.dead_time)
        return {"dead_time": _Group(_of(fitted, "dead_time"), ("dead_time",), (number,))}
    hold = 0.5 * sample_time
    before = fitted.nominal.plant.dead_time + hold + sum(given.input_delay() for given, _ in late.values())
    now = fitted.machine.plant.dead_time + hold + sum(effect.input_delay() for _, effect in late.values())
    kinds, number = ("dead_time", *dict.fromkeys(one.name for one, _ in late.values())), Number("", "s", before, now)
    moved = {path: effect for path, (_, effect) in late.items()}
    return {"input_delay": _Group(_of(fitted, "dead_time"), kinds, (number,), moved)}


def _contacts(fitted: Candidate) -> dict[str, _Group]:
    """The force of all contacts where they slip [N], as a factor of all of them; and all of each."""
    before, after = (one.friction for one in (fitted.nominal, fitted.machine))
    force, stiffness = (
        [float(np.sum(part)) for part in pair]
        for pair in (
            [np.multiply(one.stiffness, one.limit) for one in (before, after)],
            [one.stiffness for one in (before, after)],
        )
    )
    (level,) = fitted.layout.of("friction_level")
    unit = fitted.nominal.unit
    whole = (
        Number("force in all", unit("N"), force[0], force[1]),
        Number("stiffness in all", unit("N/m"), stiffness[0], stiffness[1]),
    )
    each = {place: size for name in CONTACTS for place, size in _of(fitted, name).items()}
    factor = {int(level): float(np.log(force[1] / force[0]))}
    return {
        "friction_level": _Group(factor, CONTACTS[:1], (Number("", unit("N"), force[0], force[1]),)),
        "contacts": _Group(each, CONTACTS, whole),
    }


def _modes(fitted: Candidate) -> dict[str, _Group]:
    """Each vibration mode: its gain, frequency and damping."""
    before, after = fitted.nominal.plant, fitted.machine.plant
    found = {}
    for order, i in enumerate(before.flexible):
        theta = {}
        for name in OF_MODES:
            place = int(fitted.layout.of(name)[order])
            theta[place] = float(fitted.theta[place])
        numbers = tuple(
            Number(name, unit, float(getattr(before.modes[i], name)), float(getattr(after.modes[i], name)))
            for name, unit in (("frequency", "Hz"), ("gain", fitted.nominal.unit("1/kg")), ("damping", "1"))
        )
        found[f"vibration_mode_{i + 1}"] = _Group(theta, OF_MODES, numbers)
    return found
