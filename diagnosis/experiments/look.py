"""One look at the records so far: the outcome and the names of a diagnosis, without the file that it hands over.

As `diagnosis.diagnose.diagnosed` up to its answer; how far the gap shrinks, the laws that are learned and the values of
the table are for the end.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from diagnosis.answer import answer_of, doubted, explanations, form_parts, rivalling
from diagnosis.baseline import Baseline
from diagnosis.model.fit import Fit
from diagnosis.model.parallel import on_single_blas_thread
from diagnosis.verdict import Outcome
from diagnosis.which.prune import prune, without
from diagnosis.which.select import select
from diagnosis.which.stage import Stage
from models.effects.base import Effect


@dataclass(frozen=True)
class Found:
    """What a look found: the outcome, the names, groups of effects that are alike, and by name the chi-square [1] that
    an effect gained on motions it was not fitted to."""

    outcome: Outcome
    names: tuple[str, ...]
    alike: tuple[tuple[str, ...], ...]
    gains: Mapping[str, float]

    def to_json(self) -> dict[str, Any]:
        """The outcome, the names and what is alike, as a course holds them."""
        return {"outcome": str(self.outcome), "names": list(self.names), "alike": [list(one) for one in self.alike]}


@dataclass(frozen=True)
class Look:
    """A look's finding, the model with what it named, and what that was judged against.

    tried: the names that the next record is to confirm, those that were found or, without any, what came nearest to it;
    effects: of these, with their parameters, what is a law of force or of the reading.
    """

    found: Found
    fitted: Fit
    baseline: Baseline
    tried: tuple[str, ...] = ()
    effects: tuple[Effect, ...] = ()


@on_single_blas_thread
def look(baseline: Baseline, *, seed: int = 0, disabled: Collection[str] = ()) -> Look:
    """Which effects explain what the baseline leaves, if any; disabled: effects that are not to be used; SI."""
    pruned, answer = explanations(prune(select(baseline, disabled), baseline), baseline, disabled, seed)[0]
    if less := doubted(answer, answer.stages[-1].fitted, baseline):
        answer = answer_of(without(pruned, less), pruned, baseline, seed)
    parts = form_parts(answer.stages, baseline)
    alike = rivalling(answer.stages, baseline.criteria, parts) if answer.outcome is Outcome.ATTRIBUTED else ()
    outcome = Outcome.AMBIGUOUS if alike else answer.outcome
    names = answer.names if outcome in {Outcome.ATTRIBUTED, Outcome.AMBIGUOUS} else ()
    found = Found(outcome, names, alike, _gains(answer.stages))
    stage = answer.stages[-1] if names else pruned.stages[-1]
    return Look(found, stage.fitted, baseline, *_tried(names, stage))


def _tried(names: tuple[str, ...], stage: Stage) -> tuple[tuple[str, ...], tuple[Effect, ...]]:
    """What the next record is to confirm; where nothing is named and nothing in the model, the proposal that exceeds
    its threshold by most, or stays below it by least."""
    inside = tuple(stage.fitted.candidate.added_effects)
    if names:
        return names, tuple(one for one in inside if one.name in names)
    if inside:
        return tuple(dict.fromkeys(one.name for one in inside)), inside
    best = max(stage.scanned, key=lambda one: one.gain / one.threshold, default=None)
    if best is None or best.effect is None or best.gain <= 0:
        return (), ()
    return (best.name,), (best.effect,)


def _gains(stages: tuple[Stage, ...]) -> dict[str, float]:
    """By effect, the largest gain [1] over all stages."""
    found: dict[str, float] = {}
    for stage in stages:
        for proposal in stage.scanned:
            if np.isfinite(proposal.gain):
                found[proposal.name] = max(proposal.gain, found.get(proposal.name, 0.0))
    return found
