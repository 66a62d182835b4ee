"""The force that a model lacks, as a smoother sees it behind the readings, and the fit beside one so large."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.model.fit import Fit, fit, weights
from diagnosis.model.kalman import STARTING, likeliest_start, smoothed
from diagnosis.model.parallel import parallel_map
from diagnosis.model.residual import Candidate, Residual, SmoothedPath, beside_plant, evaluate, unweighted_predictor
from diagnosis.records.motions import rms
from diagnosis.records.units import units
from models.records.record import Record

Array = NDArray[np.float64]

ITERATIONS: Final = 8
STILL: Final = 1e-5  # walk a sample over the white force: it gains a tenth of it in 100,000 samples
# Of the commands' deviation: of the white force, where a model explains all but rounding.
MIN_WHITE_FORCE_SHARE: Final = 1e-4
SEEN_BY: Final = 2.5e-3  # of the friction a sample: walk with which the unknown force is told in newtons


def unknown_force(candidate: Candidate, records: Sequence[Record], paths: Sequence[SmoothedPath]) -> tuple[Array, ...]:
    """The smoothed force (n,) [N] that a candidate lacks, by record, NaN before the state has settled."""
    walk = SEEN_BY * units(candidate.nominal).force / candidate.usual_white_force
    model = unweighted_predictor(candidate, records[0].sample_time, walk)
    state = 2 * len(candidate.machine.plant.modes)

    def force(record: Record, residual: Residual) -> Array:
        reading = record.position - beside_plant(candidate, residual.force, residual.acts, record.sample_time)
        states = smoothed(model, residual.force, reading, likeliest_start(model, residual.force, reading))
        states[:STARTING, state] = np.nan
        return np.asarray(states[:, state])

    return tuple(parallel_map(force, records, evaluate(candidate, records, paths)))


def unknown_less_mean(fitted: Fit, records: Sequence[Record]) -> tuple[Array, NDArray[np.bool_]]:
    """The smoothed unknown force (n,) [N] of all records, less its mean, and where it is known; elsewhere it is 0."""
    force = np.concatenate(unknown_force(fitted.candidate, records, fitted.paths))
    used = (weights(records) > 0) & ~np.isnan(force)
    return np.where(used, force - np.mean(force[used]), 0.0), used


def unknown_less_means(fitted: Fit, records: Sequence[Record]) -> tuple[Array, NDArray[np.bool_]]:
    """The same [N], less the mean of each record: a search leaves a constant force of each open, that of contacts that
    never slip in it."""
    force, used = unknown_less_mean(fitted, records)
    start = 0
    for record in records:
        part = slice(start, start + record.position.size)
        force[part] -= np.where(used[part], np.mean(force[part][used[part]]), 0.0)
        start = part.stop
    return force, used


def force_left(fitted: Fit, records: Sequence[Record]) -> float:
    """The deviation [N] of the unknown force that a fit leaves, about its mean in each record."""
    force, used = unknown_less_means(fitted, records)
    return rms([force[used]])


def still_fit(
    candidate: Candidate, records: Sequence[Record], paths: Sequence[SmoothedPath], iterations: int = ITERATIONS
) -> Fit:
    """The candidate fitted beside a white force as large as what it leaves (its standard deviation).

    The search fits beside an unknown force that walks at random, which follows whatever is slow: a constant force
    leaves nothing of itself behind the first samples, so that the offset of the amplifier hangs on its prior and on
    what the other values make of it. Here the variance of the unknown force is finite, so that a constant counts at
    every sample (the disturbance model decides which of two laws takes up a slow force: L. Ljung, System
    Identification, 1999, section 8.5).
    """
    left = unknown_force(candidate, records, paths)
    least = MIN_WHITE_FORCE_SHARE * max(float(np.std(record.command)) for record in records)
    white = max(float(np.nanstd(np.concatenate(left))), least)
    roughness = white / candidate.usual_white_force
    candidate = replace(candidate, roughness=(roughness,) * len(records))
    return fit(candidate, records, paths=paths, iterations=iterations, walk=STILL * roughness)
