"""The verdict: the only place with the rules by which an answer is given, as a pure function of plain numbers."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from enum import StrEnum

from diagnosis.criteria import Criteria


class Outcome(StrEnum):
    """What a diagnosis can say; each value's sentence is its docstring."""

    ATTRIBUTED = "attributed"
    """Effects explain what is left, and nothing like them does it as well."""
    AMBIGUOUS = "ambiguous"
    """Several effects explain the records equally well: a set of names."""
    NONE = "none_of_these"
    """Something is left that no effect that was looked for explains; in part, some may."""
    NOTHING = "nothing_to_explain"
    """The machine as delivered explains the records."""
    PARAMETERS = "parameters"
    """Nominal values that are re-fitted explain the records."""


@dataclass(frozen=True)
class Explanation:
    """What some stages of the search explain, in the numbers that the verdict depends on.

    names: strongest first; of these, random: act at random, so that no simulation repeats what they did; series: are a
    series expansion of another law; at_bound: whether the strongest had to leave its prior range; repeats: whether a
    law does, of which a long period draws any curve. closure and its 95 % interval [1]; excess: of what is left over
    the noise floor, in standard deviations [1]; largest_innovation, in standard deviations, and spike, from which on it
    stands out [1]; rough: the drive is rougher than its model; interpolated: but
    no more so than interpolation between the samples of its log makes any; by_force: the closure is that of the unknown
    force, as
    innovations hardly exceed the floor at all, and force_excess is of what is left of it over its own floor, in
    deviations [1]; parameter_shift: chi-square of the nominal parameters' shifts [1].
    """

    names: tuple[str, ...]
    closure: float
    interval: tuple[float, float]
    excess: float
    random: Collection[str] = ()
    series: Collection[str] = ()
    at_bound: bool = False
    repeats: bool = False
    rough: bool = False
    interpolated: bool = False
    by_force: bool = False
    force_excess: float = math.inf
    largest_innovation: float = 0.0
    spike: float = float("inf")
    parameter_shift: float = 0.0


def verdict(given: Explanation, criteria: Criteria = Criteria()) -> Outcome:
    """Attributed where the effects surely close some of the gap, and enough of it or all that is significant, the
    strongest within its prior range or leaving nothing; else something that has no name here, be it a force without a
    law; or nothing but the parameters, or nothing at all."""
    if set(given.series).intersection(given.names):
        return Outcome.NONE
    surely_some = given.interval[0] > 0
    own_law = not given.at_bound or _leaves_nothing(given, criteria)
    if given.names and surely_some and own_law and _closes_enough(given, criteria):
        return Outcome.ATTRIBUTED
    stands_out = given.largest_innovation > given.spike
    rough = given.rough and not given.interpolated
    if given.names or rough or stands_out or given.excess > criteria.missing_excess:
        return Outcome.NONE
    return Outcome.PARAMETERS if given.parameter_shift > criteria.parameter_shift else Outcome.NOTHING


def _closes_enough(given: Explanation, criteria: Criteria) -> bool:
    """Several effects surely, as two wrong names close more than one, and a single one where the drive is rougher than
    its model, whose floor hides what else is left; elsewhere a single one by its best estimate. What acts at random
    loosens this by one bound, as a simulation does not know when it acted."""
    low, high = given.interval
    bounds = (low, given.closure, high)
    looser = (len(given.names) < 2 and not given.rough) + bool(set(given.random).intersection(given.names))
    if bounds[looser] >= criteria.min_closure:
        return True
    return len(given.names) < 2 and _at_floor(given, criteria) and high >= criteria.min_closure_at_floor


def _leaves_nothing(given: Explanation, criteria: Criteria) -> bool:
    """Whether a single effect surely closes half of the gap and leaves no more than the noise floor. A law that is
    distorted to stand for another one leaves something, unless it repeats; one of another form, which rises with the
    logarithm of the time where the catalogue's goes to a limit, say, may fit to the floor with a value that no record
    shows."""
    alone = len(given.names) < 2 and not given.repeats
    return alone and given.interval[0] >= criteria.min_closure and _at_floor(given, criteria)


def _at_floor(given: Explanation, criteria: Criteria) -> bool:
    """Whether what is left is as small as the noise floor. That of a rough drive is as rough as what is left: a small
    excess says nothing there. Where innovations never exceeded it, they do not then, and the force's excess counts."""
    excess = given.force_excess if given.by_force else given.excess
    return excess < criteria.max_excess_at_floor and not given.rough
