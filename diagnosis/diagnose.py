"""The diagnosis of records: which effect, whether the answer is adequate, how far the gap shrinks with it.

refit and null     the nominal model re-fitted; what the search gains by chance       baseline.py, refit.py, null.py
select             forwards: one effect more while it gains more than chance          which/select.py, detectors/
prune              backwards: without what the others make useless; shares            which/prune.py
values             where the plant's run to their bounds: they beyond, or the effects model/at_bounds.py
slow               where nothing is found: what a force that walks at random follows which/slow.py
closure            how far the gap shrinks on motions that nothing was fitted to      closure.py, how_far.py
verdict            the rules by which an answer is given                              verdict.py, criteria.py
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.answer import (
    Answer,
    answer_of,
    as_spring,
    as_well,
    closes_too_little,
    doubted,
    explanations,
    form_parts,
    largest_adequate,
    nonlinear_spring,
    not_seen_to_repeat,
    rivalling,
)
from diagnosis.baseline import Baseline, Progress, refit_and_null
from diagnosis.closure import Closure
from diagnosis.criteria import Criteria
from diagnosis.handover.files import Content
from diagnosis.handover.gate import is_right
from diagnosis.handover.hand_over import HowFar, how_far
from diagnosis.handover.stated import direction, input_delay
from diagnosis.how_far import effect_magnitude
from diagnosis.learned.learn import Learned, learned
from diagnosis.model.at_bounds import freed, plant_at_bounds
from diagnosis.model.fit import Fit, fit
from diagnosis.model.parallel import on_single_blas_thread
from diagnosis.records.diagnosable import checked
from diagnosis.refit import noise_alone, wrong_values
from diagnosis.verdict import Outcome
from diagnosis.where.law_curve import LawCurve, law_curve
from diagnosis.which.kinds import Form
from diagnosis.which.prune import Pruned, prune, without
from diagnosis.which.select import select
from diagnosis.which.stage import Stage, excluded, strongest_first
from diagnosis.which.table import EffectRow, table
from models.effects.base import Effect
from models.effects.base import parameters as parameters_of
from models.machine import Machine
from models.quantity import listed, show
from models.records.record import Record

Array = NDArray[np.float64]

NAMED: Final = (Outcome.ATTRIBUTED, Outcome.AMBIGUOUS)  # outcomes that name effects
OF_A_MODE: Final = ("mode_gain", "mode_frequency")  # values that a law of no name drives to their bounds


@dataclass(frozen=True)
class Diagnosis:
    """What was found: the outcome and the names of the effects, strongest first.

    partly: effects that take off a part of the gap, where none explains it. equivalent: groups of effects that these
    records cannot tell apart. unexplained [1]: the share of the gap that stays. which: every candidate with its gain
    and threshold. how_far: the gap before and after, in [N], [m] and [s]. shares [1]: each effect's part of what was
    closed, over all orders of addition. stages: the models of the search; baseline: what it began with. forms: by name
    whether the law is the catalogue's, or one of its kind in another form; curves: the measured ones of such laws.
    learned: the law without a name, where no effect explains the records, or the curve by which a
    spring was named.

    >>> diagnosis
    Diagnosis(attributed: viscous_friction; ... % of the gap closes where nothing was fitted)
    """

    outcome: Outcome
    effects: tuple[str, ...]
    partly: tuple[str, ...]
    equivalent: tuple[tuple[str, ...], ...]
    unexplained: float
    which: tuple[EffectRow, ...]
    how_far: HowFar
    shares: Mapping[str, float]
    stages: tuple[Stage, ...]
    baseline: Baseline
    forms: Mapping[str, Form] = field(default_factory=lambda: MappingProxyType({}))
    curves: Mapping[str, LawCurve] = field(default_factory=lambda: MappingProxyType({}))
    learned: Learned | None = None

    def __repr__(self) -> str:
        names = f": {', '.join(self.effects)}" if self.effects else ""
        if self.outcome in NAMED and self.how_far.closure > 0:
            closed = f"{100 * self.how_far.closure:.0f} %"
            return f"Diagnosis({self.outcome}{names}; {closed} of the gap closes where nothing was fitted)"
        before, adopted = dict(self.how_far.stages)[Content.DELIVERED].force, self.how_far.handover.adopted
        left = f"{adopted.name}, leaves {show(adopted.gap.force, 'N', 2)} of {show(before, 'N', 2)}"
        return f"Diagnosis({self.outcome}{names}; the file handed over, {left})"

    @property
    def told(self) -> Fit:
        """The fit whose values are told: that behind the file with the effects, where it has all of them."""
        handed = self.how_far.handover.named(Content.EFFECTS)
        whole = handed is not None and len(handed.fitted.candidate.effects) == len(self.final.candidate.effects)
        return handed.fitted if handed is not None and whole else self.final

    @cached_property
    def noise(self) -> Array | None:
        """The white force of each record [N] where it is all that the re-fitted model leaves, and nothing has a name;
        None elsewhere."""
        if self.outcome is not Outcome.NONE or self.partly:
            return None
        base = self.baseline
        return noise_alone(base.nominal, base.records, base.criteria, base.null.usual)

    @property
    def final(self) -> Fit:
        """The model with the effects in it."""
        return self.stages[-1].fitted


@on_single_blas_thread
def diagnose(
    machine: Machine,
    records: Sequence[Record],
    *,
    criteria: Criteria = Criteria(),
    seed: int = 0,
    disabled: Collection[str] = (),
    trusted: bool = False,
    progress: Progress | None = None,
    cache: Path | None = None,
) -> Diagnosis:
    """Why the records differ from what the machine file says, and how far the gap closes once that is in the model.

    records: of one machine, each with its signals (n,) in [m] and [N]; of a log with one of several samples of the
    controller, the others are interpolated. criteria: every threshold of a decision. seed:
    of simulated floors. disabled: names of effects that are not to be used. trusted: records that only look wrong (in a
    unit or a sign, or of an axis that rests) are taken as they are. progress is told the share of the work that
    is done, 0 .. 1, and what comes next. cache: a folder in which the null's gains are kept for other records of the
    same schedule; without them the null is simulated anew, which is half of the time.

    Raises ValueError, in a sentence, for records or names that it can't take.

    >>> diagnosis.outcome, diagnosis.effects  # after diagnosis = pos.diagnose(machine, records)
    (<Outcome.ATTRIBUTED: 'attributed'>, ('viscous_friction',))
    >>> pos.diagnose(machine, [])
    Traceback (most recent call last):
    ValueError: a diagnosis needs at least one record
    """
    records = checked(machine, records, disabled, trusted=trusted)
    baseline = refit_and_null(machine, records, criteria=criteria, progress=progress, cache=cache)
    return diagnosed(baseline, seed=seed, disabled=disabled, progress=progress)


@on_single_blas_thread
def diagnosed(
    baseline: Baseline, *, seed: int = 0, disabled: Collection[str] = (), progress: Progress | None = None
) -> Diagnosis:
    """The second half: which effects explain what the baseline leaves, and how far the gap shrinks."""
    say = progress or (lambda _share, _text: None)
    say(0.5, "every effect of the catalogue against what is left")
    tell = partial(say, 0.7)

    def search(base: Baseline) -> Pruned:
        return prune(select(base, disabled, tell), base)

    for searched, base in _beside_values(search(baseline), baseline, search):
        say(0.9, "how far the gap shrinks")
        found = _told(searched, base, disabled, seed)
        if found.outcome is not Outcome.NONE:
            break
    return found


def _told(searched: Pruned, baseline: Baseline, disabled: Collection[str], seed: int) -> Diagnosis:
    """What a search says, once what it hands over has been judged."""
    for pruned, answer in explanations(searched, baseline, disabled, seed):
        found = _diagnosis(answer, pruned, baseline)
        if found.outcome in NAMED:
            break
    if found.outcome is Outcome.NONE and answer.outcome in NAMED:  # taken back
        plain = answer_of(pruned.stages[:1], pruned, baseline, seed)
        if plain.outcome is not Outcome.NONE:  # the re-fit leaves nothing, so that nothing is out of the catalogue
            found = _diagnosis(plain, pruned, baseline)
    if found.outcome is Outcome.NONE and baseline.biased and is_right_as_delivered(found.how_far, baseline, seed):
        # A re-fit that bends values where nothing is wrong does not tell what is left.
        plain = largest_adequate(pruned.stages[:1], baseline, seed)
        found = _diagnosis(replace(plain, outcome=Outcome.NOTHING, names=()), pruned, baseline)
    if found.outcome in NAMED and (less := doubted(answer, found.told, baseline)):
        found = _diagnosis(answer_of(without(pruned, less), pruned, baseline, seed), pruned, baseline)
    return found


def _beside_values(
    searched: Pruned, baseline: Baseline, search: Callable[[Baseline], Pruned]
) -> Iterator[tuple[Pruned, Baseline]]:
    """What may explain the records, the likeliest first: the search, or values of the plant beyond their bounds where
    these leave no more of the records than the effects that were found beside them within. An effect that delays the
    thrust and a longer dead time hardly differ, so that each is the other's rival. On a drive that is rougher than its
    model, any law drives the values there."""
    nominal, last, criteria = baseline.nominal, searched.stages[-1], baseline.criteria
    at_bounds = [one.name for one in plant_at_bounds(nominal.candidate)]
    if len(searched.stages) < 2 or last.fitted.candidate.rough or not at_bounds:
        yield searched, baseline
        return
    values = freed(nominal, baseline.records)
    delay = _delayed(searched, baseline) if "dead_time" in at_bounds else None
    no_more = _left(values) - _left(last.fitted) < criteria.min_gain_further
    if delay is not None:
        more = _left(values) - _left(delay.fitted)
        margin = as_well(_left(nominal) - _left(delay.fitted), criteria)
        if abs(more) < margin and (no_more or delay is last):
            cost = delay.fitted.cost
            rivals = ((str(delay.added), cost), *delay.rivals[1:], ("dead_time", cost + max(more, 0.0)))
            yield prune((searched.stages[0], replace(delay, rivals=rivals)), baseline), baseline
        elif delay is last:
            no_more = more < 0
    if no_more:
        other = replace(baseline, nominal=values)
        again = search(other)
        if len(again.stages) == 1:
            yield again, other
            return
    yield searched, baseline


def _delayed(searched: Pruned, baseline: Baseline) -> Stage | None:
    """The stage whose only effect delays the thrust: the search's, or that with the effect that was proposed."""
    first, last, nominal = searched.stages[0], searched.stages[-1], baseline.nominal
    added = last.fitted.candidate.added_effects
    if [one.name for one in added] == [last.added] and added[0].delayed_by:
        return last
    for one in first.scanned:
        if one.effect is not None and one.effect.delayed_by:
            with_it = one.added_to(nominal.candidate)
            return Stage(fit(with_it, baseline.records, paths=nominal.paths, walk=nominal.walk), added=one.name)
    return None


def _left(fitted: Fit) -> float:
    """The chi-square [1] of what a model leaves of the records, without that of its values."""
    return float(np.sum(fitted.innovations**2))


def _diagnosis(answer: Answer, pruned: Pruned, baseline: Baseline, known: Learned | None = None) -> Diagnosis:
    """known: a learned law that the answer has named."""
    stages, names, outcome, closure = answer.stages, answer.names, answer.outcome, answer.closure
    criteria = baseline.criteria
    parts = form_parts(stages, baseline)
    partly = tuple(n for n in strongest_first(stages) if n not in parts) if outcome is Outcome.NONE else ()
    rivals: tuple[tuple[str, ...], ...] = ()
    if outcome is Outcome.ATTRIBUTED:
        rivals = rivalling(stages, criteria, parts) or not_seen_to_repeat(answer, baseline)
    if rivals:
        outcome = Outcome.AMBIGUOUS
    unknown = known
    if outcome is Outcome.NONE or (known is None and nonlinear_spring(answer, baseline)):
        curve = learned(pruned.stages[0].fitted, closure.floor, baseline)
        if spring := as_spring(curve, answer, pruned, baseline):
            return _diagnosis(spring, pruned, baseline, replace(curve, reason=""))
        unknown = curve if outcome is Outcome.NONE else None
    far = how_far(stages, outcome, closure.floor, baseline, unknown)
    if far.effects_interval[1] <= 0 or far.leaves_more:  # what takes nothing off the gap resembles it in no part
        partly = ()
    final = stages[-1].fitted
    handed = far.handover.named(Content.EFFECTS)  # its values are told, unless effects of single records are not in it
    whole = handed is not None and len(handed.fitted.candidate.effects) == len(stages[-1].fitted.candidate.effects)
    if outcome in NAMED and is_withdrawn(names, final, closure, far, criteria):
        return _diagnosis(replace(answer, outcome=Outcome.NONE), pruned, baseline)
    told = (*stages[:-1], replace(stages[-1], fitted=handed.fitted)) if handed is not None and whole else stages
    named = names if outcome is not Outcome.NONE else ()
    untried = stages[-1].fitted.candidate.rough or bool(stages[0].still)
    doubtful = [name for name in named if untried or answer.forms.get(name) is Form.OTHER]
    which = table(told, criteria, named, rivals, closure.closure, baseline.segment, doubtful)
    if outcome is Outcome.NONE:
        names = ()
    if outcome is Outcome.PARAMETERS:
        names = wrong_values(stages[0].fitted, criteria, far.floor.force, baseline.null.bias())
    shares = _shares(pruned.shares, (*names, *partly), parts) if known is None else {names[0]: 1.0}
    without_effects = outcome in {Outcome.PARAMETERS, Outcome.NOTHING}
    closed = far.closure if far.handover.adopted.name == Content.MEASURED else closure.closure
    unexplained = 0.0 if without_effects else float(np.clip(1 - closed, 0.0, 1.0))
    found = {name: answer.forms.get(name, Form.CATALOGUE) for name in names if outcome in NAMED}
    others = [name for name, form in found.items() if form is Form.OTHER]
    curves = _curves(others, stages[-1].fitted, baseline) if known is None else {names[0]: known.curve()}
    return Diagnosis(
        outcome, names, partly, rivals, unexplained, which, far, shares, stages, baseline, found, curves, unknown
    )


def is_right_as_delivered(far: HowFar, baseline: Baseline, seed: int) -> bool:
    """Whether the machine as delivered leaves no more than the noise floor, or than of records that it makes itself, in
    force and in position."""
    file, floor = far.handover.files[0], far.floor
    within = file.gap.force <= floor.force and file.gap.position <= floor.position
    return within or is_right(file, baseline, seed)


def is_withdrawn(names: Sequence[str], fitted: Fit, closure: Closure, far: HowFar, criteria: Criteria) -> bool:
    """Whether the file with the named effects closes too little for them to stand. Where the search left nothing above
    the floor, unless that is as rough as what is left, little is enough, and of a converter's steps, as fine as noise,
    nothing is asked; where effects are not in the file as their phases belong to single records, it does not tell. On
    a drive that is rougher than its model a name has to be seen in the force, and surely, beside modes within their
    bounds: the position goes with whatever else makes the machine's response another one."""
    rough = fitted.candidate.rough
    if far.left_out:
        return False
    if closure.excess < criteria.max_excess_at_floor and not closure.by_force and not rough:
        named = [type(effect) for effect in fitted.candidate.added_effects if effect.name in names]
        fine = any(item.is_step for kind in named for item in parameters_of(kind))
        return not fine and closes_too_little(names, fitted, far.interval, criteria.min_closure_at_floor)
    too_little = closes_too_little(names, fitted, far.interval, criteria.min_closure)
    bent = any(one.name in OF_A_MODE for one in plant_at_bounds(fitted.candidate))
    return too_little or (rough and (far.terms.measure != "force" or far.interval[0] <= 0 or bent))


def _shares(found: Mapping[str, float], names: Sequence[str], parts: Mapping[str, str]) -> dict[str, float]:
    """Each name's share of what was closed [1], that of a part of its form included; parts: see `form_parts`."""
    kept = dict.fromkeys((name for name in found if name in names), 0.0)
    for name, share in found.items():
        if parts.get(name, name) in kept:
            kept[parts.get(name, name)] += share
    return {name: share / sum(kept.values()) for name, share in kept.items()}


def _curves(names: Sequence[str], fitted: Fit, baseline: Baseline) -> dict[str, LawCurve]:
    """The measured curves of laws whose form is another than the catalogue's."""
    kinds = baseline.machine.kinds
    measured = (law_curve(name, kinds[name].kind(), fitted, baseline.records, baseline.pieces) for name in names)
    return {name: curve for name, curve in zip(names, measured, strict=True) if curve is not None}


def to_json(found: Diagnosis) -> dict[str, Any]:
    """verdict, which and how_far as interfaces fix them; `where` comes with the evidence."""
    return {
        "verdict": {
            "outcome": str(found.outcome),
            "effects": list(found.effects),
            "partly": list(found.partly),
            "equivalent": [list(group) for group in found.equivalent],
            "kind": {name: _kind(name, found.baseline.machine) for name in (*found.effects, *found.partly)},
            "form": {name: str(form) for name, form in found.forms.items()},
            "excluded": list(excluded(found.stages[0], found.baseline.criteria.shortlist_min_ratio)),
            "direction": way.to_json() if (way := direction(found.told)) else None,
            "input_delay": input_delay(found.told, found.baseline.segment).to_json(),
            "unexplained_fraction": found.unexplained,
            **({"beside_still_force": True} if found.stages[0].still and found.outcome in NAMED else {}),
        },
        "which": [
            {**_row(row), "measured": _measured(found, row.name), "acts": _acts(found, row.name)} for row in found.which
        ],
        "how_far": found.how_far.to_json() | {"shares": dict(found.shares)},
        "learned": _unknown_law(found),
    }


def _unknown_law(found: Diagnosis) -> dict[str, Any] | None:
    """The learned law, and whether the file with it was handed over; None where there was nothing to learn."""
    if found.learned is None:
        return None
    handover, worse = found.how_far.handover, ""
    fitted = handover.adopted.finished
    if fitted is None or not any(effect.tabulated for effect in fitted.candidate.added_effects):
        with_it = Content.EFFECTS if found.outcome in NAMED else Content.MEASURED
        measures = dict.fromkeys(harm.measure for harm in handover.harms if harm.file == with_it)
        way = f"worse in {listed(measures)}" if measures else "no better"
        worse = f"on motions left out of the fit the machine with it is {way}"
    return found.learned.to_json(worse)


def _kind(name: str, machine: Machine) -> dict[str, Any] | None:
    """The kind of an effect's law; None of a nominal value."""
    return asdict(machine.kinds[name].kind()) if name in machine.kinds else None


def _measured(found: Diagnosis, name: str) -> dict[str, Any] | None:
    """The measured curve of an effect's law; None where its form is the catalogue's."""
    return found.curves[name].to_json() if name in found.curves else None


def _acts(found: Diagnosis, name: str) -> dict[str, Any] | None:
    """How much a named effect does along the records; None for what is not named, or not in the model."""
    named = name in (*found.effects, *found.partly)
    size = effect_magnitude(name, found.told.candidate, found.baseline.records, found.told.paths) if named else None
    return size.to_json() if size else None


def _row(row: EffectRow) -> dict[str, Any]:
    values = [_fitted(effect, std) for effect, std in row.members]
    return {
        "effect": row.name,
        "parameters": values[0] if values else {},
        "further_members": values[1:],
        "held_out_gain": row.gain if np.isfinite(row.gain) else None,
        "threshold": row.threshold,
        "probability": row.probability,
        "adequate": row.adequate,
    }


def _fitted(effect: Effect, deviation: Mapping[str, float]) -> dict[str, Any]:
    return {
        item.name: {
            "value": float(getattr(effect, item.name)),
            "unit": item.unit,
            "std": deviation.get(item.name),
            "role": item.role,
        }
        for item in parameters_of(type(effect))
    }
