"""From the stages of the search to an answer: how many of them hold, which names they give, and with which outcome."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from types import MappingProxyType
from typing import Final

from diagnosis.baseline import Baseline
from diagnosis.closure import Closure, held_out_closure
from diagnosis.criteria import Criteria
from diagnosis.how_far import force_share
from diagnosis.learned.learn import Learned
from diagnosis.model.at_bounds import roomier
from diagnosis.model.fit import Fit, largest, parameters_at_bounds
from diagnosis.model.unknown_force import force_left
from diagnosis.refit import shifts
from diagnosis.verdict import Explanation, Outcome, verdict
from diagnosis.which.detectors.scan import partial_out
from diagnosis.which.kinds import Form, above_floor, as_bent_spring, forms, of_kind, periods_shown, repeats
from diagnosis.which.prune import Pruned, prune, shrinking
from diagnosis.which.slow import hidden, slow_force
from diagnosis.which.stage import Carrier, Stage, strongest_first
from diagnosis.which.table import unsure
from models.effects.base import Effect, Kind
from models.records.record import Record

SPRING: Final = Kind("position", "even", memory=False, side="force")


@dataclass(frozen=True)
class Answer:
    """What some stages of the search say: their names, how far they close the gap, the outcome, and by name the form of
    the laws that are in the model."""

    stages: tuple[Stage, ...]
    names: tuple[str, ...]
    closure: Closure
    outcome: Outcome
    forms: Mapping[str, Form] = field(default_factory=lambda: MappingProxyType({}))


def answer_of(stages: tuple[Stage, ...], pruned: Pruned, baseline: Baseline, seed: int) -> Answer:
    """The answer of some stages of the search, with the forms of its laws and with what the log shows."""
    answer = largest_adequate(stages, baseline, seed)
    return with_the_log(with_forms(answer, pruned, baseline, seed), pruned, baseline, seed)


def explanations(
    pruned: Pruned, baseline: Baseline, disabled: Collection[str] = (), seed: int = 0
) -> tuple[tuple[Pruned, Answer], ...]:
    """The answer that the search gives; before it that with a slow effect, where the search found nothing for a force
    that innovations do not show, and one explains it."""
    answer = answer_of(pruned.stages, pruned, baseline, seed)
    plain = ((pruned, answer),)
    if answer.names or not hidden(answer.closure, baseline.criteria):
        return plain
    stages = slow_force(pruned.stages[0], baseline, disabled)
    if stages is None:
        return plain
    slow = prune(stages, baseline)
    with_it = answer_of(slow.stages, slow, baseline, seed)
    return ((slow, with_it), *plain) if with_it.outcome is Outcome.ATTRIBUTED else plain


def largest_adequate(stages: tuple[Stage, ...], baseline: Baseline, seed: int) -> Answer:
    """As many stages of the search as explain enough together; all of them where none do."""
    answers = []
    random, series = stages[-1].carried_by(Carrier.FLOOR), overfitting_series(stages, baseline.criteria)
    series |= broadband(stages, baseline.criteria)
    series |= drawn_curves(stages[-1].fitted.candidate.added_effects, baseline.records, baseline.criteria)
    acting = tuple(proposal.name for proposal in random)
    for count in range(len(stages), min(len(stages), 2) - 1, -1):
        answer = _with_room(stages[:count], acting, series, baseline, seed)
        if answer.outcome is not Outcome.NONE:
            return answer
        answers.append(answer)
    return answers[0]


def _with_room(
    stages: tuple[Stage, ...], random: tuple[str, ...], series: Collection[str], baseline: Baseline, seed: int
) -> Answer:
    """The answer of some stages. Where nothing but the bound of a value of the strongest stands against it, that gets
    more room, once: usual sizes are those of usual machines. A law that is distorted to stand for another one runs to
    the next bound."""
    given, closure = _explained(stages, random, series, baseline, seed)
    if given.at_bound and verdict(replace(given, at_bound=False), baseline.criteria) is Outcome.ATTRIBUTED:
        roomy = (*stages[:-1], replace(stages[-1], fitted=roomier(stages[-1].fitted, baseline.records)))
        if not strongest_at_bound(roomy):
            stages = roomy
            given, closure = _explained(stages, random, series, baseline, seed)
    return Answer(stages, given.names, closure, verdict(given, baseline.criteria))


def _explained(
    stages: tuple[Stage, ...], random: tuple[str, ...], series: Collection[str], baseline: Baseline, seed: int
) -> tuple[Explanation, Closure]:
    """What some stages of the search explain, and their closure; random: names of what acts at random beside them."""
    closure, fitted = held_out_closure(stages, baseline, seed), stages[-1].fitted
    parts = form_parts(stages, baseline)
    explains = Explanation(
        (*(name for name in strongest_first(stages) if name not in parts), *random),
        closure.closure,
        closure.interval,
        closure.excess,
        random=random,
        series=series,
        at_bound=strongest_at_bound(stages),
        repeats=any(repeats(type(one)) for one in fitted.candidate.added_effects),
        rough=fitted.candidate.rough,
        interpolated=baseline.interpolated,
        by_force=closure.by_force,
        force_excess=closure.force_excess,
        largest_innovation=largest(fitted).deviations,
        spike=baseline.spike,
        parameter_shift=shifts(stages[0].fitted, baseline.null.bias()).gain(),
    )
    return explains, closure


def with_forms(answer: Answer, pruned: Pruned, baseline: Baseline, seed: int) -> Answer:
    """The answer with the forms of its laws. Where no law of the catalogue holds, and what is left is surely of the
    kind of one of those that were tried, it is attributed to that one in another form; a law that would repeat along a
    travel of less than two periods has no other form, as nothing shows that it does."""
    criteria, records = baseline.criteria, baseline.records
    if answer.outcome is Outcome.ATTRIBUTED:
        gained = gains_by_name(answer.stages)
        found = forms(answer.stages[-1].fitted, gained, baseline)
        parts = form_parts(answer.stages, baseline)
        found |= dict.fromkeys(parts.values(), Form.OTHER)
        unshown = [
            effect.name
            for effect in answer.stages[-1].fitted.candidate.added_effects
            if found[effect.name] is Form.OTHER and periods_shown(effect, records) < criteria.min_periods
        ]
        return replace(answer, forms=found, outcome=Outcome.NONE if unshown else answer.outcome)
    if answer.outcome is not Outcome.NONE:
        return answer
    begin = pruned.stages[0]
    for name in strongest_first(pruned.stages):
        alone = pruned.fits[frozenset({name})]
        effect = next((one for one in alone.candidate.added_effects if one.name == name), None)
        if effect is None or periods_shown(effect, records) < criteria.min_periods:
            continue
        if of_kind(effect, begin.fitted, begin.scanned, baseline).decides(criteria):
            stages = (begin, replace(pruned.stages[-1], fitted=alone, added=name, rivals=()))
            closure = held_out_closure(stages, baseline, seed)
            if closure.interval[0] > 0:
                return Answer(stages, (name,), closure, Outcome.ATTRIBUTED, {name: Form.OTHER})
    return answer


def as_spring(unknown: Learned, answer: Answer, pruned: Pruned, baseline: Baseline) -> Answer | None:
    """The answer where a law that was learned is one of the catalogue's in another form: a force over the position that
    pulls back is a spring's, whatever its curve. Its closure is that on types of motion that the curve has not seen.

    Laws over other coordinates have a free form, by which `with_forms` knows them; a spring has nothing but its curve.
    """
    kinds = baseline.machine.kinds
    looked_for = [one.name for one in pruned.stages[0].scanned if one.name in kinds]
    names = [name for name in looked_for if kinds[name].kind() == SPRING and not repeats(kinds[name])]
    pulls = unknown.pulls_back(baseline.criteria.learned_max_rise)
    if not pulls or unknown.fitted is None or unknown.judgement is None or len(names) != 1:
        return None
    if unknown.judgement.interval[0] <= 0:  # it may close nothing of what other motions show
        return None
    stage = replace(pruned.stages[-1], fitted=unknown.fitted, added=names[0], rivals=())
    judged = unknown.judgement
    closure = replace(answer.closure, closure=judged.closure, interval=judged.interval, by_force=unknown.by_force)
    return Answer((pruned.stages[0], stage), tuple(names), closure, Outcome.ATTRIBUTED, {names[0]: Form.OTHER})


def nonlinear_spring(answer: Answer, baseline: Baseline) -> bool:
    """Whether the answer is one spring that is not straight, of which its curve tells more than a stiffness."""
    kinds = baseline.machine.kinds
    return [(kinds[name].kind(), form) for name, form in answer.forms.items()] == [(SPRING, Form.OTHER)]


def gains_by_name(stages: Sequence[Stage]) -> dict[str, float]:
    """The chi-square [1] that the stages of each name took off together."""
    gained: dict[str, float] = {}
    for before, after in pairwise(stages):
        gained[f"{after.added}"] = gained.get(f"{after.added}", 0.0) + before.fitted.cost - after.fitted.cost
    return gained


def form_parts(stages: Sequence[Stage], baseline: Baseline) -> dict[str, str]:
    """Effects that are a part of another one's form, each with the name of that one: what a law of the same kind adds
    to one that gained far more is the error of its curve, as that of a falling friction beside a drag. One that took
    off most of the unknown force is none, whatever it gained: a spring beside a cogging, which the filter's own random
    force follows."""
    little, least = small_beside(stages, baseline.criteria), baseline.criteria.force_share_of_slow
    most = {
        after.added
        for before, after in pairwise(stages)
        if after.added in little
        and force_share(*(force_left(one.fitted, baseline.records) for one in (before, after))) >= least
    }
    return {name: first for name, first in little.items() if name not in most}


def small_beside(stages: Sequence[Stage], criteria: Criteria) -> dict[str, str]:
    """Effects that gained little beside another one of their kind, each with the name of that one."""
    gained = gains_by_name(stages)
    kinds = {effect.name: type(effect).kind() for effect in stages[-1].fitted.candidate.added_effects}
    found: dict[str, str] = {}
    for name, kind in kinds.items():
        same = [other for other in kinds if other != name and kinds[other] == kind]
        first = max(same, key=lambda other: gained.get(other, 0.0), default=name)
        if same and gained.get(name, 0.0) < criteria.form_part * gained.get(first, 0.0):
            found[name] = first
    return found


def with_the_log(answer: Answer, pruned: Pruned, baseline: Baseline, seed: int) -> Answer:
    """The answer with what the log itself shows, whatever else is left; and where effects have no whole explanation,
    with those that are a part of one."""
    logged = tuple(proposal.name for proposal in pruned.stages[-1].carried_by(Carrier.LOG))
    stages, names, outcome = answer.stages, answer.names, answer.outcome
    if logged:
        if outcome is not Outcome.ATTRIBUTED:
            names, stages = (), pruned.stages[:1]
        names, outcome = (*logged, *names), Outcome.ATTRIBUTED
    elif outcome is not Outcome.ATTRIBUTED:
        stages = shrinking(pruned, baseline)
    same = stages[-1].fitted is answer.stages[-1].fitted
    closure = answer.closure if same else held_out_closure(stages, baseline, seed)
    return Answer(stages if not same else answer.stages, names, closure, outcome, answer.forms)


def doubted(answer: Answer, fitted: Fit, baseline: Baseline) -> set[str]:
    """Names beside the strongest whose size in a fit the model of the machine file does not tell from none: what
    chi-square gained along the search is then the form of the others."""
    further = set(answer.names) - set(strongest_first(answer.stages)[:1])
    if answer.outcome is not Outcome.ATTRIBUTED or not further:
        return set()
    return unsure(fitted, further, baseline.segment, baseline.criteria.min_deviations_further)


def rivalling(stages: Sequence[Stage], criteria: Criteria, parts: Collection[str] = ()) -> tuple[tuple[str, ...], ...]:
    """Sets of effects that explain as much as one another: those tried for a stage, of another class than the best.

    One that a later stage takes up beside the best is not in its place, and a part of another's form is not named.
    parts: see `form_parts`.
    """
    groups, inside = [], set(strongest_first(stages))
    for before, after in pairwise(stages):
        if not after.rivals or after.added in parts:
            continue
        best, least = after.rivals[0]
        margin = as_well(before.fitted.cost - least, criteria)
        alike = [
            name
            for name, cost in after.rivals[1:]
            if (cost - least < margin or name in after.by_force) and name not in {best, *inside}
        ]
        if alike:
            groups.append((best, *alike))
    return tuple(groups)


def not_seen_to_repeat(answer: Answer, baseline: Baseline) -> tuple[tuple[str, ...], ...]:
    """Sets of a named effect that repeats along the way, of which the records show too few periods to tell that, and
    those of its kind that the file's own effects suggest: what bends a stated spring is as well a sine of one period
    over all the way. Of members of a class, that of the longest period counts; where there are several, the bend may
    have whatever form, and else the one that leaves nearly as little (`_stands_for_a_bend`)."""
    final, kinds = answer.stages[-1].fitted.candidate, baseline.machine.kinds
    looked_for = [one.name for one in answer.stages[0].scanned if one.name in kinds]
    groups = []
    for name in answer.names:
        members = [one for one in final.added_effects if one.name == name]
        shown = [periods_shown(one, baseline.records) for one in members]
        alike = [
            other
            for other in looked_for
            if kinds[other].beside and not repeats(kinds[other]) and kinds[other].kind() == kinds[name].kind()
        ]
        few = shown and min(shown) < baseline.criteria.min_periods
        if few and alike and (len(members) > 1 or _stands_for_a_bend(members[0], answer, baseline)):
            groups.append((name, *alike))
    return tuple(groups)


def _stands_for_a_bend(effect: Effect, answer: Answer, baseline: Baseline) -> bool:
    """Whether a spring that hardens would leave hardly more than a law over the position, the only one of its name:
    what a rival may leave, or a law by the error of its form, or what the answer itself leaves above the floor. A sum
    of several draws any bend, so that its own form says nothing."""
    criteria, final = baseline.criteria, answer.stages[-1].fitted
    gain, left = as_bent_spring(effect, answer.stages[0].fitted, baseline)
    unexplained = above_floor(partial_out(final, baseline.segment).e, baseline)
    return left < max(as_well(gain, criteria), criteria.form_error * gain, unexplained)


def as_well(gain: float, criteria: Criteria) -> float:
    """The chi-square [1] within which another law explains the records as well as one that gains this much."""
    return max(criteria.rival_margin, criteria.rival_share * gain)


def overfitting_series(stages: Sequence[Stage], criteria: Criteria) -> set[str]:
    """Effects whose third member would still gain: the sum of members is a series expansion of another law."""
    first: dict[str, float] = {}
    for before, after in pairwise(stages):
        first.setdefault(f"{after.added}", before.fitted.cost - after.fitted.cost)
    members = Counter(effect.name for effect in stages[-1].fitted.candidate.added_effects)
    gains = {proposal.name: proposal.gain for proposal in stages[-1].scanned}
    return {
        name for name, gain in first.items() if members[name] > 1 and gains.get(name, 0.0) > criteria.series_gain * gain
    }


def broadband(stages: Sequence[Stage], criteria: Criteria) -> set[str]:
    """Forces at random about a frequency whose third line would still gain: a floor rings in one or two; what takes a
    third one is random over all frequencies, as that of commands which are late now and then."""
    gains: dict[str, list[float]] = {}
    for stage, then_added in zip(stages, [*(stage.added for stage in stages[1:]), None], strict=True):
        for one in stage.proposals:
            if one.random_force is not None and then_added in {one.name, None}:
                gains.setdefault(one.name, []).append(one.gain)
    return {name for name, own in gains.items() if own[2:] and own[2] > criteria.random_force_third * own[0]}


def drawn_curves(effects: Sequence[Effect], records: Sequence[Record], criteria: Criteria) -> set[str]:
    """Effects that would repeat over a longer way than the travel, where further laws of their kind are beside them:
    such a sum draws any curve over the travel."""
    kinds = Counter(type(effect).kind() for effect in effects)
    return {
        effect.name
        for effect in effects
        if kinds[type(effect).kind()] > 1 and periods_shown(effect, records) < criteria.min_periods_beside
    }


def closes_too_little(names: Sequence[str], fitted: Fit, interval: tuple[float, float], least: float) -> bool:
    """Whether the file with the effects surely closes less than `least` [1], by the 95 % interval [1] of its closure.
    What the search weighs by frequency may be a small part of the force that is left; what the log or the noise floor
    carries closes nothing of it."""
    inside = {effect.name for effect in fitted.candidate.added_effects}
    return inside.issuperset(names) and interval[1] < least


def strongest_at_bound(stages: Sequence[Stage]) -> bool:
    """Whether the effect that gained the most had to leave its prior range for it."""
    names = strongest_first(stages)
    first = [effect for effect in stages[-1].fitted.candidate.added_effects if names and effect.name == names[0]]
    priors = stages[-1].fitted.candidate.nominal.priors
    return bool(first) and bool(parameters_at_bounds(max(first, key=lambda effect: effect.strength()), priors))
