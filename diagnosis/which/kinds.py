"""Which kind of law, before which form: what a kind's free form explains, and whether a name's own form suffices."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from diagnosis.baseline import Baseline
from diagnosis.criteria import Criteria
from diagnosis.learned.curves_tried import curves_over
from diagnosis.model.fit import Fit, coordinates, weights
from diagnosis.model.residual import columns
from diagnosis.which.detectors.scan import NuisanceProjection, by_segment, finding_of, linear_columns, partial_out
from diagnosis.which.free_form import free_form, member_columns, unit_columns
from diagnosis.which.stage import Proposal
from models.effects.base import Effect, Kind, parameters
from models.effects.catalogue import in_order
from models.effects.measured import MOST_KNOTS, SIGNED, UNITS, Measured
from models.effects.parameter import POSITIVE
from models.records.record import Record

Array = NDArray[np.float64]

RIVALS: Final = 6  # names with the largest gains whose free forms are compared
FREE: Final = 0.3  # of an effect's size: deviation of the parts of its free form, where others are judged beside it

BEND: Final = 3  # degree of what a spring adds that hardens about any place: a cube, with the square and the line of it


class Form(StrEnum):
    """What form a law has that was named."""

    CATALOGUE = "catalogue"
    """Its entry of the catalogue."""
    OTHER = "other"
    """Another curve over the same coordinate."""


@dataclass(frozen=True)
class OfKind:
    """What the free form of a name's kind explains, and the most that one of another kind does: shares [1] of the
    chi-square above the noise floor, on held-out motions."""

    kind: Kind
    share: float
    rival: float

    def decides(self, criteria: Criteria) -> bool:
        """Whether what is left is of this kind, and of no other."""
        return self.share >= criteria.min_kind_share and self.rival <= criteria.max_rival_kind * self.share


def of_kind(effect: Effect, beside: Fit, proposals: Sequence[Proposal], baseline: Baseline) -> OfKind:
    """What free forms explain of what a fit without the effect leaves; proposals: those whose kinds may compete. Shares
    are 0 where what is left is not surely above the noise floor: of next to nothing any gain would be a large share.

    A drive that is rougher than its model has weights by which it leaves one per sample, whatever is wrong. There the
    shares are of what the effect's own kind gains, which leaves it to the closure of the unknown force how much of the
    gap that is (`diagnosis.answer.closes_too_little`).
    """
    own, records = partial_out(beside, baseline.segment), baseline.records
    kind = type(effect).kind()

    def gain(one: Effect) -> float:
        return free_form(one, beside, records, own).gain

    whole = gain(effect) if beside.candidate.rough else above_floor(own.e, baseline)
    if whole <= 0:
        return OfKind(kind, 0.0, 0.0)
    others = [one.effect for one in proposals if one.effect is not None and type(one.effect).kind() != kind]
    share = 1.0 if beside.candidate.rough else gain(effect) / whole
    return OfKind(kind, share, max((gain(one) / whole for one in others[:RIVALS]), default=0.0))


def above_floor(e: Array, baseline: Baseline) -> float:
    """The chi-square [1] by which innovations e (n,) [1] surely exceed the noise floor, else 0."""
    excess = float(e @ e - np.mean(baseline.floors))
    return excess if excess > baseline.criteria.shown_by * float(np.std(baseline.floors)) else 0.0


def forms(fitted: Fit, gained: Mapping[str, float], baseline: Baseline) -> dict[str, Form]:
    """The form of every effect in a model; gained: by name the chi-square [1] that it took off. Another than the
    catalogue's is one whose free form gains on held-out motions what an earlier effect's form may be wrong by."""
    own, criteria, found = partial_out(fitted, baseline.segment), baseline.criteria, dict[str, Form]()
    for effect in fitted.candidate.added_effects:
        found.setdefault(effect.name, Form.CATALOGUE)
        least = max(criteria.min_gain_further, criteria.form_error * gained.get(effect.name, 0.0))
        more = free_form(effect, fitted, baseline.records, own).gain
        if more > least:
            found[effect.name] = Form.OTHER
    return found


def beside_free_forms(
    proposals: Sequence[Proposal], fitted: Fit, records: Sequence[Record], own: NuisanceProjection
) -> tuple[Proposal, ...]:
    """The proposals, those of other kinds than the effects in the model with no more than they gain beside the free
    forms of these: what the first law in another form explains needs no second law."""
    inside = {type(effect).kind() for effect in fitted.candidate.added_effects}
    other = [one.effect for one in proposals if one.effect is not None and one.gain > one.threshold]
    other = [effect for effect in other if type(effect).kind() not in inside]
    if not inside or not other:
        return tuple(proposals)
    free = with_free_forms(own, fitted, records)
    given, priors = linear_columns(other, fitted, records), fitted.candidate.nominal.priors
    known = {
        effect.name: finding_of(effect, *by_segment(free(raw), free), free, priors).held_out
        for effect, raw in zip(other, given, strict=True)
    }
    less = [replace(one, gain=min(one.gain, known.get(one.name, one.gain))) if one.effect else one for one in proposals]
    return tuple(sorted(less, key=lambda one: -one.gain))


def with_free_forms(own: NuisanceProjection, fitted: Fit, records: Sequence[Record]) -> NuisanceProjection:
    """The projection that partials out the free forms of the added effects as well, each member
    within FREE of its effect's size."""
    added, parts = fitted.candidate.added_effects, [own.basis]
    begin = 0
    for effect in fitted.candidate.effects:
        count = coordinates(effect).size
        sizes = coordinates(effect)[: count - sum(item.role in POSITIVE for item in parameters(type(effect)))]
        made = fitted.effect_jacobian[:, begin : begin + sizes.size] @ sizes
        begin += count
        if sizes.size and any(effect is one for one in added):
            _, whole = member_columns(effect, fitted, records, own)
            whole = np.hstack([whole, *_drawn(effect, fitted, records, own)])
            parts.append(FREE * float(np.linalg.norm(made)) * whole)
    basis = np.hstack(parts)
    factor = cho_factor(basis.T @ basis + np.eye(basis.shape[1]))
    e = own.e - basis @ cho_solve(factor, basis.T @ own.e)
    return replace(own, e=e, basis=basis, factor=factor)


def _drawn(effect: Effect, fitted: Fit, records: Sequence[Record], own: NuisanceProjection) -> Iterator[Array]:
    """What curves can do over the coordinate of a law that has no shape of its own, such as a drag: columns (n, k) of
    unit energy [1], where the coordinate is one of those that a law can be measured over."""
    kind = type(effect).kind()
    shaped = any(item.role in {"shape", "period", "width"} for item in parameters(type(effect)))
    if shaped or kind.memory or kind.side != "force" or kind.coordinate not in UNITS:
        return
    symmetries = ("odd", "even") if kind.coordinate in SIGNED else ("directional", "plain")
    for curve in curves_over(kind.coordinate, [symmetries[kind.parity != "odd"]], fitted, records):
        yield unit_columns(curve.units_of_force(), fitted, records, own)


def repeats(kind: type[Effect]) -> bool:
    """Whether the laws of a class repeat over their coordinate."""
    return any(item.role == "period" for item in parameters(kind))


def periods_shown(effect: Effect, records: Sequence[Record]) -> float:
    """How many periods of a law over the position the records' travel holds [1]: fewer than two do not show that it
    repeats at all. Infinite for a law that need not repeat."""
    travel = max(float(np.ptp(record.position)) for record in records)
    periods = [
        float(getattr(effect, item.name))
        for item in parameters(type(effect))
        if item.role == "period" and item.periodic_in in {"position", "reading"}
    ]
    return min((travel / period for period in periods), default=float("inf"))


def as_bent_spring(effect: Effect, beside: Fit, baseline: Baseline) -> tuple[float, float]:
    """The chi-square [1] that a law over the position adds to what a fit without it leaves, and how much of it is left
    where the best spring that hardens, about whatever place, stands for it: what nominal values take up is in neither.
    """
    records, own = baseline.records, partial_out(beside, baseline.segment)
    ends = [end for record in records for end in (np.min(record.position), np.max(record.position))]
    knots = np.linspace(min(ends), max(ends), MOST_KNOTS)
    along = np.linspace(-1.0, 1.0, MOST_KNOTS)
    powers = [Measured("position", tuple(knots), tuple(along**n)) for n in range(1, BEND + 1)]
    trials = [in_order((*beside.candidate.effects, one)) for one in (effect, *powers)]
    made = columns(beside.candidate, trials, records, beside.paths, beside.residuals, beside.walk)
    law, *spring = own(made * weights(records)[:, None]).T
    bend = np.column_stack(spring)
    left = law - bend @ np.linalg.lstsq(bend, law, rcond=None)[0]
    return float(law @ law), float(left @ left)
