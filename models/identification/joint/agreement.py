"""Several records of one kind: one value of them all, and where they disagree."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import Final

import numpy as np

from models.identification import modes
from models.identification.estimate import LEAST_STD, Estimate, combined
from models.identification.force.fit import ForceFit
from models.identification.into_machine import Holdable
from models.identification.joint.steps import ForceStep, Identified, MotionStep, Step
from models.identification.modal.remarks import ResponseStep, surely_apart
from models.machine import Machine
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


def spanned(joint: modes.Fit, responses: Sequence[ResponseStep]) -> modes.Fit:
    """The plant of several responses, each value with a deviation as wide as it is away from those that surely have
    another: what depends on the amplitude is known no better, however small the noise."""
    estimate = joint.estimate
    wide = estimate.deviations
    for one in responses:
        for name, (together, alone), _ in surely_apart(estimate, one.estimate):
            place = estimate.names.index(name)
            wide[place] = max(wide[place], abs(together - alone))
    factor = wide / np.maximum(estimate.deviations, LEAST_STD)
    return replace(joint, estimate=replace(estimate, covariance=estimate.covariance * np.outer(factor, factor)))


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


def with_offset_shown(found: Identified, given: Machine) -> Identified:
    """What was identified with the offset that was given, where no record says more of it: each knows it worse than the
    file's tolerance and does not surely depart from the file's value. Such a one would widen the tolerance by what only
    that record does not show."""
    known, value = given.tolerances.offset, given.drive.offset
    every = [step.gave for step in found.steps if "offset" in step.gave.estimate.names]
    shown = [_offset_of(gave) for gave in every]
    told = any(std <= known or abs(one - value) > SIGMAS * std for one, std in shown)
    if told or not any(isinstance(gave, ForceStep) for gave in every):
        return found  # motions alone: their offset goes with the friction that they were replayed with
    machine = found.machine.with_part("drive", given.drive, given.sources_of("drive"))
    machine = machine.with_part("tolerance", given.tolerance, given.sources_of("tolerance"))
    surest = min(shown, key=lambda one: one[1])
    said = (
        f"No record tells the offset better than to {show(surest[1], 'N', 2)} ({show(surest[0], 'N', 3)}): that of the "
        f"machine file, {show(value, 'N', 3)} with a tolerance of {show(known, 'N', 2)}, stays."
    )
    return replace(found, machine=machine, of_all=(*found.of_all, said))


def _offset_of(gave: ResponseStep | ForceStep | MotionStep) -> tuple[float, float]:
    """The constant force [N] that a record shows, and its standard deviation, as a machine file can hold it."""
    if isinstance(gave, ForceStep) and gave.held is not None:
        return gave.held.offset
    return gave.estimate.value("offset"), gave.estimate.deviation("offset")


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
