"""Machines that the records allow: draws of every fitted value from its distribution after the fit.

Values are drawn together, as records of an axis leave their sums and ratios far better known than each of them. The
covariance is that of the table of effects: of what is left within a motion as dependent, and never less than if it were
white. What a fit holds as logarithms is drawn as parts of the value: the motion is linear in stiffnesses, so that the
sum of elements which stand in for each other stays as sure as it is, where draws of logarithms would make it larger. So
it is with a lag beside the dead time: for one near 0 the logarithm is uncertain by several units, and its draws lay at
both ends of its range.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.diagnose import Diagnosis
from diagnosis.handover.files import Content, Spread, machine_of
from diagnosis.handover.gate import File
from diagnosis.model.fit import Fit, bounds_of, coordinates, fit, with_coordinates
from diagnosis.model.parameters import TOLERANCES, bounded
from diagnosis.model.residual import Candidate, smooth
from diagnosis.model.roughness import variance_by_record
from diagnosis.model.unknown_force import unknown_force
from diagnosis.which.detectors.random_force import with_sines
from diagnosis.which.table import covariance_of, slopes_of_parameters
from models.effects.base import parameters as parameters_of
from models.effects.catalogue import named
from models.effects.parameter import POSITIVE
from models.machine import Machine
from models.machine import parameters as values_of
from models.machines.normal_within import normal_within

Array = NDArray[np.float64]

SMALLEST: Final = 0.05  # of a value: the least that is drawn
# Deviations, of a difference: a longer one has the curvature of logarithms, which spoils sums.
DIFFERENCE_STDS: Final = 1e-3
MIN_EIGENVALUE_RATIO: Final = 1e-12  # of the largest eigenvalue of a covariance: what is below is rounding


def machines_allowed(diagnosis: Diagnosis, count: int, seed: int = 0) -> tuple[Machine, ...]:
    """`count` machines, each the file that was handed over with its fitted values drawn anew (SI).

    Where the file is the machine as delivered, the draws are of the re-fit, which says what the records leave open.
    """
    nominal = diagnosis.baseline.machine
    found = drawn(_fitted_file(diagnosis).fitted, diagnosis.baseline.segment, count, seed)
    return tuple(replace(machine_of(nominal, one), name=nominal.name) for one in found)


def unexplained_force(diagnosis: Diagnosis) -> tuple[Array, ...]:
    """The force (n,) [N] that the file lacks around which `machines_allowed` draws, by record, where it leaves far more
    of a record than the weights promise; else none, as the runs of a design have the scale's noise of their own. The
    weights are those of the search: the file was fitted beside a white force as large as what it leaves, by which
    everything is noise."""
    baseline, file = diagnosis.baseline, _fitted_file(diagnosis).judged.candidate
    records, paths = baseline.records, smooth(file, baseline.records)
    weighed = replace(file, roughness=baseline.nominal.candidate.roughness)
    left = fit(weighed, records, paths=paths, iterations=0, walk=baseline.nominal.walk)
    if np.max(variance_by_record(left)) <= baseline.criteria.rough_variance:
        return ()
    return tuple(one[~np.isnan(one)] for one in unknown_force(file, records, paths))


def _fitted_file(diagnosis: Diagnosis) -> File:
    """The file that was handed over or, where that is the machine as delivered, the re-fitted one. Raises ValueError
    where there is none."""
    handover = diagnosis.how_far.handover
    for file in (handover.adopted, handover.named(Content.REFITTED)):
        if file is not None and file.finished is not None:
            return file
    raise ValueError("no file has a fit")


def spreads(fitted: Fit, segment: NDArray[np.int64] | None = None) -> dict[str, Spread]:
    """How well each nominal value and each effect's parameter is known by its dotted name in the file, with what their
    deviations [SI] have in common: to the first order, and of nominal values never more than the prior's; segment: see
    `covariance_of`. Without those that the fit leaves as they were, and without starts of the friction."""
    candidate, layout = fitted.candidate, fitted.candidate.layout
    covariance = covariance_of(fitted, segment)
    wide = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(wide, wide))  # as their sizes differ by far
    least = wide.copy()
    least[: layout.count] = np.minimum(wide[: layout.count], layout.deviation)
    root = least[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    slopes = {**_slopes_of_values(candidate, wide), **_slopes_of_effects(candidate, wide)}
    moved = {name: slope @ root for name, slope in slopes.items()}
    moved = {name: rows for name, rows in moved.items() if np.all(np.any(rows != 0, axis=1))}
    deviations = {name: np.linalg.norm(rows, axis=1) for name, rows in moved.items()}
    shares = [np.zeros((0, wide.size)), *(rows / deviations[name][:, None] for name, rows in moved.items())]
    # As few errors for each number as there are numbers up to it: the same covariance by a triangular root.
    triangle = np.asarray(np.linalg.qr(np.concatenate(shares).T, mode="r")).T
    triangle *= np.where(np.diag(triangle) < 0, -1.0, 1.0)
    rows = [tuple(row[: i + 1].tolist()) for i, row in enumerate(triangle)]
    found, begin = {}, 0
    for name, std in deviations.items():
        found[name] = Spread(tuple(std.tolist()), tuple(rows[begin : begin + std.size]))
        begin += std.size
    return found


def _slopes_of_values(candidate: Candidate, wide: Array) -> dict[str, Array]:
    """How the numbers of each nominal value change with theta and the effects' coordinates (numbers, P + Q), by their
    names [SI]; wide (P + Q,): deviations of the coordinates."""
    layout, here = candidate.layout, _values(candidate)
    slopes = {name: np.zeros((number.size, wide.size)) for name, number in here.items()}
    for place in np.flatnonzero((np.array(layout.names) != "initial_friction_state") & (layout.deviation > 0)):
        step = (
            DIFFERENCE_STDS
            * wide[place]
            * (-1.0 if candidate.theta[place] + DIFFERENCE_STDS * wide[place] > layout.high[place] else 1.0)
        )
        theta = candidate.theta + step * (np.arange(layout.count) == place)
        for name, number in _values(replace(candidate, theta=theta)).items():
            slopes[name][:, place] = (number - here[name]) / step
    return slopes


def _slopes_of_effects(candidate: Candidate, wide: Array) -> dict[str, Array]:
    """The same of each effect's parameters but for the choice between laws."""
    begins, begin = dict[int, int](), candidate.layout.count
    for effect in candidate.effects:
        begins[id(effect)] = begin
        begin += coordinates(effect).size
    found = dict[str, Array]()
    for path, effect in named(with_sines(candidate).effects).items():
        here = coordinates(effect)
        if id(effect) not in begins or not here.size:
            continue
        own = slice(begins[id(effect)], begins[id(effect)] + here.size)
        slopes = slopes_of_parameters(effect, here, wide[own], candidate.nominal.priors)
        for item, slope in zip(parameters_of(type(effect)), slopes, strict=True):
            if item.role != "switch":
                found[f"effects.{path}.{item.name}"] = np.zeros((1, wide.size))
                found[f"effects.{path}.{item.name}"][0, own] = slope
    return found


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
    root = vectors * np.sqrt(np.maximum(values, MIN_EIGENVALUE_RATIO * values.max()))
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
    # A limit's step is one of the element's force, in which the motion is linear, too, and not of the product with k's.
    own[layout.of("presliding_limit")] /= np.maximum(1 + own[layout.of("presliding_stiffness")], SMALLEST)
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
