"""The free form of a law: what laws of its kind explain together, whatever curve they have over their coordinate.

A law of the catalogue has a form: a bell over the speed, an exponential rise with the time of rest. Its kind (see
`models.effects.base.Kind`) is more: the sum of many members of its class, with widths and times from far below its
usual range to far above it, draws any smooth curve over the same coordinate, of the same parity, acting at the same
place. What such a sum gains on held-out motions tells how much of the gap is of this kind; what it gains beyond the
form that was fitted tells whether that form is the law's. What is periodic has its harmonics for a free form, as a sum
of other periods would draw anything.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.model.fit import Fit
from diagnosis.which.detectors.scan import BATCH, FOLDS, NuisanceProjection, linear_columns, linear_parts
from models.effects.base import Effect, parameters
from models.effects.priors import Priors
from models.records.record import Record

Array = NDArray[np.float64]

# Times a usual range, at either end, that the members of a free form have their shapes in.
SHAPE_RANGE_FACTOR: Final = 10.0
MEMBERS: Final = 24  # of a free form at most
PER_DECADE: Final = 3  # members, where that many suffice for the whole range
HARMONICS: Final = 3  # of a period
RIDGES: Final = (1e-4, 1e-3, 1e-2, 0.1)  # relative to a column's mean energy: the best on held-out motions is taken


@dataclass(frozen=True)
class FreeForm:
    """A free form beside a fit: the chi-square that it takes off held-out motions [1], its members (SI) and how much of
    each it has [1]."""

    gain: float
    members: tuple[Effect, ...]
    parts: Array


def free_form(effect: Effect, fitted: Fit, records: Sequence[Record], projection: NuisanceProjection) -> FreeForm:
    """The free form of an effect's law beside a fit, whose own parameters the projection partials out."""
    variants, whole = member_columns(effect, fitted, records, projection)
    gain, parts = ridge_regression(whole, projection)
    return FreeForm(gain, variants, parts)


def member_columns(
    effect: Effect, fitted: Fit, records: Sequence[Record], projection: NuisanceProjection
) -> tuple[tuple[Effect, ...], Array]:
    """The linear parts of a free form's members (SI), and by how much each changes the innovations after the
    projection: columns (n, k) of unit energy [1]."""
    priors = fitted.candidate.nominal.priors
    made = members(effect, priors)
    parts = tuple(part for member in made for part in linear_parts(member, priors))
    return parts, unit_columns(made, fitted, records, projection)


def unit_columns(
    effects: Sequence[Effect], fitted: Fit, records: Sequence[Record], projection: NuisanceProjection
) -> Array:
    """By how much the linear parts of effects change the innovations after the projection: columns (n, k) of unit
    energy [1]."""
    given = [linear_columns(effects[i : i + BATCH], fitted, records) for i in range(0, len(effects), BATCH)]
    whole = projection(np.hstack([column for batch in given for column in batch]))
    whole /= np.maximum(np.sqrt(np.sum(whole**2, axis=0)), 1e-300)
    return np.asarray(whole)


def members(effect: Effect, priors: Priors) -> tuple[Effect, ...]:
    """The members (SI) of a free form of the effect's law in a machine of these priors: of its shapes over a wide
    range, or the harmonics of its period."""
    items = parameters(type(effect), priors)
    periods = [item for item in items if item.role == "period"]
    if periods:
        (period,) = periods
        size = float(getattr(effect, period.name))
        times = range(1, HARMONICS + 1)
        return tuple(replace(effect, **{period.name: n * size if period.is_frequency else size / n}) for n in times)
    shapes = [item for item in items if item.role == "shape"]
    spans = [(item.low / SHAPE_RANGE_FACTOR, item.high * SHAPE_RANGE_FACTOR) for item in shapes]
    axes = [
        [(item.name, float(point)) for point in np.geomspace(*span, count)]
        for item, span, count in zip(shapes, spans, _counts(spans), strict=True)
    ]
    return tuple(replace(effect, **dict(point)) for point in itertools.product(*axes))


def _counts(spans: Sequence[tuple[float, float]]) -> Iterator[int]:
    """Points of each axis, so that their product is MEMBERS at most."""
    most = MEMBERS ** (1 / max(len(spans), 1))
    for low, high in spans:
        yield max(2, int(min(most, 1 + PER_DECADE * np.log10(high / low))))


def ridge_regression(whole: Array, projection: NuisanceProjection) -> tuple[float, Array]:
    """What a ridge regression of the innovations on columns (n, k) of unit energy gains on held-out motions, and its
    parts (k,), both [1]."""
    count = projection.fold.size
    grams, slopes = np.zeros((FOLDS, whole.shape[1], whole.shape[1])), np.zeros((FOLDS, whole.shape[1]))
    fold = projection.fold[np.minimum(projection.segment, count - 1)]
    for number in range(FOLDS):
        part = whole[fold == number]
        grams[number], slopes[number] = part.T @ part, -part.T @ projection.e[fold == number]
    total, onto, unit = grams.sum(axis=0), slopes.sum(axis=0), np.eye(whole.shape[1])
    best, ridge = -np.inf, RIDGES[0]
    for tried in RIDGES:
        gain = 0.0
        for gram, slope in zip(grams, slopes, strict=True):
            trained = np.linalg.solve(total - gram + tried * unit, onto - slope)
            gain += float(2 * slope @ trained - trained @ gram @ trained)
        if gain > best:
            best, ridge = gain, tried
    return best, np.asarray(np.linalg.solve(total + ridge * unit, onto))
