"""The nouns of the search: what a detector proposes, the model fitted with it on trial, and one stage of the model that
grows by what is proposed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import pairwise

from diagnosis.model.fit import Fit
from diagnosis.model.kalman import Resonance
from diagnosis.model.residual import Candidate
from models.effects.base import Effect
from models.effects.catalogue import in_order


class Carrier(StrEnum):
    """What carries an effect once it is accepted."""

    MODEL = "model"
    """The model: the effect is fitted with everything else, and what it takes off the gap is measured."""
    FLOOR = "floor"
    """The noise floor: the effect acts at random, so no model takes it off, but a simulation tells what it adds."""
    LOG = "log"
    """The log itself: the records show it whatever else is left, and neither model nor floor depends on it."""


@dataclass(frozen=True)
class RandomPart:
    """An effect that acts at random, made so strong that a few simulated records tell its mean energy, and the part
    [1] of that energy which the records' own adds."""

    effect: Effect
    part: float


@dataclass(frozen=True)
class Proposal:
    """An effect that a detector asks for.

    gain: chi-square on held-out motions, or -2 log likelihood [1]; threshold: what is more than chance [1];
    in_sample_gain: chi-square on all motions [1]; forbidden: that of an amplitude of a sign that it cannot have; even:
    a random force that is surely there at rest as in motion, as no law of the motion is. What
    carries it holds one of: the `effect` at its proposed
    parameters, the `random_force`, or the `random_part`; the log needs none.
    """

    name: str
    gain: float
    threshold: float
    carrier: Carrier = Carrier.MODEL
    effect: Effect | None = None
    random_force: Resonance | None = None
    random_part: RandomPart | None = None
    in_sample_gain: float = 0.0
    forbidden: float = 0.0
    even: bool = False

    @property
    def decided(self) -> bool:
        """Whether the likelihood has accepted it already: a random force changes the filter's noise, and what two
        filters leave cannot be compared by chi-square."""
        return self.random_force is not None

    def added_to(self, candidate: Candidate) -> Candidate:
        """The candidate with the proposed effect or random force in it."""
        if self.random_force is not None:
            return replace(candidate, random_forces=(*candidate.random_forces, self.random_force))
        assert self.effect is not None, f"{self.name} is carried by the {self.carrier}"
        return replace(candidate, effects=in_order((*candidate.effects, self.effect)))


@dataclass(frozen=True)
class Trial:
    """A proposal and the model with it, fitted."""

    proposal: Proposal
    fitted: Fit


@dataclass(frozen=True)
class Stage:
    """One stage of the search: the fitted model, what was added to reach it (None at the first), what the detectors
    propose beside it, and the effects that were tried for it, each with the chi-square that it left [1]; still: what
    was proposed beside an unknown force that does not walk, where the next stage is due to that: its rivals' chi-square
    is then this stage's less what they gain there; by_force: those rivals that leave no more unknown force than what
    was added, though more of chi-square."""

    fitted: Fit
    proposals: tuple[Proposal, ...] = ()
    added: str | None = None
    rivals: tuple[tuple[str, float], ...] = ()
    by_force: tuple[str, ...] = ()
    still: tuple[Proposal, ...] = ()

    def carried_by(self, carrier: Carrier) -> tuple[Proposal, ...]:
        """The proposals of one carrier."""
        return tuple(proposal for proposal in self.proposals if proposal.carrier is carrier)

    @property
    def scanned(self) -> tuple[Proposal, ...]:
        """The effects of the catalogue at their best points, the largest gain first."""
        return tuple(proposal for proposal in self.proposals if proposal.effect is not None)


def excluded(stage: Stage, ratio: float) -> tuple[str, ...]:
    """The effects that with an amplitude of a sign that they cannot have would gain more than chance does, more than as
    they can be, and so much of the best proposal's gain [1]; the largest such gain first."""
    best = max((one.gain for one in stage.scanned), default=0.0)
    least = ratio * best
    wrong = [one for one in stage.scanned if one.forbidden > max(one.threshold, one.in_sample_gain, least)]
    return tuple(one.name for one in sorted(wrong, key=lambda one: -one.forbidden))


def strongest_first(stages: Sequence[Stage]) -> tuple[str, ...]:
    """The effects that the stages added, by what each took off the cost."""
    gains: dict[str, float] = {}
    for before, after in pairwise(stages):
        assert after.added is not None
        gains[after.added] = gains.get(after.added, 0.0) + before.fitted.cost - after.fitted.cost
    return tuple(sorted(gains, key=lambda name: -gains[name]))
