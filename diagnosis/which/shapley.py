"""Several effects together: which of them the others make useless, and what each one takes off over all orders.

Effects can hide one another, so what one gains depends on which are in the model before it. Every subset of the names
is fitted with everything else; an effect's share is the mean over the orders of addition (L. S. Shapley, A value for
n-person games, 1953) of what it takes off.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.how_far import gap
from diagnosis.model.fit import Fit, fit
from diagnosis.model.parallel import parallel_map
from diagnosis.null import LEAST
from diagnosis.which.select import Step, further
from models.effects.catalogue import beyond
from models.records.record import Record

Array = NDArray[np.float64]
Names = frozenset[str]
SHAKEN = "floor_vibration"
SHRINKS: Final = 0.9  # of the unknown force before it that a part of an explanation may leave


@dataclass(frozen=True)
class Orders:
    """The stages of the search without what proved useless, each name's share of what all take off together [1], and
    the model with each subset of the names in it."""

    steps: tuple[Step, ...]
    shares: Mapping[str, float]
    fits: Mapping[Names, Fit]


def added(before: Step, after: Step) -> str:
    """The name of the effect that is in a stage and was not in the one before."""
    more = beyond(*(step.fitted.candidate.effects for step in (before, after)))
    return more[0].name if more else SHAKEN


def in_all_orders(
    steps: Sequence[Step], records: Sequence[Record], thresholds: Mapping[str, float], floors: Array
) -> Orders:
    """The search's stages, an effect that the others make useless taken out; thresholds of chi-square by name [1];
    floors: chi-square (draws,) [1] that complete models leave."""
    names = list(dict.fromkeys(added(before, after) for before, after in pairwise(steps)))
    fits = _fits(steps, names, records)
    if len(names) < 2:
        return Orders(tuple(steps), dict.fromkeys(names, 1.0), fits)
    kept = frozenset(names)
    while len(kept) > 1:
        worth = {name: fits[kept - {name}].cost - fits[kept].cost for name in sorted(kept)}
        gained = fits[frozenset()].cost - fits[kept].cost
        least = min(kept, key=lambda name: (worth[name] - thresholds.get(name, LEAST), name))
        without = fits[kept - {least}].innovations
        if worth[least] >= max(thresholds.get(least, LEAST), further(gained, float(without @ without), floors)):
            break
        kept -= {least}
    ordered = [name for name in names if name in kept]
    shared = shares({subset: fitted.cost for subset, fitted in fits.items()}, ordered)
    if len(ordered) == len(names):
        return Orders(tuple(steps), shared, fits)
    return Orders((steps[0], *_stages(fits, ordered, steps[-1])), shared, fits)


def shrinking(found: Orders, records: Sequence[Record]) -> tuple[Step, ...]:
    """The stages of those effects of the search that each shrink the unknown force, the one that shrinks it most
    first: parts of an explanation, where it has no whole."""
    names, ordered, fits = set(found.shares), list[str](), dict(found.fits)
    final = found.steps[-1].fitted
    start = found.steps[0].fitted  # what the others made of the nominal parameters is no good start for one alone
    alone = parallel_map(lambda name: _with_only(final, names - {name}, records, start), sorted(names))
    for name, fitted in zip(sorted(names), list(alone), strict=True):
        fits[frozenset({name})] = min(fitted, fits[frozenset({name})], key=lambda fitted: fitted.cost)
    least = _force(fits[frozenset()], records)
    while names:
        forces = {name: _force(fits[frozenset((*ordered, name))], records) for name in sorted(names)}
        best = min(forces, key=lambda name: forces[name])
        if forces[best] >= SHRINKS * least:
            break
        ordered, least = [*ordered, best], forces[best]
        names.remove(best)
    return (found.steps[0], *_stages(fits, ordered, found.steps[-1]))


def _force(fitted: Fit, records: Sequence[Record]) -> float:
    """What a fit leaves of unknown force, its deviation [N]."""
    return gap(fitted.candidate, records, fitted.paths).force


def _fits(steps: Sequence[Step], names: Sequence[str], records: Sequence[Record]) -> dict[Names, Fit]:
    """The model with each subset of the names in it; those that the search came through are its own."""
    known = {frozenset(): steps[0].fitted, frozenset(names): steps[-1].fitted}
    own: set[str] = set()
    for i in range(1, len(steps) - 1):
        own.add(added(steps[i - 1], steps[i]))
        if not any(added(*later) in own for later in pairwise(steps[i:])):  # no second member of a class comes later
            known[frozenset(own)] = steps[i].fitted
    left = [subset for subset in _subsets(names) if subset not in known]
    found = parallel_map(lambda subset: _with_only(steps[-1].fitted, set(names) - subset, records), left)
    return known | dict(zip(left, found, strict=True))


def _subsets(names: Sequence[str]) -> Iterator[Names]:
    for size in range(len(names) + 1):
        yield from map(frozenset, itertools.combinations(names, size))


def _with_only(final: Fit, out: Collection[str], records: Sequence[Record], start: Fit | None = None) -> Fit:
    """The final model fitted again without the effects of some names; those of the machine file stay. start: where the
    nominal parameters begin, if not at the final model's."""
    candidate = final.candidate
    gone = [effect for effect in candidate.found if effect.name in out]
    effects = [effect for effect in candidate.effects if not any(effect is one for one in gone)]
    shaken = () if SHAKEN in out else candidate.shaken
    begin = start or final
    fewer = replace(candidate, theta=begin.candidate.theta, effects=tuple(effects), shaken=shaken)
    return fit(fewer, records, paths=begin.paths, iterations=8 if start else 6, walk=final.walk)


def _stages(fits: Mapping[Names, Fit], ordered: Sequence[str], last: Step) -> Iterator[Step]:
    """The stages of an addition in this order; what the search would look at next is that of its end."""
    for count in range(1, len(ordered) + 1):
        yield replace(last, fitted=fits[frozenset(ordered[:count])], rivals=())


def shares(costs: Mapping[Names, float], names: Sequence[str]) -> dict[str, float]:
    """Shapley's values of what each name takes off the cost, over their sum [1]; costs of every subset of the names."""
    whole, count = costs[frozenset()] - costs[frozenset(names)], len(names)
    found = {}
    for name in names:
        mean = 0.0
        for before in _subsets([other for other in names if other != name]):
            weight = math.factorial(len(before)) * math.factorial(count - len(before) - 1) / math.factorial(count)
            mean += weight * (costs[before] - costs[before | {name}])
        found[name] = mean / whole
    return found
