"""The unknown law: learned where no kind of the catalogue fits, and adopted where motions that were not used agree."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.baseline import Baseline
from diagnosis.closure import NoiseFloor
from diagnosis.criteria import Criteria
from diagnosis.learned.curves_tried import Curve, shortlists
from diagnosis.learned.left_out import (
    Choice,
    Judgement,
    chosen,
    judged_by_force,
    judgement,
    shown_from,
    solved,
    summed,
)
from diagnosis.model.fit import Fit, fit, weights
from diagnosis.model.unknown_force import unknown_less_mean
from diagnosis.records.units import noise, units
from diagnosis.where.coordinates import by_motion
from diagnosis.where.energy import bootstrap_counts, interval_ends
from diagnosis.where.law_curve import LawCurve
from diagnosis.which.detectors.scan import BATCH, NuisanceProjection, linear_columns, partial_out
from models.effects.catalogue import in_order
from models.effects.measured import FORCE_UNITS, UNITS, Measured

Array = NDArray[np.float64]

ITERATIONS: Final = 4  # of a fit with the law in it


@dataclass(frozen=True)
class Learned:
    """A law without a name: its table, the low and the high end of its band at the knots (K,) [N], how it does on types
    of motion that were not used, and the model with it. reason: why it may not go into a machine without a name; empty
    if it may. by_force: whether it was judged by the unknown force, as innovations hardly show it. choice: of the curve
    that is in the model, beside which its forces were fitted."""

    law: Measured | None
    low: Array
    high: Array
    judgement: Judgement | None
    fitted: Fit | None
    reason: str = ""
    by_force: bool = False
    choice: Choice | None = None

    def fitted_to(self, motions: NDArray[np.bool_], baseline: Baseline) -> Measured:
        """The table whose forces are fitted to these motions (m,) alone (SI). Raises ValueError where there is none."""
        if self.choice is None:
            raise ValueError("no law is in the model")
        return _law(self.choice.test.curve, self.choice.test.trained(motions, self.choice.smoothness), baseline)

    def pulls_back(self, most_rise: float) -> bool:
        """Whether it is a force over the position that surely falls, and within its band nowhere rises by more than a
        part of that [1]: what pulls back towards one place. Nothing speaks against it but that few motions judge it."""
        if self.law is None or (self.law.coordinate, self.law.symmetry) != ("position", "plain"):
            return False
        if self.reason and self.fitted is None:
            return False
        fall = self.low[0] - self.high[-1]
        rise = np.max(self.low - np.minimum.accumulate(self.high))
        return bool(fall > 0 and rise < most_rise * fall)

    def curve(self) -> LawCurve:
        """The table with its band (SI). Raises ValueError where there is none."""
        if self.law is None:
            raise ValueError("no law was learned")
        law = self.law
        return LawCurve(
            law.coordinate, UNITS[law.coordinate], np.array(law.knots), np.array(law.force), self.low, self.high
        )

    def to_json(self, adopted: str) -> dict[str, Any]:
        """As results.json has it; adopted: why the file with it was not handed over, empty if it was [-]."""
        reason = self.reason or adopted
        plain: dict[str, Any] = {"adopted": not reason, "reason": reason or None}
        if self.law is not None and self.judgement is not None:
            judged = self.judgement
            plain |= {
                "coordinate": self.law.coordinate,
                "unit": UNITS[self.law.coordinate],
                "symmetry": self.law.symmetry,
                "knots": list(self.law.knots),
                "values": list(self.law.force),
                "values_unit": FORCE_UNITS[self.law.symmetry],
                "band": np.column_stack([self.low, self.high]).tolist(),
                "slow_m_per_s": self.law.slow,
                "turn_m": self.law.turn,
                "closure": judged.closure,
                "closure_interval": list(judged.interval),
                "judged_share": judged.share,
                "judged_by": "unknown force" if self.by_force else "innovations",
                "by_type": [
                    {"motions": one.motions, "closure": one.closure, "share": one.share, "coordinate": one.coordinate}
                    for one in judged.by_type
                ],
            }
        return plain


NOTHING: Final = np.zeros(0)


def learned(begin: Fit, floor: NoiseFloor, baseline: Baseline) -> Learned:
    """The curve that explains the most of what a fit leaves, and whether other types of motion confirm it (SI)."""
    criteria = baseline.criteria
    kinds = list(dict.fromkeys(piece.kind for piece in baseline.pieces))
    kind = np.array([kinds.index(piece.kind) for piece in baseline.pieces])
    names = ["" if one.rests else str(one) for one in kinds]
    types = [number for number, name in enumerate(names) if name]
    if len(types) < criteria.learned_min_types:
        return _refused(
            f"the records hold {len(types)} type{'s' * (len(types) != 1)} of motion, and a law is judged on one that "
            f"was not used, which takes {criteria.learned_min_types}; record motions of other strokes and speeds"
        )
    found = shortlists(begin, baseline.records, baseline.segment, kind, types)
    if not found:
        return _refused("no curve over time, position, speed, acceleration, command, rest or path explains any of it")
    projection = partial_out(begin, baseline.segment)
    least = shown_from(units(begin.candidate.nominal, baseline.records))
    curves = {one.named: one for shortlist in found.values() for one in shortlist}
    tested = {
        name: summed(one, columns_of(one, begin, baseline, projection), projection.e, baseline.segment, kind, least)
        for name, one in curves.items()
    }
    above = projection.e**2 - _whitened(floor, begin, baseline)
    by_force = not _surely_above(above, floor, criteria)
    if by_force:
        force, used = unknown_less_mean(begin, baseline.records)
        least = floor.gap().force
        if force @ force < criteria.min_force_ratio * least**2 * np.count_nonzero(used):
            return _refused("the gap is too small beside the noise floor to judge a law")
        tested = {
            name: judged_by_force(one, one.curve.acting, force, used, baseline.segment) for name, one in tested.items()
        }
        moving = np.array([not piece.kind.rests for piece in baseline.pieces])[baseline.segment]
        above = np.where(used & moving, force**2 - least**2, 0.0)  # it acts at rest, too, which is no type of motion
    tests = {out: [tested[one.named] for one in shortlist] for out, shortlist in found.items()}
    judged = judgement(tests, above, baseline.segment, kind, names)
    choice = chosen(tests[None], kind, types)
    low, high = _band(choice, kind.size, baseline)
    reason, fitted, inside = objection(judged, criteria), None, None
    if not reason or little_judged(judged, criteria):
        fitted, inside = in_the_model(choice, begin, baseline)
    law = _law(choice.test.curve, _of_all(inside or choice), baseline)
    force = np.array(law.force)
    return Learned(law, force + low, force + high, judged, fitted, reason, by_force, inside)


def _surely_above(above: Array, floor: NoiseFloor, criteria: Criteria) -> bool:
    """Whether innovations are above the noise floor by more than chance; above (n,): by how much, 0 where unknown [1].

    The filter's own random force follows what is slow, which innovations then hardly show.
    """
    deviation = np.sqrt(2 * np.count_nonzero(above) * (1 + 1 / len(floor.innovations)))
    return bool(above.sum() > criteria.shown_by * deviation)


def _refused(reason: str) -> Learned:
    return Learned(None, NOTHING, NOTHING, None, None, reason)


def objection(judged: Judgement, criteria: Criteria) -> str:
    """Why a law that does so on motions that were not used is not to be taken; empty if it is."""
    if judged.share < criteria.learned_min_judged:
        return (
            f"only {100 * max(judged.share, 0.0):.0f} % of the gap lies where another type of motion shows the law; "
            "record motions of other strokes and speeds over the same range"
        )
    if judged.closure < criteria.learned_min_closure:
        closes = f"{round(100 * judged.closure)} %" if judged.closure >= 0 else "nothing"
        return (
            f"on types of motion that were not used it closes {closes} of the gap, less than "
            f"the {100 * criteria.learned_min_closure:.0f} % asked for"
        )
    return ""


def little_judged(judged: Judgement, criteria: Criteria) -> bool:
    """Whether nothing is to be said against a law but that too little of the gap lies where other motions show it: it
    surely closes some of that, and in all likelihood as much as is asked for."""
    few = judged.share < criteria.learned_min_judged
    return few and judged.closure >= criteria.learned_min_closure and judged.interval[0] > 0


def columns_of(curve: Curve, fitted: Fit, baseline: Baseline, projection: NuisanceProjection) -> Array:
    """What 1 N at each knot of a curve does to the innovations after the projection (n, K) [1/N]."""
    hats = curve.units_of_force()
    given = [linear_columns(hats[i : i + BATCH], fitted, baseline.records) for i in range(0, len(hats), BATCH)]
    return projection(np.hstack([column for batch in given for column in batch]))


def _whitened(floor: NoiseFloor, fitted: Fit, baseline: Baseline) -> Array:
    """Squares (n,) [1] of what a complete model leaves, in the units of a fit's innovations."""
    size = np.concatenate([np.full(one.innovations.size, one.deviation) for one in fitted.residuals])
    square = np.mean([one**2 for one in floor.innovations], axis=0) / (size * noise(fitted.candidate.machine)) ** 2
    counts = weights(baseline.records)
    usual = float(np.nanmean(square[counts > 0]))
    return np.where(np.isnan(square), usual, square) * counts


def in_the_model(choice: Choice, begin: Fit, baseline: Baseline) -> tuple[Fit, Choice]:
    """The model with the law in it, both fitted in turn, as nominal values had taken up a part of the law; and the
    choice with its sums there. What nominal values do is as it was without the law: beside one that turns with the
    friction, a change of the friction's level takes the law with it and a change of all elements does not, so that
    together they would do what the law does."""
    curve = choice.test.curve
    force = _of_all(choice)
    fitted = _with_law(curve, force, begin, baseline)
    plain = replace(fitted, slopes=begin.slopes, effect_jacobian=begin.effect_jacobian)
    projection = partial_out(plain, baseline.segment)
    columns = columns_of(curve, fitted, baseline, projection)
    grams, slopes = by_motion(columns, projection.e, baseline.segment)
    inside = replace(choice, test=replace(choice.test, grams=grams, slopes=slopes - grams @ force))
    return _with_law(curve, _of_all(inside), begin, baseline), inside


def _of_all(choice: Choice) -> Array:
    """The forces (K,) [N] of the chosen curve fitted to all motions."""
    return choice.test.trained(np.ones(choice.test.slopes.shape[0], bool), choice.smoothness)


def _with_law(curve: Curve, force: Array, begin: Fit, baseline: Baseline) -> Fit:
    law = _law(curve, force, baseline)
    candidate = replace(begin.candidate, effects=in_order((*begin.candidate.effects, law)))
    return fit(candidate, baseline.records, paths=begin.paths, iterations=ITERATIONS, walk=begin.walk)


def _law(curve: Curve, force: Array, baseline: Baseline) -> Measured:
    """The table of these forces (K,) [N] without what a mass or a thrust constant would be, which the innovations do
    not tell from it; a plain one, or one that turns, less its median over the samples: the offset, the friction."""
    used = weights(baseline.records) > 0
    force = curve.own_part(used) @ force
    if curve.law.symmetry in {"plain", "directional"}:
        force = force - float(np.median((curve.hats @ force)[used]))
    return curve.with_force(force)


def _band(choice: Choice, motions: int, baseline: Baseline) -> tuple[Array, Array]:
    """By how much the ends of the 95 % interval differ from the curve at its knots (K,) [N], by drawing motions."""
    test, curve, best = choice.test, choice.test.curve, _of_all(choice)
    own = curve.own_part(weights(baseline.records) > 0)
    drawn = [
        own @ (solved(curve, np.tensordot(count, test.grams, 1), count @ test.slopes, choice.smoothness) - best)
        for count in bootstrap_counts(motions, 0)
    ]
    if curve.law.symmetry == "plain":  # whose level is the offset's
        level = np.mean(curve.hats, axis=0)
        drawn = [one - float(level @ one) for one in drawn]
    low, high = np.quantile(drawn, interval_ends(motions), axis=0)
    none = np.zeros(len(curve.law.knots) - low.size)
    return np.concatenate([none, np.minimum(low, 0.0)]), np.concatenate([none, np.maximum(high, 0.0)])
