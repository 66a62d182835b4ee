"""Which experiment discriminates between candidates: one whose observable's ranges over the sizes do not overlap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from studies.paper_gap.experiments import Experiment

Array = NDArray[np.float64]

MIN_DISCRIMINATING_STEPS: Final = 2.0  # steps: two candidates are discriminated if their ranges are this far apart

Measured = Mapping[str, Sequence[Sequence[Sequence[float]]]]
"""By candidate, tuned draw, experiment and observable: steps."""


def gap(first: Array, second: Array) -> Array:
    """Least distance (observables,) between the ranges of two candidates (draws, observables); 0 if they meet."""
    between = np.maximum(first.min(axis=0) - second.max(axis=0), second.min(axis=0) - first.max(axis=0))
    return np.asarray(np.maximum(between, 0.0))


def decide(experiments: Sequence[Experiment], measured: Measured) -> dict[str, Any]:
    """The pairs that each experiment discriminates, the most discriminating experiment, and what a second one adds.

    A pair of candidates is discriminated if some observable's ranges are MIN_DISCRIMINATING_STEPS or more. The
    experiment's `best` observable discriminates the most pairs and, among equals, has the largest gap between two of
    them.
    """
    names = list(measured)
    pairs = list(combinations(names, 2))
    gaps = [
        np.array([gap(_of(measured[a], i), _of(measured[b], i)) for a, b in pairs]).reshape(
            len(pairs), len(experiment.observables)
        )
        for i, experiment in enumerate(experiments)
    ]  # of each experiment (pairs, observables)
    told = [np.any(one >= MIN_DISCRIMINATING_STEPS, axis=1) for one in gaps]
    rows = [_row(experiment, gaps[i], told[i], measured, i) for i, experiment in enumerate(experiments)]
    first = int(np.argmax([np.sum(one) for one in told]))
    others = [i for i in range(len(told)) if i != first]
    second = max(others, key=lambda i: (np.sum(told[i] & ~told[first]), np.sum(told[i])))
    left = ~(told[first] | told[second])
    return {
        "apart_steps": MIN_DISCRIMINATING_STEPS,
        "pairs": len(pairs),
        "experiments": rows,
        "first": first,
        "second": second,
        "told_by_first": int(np.sum(told[first])),
        "added_by_second": int(np.sum(told[second] & ~told[first])),
        "left": [list(pair) for pair, is_left in zip(pairs, left, strict=True) if is_left],
    }


def _row(experiment: Experiment, gaps: Array, told: NDArray[np.bool_], measured: Measured, at: int) -> dict[str, Any]:
    if gaps.size:
        best = max(
            range(gaps.shape[1]), key=lambda j: (np.sum(gaps[:, j] >= MIN_DISCRIMINATING_STEPS), np.max(gaps[:, j]))
        )
    else:
        best = 0
    return {
        "name": experiment.name,
        "words": experiment.words,
        "observables": [one.name for one in experiment.observables],
        "units": [one.unit for one in experiment.observables],
        "pairs_by_observable": np.sum(gaps >= MIN_DISCRIMINATING_STEPS, axis=0),
        "pairs": int(np.sum(told)),
        "best": best,
        "largest_gap_steps": float(np.max(gaps[:, best], initial=0.0)),
        "values_steps": {name: _of(draws, at) for name, draws in measured.items()},
    }


def _of(draws: Sequence[Sequence[Sequence[float]]], experiment: int) -> Array:
    """The observables (draws, observables) of one experiment."""
    return np.array([draw[experiment] for draw in draws], float)
