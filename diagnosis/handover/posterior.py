"""Machines that the records allow: draws of every fitted value from its distribution after the fit.

Values are drawn together, as records of an axis leave their sums and ratios far better known than each of them. The
covariance is that of the table of effects: of what is left within a motion as dependent, and never less than if it were
white. What theta holds as logarithms is drawn as parts of the value: the motion is linear in stiffnesses, so that the
sum of elements which stand in for each other stays as sure as it is, where draws of logarithms would make it larger.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.diagnose import Diagnosis
from diagnosis.handover.files import Content, machine_of
from diagnosis.model.fit import Fit, coordinates, with_coordinates
from diagnosis.model.parameters import TOLERANCES, bounded
from diagnosis.model.residual import Candidate
from diagnosis.which.table import covariance_of
from models.machine import Machine
from models.machine import parameters as values_of

Array = NDArray[np.float64]

SMALLEST: Final = 0.05  # of a value: the least that is drawn
LEAST: Final = 1e-12  # of the largest eigenvalue of a covariance: what is below is rounding


def machines_allowed(diagnosis: Diagnosis, count: int, seed: int = 0) -> tuple[Machine, ...]:
    """`count` machines, each the file that was handed over with its fitted values drawn anew (SI).

    Where the file is the machine as delivered, the draws are of the re-fit, which says what the records leave open.
    """
    handover, nominal = diagnosis.how_far.handover, diagnosis.baseline.machine
    adopted = handover.adopted if handover.adopted.finished is not None else handover.named(Content.REFITTED)
    fitted = diagnosis.baseline.nominal if adopted is None or adopted.finished is None else adopted.finished.fitted
    found = drawn(fitted, diagnosis.baseline.segment, count, seed)
    return tuple(replace(machine_of(nominal, one), name=nominal.name) for one in found)


def deviations_of_values(fitted: Fit, segment: NDArray[np.int64] | None = None) -> dict[str, float]:
    """The standard deviation [SI] of each nominal value that the fit moved, by its dotted name in the file: by
    differences along the coordinates, and never more than the prior's; segment: see `covariance_of`.

    Not of several friction elements, which keep the file's tolerance: neighbours stand in for each other, so that their
    sum is far surer than each, and a file states deviations one by one, as who draws machines from it draws them.
    """
    candidate, layout = fitted.candidate, fitted.candidate.layout
    free = np.flatnonzero((np.array(layout.names) != "initial_friction_state") & (layout.deviation > 0))
    covariance = covariance_of(fitted, segment)[np.ix_(free, free)]
    wide = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(wide, wide))  # as their sizes differ by far
    root = np.minimum(wide, layout.deviation[free])[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    here = _values(candidate)
    slopes = {name: np.zeros((free.size, number.size)) for name, number in here.items()}
    for i, place in enumerate(free):
        step = 0.1 * wide[i] * (-1.0 if candidate.theta[place] + 0.1 * wide[i] > layout.high[place] else 1.0)
        theta = candidate.theta + step * (np.arange(layout.count) == place)
        for name, number in _values(replace(candidate, theta=theta)).items():
            slopes[name][i] = (number - here[name]) / step
    variance = {name: np.sum((root.T @ slope) ** 2, axis=0) for name, slope in slopes.items()}
    deviations = {name: tuple(np.sqrt(one).tolist()) for name, one in variance.items() if np.all(one > 0)}
    return {name: one[0] for name, one in deviations.items() if len(one) == 1}


def _values(candidate: Candidate) -> dict[str, Array]:
    """Every number [SI] of a candidate's machine without its effects, by its dotted name."""
    rows = values_of(replace(candidate.machine, effects=()))
    return {one.name: np.atleast_1d(one.number) for one in rows if not isinstance(one.number, str)}


def drawn(fitted: Fit, segment: NDArray[np.int64] | None, count: int, seed: int = 0) -> list[Candidate]:
    """`count` candidates around the fitted one, theta [SI and logarithms] and effects drawn together; segment: see
    `covariance_of`. Each value stays within its bounds."""
    candidate, layout = fitted.candidate, fitted.candidate.layout
    covariance = covariance_of(fitted, segment)
    wide = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(wide > 0, wide, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    root = vectors * np.sqrt(np.maximum(values, LEAST * values.max()))
    normal = np.random.default_rng([seed, 29]).standard_normal((count, scale.size))
    steps = scale * (normal @ root.T)
    found = []
    parts = np.array([name in TOLERANCES and TOLERANCES[name][1] == "1" for name in layout.names])
    for step in steps:
        moved = np.where(parts, np.log1p(np.maximum(step[: layout.count], SMALLEST - 1)), step[: layout.count])
        theta = bounded(layout, candidate.theta + moved)
        effects, begin = [], layout.count
        for effect in candidate.effects:
            here = coordinates(effect)
            moved = here + step[begin : begin + here.size]
            effects.append(with_coordinates(effect, moved, candidate.nominal.priors) if here.size else effect)
            begin += here.size
        found.append(replace(candidate, theta=theta, effects=tuple(effects)))
    return found
