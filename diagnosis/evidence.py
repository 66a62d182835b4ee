"""What stands beside a diagnosis's names: where the gap lies, what these records cannot tell, what to run next."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, Final

from diagnosis.confusability import Confusability, confusability
from diagnosis.confusability import to_json as confusion
from diagnosis.fit import Fit
from diagnosis.motions import Piece
from diagnosis.next_experiment import Proposal, along, next_experiment, showing
from diagnosis.where import Where, where
from diagnosis.where import to_json as place
from diagnosis.where_words import LEAST, SURE
from models.record import Record

UNSHOWN: Final = 6  # effects that these records cannot show, for which an experiment is looked for


@dataclass(frozen=True)
class Evidence:
    """Where, what can be told apart, and the next experiment, or None where nothing is left to find out."""

    where: Where
    confusability: Confusability
    proposal: Proposal | None

    def to_json(self) -> dict[str, Any]:
        """The keys "where" and "confusability", and what the verdict says of both; SI."""
        return {
            "where": place(self.where),
            "confusability": confusion(self.confusability),
            "verdict": {
                "not_identifiable": list(self.confusability.not_identifiable),
                "next_experiment": self.proposal.sentence if self.proposal else None,
            },
        }


def evidence(
    nominal: Fit,
    records: Sequence[Record],
    pieces: Sequence[Piece],
    outcome: str,
    named: Sequence[str],
    equivalent: Sequence[Sequence[str]] = (),
    *,
    disabled: Collection[str] = (),
    seed: int = 0,
) -> Evidence:
    """Beside a verdict: its outcome, the names in it, and the sets of which it can't tell one from another; nominal:
    the nominal model, re-fitted. Everything in SI."""
    found = where(nominal, records, pieces, seed=seed)
    apart = confusability(nominal, records, disabled)
    machine = nominal.candidate.machine
    if outcome == "ambiguous":
        proposal = next_experiment(equivalent[0] if equivalent else named, machine, seed=seed)
    elif outcome == "none_of_these":
        best = found.coordinate
        proposal = along(best.name if best.share > LEAST and best.p < SURE else None, machine)
    elif outcome == "attributed":
        near = [other for name in named for other in apart.mistaken.get(name, ()) if other not in named]
        proposal = next_experiment([*named[:1], *near], machine, seed=seed) if near else None
    else:
        proposal = showing(apart.not_identifiable[:UNSHOWN], machine, seed=seed)
    return Evidence(found, apart, proposal)
