"""Closure: the part of the gap that effects take off motions to which they were not fitted, above the noise floor.

The closure C = (G_refit^2 - G_effect^2) / (G_refit^2 - G_floor^2) compares the innovations of the re-fitted nominal
machine with those of the model with the effects, on motions to which the effects' parameters were not fitted. The floor
is what the same method leaves of a record that this very model made, simulated: quantisation, noise and what the method
itself neglects are in it. A model that surely leaves more of its own records than of the measured ones, as one that
swings by itself, did not make these: the floor is the re-fitted machine's then. Where a drive is rougher than its model
and motions repeat, the floor is what does not, and all three are of those motions only. They are weighted over
frequency by the share of the gap in what the re-fit leaves (N. Wiener's filter): the floor's noise is another in the
simulation, and elsewhere would only blur the difference.

The filter's own random force follows what is slow, so that innovations hardly show a spring or a drift. Where they do
not surely exceed the floor, the same closure is that of the smoothed unknown force. Where this leaves it open, too, as
next to a small effect the floor is not known well enough, it is that of what the effects gain on the motions left out,
which has the records' own noise in both terms: G / (G + R), with R what is left above the floor, within its deviation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from diagnosis.baseline import Baseline
from diagnosis.criteria import Criteria
from diagnosis.how_far import Gap, errors_of
from diagnosis.model.fit import Fit, effects_prior_std, unrepeated, weights, without
from diagnosis.model.parameters import bounded
from diagnosis.model.residual import Candidate, Residual, evaluate, smooth
from diagnosis.model.unknown_force import still_fit, unknown_less_means
from diagnosis.null import simulated_with_starts
from diagnosis.records.motions import Piece, repeated, rms, scatter
from diagnosis.records.units import noise
from diagnosis.where.energy import bootstrap_counts, closure_interval
from diagnosis.which.detectors.random_force import with_sines
from diagnosis.which.detectors.scan import FOLDS, NuisanceProjection, partial_out
from diagnosis.which.stage import Carrier, Stage
from models.effects.base import Effect
from models.effects.catalogue import in_order
from models.machine import Machine
from models.records.record import Record

Array = NDArray[np.float64]

Made = tuple[Candidate, tuple[Record, ...]]

BOOTSTRAP: Final = 1000
BANDS: Final = 40  # of frequency, equally wide on a logarithmic scale
LEAST_SHARE: Final = 1e-3  # that a band counts at least
SIMULATED: Final = 2  # records of the final model, whose mean is the noise floor
SIMULATION: Final = "simulated"  # where such a floor is from
SEED: Final = 500  # added to the seed for their noise


@dataclass(frozen=True)
class RandomEnergy:
    """Innovations (n,) [m] of simulated records with an effect that acts at random, and the part [1] of the energy it
    adds there that the true one adds: it acts so rarely that a simulation needs more of it for a mean."""

    innovations: Array
    part: float

    def energy(self, floor: Array) -> float:
        """What the true effect adds to the sum of squares of the floor (n,) [m^2]."""
        return self.part * float(self.innovations @ self.innovations - floor @ floor)


@dataclass(frozen=True)
class NoiseFloor:
    """The noise floor: its innovations (n,) [m] by draw, NaN where it is not known; what effects at random add to it;
    `variance_ratio`, the variance of what a complete model leaves over the floor, in that of one mean square of white
    noise; where it is from ("simulated" or "repeats"); its gap and the force [N] that effects at random add to it,
    which are asked for once an answer stands."""

    innovations: tuple[Array, ...]
    random: tuple[RandomEnergy, ...]
    variance_ratio: float
    source: str
    gap: Callable[[], Gap]
    random_force: Callable[[], float] = lambda: 0.0

    @property
    def known(self) -> NDArray[np.bool_]:
        """The samples (n,) of all records at which the floor is known."""
        return np.asarray(~np.isnan(self.innovations[0]))


@dataclass(frozen=True)
class Closure:
    """The closure on motions left out, its 95 % interval [1], by how much the innovations left exceed the floor, in
    deviations of their noise [1], and that floor. by_force: whether it is that of the unknown force, not that of
    innovations; force_excess: by how much the force left exceeds its floor then, in deviations of its logarithm over
    complete models [1]."""

    closure: float
    interval: tuple[float, float]
    excess: float
    floor: NoiseFloor
    by_force: bool = False
    force_excess: float = math.inf


def held_out_closure(stages: Sequence[Stage], baseline: Baseline, seed: int) -> Closure:
    """How much of the gap the stages close on motions that they were not fitted to.

    A drive that is rougher than its model is held to what does not repeat; only where an effect acts at random, which
    nothing but a simulation tells from the floor, is it simulated as well.
    """
    own = _repeated_floor(stages[-1], baseline) or simulated_floor(stages[-1], baseline, seed)
    found = _closure_above(own, stages, baseline)
    least = -baseline.criteria.missing_excess
    if len(stages) == 1 or own.source != SIMULATION or own.random or found.excess > least:
        return found  # of what acts at random, more is simulated than there was
    return _closure_above(simulated_floor(stages[0], baseline, seed), stages, baseline)


def _closure_above(floor: NoiseFloor, stages: Sequence[Stage], baseline: Baseline) -> Closure:
    """`held_out_closure` above a noise floor."""
    records, first, final = baseline.records, stages[0].fitted, stages[-1].fitted
    known, weight = floor.known, weights(records)
    size = _deviations(final) * noise(final.candidate.machine)
    left = held_out(final, partial_out(final, baseline.segment)) * _deviations(final)
    left = left * noise(final.candidate.machine) * weight  # in the order of `signal`: closure of nothing is exactly 0
    residuals, alike = first.residuals, replace(first.candidate, roughness=final.candidate.roughness)
    if alike.roughness != first.candidate.roughness:  # what two filters leave cannot be compared
        residuals = evaluate(alike, records, first.paths, first.walk)
    before = signal(residuals, alike.machine) * weight
    fitted = signal(final.residuals, final.candidate.machine) * weight
    _, segment = np.unique(baseline.segment[known], return_inverse=True)
    least, random = [one[known] for one in floor.innovations], floor.random
    share, interval = gap_closure(before[known], left[known], least, segment, random)
    more = np.mean([one.energy(floor) for one, floor in zip(random, least, strict=True)]) if random else 0.0
    white = 2 / np.count_nonzero(weight[known])  # the relative variance of a mean square of white noise
    least_known = baseline.null.scatter(records) ** 2 if floor.source == SIMULATION else 0.0
    deviation = float(np.sqrt(max(white, least_known) * floor.variance_ratio))
    energy = np.mean([one @ one for one in least]) + more
    began, excess = (float((one[known] @ one[known] / energy - 1) / deviation) for one in (before, fitted))
    if began >= baseline.criteria.shown_by:
        return Closure(share, interval, excess, floor)
    by_force = _closure_of_force(first, final, floor, baseline)
    if by_force and not left_open(by_force[1], final, baseline.criteria):
        return Closure(*by_force[:2], excess, floor, by_force=True, force_excess=by_force[2])
    if not random and not final.candidate.rough:  # whose weights leave one per sample whatever is missing
        whitened = [(one / size)[known] for one in (before, left, fitted, *floor.innovations)]
        gained = np.asarray(np.bincount(segment, whitened[0] ** 2 - whitened[1] ** 2), float)
        if gained.sum() >= baseline.criteria.min_gain_at_floor:
            chance = float(np.mean([one @ one for one in whitened[3:]]))
            rest = float(whitened[2] @ whitened[2]) - chance
            return Closure(*gain_closure(gained, rest, deviation * chance), excess, floor)
    if by_force:
        return Closure(*by_force[:2], excess, floor, by_force=True, force_excess=by_force[2])
    return Closure(share, interval, excess, floor)


def left_open(interval: tuple[float, float], final: Fit, criteria: Criteria) -> bool:
    """Whether the interval [1] of the force's closure allows nothing as well as enough for a name; or nothing, where
    all effects of a model are errors of the reading: a fine one is no force that could be taken off."""
    effects = final.candidate.added_effects
    of_reading = bool(effects) and all(type(one).kind().side == "reading" for one in effects)
    return interval[0] <= 0 and (of_reading or interval[1] >= criteria.min_closure)


def _closure_of_force(
    first: Fit, final: Fit, floor: NoiseFloor, baseline: Baseline
) -> tuple[float, tuple[float, float], float] | None:
    """The closure of the unknown force, its 95 % interval, and by how much what is left exceeds the floor [1], see
    `Closure.force_excess`; None where the first fit leaves no force that stands out of the floor's, where effects act
    at random, or where the floor is not simulated.

    Both are fitted once more beside a force that does not walk: the search's walk follows the very force that this is
    about, so that the sizes of what makes it hang on little else than their priors.
    """
    weighed_alike = first.candidate.roughness == final.candidate.roughness
    if floor.random or (floor.source == SIMULATION and not weighed_alike):
        return None
    records, motion = baseline.records, baseline.segment
    before = still_fit(first.candidate, records, first.paths)
    begun, used = unknown_less_means(before, records)
    least, count = floor.gap().force, np.count_nonzero(used)
    if begun @ begun < baseline.criteria.min_force_ratio * least**2 * count:
        return None
    after = before if final is first else still_fit(final.candidate, records, final.paths)
    fold, left = partial_out(final, motion).fold[motion], np.zeros(begun.size)
    for number in range(FOLDS):
        apart = replace(after, candidate=with_starts_of(after, without(after, records, fold == number)))
        left += np.where(fold == number, unknown_less_means(apart, records)[0], 0.0)
    sums = np.stack([np.bincount(motion, one) for one in (begun**2, left**2, least**2 * used)])
    drawn = sums @ bootstrap_counts(sums.shape[1], 0).T
    chance = baseline.null.force_scatter(drawn.shape[1])
    drawn[2] *= chance**2  # the floor of these records is another draw than the simulation's
    closure = float(_closed(sums.sum(axis=1)))
    over, scatter = 0.5 * float(np.log(sums[1].sum() / sums[2].sum())), float(np.std(np.log(chance)))
    excess = over / scatter if scatter > 0 else math.copysign(math.inf, over)
    return closure, closure_interval(closure, _closed(drawn), sums.shape[1]), excess


def with_starts_of(fitted: Fit, candidate: Candidate) -> Candidate:
    """The candidate with the friction elements at the start of each record where they are in the fit: what the motions
    that were left out begin from is no effect, and without a record's first one nothing else tells it."""
    layout = candidate.layout
    start = np.isin(np.arange(layout.count), layout.of("initial_friction_state"))
    return replace(candidate, theta=bounded(layout, np.where(start, fitted.candidate.theta, candidate.theta)))


def _repeated_floor(stage: Stage, baseline: Baseline) -> NoiseFloor | None:
    """The floor of a rough drive from what equal motions do not repeat; None where none are equal, or where it takes a
    simulation to tell a random effect from the floor."""
    fitted, records, criteria = stage.fitted, baseline.records, baseline.criteria
    if not fitted.candidate.rough or stage.carried_by(Carrier.FLOOR):
        return None
    if np.isnan(unrepeated(fitted, records, baseline.pieces, criteria.min_equal_motions)).all():
        return None
    return measured(fitted, records, baseline.pieces, criteria, baseline.driving)


def simulated_floor(stage: Stage, baseline: Baseline, seed: int) -> NoiseFloor:
    """The floor from records that the stage's model made of the same references."""
    final, records = stage.fitted, baseline.records
    seeds = [seed + SEED + 10 * i for i in range(SIMULATED)]
    made = [simulated_records(final.candidate, records, one) for one in seeds]
    random, again = tuple[RandomEnergy, ...](), list[Made]()
    parts = [proposal.random_part for proposal in stage.carried_by(Carrier.FLOOR) if proposal.random_part]
    if parts:
        (part,) = parts  # one detector finds effects that act at random
        again = [simulated_records(final.candidate, records, one, [part.effect]) for one in seeds]
        random = tuple(RandomEnergy(innovations_of(*one, final.walk), part.part) for one in again)
    least = tuple(innovations_of(*one, final.walk) for one in made)
    ratio = 1 + 1 / SIMULATED

    @cache
    def left(strong: bool) -> Gap:
        one = again[0] if strong else made[0]
        return errors_of(*one, smooth(*one)).gap()

    def more() -> float:
        if not again:
            return 0.0
        extra = left(True).force ** 2 - left(False).force ** 2
        return float(np.sqrt(max(random[0].part * extra, 0.0)))

    return NoiseFloor(least, random, ratio, SIMULATION, lambda: left(False), more)


def _deviations(fitted: Fit) -> Array:
    return np.concatenate([np.full(one.innovations.size, one.deviation) for one in fitted.residuals])


def measured(
    fitted: Fit,
    records: Sequence[Record],
    pieces: Sequence[Piece],
    criteria: Criteria = Criteria(),
    driving: Sequence[Record] | None = None,
) -> NoiseFloor:
    """The floor from what does not repeat between equal motions. An effect that does not repeat is floor here.
    driving: see `errors_of`."""
    groups = repeated(pieces, records, noise(fitted.candidate.nominal))
    apart = unrepeated(fitted, records, pieces, criteria.min_equal_motions)

    def scattered() -> Gap:
        left = errors_of(fitted.candidate, records, fitted.paths, driving)
        return Gap(rms(scatter(groups, pieces, left.force)), rms(scatter(groups, pieces, left.position)), None)

    size = _deviations(fitted) * noise(fitted.candidate.machine)
    ratio = len(groups) / (sum(map(len, groups)) - len(groups))
    return NoiseFloor((apart * size,), (), ratio, "repeats", scattered)


def simulated_records(candidate: Candidate, records: Sequence[Record], seed: int, extra: Sequence[Effect] = ()) -> Made:
    """The candidate as it has to be to see the records that it makes of the same references, with noise, and these;
    `extra` effects besides."""
    whole = with_sines(candidate)
    made, begun = simulated_with_starts(replace(whole, effects=in_order((*whole.effects, *extra))), records, seed)
    return replace(candidate, theta=begun.theta), made


def innovations_of(candidate: Candidate, records: Sequence[Record], walk: float) -> Array:
    """Innovations (n,) [m] of all records, one after another, seen through the candidate itself."""
    paths = smooth(candidate, records, smooth(candidate, records))
    return signal(evaluate(candidate, records, paths, walk), candidate.machine) * weights(records)


def signal(residuals: Sequence[Residual], machine: Machine) -> Array:
    """Innovations (n,) [m] of all records."""
    return np.concatenate([one.innovations * one.deviation * noise(machine) for one in residuals])


def held_out(fitted: Fit, projection: NuisanceProjection) -> Array:
    """Innovations (n,), whitened [1], each with the effects' coordinates fitted without the motions of its own fold."""
    if fitted.effect_jacobian.shape[1] == 0:
        return fitted.innovations
    layout = fitted.candidate.layout
    basis = fitted.slopes * layout.deviation
    factor = cho_factor(basis.T @ basis + np.eye(basis.shape[1]))
    given = fitted.effect_jacobian * effects_prior_std(fitted.candidate)
    given = given - basis @ cho_solve(factor, basis.T @ given)
    e = fitted.innovations.copy()
    fold = projection.fold[projection.segment]
    for number in range(FOLDS):
        train = fold != number
        gram = given[train].T @ given[train] + np.eye(given.shape[1])
        step = -np.linalg.solve(gram, given[train].T @ fitted.innovations[train])
        e[~train] += given[~train] @ step
    return e


def gap_closure(
    before: Array,
    after: Array,
    floors: Sequence[Array],
    segment: NDArray[np.int64],
    random: Sequence[RandomEnergy] = (),
) -> tuple[float, tuple[float, float]]:
    """The closure and its 95 % interval by a bootstrap over motions; innovations (n,) [m], each sample's motion.

    random: what effects that act at random add to the floors; that is explained, though no model takes it off.
    """
    count, share = int(segment.max()) + 1, gap_share(before, floors)
    energies = [weighted(one, share) ** 2 for one in (before, after)]
    energies.append(np.mean([weighted(floor, share) ** 2 for floor in floors], axis=0))
    if random:
        more = np.mean([one.part * weighted(one.innovations, share) ** 2 for one in random], axis=0)
        energies[1] = energies[1] - more + random[0].part * energies[2]
    sums = np.stack([np.bincount(segment, energy, count) for energy in energies])
    draws = np.random.default_rng(0).integers(0, count, (BOOTSTRAP, count))
    drawn = sums[:, draws].sum(axis=2)
    closure = float(_closed(sums.sum(axis=1)))
    return closure, closure_interval(closure, _closed(drawn), count)


def gain_closure(gained: Array, rest: float, deviation: float) -> tuple[float, tuple[float, float]]:
    """The closure and its 95 % interval [1] from the chi-square that effects gain on each motion (motions,), where they
    were not fitted to it, and from the rest above the floor, with its deviation; all [1]."""
    rng = np.random.default_rng(0)
    draws = rng.integers(0, gained.size, (BOOTSTRAP, gained.size))
    drawn = _of_gain(gained[draws].sum(axis=1), rest + deviation * rng.standard_normal(BOOTSTRAP))
    closure = float(_of_gain(gained.sum(), rest))
    return closure, closure_interval(closure, drawn, gained.size)


def _of_gain(gain: Array | float, rest: Array | float) -> Array:
    """The share [1] that is gone of what was above the floor, a rest below which is none."""
    return np.asarray(gain / np.maximum(np.abs(gain) + np.maximum(rest, 0.0), 1e-300))


def gap_share(before: Array, floors: Sequence[Array]) -> Array:
    """The share (n // 2 + 1,) [1] of what the re-fit leaves (n,) [m] that the floors have not, by frequency."""
    power = np.abs(np.fft.rfft(before)) ** 2
    least = np.mean([np.abs(np.fft.rfft(floor)) ** 2 for floor in floors], axis=0)
    edges = np.unique(np.geomspace(1, power.size, BANDS + 1).astype(int))
    band = np.clip(np.searchsorted(edges, np.arange(power.size), side="right") - 1, 0, None)
    gap, all_of_it = (np.bincount(band, one) for one in (power - least, power))
    return np.clip(gap / np.maximum(all_of_it, 1e-300), LEAST_SHARE, 1.0)[band]


def weighted(innovations: Array, share: Array) -> Array:
    """Innovations (n,) [m] with each frequency's energy times its share (n // 2 + 1,) [1]."""
    return np.asarray(np.fft.irfft(np.fft.rfft(innovations) * np.sqrt(share), innovations.size))


def _closed(sums: Array) -> Array:
    gap = np.maximum(sums[0] - sums[2], 1e-30)
    return np.asarray(np.clip((sums[0] - sums[1]) / gap, -1.0, 1.0))
