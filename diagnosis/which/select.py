"""Which effect: the proposed effects one after another into the model, each with all that is nominal re-fitted.

Forward selection: of the proposals that gain more on held-out motions than chance does, the most promising are fitted
with everything else and the best is kept; then the detectors look again, because one effect can hide another. What the
effects make of each other is looked at in the end (prune.py). A class of effects may have two members (two time
constants) before a second class is looked for.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from diagnosis.baseline import Baseline
from diagnosis.criteria import Criteria
from diagnosis.how_far import force_share
from diagnosis.model.fit import Fit
from diagnosis.which.admissible import inadmissible, within_range
from diagnosis.which.detectors.random_force import is_about
from diagnosis.which.search import RecordSearch, Search
from diagnosis.which.stage import Proposal, Stage, Trial
from models.effects.base import Effect, parameters

Array = NDArray[np.float64]


def select(
    baseline: Baseline, disabled: Collection[str] = (), say: Callable[[str], None] = lambda _: None
) -> tuple[Stage, ...]:
    """The stages of the search: the nominal re-fit first, then with one effect more each time, while it gains more than
    chance does and more than the form of the earlier effects may be wrong by."""
    return grown(baseline.nominal, RecordSearch(baseline, disabled), say)


def grown(nominal: Fit, search: Search, say: Callable[[str], None] = lambda _: None) -> tuple[Stage, ...]:
    """`select`, whatever proposes and fits."""
    criteria = search.criteria
    stage, columns = search.examined(Stage(nominal))
    stages, set_aside, negligible = [stage], set[str](), set[str]()
    while True:
        shortlist = shortlisted(stages, search, set_aside) or slow_ones(stages, search, set_aside)
        decided = any(one.decided for one in shortlist)
        beside = () if decided or set_aside else overlooked(stages[-1], search, shortlist)
        shortlist = (*shortlist, *beside)
        if not shortlist and negligible and _surely_left(stages[-1].fitted, search):  # what gained nothing may gain now
            (stages[-1], columns), negligible = search.examined(stages[-1], (), columns), set()
            continue
        if not shortlist:
            break
        say(f"fitting {', '.join(proposal.name for proposal in shortlist)} with all that is nominal")
        trials = search.tried(stages[-1], shortlist)
        if decided and len(trials) > 1:  # a mode rings to the commands with which the loop answers what shakes it, too
            likeliest = min(trials, key=lambda trial: search.deviance(trial.fitted))
            trials = [likeliest] if likeliest.proposal.decided else [one for one in trials if not one.proposal.decided]
        if trials[0].proposal.decided:
            negligible = _negligible_effects(stages, criteria)
            stage, columns = search.examined(_stage(search.settled(trials[0], stages[-1])), negligible)
            stages.append(stage)
            continue
        set_aside |= inadmissible(trials, stages, search) | _not_enough(trials, beside, stages[-1], search)
        trials = [trial for trial in trials if trial.proposal.name not in set_aside]
        if not trials:
            continue
        trials = within_range(trials, stages[-1], criteria)
        first = min(trials, key=lambda trial: trial.fitted.cost)
        best = search.settled(first, stages[-1])
        if stages[-1].fitted.cost - best.fitted.cost < criteria.min_gain:
            set_aside |= {trial.proposal.name for trial in trials}
            continue
        if not _takes_force(best, stages, search):
            set_aside.add(best.proposal.name)
            continue
        if _too_many(best.fitted, criteria):
            break
        if not decided and (shaken := _shaken(first, stages[-1], search)):
            negligible = _negligible_effects(stages, criteria)
            stage, columns = search.examined(_stage(search.settled(shaken, stages[-1])), negligible)
            stages.append(stage)
            continue
        negligible = _negligible_effects(stages, criteria)
        stage, columns = search.examined(_beside_rivals(best, trials, stages[-1], search), negligible, columns)
        stages.append(stage)
        set_aside = set()
    return tuple(stages)


def _shaken(mode: Trial, before: Stage, search: Search) -> Trial | None:
    """What shakes the axis about the frequency of a mode that is about to be kept, where it is likelier: a mode that
    isn't there rings to the commands with which the loop answers the shaking, and so gains on held-out motions. Lines
    are looked for by themselves only where a mode that the file has slightly wrong leaves none; so one is here."""
    members = [one for one in mode.fitted.candidate.added_effects if one.name == mode.proposal.name]
    frequencies = [part.frequency for one in members for part in one.modes()]
    proposals = [proposal for frequency in frequencies for proposal in search.shaking(before, frequency)]
    if not proposals:
        return None
    likeliest = min(search.tried(before, proposals), key=lambda trial: search.deviance(trial.fitted))
    return likeliest if search.deviance(likeliest.fitted) < search.deviance(mode.fitted) else None


def _stage(best: Trial) -> Stage:
    """The stage that a trial makes by itself."""
    return Stage(best.fitted, added=best.proposal.name)


def _beside_rivals(best: Trial, trials: Sequence[Trial], before: Stage, search: Search) -> Stage:
    """The stage that the best of the trials makes, with those that were compared by chi-square for it. In a model that
    is wrong elsewhere, chi-square prefers what makes up for that; the unknown force may prefer the other."""
    ordered = sorted(trials, key=lambda trial: trial.fitted.cost)
    first, *others = ordered
    far = search.criteria.rival_share_by_force * (before.fitted.cost - first.fitted.cost)
    near = [trial for trial in others if trial.fitted.cost - first.fitted.cost < far]
    least = search.force(first.fitted) if near else 0.0
    by_force = tuple(trial.proposal.name for trial in near if search.force(trial.fitted) <= least)
    rivals = tuple((trial.proposal.name, trial.fitted.cost) for trial in ordered)
    return replace(_stage(best), rivals=rivals, by_force=by_force)


def shortlisted(stages: Sequence[Stage], search: Search, set_aside: Collection[str] = ()) -> tuple[Proposal, ...]:
    """The proposals to be fitted next, the most promising first; none ends the search.

    A proposal that the likelihood has decided goes first; beside it a mode that rings about its frequency, if it gains
    a good part of it, and effects of the catalogue that gain far more. These go alone where the force may be what a law
    of the motion leaves. Where much is left, though, chi-square promises more than the likelihood gains, as a filter
    that expects no force of that size doubts everything else.
    """
    promising = _promising(stages, search, set_aside)
    most = promising[0].gain if promising else 0.0
    least = search.criteria.shortlist_min_ratio * most
    decided = [one for one in stages[-1].proposals if one.decided and (one.even or one.gain > least)]
    if not decided:
        return promising
    first = max(decided, key=lambda proposal: proposal.gain)
    if first.gain <= least:
        return (first, *promising)
    return (first, *_ringing(first, _significant(stages, search, set_aside), search.criteria))


def _ringing(decided: Proposal, allowed: Sequence[Proposal], criteria: Criteria) -> tuple[Proposal, ...]:
    """The mode among what is allowed that a random force stands in for: what shakes the axis by itself doesn't answer
    the motions, so a mode about its frequency gains next to nothing on those held out."""
    assert decided.random_force is not None
    least = criteria.random_force_of_a_mode * decided.gain
    about = decided.random_force.frequency
    return tuple(
        one
        for one in allowed
        if one.effect is not None
        and one.gain > least
        and any(is_about(mode.frequency, about) for mode in one.effect.modes())
    )


def slow_ones(stages: Sequence[Stage], search: Search, set_aside: Collection[str] = ()) -> tuple[Proposal, ...]:
    """The proposal to be fitted beside effects once no other is worth it, in case that it is a slow force: the next of
    those few that gain the most of all that gain more than chance."""
    inside = {effect.name for effect in stages[-1].fitted.candidate.added_effects}
    allowed = [one for one in stages[-1].scanned if one.name not in inside and above_chance(one, search.criteria)]
    left = [one for one in allowed[: search.criteria.shortlist_size] if one.name not in set_aside]
    return tuple(left[:1]) if inside else ()


def overlooked(stage: Stage, search: Search, shortlist: Sequence[Proposal]) -> tuple[Proposal, ...]:
    """The proposal that gains a good part of what is surely left over all motions, and too little on held-out ones for
    the shortlist, if there is one: to first order it need not carry over, where contacts slip that the law moves."""
    if not _surely_left(stage.fitted, search):
        return ()
    least = search.criteria.overlooked_share * _excess(stage.fitted, search)
    inside = {effect.name for effect in stage.fitted.candidate.added_effects}
    left = [
        one
        for one in stage.scanned
        if one.in_sample_gain > max(least, search.criteria.min_gain) and one not in shortlist and one.name not in inside
    ]
    return tuple(sorted(left, key=lambda one: -one.in_sample_gain)[:1])


def _not_enough(trials: Sequence[Trial], beside: Sequence[Proposal], before: Stage, search: Search) -> set[str]:
    """Those of the overlooked effects that, fitted, do not take off half of what is left, which may be chance, or
    beside which one does that gains on held-out motions, too."""
    half, names = 0.5 * _excess(before.fitted, search), {one.name for one in beside}
    enough = {one.proposal.name for one in trials if before.fitted.cost - one.fitted.cost >= half}
    return names if enough - names else names - enough


def _excess(fitted: Fit, search: Search) -> float:
    """The chi-square [1] that a model leaves above the noise floor."""
    return float(fitted.innovations @ fitted.innovations - np.mean(search.floors))


def _promising(stages: Sequence[Stage], search: Search, set_aside: Collection[str]) -> tuple[Proposal, ...]:
    """Of the scan's significant proposals those that gain nearly as much as the best; a second member of a class in the
    model goes before another class."""
    criteria, allowed = search.criteria, _significant(stages, search, set_aside)
    if not allowed:
        return ()
    most = allowed[0].gain
    inside = {effect.name for effect in stages[-1].fitted.candidate.added_effects}
    again = [proposal for proposal in allowed if proposal.name in inside]
    if again and again[0].gain > criteria.second_member_ratio * most:
        return (again[0],)
    tried = allowed[: criteria.shortlist_size]
    return tuple(proposal for proposal in tried if proposal.gain > criteria.shortlist_min_ratio * most)


def _significant(stages: Sequence[Stage], search: Search, set_aside: Collection[str]) -> list[Proposal]:
    """The scan's proposals above chance, above the form error of what is in the model already, and not set aside."""
    criteria, here = search.criteria, stages[-1].fitted
    inside = [effect.name for effect in here.candidate.added_effects]
    gained, left = stages[0].fitted.cost - here.cost, float(here.innovations @ here.innovations)
    further = min_gain_beside_others(gained, left, search.floors, criteria)
    of_excess = criteria.min_share_of_excess * (left - float(np.mean(search.floors)))
    allowed = []
    for proposal in stages[-1].scanned:
        members = inside.count(proposal.name)
        enough = proposal.gain > max(0.0 if members or not inside else further, of_excess)
        may = members < _most_members(proposal.effect, criteria) and proposal.name not in set_aside
        if may and enough and above_chance(proposal, criteria):
            allowed.append(proposal)
    return allowed


def _most_members(effect: Effect | None, criteria: Criteria) -> int:
    """Members of a class that a model may have: two that differ by nothing but their amplitude are one."""
    plain = effect is not None and all(item.role == "amplitude" for item in parameters(type(effect)))
    return 1 if plain else criteria.max_members


def above_chance(proposal: Proposal, criteria: Criteria) -> bool:
    """Whether a proposal gains more than any effect has to, and than chance does."""
    return proposal.gain > max(proposal.threshold, criteria.min_gain)


def min_gain_beside_others(gained: float, left: float, floors: Array, criteria: Criteria) -> float:
    """The chi-square that an effect has to gain beside others that `gained` so much and `left` so much: more than the
    others' form may be wrong by, or a good part of what is surely above the noise floors (draws,); all [1]."""
    excess, form = left - float(np.max(floors)), criteria.form_error * gained
    least = min(form, criteria.form_error_of_excess * excess) if excess > 0 else form
    return max(criteria.min_gain_further, least)


def _takes_force(trial: Trial, stages: Sequence[Stage], search: Search) -> bool:
    """Whether a trial takes off as much of the unknown force as it needs to.

    That is a good part of what is left, and of what was there at first, where it gains less than the form of the others
    may be wrong by; a part of what is left for a class beyond those that chi-square alone may put into one answer, as
    many laws together draw anything; nothing else.
    """
    criteria, before = search.criteria, stages[-1].fitted
    slow = trial.proposal not in _significant(stages, search, ())
    further = _classes(trial.fitted) > max(criteria.max_effects, _classes(before))
    if not (slow or further):
        return True
    first, last, now = (search.force(one) for one in (stages[0].fitted, before, trial.fitted))
    taken = force_share(last, now)
    if not slow:
        return taken >= criteria.min_force_share_further
    return taken >= criteria.force_share_of_slow and last**2 - now**2 >= criteria.min_force_share_slow * first**2


def _classes(fitted: Fit) -> int:
    return len({effect.name for effect in fitted.candidate.added_effects})


def _too_many(fitted: Fit, criteria: Criteria) -> bool:
    """Whether so many effects are in the model that they could be a series expansion of anything."""
    most = max(criteria.max_effects_by_force, criteria.max_effects)
    return _classes(fitted) > most or len(fitted.candidate.added_effects) > most + 2


def _surely_left(fitted: Fit, search: Search) -> bool:
    """Whether a model leaves more than the noise floor, beyond chance."""
    left, floors = float(fitted.innovations @ fitted.innovations), search.floors
    return left - float(np.mean(floors)) > search.criteria.missing_excess * float(np.std(floors))


def _negligible_effects(stages: Sequence[Stage], criteria: Criteria) -> set[str]:
    """Effects that gained nothing at the first stage nor at the second: the scan does not look at them again."""
    if len(stages) < 2:
        return set()
    worth = {one.name for stage in stages[:2] for one in stage.scanned if one.gain > criteria.dull_gain}
    return {proposal.name for proposal in stages[0].scanned} - worth
