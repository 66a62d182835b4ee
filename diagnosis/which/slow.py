"""A slow force that the search found nothing for: searched beside an unknown force that does not walk.

The filter's own random force follows what is slow, a spring or a drift, so that the innovations hardly show it and no
gain in chi-square tells one from another. Where the smoothed unknown force stands out of the noise floor's all the
same, the nominal machine is fitted once more beside a white force as large as what it leaves, in which a law that is
there shows in full, and the catalogue is scanned again. What is slow is not white, so that many a law gains there: one
counts that takes off a good part of the force itself, and whether it explains the records is left to the closure.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

from diagnosis.baseline import Baseline
from diagnosis.closure import Closure
from diagnosis.criteria import Criteria
from diagnosis.how_far import force_share
from diagnosis.model.fit import Fit, fit
from diagnosis.model.parallel import parallel_map
from diagnosis.model.unknown_force import force_left, still_fit
from diagnosis.which.admissible import inadmissible
from diagnosis.which.detectors.detect import catalogue_scan, view
from diagnosis.which.search import ITERATIONS, RecordSearch
from diagnosis.which.select import above_chance
from diagnosis.which.stage import Proposal, Stage, Trial


def hidden(closure: Closure, criteria: Criteria) -> bool:
    """Whether a force that innovations do not show surely stands out of the noise floor's."""
    return closure.by_force and closure.force_excess > criteria.shown_by


def slow_force(stage: Stage, baseline: Baseline, disabled: Collection[str] = ()) -> tuple[Stage, Stage] | None:
    """The stage with what was proposed beside a force that stands still, and one with the effect of these that leaves
    the least of those few that take off a good part of the unknown force; None where none does. A law that repeats has
    to show that it does. disabled: effects that must not be used."""
    records, criteria, search = baseline.records, baseline.criteria, RecordSearch(baseline, disabled)
    begin = still_fit(stage.fitted.candidate, records, stage.fitted.paths)
    found = catalogue_scan(view(begin, baseline, disabled, (), {})).proposals
    allowed = [one for one in found if above_chance(one, criteria)][: criteria.shortlist_size]

    def fitted(proposal: Proposal) -> Trial:
        candidate = proposal.added_to(begin.candidate)
        return Trial(proposal, fit(candidate, records, paths=begin.paths, iterations=ITERATIONS, walk=begin.walk))

    def takes_off(made: Fit) -> bool:
        return force_share(*(force_left(one, records) for one in (begin, made))) >= criteria.force_share_of_slow

    tried = list(parallel_map(fitted, allowed))
    out = inadmissible(tried, [replace(stage, fitted=begin)], search)
    out |= {
        trial.proposal.name
        for trial in tried
        for effect in trial.fitted.candidate.added_effects
        if search.periods(effect) < criteria.min_periods
    }
    trials = [trial for trial in tried if trial.proposal.name not in out and takes_off(trial.fitted)]
    if not trials:
        return None
    trials.sort(key=lambda trial: trial.fitted.cost)
    best, before = trials[0], stage.fitted
    candidate = replace(best.fitted.candidate, roughness=before.candidate.roughness)
    whole = fit(candidate, records, paths=best.fitted.paths, iterations=ITERATIONS, walk=before.walk)
    rivals = tuple((one.proposal.name, before.cost - (begin.cost - one.fitted.cost)) for one in trials)
    return replace(stage, still=found), Stage(whole, added=best.proposal.name, rivals=rivals)
