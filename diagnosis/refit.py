"""What every effect is judged against: what is nominal, re-fitted to the records under weights that they bear out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.criteria import Criteria
from diagnosis.model.at_bounds import freed, mode_at_bounds, stated_at_bounds
from diagnosis.model.fit import Fit, coordinates, fit, weights
from diagnosis.model.parameters import PRIOR_BOUND_STDS, Parameters, parameters
from diagnosis.model.residual import Candidate, SmoothedPath, smooth
from diagnosis.model.roughness import steady_variance, unmodelled_variance, variance_by_record
from diagnosis.model.start_states import has_fine_scale, search, static_equilibrium_start
from diagnosis.model.unknown_force import unknown_force
from diagnosis.records.units import loop_time, slow_walk
from models.effects.base import Effect
from models.effects.catalogue import in_order
from models.machine import Machine, Provenance
from models.records.record import Record

Array = NDArray[np.float64]

FORGIVING: Final = (0.375, 0.125)  # walks [usual white forces a sample] of the first steps of the re-fit
FIRST_ITERATIONS, LAST_ITERATIONS = 3, 6  # of each of them, and of the last step
RATED: Final = "drive.rated_thrust"
FOLLOWED: Final = Provenance("identified", "the largest command of the records, which the drive followed")
MORE: Final = 2.8  # times the slow walk, under which the starts are searched once more on a fine scale
START_SEARCHES: Final = 2  # times that the starts are searched once more
MAX_CONTINUATIONS: Final = 6  # times that a fit which has not converged is continued
OTHER_MODES: Final = 0.1  # of what a fit leaves above noise, below which modes far from the file's are the axis's
MIN_CHI_SQUARE_GAIN: Final = 20.0  # fall of chi-square, up to which a fit is no better than the one before
WEIGHED: Final = 12  # times that the white force is estimated from what a fit under the one before leaves
LEAST_SLOPE: Final = 0.3  # where the scale's noise is most of it, whatever the white force
# The names under which a reader knows parameters of the fit.
OFFSET: Final = "amplifier_offset"
CALLED: Final = {"mode_gain": "payload_mass", "presliding_limit": "presliding_stiffness"}
CLOSE: Final = 0.05  # relative difference of white forces that are the same


def refit(layout: Parameters, records: Sequence[Record], effects: tuple[Effect, ...] = ()) -> Fit:
    """The nominal parameters fitted, from a disturbance that forgives much to one that forgives little.

    Values and the records' starts are found by turns. Where the scale resolves the friction finely, contacts of other
    stiffness may make up for a wrong start: if more than the noise is left there, the starts are found with the file's
    values, before any is fitted, and the better fit is kept. Elsewhere that is no better: on 29 default tables, most of
    them with a law of the catalogue, by 9 of chi-square at most, and worse by up to 1003.
    """
    candidate = Candidate(layout, static_equilibrium_start(layout, records), effects)
    found = _first_fit(candidate, records, FIRST_ITERATIONS)
    if _starts_may_be_missed(found, records):
        found = min(found, _first_fit(candidate, records, 0), key=lambda one: one.cost)
    return with_new_starts(found, records)


def _starts_may_be_missed(fitted: Fit, records: Sequence[Record]) -> bool:
    """Whether more than noise is left where the scale resolves the friction finely."""
    return has_fine_scale(fitted.candidate.nominal) and float(fitted.innovations @ fitted.innovations) > float(
        np.sum(weights(records))
    )


def _first_fit(candidate: Candidate, records: Sequence[Record], iterations: int) -> Fit:
    """The candidate fitted, with so many steps of its values before each search of the starts."""
    paths: tuple[SmoothedPath, ...] | None = None
    for walk in FORGIVING:
        fitted = fit(candidate, records, paths=paths, iterations=iterations, walk=walk)
        candidate, paths = search(fitted, records), fitted.paths if iterations else None
    walk = slow_walk(candidate.nominal)
    return fit(candidate, records, paths=paths, iterations=LAST_ITERATIONS, walk=walk)


def refit_within(machine: Machine, records: Sequence[Record], criteria: Criteria = Criteria()) -> Fit:
    """The nominal re-fit, under the white force [N] that each record needs."""
    return weighed(within_rating(machine, records), records, criteria)


def weighed(
    fitted: Fit,
    records: Sequence[Record],
    criteria: Criteria = Criteria(),
    usual: Callable[[], Sequence[float]] | None = None,
) -> Fit:
    """The fit as it is, unless a record is far rougher than its weights promise: then fitted again under the white
    force with which each such record leaves as much as they promise. Weights that a drive does not keep drive what is
    nominal to its bounds.

    How rough a record is: see `roughness.unmodelled_variance` (N. Kristensen, H. Madsen, S. Jorgensen, Automatica 40,
    2004, estimate such a diffusion by likelihood, which takes up a law that is missing as well). Where a white force as
    large as the commands (their deviation) is not enough, there is no such force, and the weights stay. usual: gives
    the variance of what complete models leave of each record [1], if it is known; called where a record may be rough.
    Where interpolation between a log's samples makes it large, that is such a force of this record, too.
    """
    rough, _ = rough_records(fitted, records, criteria, usual)
    rough |= np.array([fitted.candidate.roughness_of(i) for i in range(len(records))]) > 1
    return _weighed(fitted, records, rough) if rough.any() else fitted


def rough_records(
    fitted: Fit, records: Sequence[Record], criteria: Criteria, usual: Callable[[], Sequence[float]] | None = None
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which records are far rougher than their weights promise, and which of these are no rougher than interpolation
    between their log's samples makes those of a complete model (R,). usual: the variance of what complete models leave
    of each record [1], as of `weighed`."""
    apart = unmodelled_variance(fitted, records, criteria.min_equal_motions)
    rough = apart > criteria.rough_variance
    if not usual or not rough.any():
        return rough, np.zeros(rough.size, bool)
    left, filled = np.maximum(usual(), 1.0), np.array([record.every > 1 for record in records])
    beyond = apart > criteria.rough_variance * left
    by_log = rough & ~beyond & filled & (left > criteria.filled_most_left)
    return beyond | by_log, by_log


def noise_alone(fitted: Fit, records: Sequence[Record], criteria: Criteria, usual: Sequence[float]) -> Array | None:
    """The white force of each record [N] beside which a fit leaves white noise and nothing else; None where there is no
    such force. usual: the variance of what complete models leave of each record [1].

    The search does not allow for a drive that is rougher by so little, as steps of its converter would pass for it.
    """
    apart = unmodelled_variance(fitted, records, criteria.min_equal_motions)
    more = apart > criteria.noise_variance * np.maximum(usual, 1.0)
    if fitted.candidate.rough or not more.any():
        return None
    found = _weighed(fitted, records, more)
    if not found.candidate.rough or np.any(whiteness(found, records) < criteria.whiteness):
        return None
    roughness = [found.candidate.roughness_of(i) for i in range(len(records))]
    return found.candidate.usual_white_force * np.array(roughness)


def whiteness(fitted: Fit, records: Sequence[Record]) -> Array:
    """By record, how much of what a fit leaves is steadily there about the loop's frequency, over the same of white
    noise [1], or the inverse where that is less: 1 of white noise, next to 0 where a law is missing."""
    loop = loop_time(fitted.candidate.nominal)
    steady = [
        steady_variance(one.innovations, record, loop) for one, record in zip(fitted.residuals, records, strict=True)
    ]
    share = np.nan_to_num(steady, nan=1.0) / variance_by_record(fitted)
    return np.asarray(np.minimum(share, 1 / np.maximum(share, 1e-12)))


def _weighed(fitted: Fit, records: Sequence[Record], rough: NDArray[np.bool_]) -> Fit:
    """The fit under the white force with which each of the rough records leaves as much as the weights promise."""
    candidate = fitted.candidate
    given, most = fitted, max(float(np.std(record.command)) for record in records) / candidate.usual_white_force
    variance = variance_by_record(fitted)
    slope = np.ones(len(records))  # of the variance over the white force, on logarithms, with its sign turned
    for _ in range(WEIGHED):
        before = np.array([fitted.candidate.roughness_of(i) for i in range(len(records))])
        wanted = np.where(rough, np.maximum(before * variance ** (1 / slope), 1.0), before)
        if np.all(np.abs(wanted / before - 1) < CLOSE):
            break
        if np.any(np.minimum(before, wanted) >= most):
            return given
        roughness = np.minimum(wanted, most)
        candidate = replace(fitted.candidate, roughness=tuple(roughness.tolist()))
        fitted = fit(candidate, records, paths=fitted.paths, walk=fitted.walk)
        after = variance_by_record(fitted)
        moved = np.abs(np.log(roughness / before)) > 1e-6
        fall = -np.log(after / variance) / np.log(np.where(moved, roughness / before, 2.0))
        slope = np.where(moved, np.clip(fall, LEAST_SLOPE, 2.0), slope)
        variance = after
    return with_new_starts(fitted, records)


def within_rating(machine: Machine, records: Sequence[Record]) -> Fit:
    """The nominal re-fit under the usual weights. Where commands go beyond the rated thrust, the drive that followed
    them is tried as well: many do so for a while. A value of an effect that the file states may be farther off than
    usual sizes go, as long as it comes to rest there."""
    fitted = _within_rating(machine, records)
    found = freed(fitted, records, stated_at_bounds)
    rests = found is not fitted and not stated_at_bounds(found.candidate)
    gained = float(np.sum(fitted.innovations**2) - np.sum(found.innovations**2))  # the priors are others
    return _with_other_modes(found if rests and gained > MIN_CHI_SQUARE_GAIN else fitted, records)


def _with_other_modes(fitted: Fit, records: Sequence[Record]) -> Fit:
    """The fit with as much room as its modes need, where one ran to the bound of its frequency, if they come to rest
    there and nearly all of what was left is gone: beneath another load or on a softer spring a mode is another one. One
    that makes up for a mode that the file lacks was seen to take three quarters of it."""
    if not mode_at_bounds(fitted.candidate):
        return fitted
    found = freed(fitted, records, mode_at_bounds)
    before, after = (float(np.sum(one.innovations**2) - np.sum(weights(records))) for one in (fitted, found))
    less = before - after > MIN_CHI_SQUARE_GAIN and after < OTHER_MODES * before
    return found if less and not mode_at_bounds(found.candidate) else fitted


def _within_rating(machine: Machine, records: Sequence[Record]) -> Fit:
    """The re-fit with the rating as it is stated or, where that leaves clearly less, as it was seen to be exceeded."""
    most = max(float(np.max(np.abs(record.command))) for record in records)
    effects = in_order(machine.effects)
    layout = _with_any_load(parameters(machine, len(records)), records, effects)
    if most <= machine.drive.rated_thrust:
        return refit(layout, records, effects)
    drive, sources = replace(machine.drive, rated_thrust=most), {**machine.sources, RATED: FOLLOWED}
    follows = refit(replace(layout, machine=replace(machine, drive=drive, sources=sources)), records, effects)
    bounded = fit(replace(follows.candidate, layout=layout), records, paths=follows.paths, walk=follows.walk)
    found = [follows, bounded]
    if follows.cost - bounded.cost > MIN_CHI_SQUARE_GAIN:  # another drive: what it was fitted from may be no good start
        found.append(refit(layout, records, effects))
    return min(found, key=lambda fitted: fitted.cost)


def _with_any_load(layout: Parameters, records: Sequence[Record], effects: tuple[Effect, ...]) -> Parameters:
    """The layout with as wide a prior of the offset as the constant force that the machine as delivered leaves, where
    that is beyond the offset's bound: a load on a vertical axis, or a spring that was taken off. Innovations hardly
    tell it, as the filter's own unknown force follows what is constant; the usual prior had bent other values."""
    candidate = Candidate(layout, static_equilibrium_start(layout, records), effects)
    left = np.concatenate(unknown_force(candidate, records, smooth(candidate, records)))
    constant, at = abs(float(np.nanmean(left))), layout.of(OFFSET)
    if not constant > layout.high[at]:
        return layout
    deviation, low, high = layout.deviation.copy(), layout.low.copy(), layout.high.copy()
    deviation[at], low[at], high[at] = constant, -PRIOR_BOUND_STDS * constant, PRIOR_BOUND_STDS * constant
    return replace(layout, deviation=deviation, low=low, high=high)


def with_new_starts(fitted: Fit, records: Sequence[Record]) -> Fit:
    """The fit with its records' starts searched anew, as long as that leaves less: what else is in the model decides
    which starts are best."""
    for _ in range(START_SEARCHES):
        better = fit(search(fitted, records), records, paths=fitted.paths, iterations=4, walk=fitted.walk)
        if fitted.cost - better.cost < MIN_CHI_SQUARE_GAIN:
            break
        fitted = better
    for _ in range(MAX_CONTINUATIONS):  # a scale that resolves the friction finely needs the starts to many digits
        if fitted.converged:
            break
        fitted = fit(fitted.candidate, records, paths=fitted.paths, iterations=LAST_ITERATIONS, walk=fitted.walk)
    if _starts_may_be_missed(fitted, records):
        fitted = min(fitted, _forgiving(fitted, records), key=lambda one: one.cost)
    return fitted


def _forgiving(fitted: Fit, records: Sequence[Record]) -> Fit:
    """The fit with its records' starts searched under a force that walks faster, to which a start that is nearly right
    looks so."""
    walk = MORE * fitted.walk
    here = fit(fitted.candidate, records, paths=fitted.paths, iterations=0, walk=walk)
    here = fit(search(here, records), records, paths=here.paths, iterations=LAST_ITERATIONS, walk=walk)
    return fit(here.candidate, records, paths=here.paths, iterations=LAST_ITERATIONS, walk=fitted.walk)


@dataclass(frozen=True)
class Shifts:
    """How far the re-fit moved the values of a machine file: their names as a reader knows them and their shifts (P,),
    in SI or, of relative ones, as logarithms, beyond what it moves them where nothing is wrong; and the inverse (P, P)
    of their covariance by the data alone, whatever the records' starts are."""

    names: tuple[str, ...]
    moved: Array
    inverse: Array

    def gain(self, name: str | None = None) -> float:
        """The chi-square [1] of the shifts of one name, or of all together."""
        own = np.flatnonzero([name in {None, one} for one in self.names])
        return float(self.moved[own] @ self.inverse[np.ix_(own, own)] @ self.moved[own])


def shifts(fitted: Fit, bias: Array | None = None) -> Shifts:
    """Those of a nominal re-fit, which has no effects but those that the machine file states [SI; 1 for logarithms].
    bias: how far it moves each nominal value but the starts where nothing is wrong [tolerances] (`Null.bias`)."""
    candidate, layout = fitted.candidate, fitted.candidate.layout
    pairs = list(zip(in_order(candidate.nominal.effects), candidate.effects, strict=True))
    stated = [coordinates(now) - coordinates(before) for before, now in pairs]
    names = [CALLED.get(name, name) for name in layout.names]
    names += [now.name for (_, now), part in zip(pairs, stated, strict=True) for _ in part]
    where = np.flatnonzero(np.array(names) != "initial_friction_state")
    rest = layout.of("initial_friction_state")
    slopes = np.hstack([fitted.slopes, fitted.effect_jacobian])
    whole = slopes.T @ slopes
    wide = np.diag(1 / layout.deviation[rest] ** 2)
    inverse = whole[np.ix_(where, where)] - whole[np.ix_(where, rest)] @ np.linalg.solve(
        whole[np.ix_(rest, rest)] + wide, whole[np.ix_(rest, where)]
    )
    theta = candidate.theta.copy()
    if bias is not None and bias.size:
        own = np.setdiff1d(np.arange(layout.count), rest)
        theta[own] -= bias * layout.deviation[own]
    moved = np.concatenate([theta, *stated])
    return Shifts(tuple(names[i] for i in where), moved[where], inverse)


def wrong_values(
    fitted: Fit, criteria: Criteria, floor: float = math.inf, bias: Array | None = None
) -> tuple[str, ...]:
    """The values of the machine file that are wrong, nominal ones and those of stated effects, by the names of both;
    those whose shift matters the most first. An offset comes before them where it is surely above the noise floor's
    force [N]: what is constant, the filter's own unknown force follows, so that innovations hardly show it. bias: see
    `shifts`."""
    moved = shifts(fitted, bias)
    gains = {name: moved.gain(name) for name in dict.fromkeys(moved.names)}
    least = max(criteria.parameter_share * max(gains.values()), criteria.parameter_min_gain)
    offset = float(fitted.candidate.theta[fitted.candidate.layout.of(OFFSET)][0])
    first = (OFFSET,) * (offset**2 > criteria.min_force_ratio * floor**2)
    found = sorted((name for name in gains if gains[name] > least), key=lambda name: -gains[name])
    return tuple(dict.fromkeys((*first, *found)))
