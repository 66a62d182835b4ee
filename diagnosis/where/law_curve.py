"""The measured curve of a law whose form is not the catalogue's: its force over its coordinate, with a band.

The force is that of the fitted law and what is left beside it, of the parity that the law has: the partial residuals
(W. Larsen, S. McCleary, The use of partial residual plots in regression analysis, Technometrics 14, 1972). The curve is
piecewise linear; its band comes from a bootstrap over whole motions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.model.fit import Fit, weights
from diagnosis.model.residual import evaluate
from diagnosis.model.unknown_force import unknown_force
from diagnosis.records.motions import Piece, numbered
from diagnosis.where.coordinates import by_motion, coordinates, hat_functions, slowest
from diagnosis.where.energy import bootstrap_counts, interval_ends, label_samples
from models.effects.base import Kind
from models.effects.catalogue import in_order
from models.records.record import Record

Array = NDArray[np.float64]

OWN_SIGN: Final = ("acceleration", "command", "velocity_sign")  # over which an odd law changes its sign by itself
CALLED: Final = MappingProxyType(
    {
        "speed": "velocity",
        "direction": "velocity",
        "position": "position",
        "time": "time",
        "rest": "dwell",
        "way since a reversal": "since_reversal",
        "command": "command",
        "acceleration": "acceleration",
    }
)
"""What the coordinate of a kind is called among the coordinates of the unknown force."""
RIDGE: Final = 1e-3  # relative to the mean energy of a hat function: where the records hold little, the curve is flat


@dataclass(frozen=True)
class LawCurve:
    """A law's force on the table (K,) [N] at the knots (K,) of its coordinate, in `unit`, the low and the high end of
    its band (K,) [N]. An odd one is that of motions forwards; over the speed, it is over its size."""

    coordinate: str
    unit: str
    knots: Array
    force: Array
    low: Array
    high: Array

    def to_json(self) -> dict[str, Any]:
        """As results.json has it."""
        return {
            "coordinate": self.coordinate,
            "unit": self.unit,
            "at": self.knots.tolist(),
            "values": self.force.tolist(),
            "values_unit": "N",
            "band": np.column_stack([self.low, self.high]).tolist(),
        }


def law_curve(
    name: str, kind: Kind, fitted: Fit, records: Sequence[Record], pieces: Sequence[Piece]
) -> LawCurve | None:
    """The measured curve of the law of this name in a fit (SI); None where it has no coordinate that records show."""
    settling = fitted.candidate.machine.specification.settling_time
    units = fitted.candidate.nominal.priors.units
    samples = label_samples(records, pieces, numbered(pieces, records), weights(records), settling, units)
    known = {one.name: one for one in coordinates(fitted, records, samples)}
    coordinate = known.get(CALLED.get(kind.coordinate, ""))
    if coordinate is None or kind.side != "force":
        return None
    if coordinate.name == "velocity":
        coordinate = replace(coordinate, values=np.abs(coordinate.values))
    force = _force_of(name, fitted, records) + np.concatenate(unknown_force(fitted.candidate, records, fitted.paths))
    turning = kind.parity == "odd" and coordinate.name not in OWN_SIGN
    direction = samples.direction if coordinate.turns is None else coordinate.turns
    if turning:
        force = force * direction
    used = samples.counts & ~np.isnan(force) & (direction != 0)
    if coordinate.name == "velocity":  # at rest the speed is the smoother's error
        used &= coordinate.values > slowest(samples)
    if not used.any():
        return None
    basis, knots = hat_functions(coordinate, used, straight=True)
    grams, slopes = by_motion(basis * used[:, None], np.where(used, force, 0.0), samples.motion)
    drawn = bootstrap_counts(grams.shape[0], 0)
    curves = [_solved(np.tensordot(count, grams, 1), count @ slopes) for count in drawn]
    low, high = np.quantile(curves, interval_ends(grams.shape[0]), axis=0)
    best = _solved(grams.sum(axis=0), slopes.sum(axis=0))
    return LawCurve(kind.coordinate, coordinate.unit, knots, best, low, high)


def _force_of(name: str, fitted: Fit, records: Sequence[Record]) -> Array:
    """What the added effects of this name make of the net force (n,) [N] of all records, one after another."""
    candidate = fitted.candidate
    added = candidate.added_effects
    off = [one.off() if one.name == name and any(one is other for other in added) else one for one in candidate.effects]
    less = evaluate(replace(candidate, effects=in_order(off)), records, fitted.paths, fitted.walk)
    pairs = zip(fitted.residuals, less, strict=True)
    return np.concatenate([np.mean(whole.force - without.force, axis=1) for whole, without in pairs])


def _solved(gram: Array, slope: Array) -> Array:
    ridge = RIDGE * np.trace(gram) / gram.shape[0] + 1e-300
    return np.asarray(np.linalg.solve(gram + ridge * np.eye(gram.shape[0]), slope))
