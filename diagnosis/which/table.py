"""The table of candidates: every effect with what it gains, its fitted parameters and how likely it is."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from diagnosis.criteria import Criteria
from diagnosis.model.fit import Fit, coordinates, effects_prior_std, with_coordinates
from diagnosis.which.detectors.random_force import with_sines
from diagnosis.which.stage import Carrier, Proposal, Stage
from models.effects.base import Effect
from models.effects.base import parameters as parameters_of
from models.effects.parameter import POSITIVE
from models.effects.priors import Priors

Array = NDArray[np.float64]


@dataclass(frozen=True)
class EffectRow:
    """One effect of the answer, or one that was looked at: gain and threshold in chi-square, the rest [1].

    members: the effect and its parameters' standard deviations [SI], the strongest first where it is in the model more
    than once; without deviations where it is not in the model or stands for a random force, as in the machine file, and
    none where the log, the noise floor or a measured curve carries it.
    """

    name: str
    members: tuple[tuple[Effect, Mapping[str, float]], ...]
    gain: float
    threshold: float
    probability: float
    adequate: bool


def table(
    stages: Sequence[Stage],
    criteria: Criteria,
    names: Sequence[str],
    rivals: Sequence[Sequence[str]],
    closure: float,
    segment: NDArray[np.int64] | None = None,
    doubtful: Collection[str] = (),
) -> tuple[EffectRow, ...]:
    """Every effect, those of the answer first: with their fitted parameters, the others at their best point of the
    grid, and how likely each is; closure: of the whole answer [1]; segment: see `deviations_of`; doubtful: see
    `probability`."""
    inside = _members(stages[-1].fitted, segment)
    rows = []
    for name, proposal in _best_scanned(stages).items():
        members, shown = inside.get(name), proposal
        unfitted: tuple[tuple[Effect, Mapping[str, float]], ...] = ((_effect(proposal), {}),)
        if name in names and members is None:  # in the model as a random force or as a measured curve
            decided = _decided(stages, name)
            shown = max(decided, key=lambda one: one.gain, default=proposal)
            unfitted = _sines(stages[-1].fitted, name) or (unfitted if decided else ())
        elif name in names and members is not None:  # as a sine, and perhaps as a random force as well
            members = tuple(sorted((*members, *_sines(stages[-1].fitted, name)), key=lambda one: -one[0].strength()))
        adequate = name in names and closure > criteria.min_closure
        rows.append(EffectRow(name, members or unfitted, shown.gain, shown.threshold, 0.0, adequate))
    seen = [one for one in stages[-1].proposals if one.carrier is not Carrier.MODEL and one.name in names]
    rows += [EffectRow(one.name, (), one.gain, one.threshold, 0.0, adequate=True) for one in seen]
    rows.sort(key=lambda row: (row.name not in names, -row.gain))
    return tuple(
        replace(row, probability=probability(row, place, names, rivals, criteria, doubtful))
        for place, row in enumerate(rows)
    )


def _sines(fitted: Fit, name: str) -> tuple[tuple[Effect, Mapping[str, float]], ...]:
    """What of this name stands for the model's random forces where they are written or simulated, the strongest
    first."""
    before = Counter(fitted.candidate.effects)
    standing = [one for one in with_sines(fitted.candidate).effects if one.name == name and one not in before]
    return tuple((one, {}) for one in sorted(standing, key=lambda one: -one.strength()))


def _best_scanned(stages: Sequence[Stage]) -> dict[str, Proposal]:
    """By effect the scan's proposal with the largest gain, of all stages."""
    best: dict[str, Proposal] = {}
    for stage in stages:
        for proposal in (*stage.scanned, *stage.still):
            known = best.get(proposal.name)
            best[proposal.name] = proposal if known is None or proposal.gain > known.gain else known
    return best


def _decided(stages: Sequence[Stage], name: str) -> list[Proposal]:
    """The proposals of this name that the likelihood decided, of all stages."""
    return [proposal for stage in stages for proposal in stage.proposals if proposal.decided and proposal.name == name]


def _effect(proposal: Proposal) -> Effect:
    assert proposal.effect is not None
    return proposal.effect


def _members(
    fitted: Fit, segment: NDArray[np.int64] | None = None
) -> dict[str, tuple[tuple[Effect, Mapping[str, float]], ...]]:
    """By name what the model has beside the machine file's own effects, each class's strongest member first."""
    effects, found = fitted.candidate.effects, dict[str, tuple[tuple[Effect, Mapping[str, float]], ...]]()
    stated = Counter(effect.name for effect in effects) - Counter(
        effect.name for effect in fitted.candidate.added_effects
    )
    for effect, std in zip(effects, deviations_of(fitted, segment), strict=True):
        if stated[effect.name] > 0:
            stated[effect.name] -= 1
            continue
        members = (*found.get(effect.name, ()), (effect, std))
        found[effect.name] = tuple(sorted(members, key=lambda one: -one[0].strength()))
    return found


def probability(
    row: EffectRow,
    place: int,
    names: Sequence[str],
    rivals: Sequence[Sequence[str]],
    criteria: Criteria,
    doubtful: Collection[str] = (),
) -> float:
    """How likely it is that this effect is in the machine [1]; place: in the list, the best first.

    The constants were read off the 1500 cases of trials with `diagnosis.criteria.SEEDS`, never off those of the one
    that the README quotes: how often a name was right (931 of 948; of the 109 near their thresholds 108), and how often
    the first on the list was in the machine where nothing was named though it passed its threshold (53 of 145; far
    above it 13 of 189), or where it stayed below (too few cases to read more than a guess). Effects that explain alike
    share the probability. doubtful: names that those cases say nothing of, as the drive is rougher than its model or
    the law has another form.
    """
    over = row.gain / row.threshold
    among = next((group for group in rivals if row.name in group), None)
    if row.name in names or among is not None:
        right = criteria.probability_doubtful if row.name in doubtful else criteria.probability_named
        return right / (len(among) if among else 1)
    if names or place > 0:
        return criteria.probability_other
    if over > 1:
        return criteria.probability_far_above if over > criteria.far_above else criteria.probability_first
    return criteria.probability_below * max(over, 0.0) ** 3


def deviations_of(fitted: Fit, segment: NDArray[np.int64] | None = None) -> list[dict[str, float]]:
    """Standard deviation of every parameter of each effect in the model [SI], by the linearised fit.

    segment (n,): the motion that each sample belongs to. With it, what is left counts as dependent within a motion (the
    sandwich of H. White, Econometrica 50, 1982, clustered by motions); never less than if it were white.
    """
    candidate = fitted.candidate
    if not candidate.effects:
        return []
    covariance = covariance_of(fitted, segment)
    found, begin = [], candidate.layout.count
    for effect in candidate.effects:
        here = coordinates(effect)
        own = covariance[begin : begin + here.size, begin : begin + here.size]
        found.append(_spread_of(effect, here, own, candidate.nominal.priors))
        begin += here.size
    return found


def unsure(fitted: Fit, names: Collection[str], segment: NDArray[np.int64], deviations: float) -> set[str]:
    """Those of the names whose size, an amplitude or a width, is nowhere in a fit by so many of its own deviations [1]
    apart from none; names without a size are none of them. segment: see `deviations_of`."""
    added, sizes = fitted.candidate.added_effects, dict[str, list[float]]()
    for effect, spread in zip(fitted.candidate.effects, deviations_of(fitted, segment), strict=True):
        if effect.name in names and any(effect is one for one in added):
            items = [item.name for item in parameters_of(type(effect)) if item.role in {"amplitude", "width"}]
            apart = [abs(float(getattr(effect, item))) / max(spread[item], 1e-300) for item in items]
            sizes.setdefault(effect.name, []).extend(apart)
    return {name for name, apart in sizes.items() if apart and max(apart) < deviations}


def covariance_of(fitted: Fit, segment: NDArray[np.int64] | None = None) -> Array:
    """Covariance (P + Q, P + Q) of theta and the effects' coordinates (SI); segment: see `deviations_of`."""
    candidate = fitted.candidate
    wide = np.concatenate([candidate.layout.deviation, effects_prior_std(candidate)])
    whole = np.hstack([fitted.slopes, fitted.effect_jacobian]) * wide
    covariance = np.linalg.inv(whole.T @ whole + np.eye(wide.size))
    if segment is not None:
        pulls = np.zeros((int(segment.max()) + 1, wide.size))
        np.add.at(pulls, segment, whole * fitted.innovations[:, None])
        spread = covariance @ pulls.T @ pulls @ covariance
        larger = np.sqrt(np.maximum(np.diag(spread) / np.diag(covariance), 1.0))
        covariance = covariance * np.outer(larger, larger)
    return np.asarray(covariance * np.outer(wide, wide))


def _spread_of(effect: Effect, here: Array, covariance: Array, priors: Priors) -> dict[str, float]:
    """By the slopes of the parameters along each coordinate; none of what has no parameters."""
    if not here.size:
        return {}
    slopes = slopes_of_parameters(effect, here, np.sqrt(np.diag(covariance)), priors)
    std = np.sqrt(np.maximum(np.diag(slopes @ covariance @ slopes.T), 0.0))
    items = parameters_of(type(effect))
    return {item.name: float(s) for item, s in zip(items, std, strict=True) if item.role != "switch"}


def slopes_of_parameters(effect: Effect, here: Array, deviations: Array, priors: Priors) -> Array:
    """How the parameters [SI] of an effect change with its coordinates here (Q,), which are known to so many deviations
    (Q,): those of sizes by their logarithms' derivatives, as a step that is long for a logarithm would tell more than
    the fit; all others by differences."""
    steps, items = 0.3 * deviations, parameters_of(type(effect))
    turns = np.array([item.role == "phase" for item in items])

    def moved(i: int) -> Array:
        """By how much the parameters change with a step of one coordinate; a phase by the shorter way round."""
        by = with_coordinates(effect, here + steps[i] * (np.arange(here.size) == i), priors).values() - effect.values()
        return np.where(turns, (by + np.pi) % (2 * np.pi) - np.pi, by)

    sizes = [i for i, item in enumerate(items) if item.role in POSITIVE]
    slopes = np.zeros((len(items), here.size))
    for i in range(here.size - len(sizes)):
        slopes[:, i] = moved(i) / steps[i]
    slopes[sizes, np.arange(here.size - len(sizes), here.size)] = effect.values()[sizes]
    return slopes
