"""What accompanies the named effects: where the gap lies, what the records cannot distinguish, what to run next."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from operator import call
from typing import Any, Final

from diagnosis.baseline import Baseline, Progress
from diagnosis.diagnose import Diagnosis, diagnosed
from diagnosis.experiments.confusability import Confusability, confusability
from diagnosis.experiments.confusability import to_json as confusion
from diagnosis.experiments.propose import Proposal, along, next_experiment, showing
from diagnosis.model.parallel import on_single_blas_thread, parallel_map
from diagnosis.verdict import Outcome
from diagnosis.where.force import borne_out
from diagnosis.where.locate import Where, locate
from diagnosis.where.serialise import to_json as place
from models.quantity import turned

UNSHOWN: Final = 6  # undetectable effects for which an experiment is searched, at most


@dataclass(frozen=True)
class Evidence:
    """Where the gap lies, which effects the records can distinguish, and the next experiment, or None if none helps;
    named: the effects that the diagnosis found, in whole or in part."""

    where: Where
    confusability: Confusability
    proposal: Proposal | None
    named: tuple[str, ...] = ()

    @property
    def not_identifiable(self) -> tuple[str, ...]:
        """The effects that these records could not show at their typical size; one that is named is there at a size
        that they do show, so it is none of them."""
        return tuple(name for name in self.confusability.not_identifiable if name not in self.named)

    def to_json(self) -> dict[str, Any]:
        """The keys "where" and "confusability", and what the verdict says about both; SI."""
        return {
            "where": place(self.where),
            "confusability": confusion(self.confusability),
            "verdict": {
                "not_identifiable": list(self.not_identifiable),
                "next_experiment": self.proposal.sentence if self.proposal else None,
            },
        }


@on_single_blas_thread
def evidence(found: Diagnosis, *, disabled: Collection[str] = (), seed: int = 0) -> Evidence:
    """The evidence for a diagnosis, from its re-fitted nominal model; disabled: effects that are not to be used; SI."""
    return _evidence(found, _looked(found.baseline, disabled, seed), seed)


@on_single_blas_thread
def examined(
    begun: Baseline, *, seed: int = 0, disabled: Collection[str] = (), progress: Progress | None = None
) -> tuple[Diagnosis, Evidence]:
    """`diagnosed` with its evidence; what the evidence needs of the baseline is computed in parallel; SI."""
    found, looked = parallel_map(
        call,
        (
            lambda: diagnosed(begun, seed=seed, disabled=disabled, progress=progress),
            lambda: _looked(begun, disabled, seed),
        ),
    )
    if progress:
        progress(0.95, "the experiment that would tell more")
    return found, _evidence(found, looked, seed)


def _looked(found: Baseline, disabled: Collection[str], seed: int) -> tuple[Where, Confusability]:
    spike, replays, criteria = found.spike, found.replays, found.criteria
    lies = locate(
        found.nominal, found.records, found.pieces,
        seed=seed, spike=spike, replays=replays, criteria=criteria, usual=found.null.usual,
    )  # fmt: skip
    weighed = borne_out(found.nominal, found.records, criteria)
    return lies, confusability(weighed, found.records, disabled, criteria)


def _evidence(found: Diagnosis, looked: tuple[Where, Confusability], seed: int) -> Evidence:
    proposal = _proposal(found, *looked, seed)
    if proposal is not None and found.baseline.machine.axis == "rotary":
        proposal = replace(proposal, sentence=turned(proposal.sentence))
    return Evidence(*looked, proposal, (*found.effects, *found.partly))


def _proposal(found: Diagnosis, lies: Where, apart: Confusability, seed: int) -> Proposal | None:
    candidate, named = found.baseline.nominal.candidate, found.effects
    machine, criteria = candidate.machine, found.baseline.criteria
    if any(one.is_another_log for one in found.baseline.replays):
        return None  # another record would have the same log
    if found.outcome is Outcome.AMBIGUOUS:
        return next_experiment(
            found.equivalent[0] if found.equivalent else named,
            machine,
            criteria=criteria,
            seed=seed,
            white_force=candidate.white_force,
        )
    if found.outcome is Outcome.NONE and found.noise is None:
        best = lies.coordinate
        return along(best.name if best.is_stated(criteria) else None, machine, found.baseline.records)
    if found.outcome is Outcome.ATTRIBUTED:
        near = [other for name in named for other in apart.mistaken.get(name, ()) if other not in named]
        return (
            next_experiment(
                [*named[:1], *near], machine, criteria=criteria, seed=seed, white_force=candidate.white_force
            )
            if near
            else None
        )
    return showing(
        apart.not_identifiable[:UNSHOWN], machine, criteria=criteria, seed=seed, white_force=candidate.white_force
    )
