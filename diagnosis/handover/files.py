"""A fitted candidate as the machine file that is written of it, and that file as the candidate that is judged."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from diagnosis.handover.overrun import OVERRUN, beyond_tolerance, overrun
from diagnosis.model.kalman import Resonance
from diagnosis.model.parameters import Parameters, bounded, initial_state, parameters
from diagnosis.model.residual import Candidate
from diagnosis.which.detectors.random_force import with_sines
from models.effects.base import Effect
from models.effects.base import parameters as parameters_of
from models.effects.catalogue import in_order, named
from models.machine import Machine, Presliding, Provenance
from models.machine import parameters as values_of
from models.machine_file import loaded
from models.machines.provenance import Shares
from models.quantity import declaration, nearest

Array = NDArray[np.float64]

FILE = Path("improved.toml")


class Content(StrEnum):
    """What a machine file has that could be handed over; the names are those in results.json."""

    DELIVERED = "as delivered"
    OFFSET = "offset alone"
    REFITTED = "re-fitted"
    SOME = "with some of the effects"
    EFFECTS = "with effects"
    MEASURED = "measured law"


@dataclass(frozen=True)
class JudgedFile:
    """A machine file as it is judged: the machine that was loaded from it, and the candidate whose errors are its own.

    The candidate knows two things that no file holds: where the friction elements stand at the start of each record,
    and that the sine of a random force stands for its power at an unknown phase.
    """

    machine: Machine
    candidate: Candidate


def judged_file(machine: Machine, starts: Sequence[Array], random_forces: Sequence[Resonance] = ()) -> JudgedFile:
    """A machine as its file says. starts: displacements (N,) [m] of the friction elements by record; random_forces:
    those for which sines stand in the file."""
    file = loaded(machine, FILE)
    layout = parameters(file, len(starts))
    return JudgedFile(
        file, Candidate(layout, _starting(layout, starts), _effects(file, random_forces), tuple(random_forces))
    )


def _effects(file: Machine, random_forces: Sequence[Resonance]) -> tuple[Effect, ...]:
    sines = with_sines(Candidate(parameters(file, 1), np.zeros(0), (), tuple(random_forces))).effects
    left = list(file.effects)
    for sine in sines:
        left.remove(sine)
    return in_order(left)


def _starting(layout: Parameters, starts: Sequence[Array]) -> Array:
    theta = np.zeros(layout.count)
    theta[layout.of("initial_friction_state")] = np.concatenate(list(starts))
    return bounded(layout, theta)


def starts_of(candidate: Candidate) -> tuple[Array, ...]:
    """Displacements (N,) [m] of the friction elements at the start of each record."""
    return tuple(initial_state(candidate.layout, candidate.theta, i) for i in range(candidate.layout.records))


@dataclass(frozen=True)
class Spread:
    """How well the numbers of a value are known: their standard deviations [SI], and what these have in common with
    those of other values [1]."""

    deviations: tuple[float, ...]
    shares: Shares


def machine_of(
    nominal: Machine,
    candidate: Candidate,
    deviations: Sequence[Mapping[str, float]] = (),
    source: str = "diagnosis",
    stated: Mapping[str, Spread] = MappingProxyType({}),
) -> Machine:
    """The nominal machine with what the candidate changes, each value with its provenance; deviations: of the
    candidate's effects [SI]; stated: of its nominal values by their dotted names [SI], and what all have in common."""
    whole = with_sines(candidate)
    fitted = replace(whole.machine, priors=nominal.priors, tolerance=nominal.tolerance)
    sources = {**nominal.sources, **dict(_refitted(nominal, fitted, source, stated))}
    if whole.effects:
        given = {effect.name for effect in nominal.effects}
        known = deviations or [{} for _ in candidate.effects]
        own = dict(provenance_of_effects(whole.effects, candidate.effects, known, given, source))
        sources |= {
            path: replace(one, shares=stated[path].shares) if one.std is not None and path in stated else one
            for path, one in own.items()
        }
    for field in fields(Presliding):  # the presliding curve follows from the friction elements, which have changed
        sources[f"presliding.{field.name}"] = Provenance("derived", "from the friction elements")
    effects = tuple(_allowed(effect) for effect in whole.effects)
    return replace(fitted, name=f"{nominal.name}, improved", effects=effects, published=None, sources=sources)


def _allowed(effect: Effect) -> Effect:
    """The effect with each size where a file may have it: a fit, of a single record say, may turn the sign of a size
    that has only one, as evidence against the effect. The file is judged as it is written."""
    changed = {}
    for item in parameters_of(type(effect)):
        (field,) = (one for one in fields(effect) if one.name == item.name)
        declared = declaration(field, effect)
        number = getattr(effect, item.name)
        if declared is not None and nearest(number, declared) != number:
            changed[item.name] = nearest(number, declared)
    return replace(effect, **changed) if changed else effect


def _refitted(
    nominal: Machine, fitted: Machine, source: str, stated: Mapping[str, Spread]
) -> Iterator[tuple[str, Provenance]]:
    """The provenance of every value that the re-fit changed, by the value's dotted name; stated: see `machine_of`."""
    before, after = (replace(one, effects=()) for one in (nominal, fitted))
    delivered = {one.name: one.number for one in values_of(before)}
    far = {one.name: f"{one.deviations:,.0f} stated standard deviations" for one in overrun(before, after, OVERRUN)}
    far |= beyond_tolerance(before, after)
    for one in values_of(after):
        if delivered.get(one.name) != one.number:
            moved = f"{far[one.name]} from" if one.name in far else "within the tolerance of"
            provenance = Provenance("identified", f"{source}, {moved} the file's value")
            spread = stated.get(one.name)
            yield one.name, provenance if spread is None else _with_spread(provenance, one.number, spread)


def _with_spread(provenance: Provenance, number: object, spread: Spread) -> Provenance:
    std = spread.deviations if isinstance(number, tuple) else spread.deviations[0]
    return replace(provenance, std=std, shares=spread.shares)


def provenance_of_effects(
    effects: Sequence[Effect],
    fitted: Sequence[Effect],
    deviations: Sequence[Mapping[str, float]],
    given: Collection[str],
    source: str,
) -> Iterator[tuple[str, Provenance]]:
    """The provenance of every parameter of the effects, by its dotted name, with its standard deviation [SI] where the
    fit has one.

    fitted: the effects that were fitted, among the effects by identity, with the standard deviations of each. given:
    names of effects of the machine file, whose law (a switch) the diagnosis did not choose.
    """
    known = {id(effect): std for effect, std in zip(fitted, deviations, strict=True)}
    for path, effect in named(effects).items():
        std = known.get(id(effect), {})
        for field in fields(effect) if effect.tabulated else ():
            if getattr(effect, field.name) != field.default:
                yield f"effects.{path}.{field.name}", Provenance("identified", source)
        for item in parameters_of(type(effect)):
            if item.role == "switch" and effect.name in given:
                continue
            detail = f"{source}; the best of its laws" if item.role == "switch" else source
            deviation = std.get(item.name, math.nan)
            known_well = item.role != "switch" and math.isfinite(deviation)
            yield (
                f"effects.{path}.{item.name}",
                Provenance("identified", detail, std=deviation if known_well else None),
            )
