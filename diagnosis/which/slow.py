"""A slow force that no effect was named for: searched beside an unknown force that does not walk.

The filter's own random force follows what is slow, a spring or a drift, so that the innovations hardly show it and no
gain in chi-square tells one from another. Where the smoothed unknown force stands out of the noise floor's all the
same, the nominal machine is fitted once more beside a white force as large as what it leaves, in which a law that is
there shows in full, and the catalogue is scanned again.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Final

from diagnosis.baseline import Baseline
from diagnosis.closure import Closure
from diagnosis.criteria import Criteria
from diagnosis.handover.final_fit import still_fit
from diagnosis.how_far import force_share
from diagnosis.model.fit import Fit, fit
from diagnosis.model.parallel import parallel_map
from diagnosis.model.unknown_force import force_left
from diagnosis.which.detectors import catalogue_scan, view
from diagnosis.which.select import above_chance
from diagnosis.which.stage import Proposal, Stage

ITERATIONS: Final = 8  # of the fit of an effect with everything else


def hidden(closure: Closure, criteria: Criteria) -> bool:
    """Whether a force that innovations do not show surely stands out of the noise floor's."""
    return closure.by_force and closure.force_excess > criteria.shown_by


def slow_force(stage: Stage, baseline: Baseline, disabled: Collection[str] = ()) -> tuple[Stage, ...]:
    """The stage, and one with the effect that explains the most beside a force that stands still, if it gains more than
    chance and takes off a good part of the unknown force; the proposals of the first are those beside such a force.
    disabled: effects that must not be used."""
    records, criteria = baseline.records, baseline.criteria
    begin = still_fit(stage.fitted.candidate, records, stage.fitted.paths)
    found = catalogue_scan(view(begin, baseline, disabled, (), {})).proposals
    allowed = [one for one in found if above_chance(one, criteria)][: criteria.shortlist_size]
    if not allowed:
        return (stage,)

    def fitted(proposal: Proposal) -> Fit:
        candidate = proposal.added_to(begin.candidate)
        return fit(candidate, records, paths=begin.paths, iterations=ITERATIONS, walk=begin.walk)

    trials = sorted(zip(allowed, parallel_map(fitted, allowed), strict=True), key=lambda trial: trial[1].cost)
    (best, least), before = trials[0], stage.fitted
    if force_share(*(force_left(one, records) for one in (begin, least))) < criteria.force_share_of_slow:
        return (stage,)
    candidate = replace(least.candidate, roughness=before.candidate.roughness)
    whole = fit(candidate, records, paths=least.paths, iterations=ITERATIONS, walk=before.walk)
    rivals = tuple((one.name, before.cost - (begin.cost - trial.cost)) for one, trial in trials)
    others = tuple(one for one in stage.proposals if one.effect is None)
    return replace(stage, proposals=(*found, *others), still=True), Stage(whole, added=best.name, rivals=rivals)
