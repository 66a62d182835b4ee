"""What the search for effects asks of the records, and how those of a baseline answer."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from diagnosis.baseline import Baseline
from diagnosis.criteria import Criteria
from diagnosis.model.fit import Fit, fit
from diagnosis.model.parallel import parallel_map
from diagnosis.model.unknown_force import force_left
from diagnosis.refit import weighed, with_new_starts
from diagnosis.which.detectors.detect import detect, random_force, view
from diagnosis.which.detectors.random_force import MIN_REFINED_GAIN, as_seen
from diagnosis.which.detectors.scan import Columns
from diagnosis.which.kinds import beside_free_forms, periods_shown
from diagnosis.which.stage import Proposal, Stage, Trial
from models.effects.base import Effect

Array = NDArray[np.float64]

ITERATIONS: Final = 8  # of the fit of an effect with everything else
ITERATIONS_OF_A_FORCE: Final = 4  # of a random force, beside which little else moves


class Search(Protocol):
    """What the search needs of the records: criteria, the noise floors (draws,) [1], and what it does."""

    @property
    def criteria(self) -> Criteria:
        """The thresholds by which it decides."""

    @property
    def floors(self) -> Array:
        """Chi-square (draws,) [1] that complete models leave."""

    def examined(
        self, stage: Stage, negligible: Collection[str] = (), known: Columns = MappingProxyType({})
    ) -> tuple[Stage, Columns]:
        """The stage with what the detectors propose, and the scan's columns for the next stage."""

    def tried(self, stage: Stage, proposals: Sequence[Proposal]) -> list[Trial]:
        """The stage's model fitted with each proposal."""

    def shaking(self, stage: Stage, frequency: float) -> tuple[Proposal, ...]:
        """The random force about a frequency [Hz], if the stage's model leaves one."""

    def settled(self, trial: Trial, before: Stage) -> Trial:
        """The trial that is about to be kept, with what it may have stood in for estimated anew."""

    def force(self, fitted: Fit) -> float:
        """The deviation [N] of the unknown force that a model leaves."""

    def deviance(self, fitted: Fit) -> float:
        """-2 log likelihood [1] of a model, its priors included: what compares one with another random force."""

    def periods(self, effect: Effect) -> float:
        """How many periods of a law the records' travel holds [1]; infinite for a law that need not repeat."""


@dataclass(frozen=True)
class RecordSearch:
    """The search in the records of a baseline; disabled: effects that must not be used."""

    baseline: Baseline
    disabled: Collection[str] = ()

    @property
    def criteria(self) -> Criteria:
        """The baseline's."""
        return self.baseline.criteria

    @property
    def floors(self) -> Array:
        """The baseline's noise floors (draws,) [1]."""
        return self.baseline.floors

    def examined(
        self, stage: Stage, negligible: Collection[str] = (), known: Columns = MappingProxyType({})
    ) -> tuple[Stage, Columns]:
        """An effect in the model changes the columns of others to second order only, so they are computed once."""
        seen = view(stage.fitted, self.baseline, self.disabled, negligible, known)
        detected = detect(seen)
        proposals = beside_free_forms(detected.proposals, stage.fitted, self.baseline.records, seen.own)
        return replace(stage, proposals=proposals), detected.columns

    def tried(self, stage: Stage, proposals: Sequence[Proposal]) -> list[Trial]:
        """Side by side, from where the stage stands."""
        here, records = stage.fitted, self.baseline.records

        def fitted(proposal: Proposal) -> Trial:
            iterations = ITERATIONS_OF_A_FORCE if proposal.decided else ITERATIONS
            candidate = proposal.added_to(here.candidate)
            return Trial(proposal, fit(candidate, records, paths=here.paths, iterations=iterations, walk=here.walk))

        return list(parallel_map(fitted, proposals))

    def shaking(self, stage: Stage, frequency: float) -> tuple[Proposal, ...]:
        """By the detector of such forces, at frequencies that it does not look at by itself, too."""
        return random_force(view(stage.fitted, self.baseline, self.disabled, (), {}), frequency).proposals

    def settled(self, trial: Trial, before: Stage) -> Trial:
        """Start states and white force, where what the trial gained may have stood in for them."""
        fitted, records = trial.fitted, self.baseline.records
        if before.fitted.cost - fitted.cost > self.criteria.restart_gain:
            fitted = with_new_starts(fitted, records)
        if fitted.candidate.rough:
            fitted = weighed(fitted, records, self.criteria, lambda: self.baseline.null.usual)
        if trial.proposal.decided and trial.proposal.gain > MIN_REFINED_GAIN:
            fitted = as_seen(fitted, records)
        return replace(trial, fitted=fitted)

    def force(self, fitted: Fit) -> float:
        """Of the baseline's records."""
        return force_left(fitted, self.baseline.records)

    def deviance(self, fitted: Fit) -> float:
        """The cost, beside what the innovations' deviations are by themselves."""
        sizes = [2 * one.innovations.size * math.log(one.deviation) for one in fitted.residuals]
        return fitted.cost + sum(sizes)

    def periods(self, effect: Effect) -> float:
        """In the longest travel of the baseline's records."""
        return periods_shown(effect, self.baseline.records)
