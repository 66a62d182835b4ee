"""The improved machine: re-fitted values and the named effects, each with the records as its source."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from typing import Final

from diagnosis.diagnose import Diagnosis
from diagnosis.how_far import with_sines
from diagnosis.which.table import deviations_of
from models.effects.base import Effect
from models.effects.base import parameters as parameters_of
from models.effects.catalogue import named
from models.machine import Machine, Presliding, Provenance
from models.quantity import show

ADOPTED: Final = ("attributed", "ambiguous")  # outcomes whose effects go into the machine


def improved(found: Diagnosis, records: Sequence[str]) -> Machine:
    """The machine that explains the records best, as far as the verdict goes: with the effects where they are named,
    re-fitted where the re-fit explains something, as delivered where there was nothing to explain. SI inside."""
    nominal = found.baseline.nominal.candidate.layout.machine
    if found.outcome == "nothing_to_explain":
        return nominal
    taken = found.final if found.outcome in ADOPTED else found.baseline.nominal
    candidate = with_sines(taken.candidate)
    detail = ", ".join(records)
    sources = {**nominal.sources, **dict(_refitted(nominal, candidate.machine, detail))}
    if candidate.effects:
        stays = {effect.name for effect in nominal.effects}
        sources |= dict(_effects(candidate.effects, taken.candidate.effects, deviations_of(taken), stays, detail))
    for field in fields(Presliding):  # they follow from the elements, which have moved
        sources[f"presliding.{field.name}"] = Provenance("derived", "from the friction elements")
    return replace(
        candidate.machine, name=f"{nominal.name}, improved", effects=candidate.effects, published=None, sources=sources
    )


def _refitted(before: Machine, after: Machine, detail: str) -> Iterator[tuple[str, Provenance]]:
    """A source for every value that the re-fit moved."""
    said = Provenance("identified", f"gap_diagnosis of {detail}, within the tolerance of the file's value")
    for i, (one, other) in enumerate(zip(before.plant.modes, after.plant.modes, strict=True)):
        for name in ("gain", "frequency", "damping"):
            if getattr(one, name) != getattr(other, name):
                yield f"plant.modes.{i + 1}.{name}", said
    if before.plant.dead_time != after.plant.dead_time:
        yield "plant.dead_time", said
    if before.drive.offset != after.drive.offset:
        yield "drive.offset", said
    for name in ("stiffness", "limit"):
        if getattr(before.friction, name) != getattr(after.friction, name):
            yield f"friction.{name}", said


def _effects(
    effects: Sequence[Effect],
    fitted: Sequence[Effect],
    stds: Sequence[Mapping[str, float]],
    stays: Collection[str],
    detail: str,
) -> Iterator[tuple[str, Provenance]]:
    """A source for every value of the effects, with its standard deviation where the fit has one; stays: names of those
    whose law the machine file gave, so that nobody chose it."""
    known = {id(effect): std for effect, std in zip(fitted, stds, strict=True)}
    for path, effect in named(effects).items():
        std = known.get(id(effect), {})
        for item in parameters_of(type(effect)):
            if item.role == "switch" and effect.name in stays:
                continue
            spread = f"; standard deviation {show(std[item.name], item.unit, 2)}" if item.name in std else ""
            spread = "; the better of two laws" if item.role == "switch" else spread
            yield f"effects.{path}.{item.name}", Provenance("identified", f"gap_diagnosis of {detail}{spread}")
