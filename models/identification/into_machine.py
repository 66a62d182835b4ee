"""What a fit found, put into the machine: each value with its record, the record's hash and its standard deviation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.effects import catalogue
from models.effects.base import Effect
from models.effects.friction_laws import DirectionalFriction, ViscousFriction
from models.effects.motor import CurrentLoopLag
from models.effects.structure import CableSpring
from models.identification import modes
from models.identification.estimate import Estimate, newey_west
from models.identification.force import by_elements
from models.identification.force.fit import DAMPING, SIGNIFICANT_STDS, SPRING, ForceFit
from models.identification.motion import MotionFit
from models.machine import Machine, Provenance, with_derived_presliding
from models.records.files import Loaded
from models.variation import known_apart

Array = NDArray[np.float64]

VISCOUS_DIRECTIONS: Final = ("viscous friction forwards", "viscous friction backwards")
METHODS: Final = {
    "response": "frequency response",
    "hysteresis": "slow record",
    "motion": "prediction error of motions",
    "dynamics": "inverse dynamics",
}


@dataclass(frozen=True)
class Found:
    """Where values are from: the file, and which of METHODS gave them."""

    loaded: Loaded
    method: str

    def by(self, std: float | Sequence[float]) -> Provenance:
        """The provenance of a value with this standard deviation, or these, in the value's unit."""
        known = bool(np.all(np.isfinite(std)))
        spread = (float(std) if isinstance(std, int | float) else tuple(map(float, std))) if known else None
        return Provenance(
            "identified", METHODS[self.method], record=self.loaded.name, sha256=self.loaded.sha256, std=spread
        )

    def hidden(self) -> Provenance:
        """The provenance of a value that the record was asked for and does not show."""
        return Provenance("assumed", f"record {self.loaded.name} does not show it")


def with_response(machine: Machine, fit: modes.Fit, found: Found, *, sprung: bool = True) -> Machine:
    """The machine with the plant of a frequency response, whose gains hold the thrust constant; the lag of the current
    loop, the viscous drag and the spring that it shows, if that is one to ground (sprung), are effects. Without a lag
    of its own the dead time holds any."""
    e = fit.estimate
    sources = {
        "dead_time": found.by(e.deviation("dead time")),
        "thrust_constant": Provenance("derived", "the gains are identified with it as 1"),
        "modes.1.gain": found.by(e.deviation("rigid body gain")),
        "modes.1.frequency": Provenance("derived", "the rigid body"),
        "modes.1.damping": Provenance("derived", "the rigid body"),
    }
    for i in range(2, len(fit.plant.modes) + 1):
        for part in ("gain", "frequency", "damping"):
            sources[f"modes.{i}.{part}"] = found.by(e.deviation(f"mode {i} {part}"))
    machine = machine.with_part("plant", fit.plant, sources)
    lag = (fit.lag, e.deviation(modes.LAG)) if fit.lag > 0 else None
    machine = with_lag(machine, lag, found)
    if sprung and SPRING in e.names:
        machine = with_spring(machine, (fit.spring, e.deviation(SPRING)), found)
    return with_drag(machine, (fit.drag, e.deviation(modes.DRAG)), None, found) if fit.drag > 0 else machine


def with_lag(machine: Machine, lag: tuple[float, float] | None, found: Found) -> Machine:
    """The machine with a current loop's time constant and its standard deviation [s] as an effect; None takes it
    out."""
    new = None if lag is None else (CurrentLoopLag(lag[0]), found.by(lag[1]))
    return _with_effect(machine, CurrentLoopLag.name, "time", new)


def with_spring(machine: Machine, spring: tuple[float, float] | None, found: Found) -> Machine:
    """The machine with a spring to ground and its standard deviation [N/m] as an effect; None takes it out."""
    new = None if spring is None else (CableSpring(spring[0]), found.by(spring[1]))
    return _with_effect(machine, CableSpring.name, "stiffness", new)


def _with_effect(machine: Machine, name: str, part: str, new: tuple[Effect, Provenance] | None) -> Machine:
    """The machine with an effect of one value [SI] in place of those of its name; None takes them out."""
    sources = {path: one for path, one in machine.sources_of("effects").items() if not path.startswith(name)}
    others = [effect for effect in machine.effects if effect.name != name]
    if new is not None:
        sources[f"{name}.{part}"] = new[1]
        others.append(new[0])
    return machine.with_part("effects", catalogue.in_order(others), sources)


def lag_of(machine: Machine) -> float:
    """The time constant [s] of the machine's current loop beside its dead time; 0 without one."""
    return sum(effect.input_delay() for effect in machine.effects)


def drag_of(machine: Machine) -> float:
    """The viscous drag [N s/m] among the machine's effects; 0 without one."""
    return sum(effect.viscous_drag() for effect in machine.effects)


def spring_of(machine: Machine) -> float:
    """The spring to ground [N/m] among the machine's effects; 0 without one."""
    return sum(effect.spring_to_ground() for effect in machine.effects)


def with_friction(machine: Machine, fit: ForceFit, found: Found) -> Machine:
    """The machine with the friction elements of a record; the facts of its hysteresis curve follow from them."""
    count, std = len(fit.friction.limit), fit.estimate.deviations
    sources = {
        "stiffness": found.by(std[-2 * count : -count].tolist()),
        "limit": found.by(std[-count:].tolist()),
        "damping": found.by(fit.damping_std().tolist()) if fit.damped else found.hidden(),
    }
    return with_derived_presliding(machine.with_part("friction", fit.friction, sources))


def with_offset(machine: Machine, offset: float, std: float, found: Found) -> Machine:
    """The machine with a constant force [N] beside friction that a record shows, and its standard deviation [N], which
    is its tolerance where it is more than the usual one."""
    machine = machine.with_value("drive.offset", offset, found.by(std))
    unstated = replace(machine, tolerance=replace(machine.tolerance, offset=0.0))
    if std > unstated.tolerances.offset:
        return machine.with_value("tolerance.offset", std, found.by(std))
    stated = {name: source for name, source in machine.sources_of("tolerance").items() if name != "offset"}
    return machine.with_part("tolerance", unstated.tolerance, stated)


def with_drag(
    machine: Machine, drag: tuple[float, float] | None, asymmetry: tuple[float, float] | None, found: Found
) -> Machine:
    """The machine with viscous friction c [N s/m] and friction by direction [1], each with its standard deviation, as
    effects; None takes the effect out."""
    new: list[tuple[Effect, str, float]] = []
    if drag is not None:
        new.append((ViscousFriction(drag[0]), "coefficient", drag[1]))
    if asymmetry is not None:
        turning = replace(DirectionalFriction.typical(), asymmetry=asymmetry[0])
        new.append((turning, "asymmetry", asymmetry[1]))
    ours = (ViscousFriction.name, DirectionalFriction.name)
    sources = {path: one for path, one in machine.sources_of("effects").items() if not path.startswith(ours)}
    sources |= {f"{effect.name}.{part}": found.by(std) for effect, part, std in new}
    others = [effect for effect in machine.effects if effect.name not in ours]
    return machine.with_part("effects", catalogue.in_order([*others, *(effect for effect, *_ in new)]), sources)


def with_inertia(machine: Machine, estimate: Estimate, found: Found) -> Machine:
    """The machine with the mass and the delay of inverse dynamics: of its rigid body, and as its dead time."""
    mass, plant = estimate.value("mass"), machine.plant
    gain = 1 / (mass * plant.thrust_constant)
    machine = machine.with_value(
        f"plant.modes.{plant.rigid + 1}.gain", gain, found.by(gain * estimate.deviation("mass") / mass)
    )
    delay = max(estimate.value("delay") - 0.5 * machine.sample_time, 0.0)
    return machine.with_value("plant.dead_time", delay, found.by(estimate.deviation("delay")))


def with_scaled_plant(machine: Machine, fit: MotionFit, found: Found) -> Machine:
    """The machine with the mass and dead time of a motion record, which scales all modes alike; their ratios are no
    surer than they were."""
    e, plant, own = fit.estimate, fit.machine.plant, _relative(machine)
    machine = machine.with_value("plant.dead_time", plant.dead_time, found.by(e.deviation("dead time")))
    for i, mode in enumerate(plant.modes):
        name = f"plant.modes.{i + 1}.gain"
        held = 0.0 if i == plant.rigid else own[name][0]
        std = abs(mode.gain) * math.hypot(e.deviation("mass") / e.value("mass"), held)
        machine = machine.with_value(name, mode.gain, found.by(std))
    return machine


def with_scaled_friction(machine: Machine, fit: MotionFit, found: Found) -> Machine:
    """The machine with the friction of a motion record, which scales all elements alike; its damping stays, and the
    elements' ratios are no surer than they were."""
    friction, e, own = fit.machine.friction, fit.estimate, _relative(machine)
    level, length = (e.deviation(name) / e.value(name) for name in ("friction level", "presliding length"))
    stiffness, limit = (own[f"friction.{name}"] for name in ("stiffness", "limit"))
    sources = dict(machine.sources_of("friction")) | {
        "stiffness": found.by(
            [k * math.hypot(level, length, held) for k, held in zip(friction.stiffness, stiffness, strict=True)]
        ),
        "limit": found.by([x * math.hypot(length, held) for x, held in zip(friction.limit, limit, strict=True)]),
    }
    elements = replace(friction, damping=machine.friction.damping)
    return with_derived_presliding(machine.with_part("friction", elements, sources))


def _relative(machine: Machine) -> dict[str, tuple[float, ...]]:
    """How well each value was known, as shares of it [1]."""
    return {one.name: one.relative for one in known_apart(machine)}


def with_damping_of_motion(machine: Machine, fit: MotionFit, found: Found) -> Machine:
    """The machine with the elements' damping as a motion record shows it, or with none where it does not.

    The record gives one time; the stiffnesses are those that the machine has.
    """
    friction, e = machine.friction, fit.estimate
    if not fit.damped:
        return machine.with_value("friction.damping", (0.0,) * len(friction.stiffness), found.hidden())
    level, length = e.deviation("friction level"), e.deviation("presliding length")
    time, std = e.value(DAMPING), e.deviation(DAMPING)
    damping = tuple(time * k for k in friction.stiffness)
    relative = math.hypot(std / time, level, length)
    return machine.with_value("friction.damping", damping, found.by([d * relative for d in damping]))


@dataclass(frozen=True)
class Holdable:
    """A force as a machine file can hold it: viscous friction [N s/m] and asymmetry [1], None where not sure, and the
    offset [N], each with its standard deviation; its relative force error [1] where it was fitted and held out."""

    drag: tuple[float, float] | None
    asymmetry: tuple[float, float] | None
    offset: tuple[float, float]
    fitted: float
    held_out: float


def holdable(fit: ForceFit) -> Holdable:
    """What a machine file can hold of a fit of inverse dynamics by direction; forces in [N].

    F = sum K_i z_i + c v, with c the mean of both directions. What is left beyond it is even in the direction: a |F|,
    the friction by direction of a machine file, and an offset. What is not sure, c or a, is left out.
    """
    e, kept = fit.estimate, fit.used
    where = [e.names.index(name) for name in VISCOUS_DIRECTIONS]
    ahead, back = e.values[where]
    drag = _sure(max(float(ahead + back) / 2, 0.0), 0.5 * float(np.sqrt(np.sum(e.covariance[np.ix_(where, where)]))))
    speed = np.gradient(fit.path, fit.time)
    dragged = drag[0] * speed if drag else np.zeros(speed.size)
    beyond = fit.measured - fit.modelled + e.value("offset") + np.where(speed > 0, ahead, back) * speed - dragged
    columns = np.column_stack([np.ones(speed.size), np.abs(fit.rolling + dragged)])
    values, stds = _least_squares(columns[kept], beyond[kept])
    asymmetry = _sure(float(values[1]), float(stds[1]))
    if asymmetry is None:
        columns = columns[:, :1]
        values, stds = _least_squares(columns[kept], beyond[kept])
    rest = beyond - columns @ values
    fitted, held_out = (
        float(np.linalg.norm(rest[part]) / np.linalg.norm(fit.measured[part])) for part in (kept, ~kept)
    )
    carried = fit.remembered / math.sqrt(3.0)  # by the contacts, from before the record: equally likely anywhere within
    return Holdable(drag, asymmetry, (float(values[0]), math.hypot(float(stds[0]), carried)), fitted, held_out)


def _sure(value: float, std: float) -> tuple[float, float] | None:
    """A value and its standard deviation [the same unit] if it is surely not zero."""
    return (value, std) if abs(value) > SIGNIFICANT_STDS * std else None


def _least_squares(columns: Array, wanted: Array) -> tuple[Array, Array]:
    """Weights of the columns (n, p) by least squares and their standard deviations (p,) [N, or 1 for a part of one]."""
    found = np.linalg.lstsq(columns, wanted, rcond=None)[0]
    covariance = newey_west(columns, wanted - columns @ found, by_elements.TOGETHER)
    return np.asarray(found, float), np.asarray(np.sqrt(np.diag(covariance)), float)
