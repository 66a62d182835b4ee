"""More friction elements than the machine file has, where the records show the curve between them.

A few elements draw the friction's curve to a percent, as well as most data sheets know it. A fine scale sees what that
leaves in every motion, and the search would take it for an effect, or for one that the catalogue lacks. So a force of
elements with other limits is tried beside the fit, with its stiffnesses free: it is linear in them, and gains little
from effects on motions to which they were not fitted, as elements remember nothing but the path (Masing's rule). Where
it gains far more than effects were seen to give it, every element of the file becomes two of half its stiffness. The
machine as delivered stays what it was, and the re-fit moves them apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.criteria import Criteria
from diagnosis.model.fit import Fit, fit
from diagnosis.model.parameters import bounded, parameters
from diagnosis.refit import with_new_starts
from diagnosis.where.side import as_force
from diagnosis.which.detectors.scan import partial_out
from diagnosis.which.free_form import ridge_regression
from models.friction import Friction, deflections
from models.machine import Machine
from models.records.record import Record

Array = NDArray[np.float64]

GRID_LIMITS: Final = 24  # limits that are tried, from a third of the shortest to half as much again as the longest
MIN_LIMIT_RATIO, MAX_LIMIT_RATIO = 1 / 3, 1.5
MAX_ELEMENTS: Final = 32  # elements: a re-fit of 40 took 16 times as long as one of 7
ITERATIONS: Final = 12
FREE_STIFFNESS: Final = 0.7  # deviation of the logarithm of a half's stiffness: it may be nearly all or nearly nothing
FREE_LIMIT: Final = 0.99  # and of its limit's at most, however far apart the elements are: a file's is below 1


def with_finer_friction(
    fitted: Fit, records: Sequence[Record], segment: NDArray[np.int64], criteria: Criteria = Criteria()
) -> Fit:
    """The fit as it is, or with twice as many elements, or more, where the records show the curve between them by far;
    segment (n,): the number of each sample's motion [1]."""
    least = criteria.finer_friction * fitted.innovations.size
    while _may_have_more(fitted, least) and curve_gain(fitted, records, segment) > least:
        finer = _halved(fitted, records)
        if fitted.cost - finer.cost < least:
            break
        fitted = finer  # a file that lacks elements may lack more of them, which then have less to gain
        least = criteria.finer_friction_again * float(fitted.innovations @ fitted.innovations)
    return fitted


def _may_have_more(fitted: Fit, least: float) -> bool:
    """Whether a fit leaves what has to be gained, and may have twice as many elements."""
    left = float(fitted.innovations @ fitted.innovations)
    return left > least and 2 * len(fitted.candidate.nominal.friction.limit) <= MAX_ELEMENTS


def curve_gain(fitted: Fit, records: Sequence[Record], segment: NDArray[np.int64]) -> float:
    """The chi-square [1] that another curve of the friction, of elements with limits of any length, takes off motions
    to which it was not fitted, beside all that is nominal; segment as above."""
    limit = np.array(fitted.candidate.machine.friction.limit)
    grid = np.geomspace(MIN_LIMIT_RATIO * np.min(limit), MAX_LIMIT_RATIO * np.max(limit), GRID_LIMITS)
    forces = np.concatenate([-deflections(grid, one.path.at_samples) / grid for one in fitted.paths])
    own = partial_out(fitted, segment)
    whole = own(as_force(fitted, records, forces))
    whole /= np.maximum(np.sqrt(np.sum(whole**2, axis=0)), 1e-300)
    return ridge_regression(whole, own)[0]


def _halved(fitted: Fit, records: Sequence[Record]) -> Fit:
    """The fit with each element in two, moved apart to begin with and fitted with everything else."""
    candidate, layout = fitted.candidate, fitted.candidate.layout
    apart = _spacing(np.array(candidate.machine.friction.limit))
    finer = parameters(halved(candidate.nominal, float(np.median(apart))), layout.records)
    theta = np.zeros(finer.count)
    for name in dict.fromkeys(layout.names):
        values = candidate.theta[layout.of(name)]
        elements = name in {"presliding_stiffness", "presliding_limit", "initial_friction_state"}
        theta[finer.of(name)] = np.repeat(values, 2) if elements else values
    theta[finer.of("presliding_limit")] += np.outer(apart, (-0.25, 0.25)).ravel()
    begun = replace(candidate, layout=finer, theta=bounded(finer, theta))
    paths = fitted.paths
    return with_new_starts(fit(begun, records, paths=paths, iterations=ITERATIONS, walk=fitted.walk), records)


def halved(machine: Machine, apart: float) -> Machine:
    """The machine with each friction element in two of half its stiffness, which act as the one did; their tolerance
    [1] lets either become the whole, and its limit move half as far as neighbours are `apart` on a logarithm."""
    friction, tolerance, sources = machine.friction, machine.tolerance, dict(machine.sources)
    for name in ("stiffness", "limit", "damping"):
        source = sources.get(f"friction.{name}")
        if source and isinstance(source.std, tuple):
            sources[f"friction.{name}"] = replace(
                source,
                std=_twice(source.std, 1 if name == "limit" else 2),
                shares=tuple(row for row in source.shares for _ in range(2)),
            )
    return replace(
        machine,
        friction=Friction(_twice(friction.stiffness, 2), _twice(friction.limit, 1), _twice(friction.damping, 2)),
        tolerance=replace(
            tolerance,
            stiffness=max(tolerance.stiffness, FREE_STIFFNESS),
            limit=max(tolerance.limit, min(apart / 2, FREE_LIMIT)),
        ),
        sources=sources,
    )


def _twice(values: Sequence[float], parts: int) -> tuple[float, ...]:
    """Each value over `parts`, two times."""
    return tuple(value / parts for value in values for _ in range(2))


def _spacing(limit: Array) -> Array:
    """How far apart (N,) neighbours are on the logarithm of their limits [1]; of one element alone, a decade."""
    if limit.size < 2:
        return np.full(1, np.log(10.0))
    gaps = np.maximum(np.diff(np.log(np.sort(limit))), 1e-3)
    both = np.concatenate([gaps[:1], 0.5 * (gaps[1:] + gaps[:-1]), gaps[-1:]])
    return np.asarray(both[np.argsort(np.argsort(limit))])
