"""Values that a fit led to the end of their range, and the same fit with more room for them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.model.fit import Fit, fit, parameters_at_bounds
from diagnosis.model.parameters import LOOSE, OF_MODES, Parameters, at_most_lower, below_nyquist, moved
from diagnosis.model.residual import Candidate
from models.effects.base import parameters as parameters_of
from models.effects.priors import Priors
from models.records.record import Record

Array = NDArray[np.float64]

WIDENING_ROUNDS: Final = 3  # of fits in which values that newly run to their bounds get more room
WIDENING_FACTOR: Final = 2.0  # by which the room of a value that ran to its bound is widened, once
AT_BOUND_ROOM_SHARE: Final = 1e-3  # of the room of a value: nearer to its bound it is at it


@dataclass(frozen=True)
class AtBound:
    """A value that the fit left at the end of its range: what it belongs to ("cogging", or "nominal"), its name, and
    how far it is: deviations of the tolerance [1] of a nominal value, SI of an effect's. number: of the entry in theta,
    or of the effect in the model."""

    part: str
    name: str
    value: float
    unit: str
    number: int = 0

    @property
    def place(self) -> tuple[str, str, int]:
        """Which value of the model it is."""
        return self.part, self.name, self.number


def at_bounds(candidate: Candidate) -> tuple[AtBound, ...]:
    """The values at a bound of their range; a dead time or a damping of 0 is at none."""
    layout, found = candidate.layout, list[AtBound]()
    away = moved(layout, candidate.theta)
    for i in _hit(layout, candidate.theta):
        found.append(AtBound("nominal", layout.names[i], float(away[i]), "deviations of its tolerance", i))
    for number, effect in enumerate(candidate.effects):
        for item in parameters_at_bounds(effect, candidate.nominal.priors):
            found.append(AtBound(effect.name, item.name, float(getattr(effect, item.name)), item.unit, number))
    return tuple(found)


def _is_period(candidate: Candidate, one: AtBound) -> bool:
    kind = type(candidate.effects[one.number])
    return any(item.name == one.name and item.role == "period" for item in parameters_of(kind))


def _hit(layout: Parameters, theta: Array) -> list[int]:
    """The entries of theta at a bound that is not a physical one; starts have no others."""
    room = AT_BOUND_ROOM_SHARE * (layout.high - layout.low)
    least = at_most_lower(layout.machine)
    none = np.array([low <= -least.get(name, np.inf) for name, low in zip(layout.names, layout.low, strict=True)])
    at = ((theta <= layout.low + room) & ~none) | (theta >= layout.high - room)
    return [int(i) for i in np.flatnonzero(at) if layout.names[i] != "initial_friction_state"]


def with_more_room(candidate: Candidate, hit: Sequence[AtBound]) -> Candidate:
    """The candidate with WIDENING_FACTOR times the room for the values at their bounds."""
    layout = candidate.layout
    low, high, ranges = layout.low.copy(), layout.high.copy(), dict(layout.machine.priors)
    for one in hit:
        if one.part == "nominal":
            low[one.number], high[one.number] = WIDENING_FACTOR * low[one.number], WIDENING_FACTOR * high[one.number]
            continue
        kind = type(candidate.effects[one.number])
        (item,) = (item for item in parameters_of(kind, layout.machine.priors) if item.name == one.name)
        ends = (item.low, item.high) if item.stated else item.widest
        ranges[one.part, one.name] = (ends[0] / WIDENING_FACTOR, ends[1] * WIDENING_FACTOR)
    dead = layout.of("dead_time")
    low[dead] = np.maximum(low[dead], -layout.machine.plant.dead_time)
    mode = layout.of("mode_frequency")
    high[mode] = np.minimum(high[mode], below_nyquist(layout.machine))
    machine = replace(layout.machine, priors=Priors.of(ranges, layout.machine.priors.units))
    return replace(candidate, layout=replace(layout, machine=machine, low=low, high=high))


def roomier(given: Fit, records: Sequence[Record]) -> Fit:
    """A fit of the search, fitted again under its own weights with more room for effects' values at their bounds; none
    for periods: a sine that is longer than the travel draws any curve."""
    hit = [one for one in at_bounds(given.candidate) if one.part != "nominal" and not _is_period(given.candidate, one)]
    return given if not hit else fit(with_more_room(given.candidate, hit), records, paths=given.paths, walk=given.walk)


def plant_at_bounds(candidate: Candidate) -> tuple[AtBound, ...]:
    """The values of the plant and its drive at a bound, which are other values where they were changed without a note,
    while contacts there may stand in for any law."""
    return tuple(one for one in at_bounds(candidate) if one.part == "nominal" and one.name in LOOSE)


def mode_at_bounds(candidate: Candidate) -> tuple[AtBound, ...]:
    """The values of vibration modes at a bound, where a frequency is among them: the structure is another one."""
    found = tuple(one for one in plant_at_bounds(candidate) if one.name in OF_MODES)
    return found if any(one.name == "mode_frequency" for one in found) else ()


def stated_at_bounds(candidate: Candidate) -> tuple[AtBound, ...]:
    """The values of effects at a bound, but for periods; for a candidate whose effects are the machine file's alone."""
    return tuple(one for one in at_bounds(candidate) if one.part != "nominal" and not _is_period(candidate, one))


def freed(
    given: Fit, records: Sequence[Record], hit_by: Callable[[Candidate], Sequence[AtBound]] = plant_at_bounds
) -> Fit:
    """A fit without effects but the file's, fitted again under its own weights with more room for those values that
    stand at their bounds, by default the plant's, and once more while one runs on."""
    fitted = given
    for _ in range(WIDENING_ROUNDS):
        hit = hit_by(fitted.candidate)
        if not hit:
            break
        fitted = fit(with_more_room(fitted.candidate, hit), records, paths=fitted.paths, walk=fitted.walk)
    return fitted
