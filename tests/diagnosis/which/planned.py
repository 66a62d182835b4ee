"""A search that goes as planned: what each stage promises, and what each effect costs once it is tried."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from diagnosis.criteria import Criteria
from diagnosis.model.fit import Fit
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.which.detectors.random_force import is_about
from diagnosis.which.detectors.scan import Columns
from diagnosis.which.stage import Proposal, Stage, Trial
from models.effects.base import Effect
from models.effects.catalogue import every, in_order
from models.effects.motor import Cogging
from tests.diagnosis.tables import table

MACHINE, CRITERIA = table(), Criteria()
START = 2000.0  # cost of the nominal re-fit
Array = NDArray[np.float64]


def leaving(cost: float, effects: Sequence[Effect] = (), own: Sequence[Effect] = ()) -> Fit:
    """A fit that leaves so much, with effects in the model; own: those of the machine file, which are in it, too."""
    layout = parameters(replace(MACHINE, effects=tuple(own)), 1)
    candidate = Candidate(layout, np.zeros(layout.count), in_order((*own, *effects)))
    nothing = np.zeros((3, 0))
    return Fit(candidate, (), (), np.zeros(3), nothing, nothing, cost, 0.0)


@dataclass(frozen=True)
class Planned:
    """A search that goes as planned: with so many effects in the model these gain so much, and cost that once tried."""

    promises: Mapping[int, Mapping[str, float]]
    costs: Mapping[str, float]
    effects: Mapping[str, Effect]
    forces: Mapping[int, Proposal]
    criteria: Criteria = CRITERIA
    threshold: float = CRITERIA.min_gain
    travel: float = 0.1  # [m]
    line: Proposal | None = None  # of a random force, where one is looked for only

    @property
    def floors(self) -> Array:
        return np.zeros(1)

    def examined(
        self,
        stage: Stage,
        negligible: Collection[str] = (),  # noqa: ARG002 - of the protocol
        known: Columns | None = None,
    ) -> tuple[Stage, Columns]:
        candidate = stage.fitted.candidate
        promised = self.promises.get(len(candidate.effects), {})
        proposals = [Proposal(name, gain, self.threshold, effect=self._effect(name)) for name, gain in promised.items()]
        force = self.forces.get(len(candidate.random_forces))
        return replace(stage, proposals=(*proposals, *([force] if force else []))), known or {}

    def tried(self, stage: Stage, proposals: Sequence[Proposal]) -> list[Trial]:
        return [
            Trial(one, replace(stage.fitted, candidate=one.added_to(stage.fitted.candidate), cost=self.costs[one.name]))
            for one in proposals
        ]

    def shaking(self, stage: Stage, frequency: float) -> tuple[Proposal, ...]:
        line = self.line
        known = line is None or line.random_force in stage.fitted.candidate.random_forces
        if line is None or line.random_force is None or known or not is_about(frequency, line.random_force.frequency):
            return ()
        return (line,)

    def settled(self, trial: Trial, before: Stage) -> Trial:  # noqa: ARG002 - of the protocol
        return trial

    def force(self, fitted: Fit) -> float:
        return float(np.sqrt(fitted.cost))

    def deviance(self, fitted: Fit) -> float:
        return fitted.cost

    def periods(self, effect: Effect) -> float:
        return self.travel / effect.pitch if isinstance(effect, Cogging) else float("inf")

    def _effect(self, name: str) -> Effect:
        return self.effects.get(name, every()[name].typical())
