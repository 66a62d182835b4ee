"""The fit behind a machine file: nominal values and effects together, under the force that they leave.

Values that run to a bound get twice the room, once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from diagnosis.model.at_bounds import AT_BOUND_ROOM_SHARE, WIDENING_ROUNDS, AtBound, at_bounds, with_more_room
from diagnosis.model.fit import Fit
from diagnosis.model.parameters import moved
from diagnosis.model.residual import Candidate
from diagnosis.model.unknown_force import ITERATIONS, still_fit
from models.records.record import Record


@dataclass(frozen=True)
class Finished:
    """The fit behind a machine file; widened: values that got more room; at_bound: those that are at a bound
    still, or where the first one was; modes_kept: by how many of its stated deviations a fit to these records alone
    moved the vibration mode that it moved the most, where this one keeps what the file knows of them [1];
    frequency_alone: that mode's frequency in the file and in that fit [Hz]."""

    fitted: Fit
    widened: tuple[AtBound, ...] = ()
    at_bound: tuple[AtBound, ...] = ()
    modes_kept: float = 0.0
    frequency_alone: tuple[float, float] | None = None

    @property
    def candidate(self) -> Candidate:
        """The fitted candidate."""
        return self.fitted.candidate


def finished(given: Fit, records: Sequence[Record], iterations: int = ITERATIONS) -> Finished:
    """A fit of the search, fitted again for the file, where needed with more room."""
    fitted = still_fit(given.candidate, records, given.paths, iterations)
    widened = list[AtBound]()
    for _ in range(WIDENING_ROUNDS):
        new = [one for one in at_bounds(fitted.candidate) if one.place not in {before.place for before in widened}]
        if not new:
            break
        fitted = still_fit(with_more_room(fitted.candidate, new), records, fitted.paths, iterations)
        widened += new
    stayed = (one for one in widened if _stayed(one, fitted.candidate))
    return Finished(fitted, tuple(widened), (*at_bounds(fitted.candidate), *stayed))


def _stayed(one: AtBound, candidate: Candidate) -> bool:
    """Whether a value that got more room is where its room had ended still: the fit came to rest there."""
    if one.part == "nominal":
        now = float(moved(candidate.layout, candidate.theta)[one.number])
    else:
        now = float(getattr(candidate.effects[one.number], one.name))
    return abs(now / one.value - 1) < AT_BOUND_ROOM_SHARE
