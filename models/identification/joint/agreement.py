"""Several force records of one kind: one value of them all, and where they disagree."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import Final

import numpy as np

from models.identification.estimate import Estimate, combined
from models.identification.force.fit import ForceFit
from models.identification.into_machine import Holdable
from models.identification.joint.steps import ForceStep, Identified, Step
from models.quantity import show
from models.records.files import Loaded

CAUSES: Final = {
    "mass": "another payload or thrust constant, or friction that is not the model's",
    "delay": "commands or positions logged a sample apart, or another current loop",
    "offset": "gravity by another tilt, a cable, or what friction still remembers",
}
SIGMAS: Final = 3.0  # beyond which two records differ by more than their noise


def steps_of(found: Identified, kind: str) -> list[Step]:
    """The steps of one kind so far."""
    return [step for step in found.steps if step.kind == kind]


def together(steps: Sequence[Step]) -> Loaded:
    """The last of the files, with the names and hashes of all."""
    names, hashes = zip(*((step.loaded.name, step.loaded.sha256) for step in steps), strict=True)
    return replace(steps[-1].loaded, name=", ".join(names), sha256=", ".join(hashes))


def vagueness(fit: ForceFit) -> float:
    """The relative standard deviation of the slip force [1]."""
    slip, std = fit.slip_force()
    return std / slip


def joint_estimate(estimates: Sequence[Estimate], names: Sequence[str]) -> Estimate:
    """Some parameters of all the estimates together."""
    joint = [combined([(one.value(name), one.deviation(name)) for one in estimates]) for name in names]
    units = tuple(estimates[0].units[estimates[0].names.index(name)] for name in names)
    values, stds = (np.array([one[i] for one in joint]) for i in range(2))
    return Estimate(tuple(names), units, values, np.diag(stds**2))


def joint_force(helds: Sequence[Holdable], best: int) -> tuple[Holdable, bool]:
    """What a machine file holds of all records together, and whether it is of all: of the best one where their forms
    differ."""
    forms = {(held.drag is None, held.asymmetry is None) for held in helds}
    if len(forms) > 1:
        return helds[best], False
    drag, asymmetry, offset = (
        None if None in parts else combined([part for part in parts if part is not None])[:2]
        for parts in zip(*((held.drag, held.asymmetry, held.offset) for held in helds), strict=True)
    )
    assert offset is not None
    return replace(helds[best], drag=drag, asymmetry=asymmetry, offset=offset), True


def on_agreement(steps: Sequence[Step], names: Sequence[str]) -> Iterator[str]:
    """In which parameters the last record disagrees with those before it."""
    new = steps[-1].gave.estimate
    for step, name in product(steps[:-1], names):
        old = step.gave.estimate
        pair = [(one.value(name), one.deviation(name)) for one in (old, new)]
        apart = combined(pair)[2]
        if apart > SIGMAS:
            unit, cause = old.units[old.names.index(name)], CAUSES.get(name, "the axis or its surroundings changed")
            said = [f"{show(value, unit)} ± {show(std, unit, 2)}" for value, std in pair]
            yield (
                f"{step.loaded.name} and {steps[-1].loaded.name} disagree in the {name}, {said[0]} and {said[1]}, by "
                f"{apart:.1f} standard deviations ({cause}); the machine file has their mean, with a deviation as wide."
            )


def on_slip(steps: Sequence[Step], kept: str) -> Iterator[str]:
    """Where the last record's slip force disagrees with those before it; kept: what the machine file has then."""
    forces = [step.gave.fit.slip_force() for step in steps if isinstance(step.gave, ForceStep)]
    for step, slip in zip(steps[:-1], forces[:-1], strict=True):
        apart = combined([slip, forces[-1]])[2]
        if apart > SIGMAS:
            said = [f"{show(value, 'N')} ± {show(std, 'N', 2)}" for value, std in (slip, forces[-1])]
            yield (
                f"{step.loaded.name} and {steps[-1].loaded.name} disagree in the slip force, {said[0]} and {said[1]}, "
                f"by {apart:.1f} standard deviations (temperature, lubrication, preload or another place of the "
                f"guide); the machine file has {kept}."
            )
