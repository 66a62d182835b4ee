"""Machines that the records allow: draws of every fitted value from its distribution after the fit.

Values are drawn together, as records of an axis leave their sums and ratios far better known than each of them. The
covariance is that of the table of effects: of what is left within a motion as dependent, and never less than if it were
white. What a fit holds as logarithms is drawn as parts of the value: the motion is linear in stiffnesses, so that the
sum of elements which stand in for each other stays as sure as it is, where draws of logarithms would make it larger. So
it is with a lag beside the dead time: of one near 0 the logarithm is open by several, and its draws lay at both ends of
its range.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.diagnose import Diagnosis
from diagnosis.handover.files import Content, machine_of
from diagnosis.handover.within import normal_within
from diagnosis.model.fit import Fit, bounds_of, coordinates, with_coordinates
from diagnosis.model.parameters import TOLERANCES, bounded
from diagnosis.model.residual import Candidate
from diagnosis.which.table import covariance_of
from models.effects.base import POSITIVE
from models.effects.base import parameters as parameters_of
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
    """`count` candidates around the fitted one, theta and effects [SI and logarithms] drawn together; segment: see
    `covariance_of`. Each value stays within its bounds, and where these cut off a part of its distribution, the values
    that stand in for it move along: a lag that is not below 0 beside a dead time, whose sum is sure."""
    candidate = fitted.candidate
    covariance = covariance_of(fitted, segment)
    wide = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(wide > 0, wide, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    root = vectors * np.sqrt(np.maximum(values, LEAST * values.max()))
    low, high = (room / scale for room in _room(candidate))
    steps = scale * normal_within(root, low, high, count, np.random.default_rng([seed, 29]))
    return [_stepped(candidate, step) for step in steps]


def _room(candidate: Candidate) -> tuple[Array, Array]:
    """The least and the greatest step (P + Q,) [SI, and parts of the value for logarithms]; none for how the friction
    stands at the start, which is bounded by limits that are drawn, too."""
    layout, theta = candidate.layout, candidate.theta
    low, high, parts = layout.low - theta, layout.high - theta, _parts(candidate)
    low[parts], high[parts] = np.maximum(np.expm1(low[parts]), SMALLEST - 1), np.expm1(high[parts])
    free = layout.of("initial_friction_state")
    low[free], high[free] = -np.inf, np.inf
    ends = [(low, high)]
    for effect in candidate.effects:
        sizes = [one for one in parameters_of(type(effect), candidate.nominal.priors) if one.role in POSITIVE]
        others = np.full(coordinates(effect).size - len(sizes), np.inf)
        reach = np.array([bounds_of(one) for one in sizes]).reshape(-1, 2).T
        least, most = reach / np.array([getattr(effect, one.name) for one in sizes]) - 1
        ends.append((np.append(-others, least), np.append(others, most)))
    lows, highs = (np.concatenate(side) for side in zip(*ends, strict=True))
    return np.minimum(lows, 0.0), np.maximum(highs, 0.0)


def _parts(candidate: Candidate) -> NDArray[np.bool_]:
    """Which entries of theta (P,) are logarithms of values."""
    return np.array([name in TOLERANCES and TOLERANCES[name][1] == "1" for name in candidate.layout.names])


def _stepped(candidate: Candidate, step: Array) -> Candidate:
    """The candidate a step (P + Q,) away, in the units of `_room`."""
    layout, priors = candidate.layout, candidate.nominal.priors
    own = step[: layout.count].copy()
    parts = _parts(candidate)
    own[parts] = np.log1p(np.maximum(own[parts], SMALLEST - 1))
    effects, begin = [], layout.count
    for effect in candidate.effects:
        here = coordinates(effect)
        moved = step[begin : begin + here.size].copy()
        sizes = slice(here.size - sum(one.role in POSITIVE for one in parameters_of(type(effect))), None)
        with np.errstate(divide="ignore"):  # none of a width is its least one
            moved[sizes] = np.log1p(np.maximum(moved[sizes], -1.0))
        effects.append(with_coordinates(effect, here + moved, priors) if here.size else effect)
        begin += here.size
    return replace(candidate, theta=bounded(layout, candidate.theta + own), effects=tuple(effects))
