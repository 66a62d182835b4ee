"""Whether an effect that was tried may stand in the model, whatever it gains: some only mend the form of another law.

One has to be as large as its kind can be and of a sign that it can have, within its prior range unless it gains much
there, and no member that only takes from another of its class or draws what the others leave.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import fields
from typing import Final

from diagnosis.criteria import Criteria
from diagnosis.how_far import force_share
from diagnosis.model.fit import Fit, amplitudes, parameters_at_bounds
from diagnosis.which.detectors.scan import HIGHEST
from diagnosis.which.search import Search
from diagnosis.which.stage import Stage, Trial
from models.effects.base import Effect
from models.quantity import declaration

OVERLAP_WIDTHS: Final = 3.0  # of resonances, in the widths of both: within, one of the other sign takes from the first


def inadmissible(trials: Sequence[Trial], stages: Sequence[Stage], search: Search) -> set[str]:
    """Effects that were tried and only mend the form of another law: whose members take from each other, further
    members that do not repeat within the travel, those larger than any can be, and those at the bounds of their prior
    range that gain little of what the effects before them did."""
    criteria, here = search.criteria, stages[-1].fitted
    names = {trial.proposal.name for trial in trials if _opposed(trial.fitted, trial.proposal.name)}
    names |= {trial.proposal.name for trial in trials if _too_fast(trial.fitted)}
    names |= {trial.proposal.name for trial in trials if _draws_more(trial, here, search)}
    names |= {trial.proposal.name for trial in trials if _is_impossible(trial.fitted, trial.proposal.name)}
    if here.candidate.added_effects:
        large = criteria.min_gain_at_bound * (stages[0].fitted.cost - here.cost)
        bounded = [trial for trial in trials if runs_to_bounds(trial.fitted, trial.proposal.name)]
        little = [trial for trial in bounded if here.cost - trial.fitted.cost < large]
        names |= {trial.proposal.name for trial in little if not _is_of_rest(trial, here, search)}
    return names


def within_range(trials: Sequence[Trial], before: Stage, criteria: Criteria) -> list[Trial]:
    """Of effects that were tried those that may be kept: not one that ran to the bounds of its prior range, where it
    is another law's stand-in, and gains little more than one within its range does."""
    outside = [trial for trial in trials if runs_to_bounds(trial.fitted, trial.proposal.name)]
    inside = [trial for trial in trials if trial not in outside]
    gains = [before.fitted.cost - trial.fitted.cost for trial in inside]
    enough = criteria.min_ratio_at_bound * max(gains, default=0.0)
    return [*inside, *(one for one in outside if before.fitted.cost - one.fitted.cost > enough)]


def _is_of_rest(trial: Trial, before: Fit, search: Search) -> bool:
    """Whether an effect that was tried is of the time at rest and takes off the greater part of the unknown force.
    What happens at rest has time constants over decades (ageing goes with the logarithm of the time), of which the
    best single one may be shorter or longer than any that is usual."""
    effect = trial.proposal.effect
    if effect is None or type(effect).kind().coordinate != "rest":
        return False
    return force_share(search.force(before), search.force(trial.fitted)) >= search.criteria.force_share_of_slow


def runs_to_bounds(fitted: Fit, name: str) -> bool:
    """Whether an effect of this class had to leave its prior range."""
    priors = fitted.candidate.nominal.priors
    return any(parameters_at_bounds(effect, priors) for effect in fitted.candidate.added_effects if effect.name == name)


def _too_fast(fitted: Fit) -> bool:
    """Whether a mode that was added ran to frequencies that the samples hardly hold."""
    highest = HIGHEST * 0.5 / fitted.paths[0].path.sample_time if fitted.paths else float("inf")
    return any(mode.frequency > highest for effect in fitted.candidate.added_effects for mode in effect.modes())


def _draws_more(trial: Trial, before: Fit, search: Search) -> bool:
    """Whether a further member of a class has a period that the travel does not show to repeat, beside one that it
    does: it draws what the others leave, and no form of the class could be told from it."""
    name, least = trial.proposal.name, search.criteria.min_periods

    def shown(fitted: Fit) -> list[bool]:
        return [search.periods(one) >= least for one in fitted.candidate.effects if one.name == name]

    return any(shown(before)) and shown(trial.fitted).count(False) > shown(before).count(False)


def _is_impossible(fitted: Fit, name: str) -> bool:
    """Whether an effect of this class is larger than one can be, as a ripple of more than the whole thrust, or has a
    sign that none has, so that a file would hold it as none at all."""
    for effect in fitted.candidate.added_effects:
        for field in fields(effect) if effect.name == name else ():
            declared, number = declaration(field, effect), getattr(effect, field.name)
            if declared and declared.below is not None and number > declared.below:
                return True
            if declared and declared.at_least is not None and number < declared.at_least:
                return True
    return False


def _opposed(fitted: Fit, name: str) -> bool:
    """Whether members of this class, the machine file's among them, have first amplitudes of both signs; modes only
    where their resonances overlap, as others of both signs are usual."""
    alike = [effect for effect in fitted.candidate.effects if effect.name == name and amplitudes(effect)]
    return any(
        amplitudes(one)[0] * amplitudes(other)[0] < 0 and _overlap(one, other)
        for one, other in itertools.combinations(alike, 2)
    )


def _overlap(one: Effect, other: Effect) -> bool:
    """Whether laws act at the same frequencies: all do but modes that are apart by more than a few of their widths."""
    pairs = list(itertools.product(one.modes(), other.modes()))
    return not pairs or any(
        abs(a.frequency - b.frequency) < OVERLAP_WIDTHS * (a.damping * a.frequency + b.damping * b.frequency)
        for a, b in pairs
    )
