"""The improved machine of a diagnosis: the file that did no harm on motions that it was not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from diagnosis.diagnose import Diagnosis
from diagnosis.handover.files import Content, machine_of
from diagnosis.handover.gate import chosen, is_believed
from diagnosis.handover.known_values import with_known_deviations
from diagnosis.handover.posterior import spreads
from diagnosis.model.residual import Candidate
from diagnosis.verdict import Outcome
from diagnosis.which.table import deviations_of
from models.machine import Machine, Provenance, parameters

OFFSET_PATH: Final = "drive.offset"


def improved_machine(diagnosis: Diagnosis, source: str = "diagnosis") -> Machine:
    """The machine that explains the records best, as far as the verdict goes and without harm (SI).

    With the effects where the verdict names them; with the re-fitted nominal values alone where no effect may be
    adopted; as it was given where there was nothing to explain. Where a richer one of these is worse than a simpler one
    on motions that were left out of its fit, in force, position or settling, it is the simpler one, or has all of the
    effects but one where that alone does harm: see `diagnosis.handover.gate`. `source` says what the records were, as
    in "gap_diagnosis of moves.csv": it becomes the provenance of every value that the diagnosis changed or added, with
    its standard deviation where the records are explained; elsewhere with that of the given file, and no less than the
    move.

    >>> better = pos.improved_machine(diagnosis, "diagnosis of moves.csv")
    >>> [effect.name for effect in better.effects]
    ['viscous_friction']
    """
    nominal, adopted = diagnosis.baseline.machine, diagnosis.how_far.handover.adopted
    if adopted.finished is None:
        given = diagnosis.baseline.delivered
        return given if adopted.name == Content.DELIVERED else _with_offset(given, adopted.machine.drive.offset, source)
    fitted = adopted.finished.fitted
    segment = diagnosis.baseline.segment
    limits = at_limit(fitted.candidate, [one.number for one in adopted.finished.at_bound if one.part == "nominal"])
    # Where something is left that has no name, or values are at the end of their range, they stand in for what the
    # model lacks by more than their deviations tell.
    believed = diagnosis.outcome is not Outcome.NONE and not limits
    stated = spreads(fitted, segment) if believed else {}
    better = machine_of(nominal, fitted.candidate, deviations_of(fitted, segment), source, stated)
    better = with_known_deviations(nominal, better, believed=believed)
    marked = {name: replace(better.sources[name], at_limit=True) for name in limits if name in better.sources}
    return replace(better, sources={**better.sources, **marked})


def at_limit(candidate: Candidate, places: Sequence[int]) -> set[str]:
    """The dotted names of the values in a file that these entries of theta make."""
    layout, here = candidate.layout, _numbers(candidate)
    found = set[str]()
    for place in places:
        nearer = candidate.theta * np.where(np.arange(layout.count) == place, 0.9, 1.0)
        found |= {name for name, number in _numbers(replace(candidate, theta=nearer)).items() if number != here[name]}
    return found


def _numbers(candidate: Candidate) -> dict[str, object]:
    rows = parameters(replace(candidate.machine, effects=()))
    return {one.name: one.number for one in rows if not one.name.startswith("presliding.")}  # which is derived


def _with_offset(machine: Machine, offset: float, source: str) -> Machine:
    """The machine with another offset [N], which the records showed, and nothing else changed."""
    said = Provenance("identified", f"{source}, the mean of the force that the file left")
    moved = replace(machine, drive=replace(machine.drive, offset=offset))
    moved = replace(moved, sources={**machine.sources, OFFSET_PATH: said})
    return with_known_deviations(machine, moved, believed=False)


def unchanged(diagnosis: Diagnosis) -> Diagnosis:
    """The diagnosis with the machine as delivered handed over, where its own file does harm on records held out."""
    far = diagnosis.how_far
    kept = replace(far.handover, adopted=far.handover.files[0], without=())
    return replace(diagnosis, how_far=replace(far, handover=kept))


def without_effects(diagnosis: Diagnosis) -> Diagnosis:
    """The diagnosis where the names that it found are not sure after all: none of them counts, and the file that is
    handed over has none of their effects."""
    far = diagnosis.how_far
    files = [
        file
        for file in far.handover.files
        if file.name not in {Content.SOME, Content.EFFECTS} and is_believed(file, diagnosis.baseline)
    ]
    return replace(
        diagnosis,
        outcome=Outcome.NONE,
        effects=(),
        partly=diagnosis.effects,
        equivalent=(),
        how_far=replace(far, handover=chosen(files)),
    )
