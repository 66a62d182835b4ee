"""The nominal parameters of a machine, which are known to within a prior and re-fitted every time.

The vector theta (P,) holds deviations: relative ones as logarithms (for the payload's mass, of the rigid body's gain),
the dead time [s], the offset [N], the contacts' damping over their stiffness [s] where the file states how well it is
known, and the friction elements' displacements [m] at the start of each record. An effect
counts only for what it explains beyond these, because a gap that a re-fit closes needs no new physics.

A deviation that a machine file states beside a value widens its prior and never narrows it: it says how well records
once told the value, while a diagnosis asks about an axis that may have changed since, by as much as is usual. A prior
that is too narrow would make a change that needs no new physics look like an effect.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.machine import Machine
from models.variation import Origin, Variation, known_apart, varied

Array = NDArray[np.float64]

NOWHERE: Final = np.zeros(0, np.int64)
PRIOR_BOUND_STDS: Final = 3.0  # bound of a parameter, in prior standard deviations
# Bound of those in LOOSE: a drive or a preload may have been changed without a note in the file.
LOOSE_BOUND_STDS: Final = 8.0
BELOW_NYQUIST: Final = 0.99  # of the Nyquist frequency, to which a re-fit may move a mode's frequency at most
MASS_BOUND_STDS: Final = 20.0  # bound of the mass and of a mode's frequency: a load may have been left on the table
MAX_RELATIVE_STD: Final = 1.0  # relative deviation of a value at most, as of a stated tolerance
ABSOLUTE: Final = ("plant.dead_time", "drive.offset")  # values whose deviation is not a share of them
UNKNOWN_DELAY: Final = 0.5  # sample times: deviation of a dead time that a file neglects; drives take one or two
TOLERANCES: Final = {  # of the file that each parameter's prior is from, and the unit of its deviation
    "mode_gain": ("mode_gain", "1"),
    "payload_mass": ("mass", "1"),
    "mode_frequency": ("frequency", "1"),
    "mode_damping": ("damping", "1"),
    "dead_time": ("dead_time", "s"),
    "thrust_constant": ("thrust_constant", "1"),
    "amplifier_offset": ("offset", "N"),
    "friction_level": ("friction_level", "1"),
    "presliding_stiffness": ("stiffness", "1"),
    "presliding_limit": ("limit", "1"),
    "contact_damping": ("", "s"),  # of which a file has no tolerance, and which only moves where it states a deviation
}
OF_MODES: Final = ("mode_gain", "mode_frequency", "mode_damping")
LOOSE: Final = (
    "mode_gain",
    "mode_frequency",
    "mode_damping",
    "dead_time",
    "friction_level",
    "thrust_constant",
    "amplifier_offset",
)


@dataclass(frozen=True)
class Parameters:
    """The layout of theta for one machine and so many records: names, prior standard deviations (P,), bounds low and
    high (P,)."""

    machine: Machine
    records: int
    names: tuple[str, ...]
    deviation: Array
    low: Array
    high: Array

    @property
    def count(self) -> int:
        """P."""
        return self.deviation.size

    def of(self, name: str) -> NDArray[np.int64]:
        """The indices in theta of the parameters of this name; not to be changed."""
        return self._places.get(name, NOWHERE)

    @cached_property
    def _places(self) -> dict[str, NDArray[np.int64]]:
        """The indices by name: a diagnosis asks for them ten thousand times."""
        return {name: np.flatnonzero(np.array(self.names) == name) for name in set(self.names)}


def parameters(machine: Machine, records: int) -> Parameters:
    """The parameters of a machine, with priors by its tolerance, in so many records."""
    rows = list(_rows(machine, records))
    names, usual, deviation = zip(*rows, strict=True)
    wide = np.array(deviation)
    far = np.where(np.isin(names, LOOSE), LOOSE_BOUND_STDS, PRIOR_BOUND_STDS)
    far[np.isin(names, ["payload_mass", "mode_frequency"])] = MASS_BOUND_STDS
    high = np.maximum(far * np.array(usual), PRIOR_BOUND_STDS * wide)
    low = -high
    for name, least in at_most_lower(machine).items():
        low = np.where(np.array(names) == name, np.maximum(low, -least), low)
    start, limit = np.array(names) == "initial_friction_state", np.array(names) == "presliding_limit"
    if machine.drive.travel > 0:  # a contact that would slip beyond the travel is a spring
        within = np.log(np.maximum(machine.drive.travel / np.array(machine.friction.limit), 1.0))
        high[limit] = np.minimum(high[limit], within)
    mode = np.array(names) == "mode_frequency"
    high[mode] = np.minimum(high[mode], below_nyquist(machine))
    longer = np.exp(np.minimum(PRIOR_BOUND_STDS * wide[limit], high[limit]))  # the limits are fitted, too
    high[start] = np.tile(np.array(machine.friction.limit) * longer, records)
    low[start] = -high[start]
    return Parameters(machine, records, names, wide, low, high)


def below_nyquist(machine: Machine) -> Array:
    """How far each of the plant's modes may rise (F,) [1, on the logarithm], as a machine file has none from the
    Nyquist frequency on."""
    frequency = np.array([machine.plant.modes[i].frequency for i in machine.plant.flexible])
    most = BELOW_NYQUIST * 0.5 / machine.sample_time
    return np.asarray(np.log(np.maximum(most / frequency, 1.0)))


def at_most_lower(machine: Machine) -> dict[str, float]:
    """How far the values may fall that a physical bound of 0 holds, by their names [SI]."""
    friction = machine.friction
    lags = [d / k for d, k in zip(friction.damping, friction.stiffness, strict=True) if k > 0]
    return {"dead_time": machine.plant.dead_time, "contact_damping": max(lags, default=0.0)}


def _rows(machine: Machine, records: int) -> Iterator[tuple[str, float, float]]:
    """Name, usual deviation and deviation of each parameter: what the file states beside a value where that is more."""
    plant, friction, tolerance = machine.plant, machine.friction, machine.tolerances
    stated = {one.name: one for one in known_apart(machine) if one.origin == "value"}

    def each(name: str, usual: float, path: str, count: int = 1) -> Iterator[tuple[str, float, float]]:
        one = stated.get(path)
        said = (0.0,) * count if one is None else one.deviations if path in ABSOLUTE else one.relative
        yield from (
            (name, usual, max(usual, min(std, np.inf if path in ABSOLUTE else MAX_RELATIVE_STD))) for std in said
        )

    flexible = [f"plant.modes.{i + 1}" for i in plant.flexible]
    for i, mode in enumerate(plant.modes, start=1):
        name, usual = ("mode_gain", tolerance.mode_gain) if mode.frequency > 0 else ("payload_mass", tolerance.mass)
        yield from each(name, usual, f"plant.modes.{i}.gain")
    for path in flexible:
        yield from each("mode_frequency", tolerance.frequency, f"{path}.frequency")
    for path in flexible:
        yield from each("mode_damping", tolerance.damping, f"{path}.damping")
    yield from each("dead_time", _delay_deviation(machine), "plant.dead_time")
    if tolerance.thrust_constant > 0:
        yield "thrust_constant", tolerance.thrust_constant, tolerance.thrust_constant
    yield from each("amplifier_offset", tolerance.offset, "drive.offset")
    yield "friction_level", tolerance.friction_level, tolerance.friction_level
    yield from each("presliding_stiffness", tolerance.stiffness, "friction.stiffness", len(friction.stiffness))
    yield from each("presliding_limit", tolerance.limit, "friction.limit", len(friction.limit))
    damping = stated.get("friction.damping")
    if damping is not None:  # tau = D_i / K_i is one time of all contacts, see models.identification.force.by_elements
        lags = [std / k for std, k in zip(damping.deviations, friction.stiffness, strict=True) if k > 0]
        yield "contact_damping", 0.0, max(lags)
    for _ in range(records):
        yield from (("initial_friction_state", 0.6 * limit, 0.6 * limit) for limit in friction.limit)


def modes_as_stated(layout: Parameters) -> Array:
    """The deviations (P,) with which the vibration modes are known as the file states beside their values, where that
    is less than usual; those of everything else, and of other modes, stay as they are [SI; 1 for logarithms]."""
    machine, deviation = layout.machine, layout.deviation.copy()
    stated = {one.name: one.relative[0] for one in known_apart(machine) if one.origin == "value"}
    for name, value in (("mode_gain", "gain"), ("mode_frequency", "frequency"), ("mode_damping", "damping")):
        for place, i in zip(layout.of(name), machine.plant.flexible, strict=True):
            said = stated.get(f"plant.modes.{i + 1}.{value}", 0.0)
            deviation[place] = min(said, deviation[place]) if said > 0 else deviation[place]
    return deviation


@dataclass(frozen=True)
class Prior:
    """The prior of all parameters of one name: the least and the largest standard deviation [SI; 1 for logarithms], and
    where the largest is from: stated beside a "value" of the file, its "tolerance", or the "usual" tolerance."""

    name: str
    unit: str
    deviations: tuple[float, float]
    origin: Origin


def priors(layout: Parameters) -> tuple[Prior, ...]:
    """How far nominal values may move for little, by their names, without the friction's state at the start [SI]."""
    rows, machine = list(_rows(layout.machine, 0)), layout.machine
    found = []
    for name, (tolerance, unit) in TOLERANCES.items():
        each = [(usual, deviation) for own, usual, deviation in rows if own == name]
        if each:
            wider = any(deviation > usual for usual, deviation in each)
            stated: Origin = "tolerance" if f"tolerance.{tolerance}" in machine.sources else "usual"
            sizes = [deviation for _, deviation in each]
            found.append(Prior(name, machine.unit(unit), (min(sizes), max(sizes)), "value" if wider else stated))
    return tuple(found)


def _delay_deviation(machine: Machine) -> float:
    """Deviation [s] of the dead time. One of 0 that is only assumed neglects the delay that every drive has, so that
    the usual tolerance, which is about a known delay, does not hold for it."""
    source, usual = machine.sources.get("plant.dead_time"), machine.tolerances.dead_time
    neglected = machine.plant.dead_time == 0 and source is not None and source.kind == "assumed"
    if not neglected or "tolerance.dead_time" in machine.sources:
        return usual
    return max(usual, UNKNOWN_DELAY * machine.sample_time)


def applied(layout: Parameters, theta: Array) -> Machine:
    """The machine with the deviations theta (P,), whose offset [N] is added to the file's; without the initial state of
    the friction, which belongs to the records.

    A thrust constant that is off, where it may be, divides the friction and the file's offset: these are known in
    newtons, and act in newtons of thrust reference.
    """
    machine = layout.machine
    plant, level = machine.plant, float(theta[layout.of("friction_level")][0])
    gain, frequency, damping = ([0.0] * len(plant.modes) for _ in range(3))
    gain[plant.rigid] = _relative(theta[layout.of("payload_mass")][0])
    for name, errors in (("mode_gain", gain), ("mode_frequency", frequency), ("mode_damping", damping)):
        for i, shift in zip(plant.flexible, theta[layout.of(name)], strict=True):
            errors[i] = _relative(shift)
    variation = Variation(
        stiffness=tuple((np.exp(theta[layout.of("presliding_stiffness")] + level) - 1).tolist()),
        limit=tuple((np.exp(theta[layout.of("presliding_limit")]) - 1).tolist()),
        modal_gain=tuple(gain),
        frequency=tuple(frequency),
        damping=tuple(damping),
        dead_time=float(theta[layout.of("dead_time")][0]),
        offset=float(theta[layout.of("amplifier_offset")][0]),
        thrust_constant=_relative(np.sum(theta[layout.of("thrust_constant")])),
        contact_damping=float(np.sum(theta[layout.of("contact_damping")])),
    )
    return varied(machine, variation)


def _relative(logarithm: float) -> float:
    """The relative error [1] of a value that is off by so much on the logarithm.

    Not expm1: 1 + (y - 1) gives back y = exp(logarithm) to the last digit for y above 1/2.
    """
    return float(np.exp(logarithm)) - 1


def initial_state(layout: Parameters, theta: Array, record: int) -> Array:
    """Displacements (N,) [m] of the friction's elements at the start of a record."""
    start = theta[layout.of("initial_friction_state")].reshape(layout.records, -1)
    return np.asarray(start[record], float)


def bounds(layout: Parameters, theta: Array) -> tuple[Array, Array]:
    """The least and the greatest theta (P,) [SI]; of the elements' displacements their limits with this theta: beyond
    these a displacement is the same, and a step there would not be felt."""
    low, high = layout.low.copy(), layout.high.copy()
    start, stretched = layout.of("initial_friction_state"), np.exp(theta[layout.of("presliding_limit")])
    high[start] = np.tile(np.array(layout.machine.friction.limit) * stretched, layout.records)
    low[start] = -high[start]
    return low, high


def bounded(layout: Parameters, theta: Array) -> Array:
    """theta (P,) clipped to its bounds, the elements' displacements [m] to the limits that are then theirs."""
    within = np.clip(theta, layout.low, layout.high)
    return np.clip(theta, *bounds(layout, within))


def moved(layout: Parameters, theta: Array) -> Array:
    """By how many prior standard deviations (P,) [1] each value is above the file's.

    theta has the logarithm of the rigid body's gain for `payload_mass`, and the gain falls as the mass rises.
    """
    sign = np.where(np.array(layout.names) == "payload_mass", -1.0, 1.0)
    return np.asarray(sign * theta / layout.deviation)
