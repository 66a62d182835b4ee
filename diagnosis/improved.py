"""The improved machine of a diagnosis: re-fitted nominal values and the named effects, each with its provenance."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import fields, replace
from typing import Final

from diagnosis.diagnose import Diagnosis
from diagnosis.which.random_force import with_sines
from diagnosis.which.table import deviations_of
from models.effects.base import Effect
from models.effects.base import parameters as parameters_of
from models.effects.catalogue import named
from models.machine import Machine, Presliding, Provenance, parameters

ADOPTED: Final = ("attributed", "ambiguous")  # outcomes whose effects go into the machine


def improved_machine(diagnosis: Diagnosis, source: str = "diagnosis") -> Machine:
    """The machine that explains the records best, as far as the verdict goes (SI).

    With the effects where the verdict names them; with the re-fitted nominal values alone where no effect may be
    adopted; as it was given where there was nothing to explain. `source` says what the records were, as in
    "gap_diagnosis of moves.csv": it becomes the provenance of every value that the diagnosis changed or added.

    >>> better = pos.improved_machine(diagnosis, "diagnosis of moves.csv")
    >>> [effect.name for effect in better.effects]
    ['viscous_friction']
    """
    nominal = diagnosis.baseline.nominal.candidate.nominal
    if diagnosis.outcome == "nothing_to_explain":
        return nominal
    adopted = diagnosis.final if diagnosis.outcome in ADOPTED else diagnosis.baseline.nominal
    candidate = with_sines(adopted.candidate)
    sources = {**nominal.sources, **dict(_refitted(nominal, candidate.machine, source))}
    if candidate.effects:
        given = {effect.name for effect in nominal.effects}
        deviations = deviations_of(adopted)
        sources |= dict(provenance_of_effects(candidate.effects, adopted.candidate.effects, deviations, given, source))
    for field in fields(Presliding):  # the presliding curve follows from the friction elements, which have changed
        sources[f"presliding.{field.name}"] = Provenance("derived", "from the friction elements")
    return replace(
        candidate.machine, name=f"{nominal.name}, improved", effects=candidate.effects, published=None, sources=sources
    )


def _refitted(nominal: Machine, fitted: Machine, source: str) -> Iterator[tuple[str, Provenance]]:
    """The provenance of every value that the re-fit changed, by the value's dotted name."""
    before = {one.name: one.number for one in parameters(replace(nominal, effects=()))}
    provenance = Provenance("identified", f"{source}, within the tolerance of the file's value")
    for one in parameters(replace(fitted, effects=())):
        if before.get(one.name) != one.number:
            yield one.name, provenance


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
    names of effects of the machine file, whose law (a switch between two) the diagnosis did not choose.
    """
    known = {id(effect): std for effect, std in zip(fitted, deviations, strict=True)}
    for path, effect in named(effects).items():
        std = known.get(id(effect), {})
        for item in parameters_of(type(effect)):
            if item.role == "switch" and effect.name in given:
                continue
            detail = f"{source}; the better of two laws" if item.role == "switch" else source
            deviation = std.get(item.name, math.nan)
            known_well = item.role != "switch" and math.isfinite(deviation)
            yield (
                f"effects.{path}.{item.name}",
                Provenance("identified", detail, std=deviation if known_well else None),
            )
