"""Backward elimination: which of several effects the others make useless, and what each takes off over all orders.

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

import numpy as np
from numpy.typing import NDArray

from diagnosis.baseline import Baseline
from diagnosis.how_far import force_share
from diagnosis.model.fit import Fit, fit
from diagnosis.model.parallel import parallel_map
from diagnosis.model.unknown_force import force_left
from diagnosis.which.admissible import runs_to_bounds
from diagnosis.which.select import min_gain_beside_others
from diagnosis.which.stage import Stage
from models.records.record import Record

Array = NDArray[np.float64]
Names = frozenset[str]


@dataclass(frozen=True)
class Pruned:
    """The stages of the search without the effects that proved useless, each remaining name's share of what all take
    off together [1], and the model with each subset of the names in it."""

    stages: tuple[Stage, ...]
    shares: Mapping[str, float]
    fits: Mapping[Names, Fit]


def prune(stages: Sequence[Stage], baseline: Baseline) -> Pruned:
    """The search's stages; an effect that the others make useless is taken out, the most useless first. Shares are of
    chi-square, or of the unknown force's energy where a name is needed for that alone."""
    names = list(dict.fromkeys(_name(stage) for stage in stages[1:]))
    fits = _fits(stages, names, baseline.records)
    if len(names) < 2:
        return Pruned(tuple(stages), dict.fromkeys(names, 1.0), fits)
    kept = _needed(names, fits, baseline)
    ordered = [name for name in names if name in kept]
    shared = shares(_costs(kept, fits, baseline), ordered)
    if len(ordered) == len(names):
        return Pruned(tuple(stages), shared, fits)
    return Pruned((stages[0], *_stages(fits, ordered, stages[-1])), shared, fits)


def _needed(names: Sequence[str], fits: Mapping[Names, Fit], baseline: Baseline) -> Names:
    """The names that each gain more than chance, and than the others' form error, beside all the others."""
    kept = frozenset(names)
    while len(kept) > 1 and (useless := _useless(kept, fits, baseline)):
        kept -= {useless}
    return kept


def _useless(kept: Names, fits: Mapping[Names, Fit], baseline: Baseline) -> str | None:
    """The name that is needed the least, if it isn't needed; one that gains little is, where it takes off a good part
    of a slow force. One at a bound of its range is needed only where it takes off as much, or gains what the search
    asks of such a one: within its range it may have gained more when it was tried."""
    criteria, thresholds = baseline.criteria, baseline.thresholds
    worth = {name: fits[kept - {name}].cost - fits[kept].cost for name in sorted(kept)}
    limit = {name: thresholds.get(name, criteria.min_gain) for name in worth}
    gained = fits[frozenset()].cost - fits[kept].cost
    ordered = sorted(worth, key=lambda name: (worth[name] - limit[name], name))

    if worth[ordered[0]] < limit[ordered[0]]:
        return ordered[0]
    for name in ordered:
        little = worth[name] < criteria.min_gain_at_bound * (gained - worth[name])
        if little and runs_to_bounds(fits[kept], name) and not _slow(name, kept, fits, baseline):
            return name
    for name in ordered:
        if _gains_enough(name, kept, fits, baseline):
            return None
        if not _slow(name, kept, fits, baseline):
            return name
    return None


def _gains_enough(name: str, kept: Names, fits: Mapping[Names, Fit], baseline: Baseline) -> bool:
    """Whether a name gains more of chi-square beside the others than their form may be wrong by."""
    without, gained = fits[kept - {name}], fits[frozenset()].cost - fits[kept].cost
    left = float(without.innovations @ without.innovations)
    return without.cost - fits[kept].cost >= min_gain_beside_others(gained, left, baseline.floors, baseline.criteria)


def _slow(name: str, kept: Names, fits: Mapping[Names, Fit], baseline: Baseline) -> bool:
    """Whether a name takes off a good part of the unknown force beside the others."""
    taken = force_share(*(force_left(fits[one], baseline.records) for one in (kept - {name}, kept)))
    return taken >= baseline.criteria.force_share_of_slow


def _costs(kept: Names, fits: Mapping[Names, Fit], baseline: Baseline) -> dict[Names, float]:
    """What each subset of the names that are kept leaves. Chi-square hardly shows a slow force, which the filter's own
    random force follows: a spring had got a share of -1 %, and a mode beside it 101 %, where the force fell to a third
    by the spring alone."""
    subsets = [subset for subset in fits if subset <= kept]
    if all(_gains_enough(name, kept, fits, baseline) for name in kept):
        return {subset: fits[subset].cost for subset in subsets}
    return {subset: force_left(fits[subset], baseline.records) ** 2 for subset in subsets}


def without(pruned: Pruned, names: Collection[str]) -> tuple[Stage, ...]:
    """The stages that are left without the effects of some names, in the order of the search."""
    ordered = [name for name in dict.fromkeys(map(_name, pruned.stages[1:])) if name not in names]
    return (pruned.stages[0], *_stages(pruned.fits, ordered, pruned.stages[-1]))


def shrinking(pruned: Pruned, baseline: Baseline) -> tuple[Stage, ...]:
    """The stages of those effects of the search that each shrink the unknown force, the one that shrinks it most
    first: parts of an explanation, where it has no whole."""
    names, ordered, fits = set(pruned.shares), list[str](), dict(pruned.fits)
    records = baseline.records
    start = pruned.stages[0].fitted  # the others distort the nominal parameters: no good start for one effect alone
    alone = parallel_map(lambda name: _without(pruned.stages, names - {name}, records, start), sorted(names))
    for name, fitted in zip(sorted(names), list(alone), strict=True):
        fits[frozenset({name})] = min(fitted, fits[frozenset({name})], key=lambda fitted: fitted.cost)
    least = force_left(fits[frozenset()], records)
    while names:
        forces = {name: force_left(fits[frozenset((*ordered, name))], records) for name in sorted(names)}
        best = min(forces, key=lambda name: forces[name])
        if forces[best] >= baseline.criteria.max_force_ratio * least:
            break
        ordered, least = [*ordered, best], forces[best]
        names.remove(best)
    return (pruned.stages[0], *_stages(fits, ordered, pruned.stages[-1]))


def _name(stage: Stage) -> str:
    assert stage.added is not None
    return stage.added


def _fits(stages: Sequence[Stage], names: Sequence[str], records: Sequence[Record]) -> dict[Names, Fit]:
    """The model with each subset of the names in it; those that the search came through are its own."""
    known = {frozenset(): stages[0].fitted, frozenset(names): stages[-1].fitted}
    own: set[str] = set()
    for i in range(1, len(stages) - 1):
        own.add(_name(stages[i]))
        if not any(_name(later) in own for later in stages[i + 1 :]):  # no second member of a class comes later
            known[frozenset(own)] = stages[i].fitted
    missing = [subset for subset in _subsets(names) if subset not in known]
    fitted = parallel_map(lambda subset: _without(stages, set(names) - subset, records), missing)
    return known | dict(zip(missing, fitted, strict=True))


def _subsets(names: Sequence[str]) -> Iterator[Names]:
    for size in range(len(names) + 1):
        yield from map(frozenset, itertools.combinations(names, size))


def _without(
    stages: Sequence[Stage], names: Collection[str], records: Sequence[Record], start: Fit | None = None
) -> Fit:
    """The last stage's model fitted again without the effects of some names; those of the machine file stay. start:
    where the nominal parameters begin, if not at that model's."""
    final = stages[-1].fitted
    candidate = final.candidate
    gone = [effect for effect in candidate.added_effects if effect.name in names]
    effects = [effect for effect in candidate.effects if not any(effect is one for one in gone)]
    random = {_name(after) for before, after in pairwise(stages) if _forces(after) > _forces(before)}
    begin = start or final
    fewer = replace(
        candidate,
        theta=begin.candidate.theta,
        effects=tuple(effects),
        random_forces=() if random.intersection(names) else candidate.random_forces,
    )
    return fit(fewer, records, paths=begin.paths, iterations=8 if start else 6, walk=final.walk)


def _forces(stage: Stage) -> int:
    return len(stage.fitted.candidate.random_forces)


def _stages(fits: Mapping[Names, Fit], ordered: Sequence[str], last: Stage) -> Iterator[Stage]:
    """The stages of an addition in this order; what the detectors would propose next is that of its end."""
    for count, name in enumerate(ordered, 1):
        yield replace(last, fitted=fits[frozenset(ordered[:count])], added=name, rivals=())


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
