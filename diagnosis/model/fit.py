"""Fits a candidate to records: theta and the parameters of its effects jointly, by damped Gauss and Newton's steps.

The cost is that of the posterior: squared whitened innovations and squared deviations from the priors. An effect's
coordinates: an amplitude and a phase as its cosine and sine part, a shape or a width as its logarithm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from diagnosis.model.kalman import STARTING
from diagnosis.model.parameters import bounded, bounds
from diagnosis.model.residual import (
    WALK,
    Candidate,
    Residual,
    SmoothedPath,
    columns,
    evaluate,
    nominal_slopes,
    smooth,
)
from diagnosis.records.motions import Piece, repeated, scatter
from diagnosis.records.units import noise
from models.effects.base import Effect, parameters
from models.effects.catalogue import in_order
from models.effects.parameter import POSITIVE, Parameter
from models.effects.priors import Priors
from models.records.record import Record

Array = NDArray[np.float64]

PRIOR_ROOM_FACTOR: Final = 1.5  # A fit may move a shape, period or width by this factor beyond its prior range.
# A width may fall by this factor below its prior range: that is a small effect and no other law.
WIDTH_RANGE_FACTOR: Final = 20.0
STRIDE: Final = 0.7  # The largest change of the logarithm of a shape, period or width in one step.
START_STRIDE: Final = 1.0  # The largest change of an element's start in one step, in prior standard deviations.
MAX_DAMPING: Final = 1e5  # The search for a step ends where even this damping does not reduce the cost.
DIFFERENCE: Final = {"shape": 0.02, "period": 0.02, "width": 0.05}  # Relative steps of numerical derivatives, by role.
OF_PERIOD: Final = 0.02  # Such a step in a period moves the last period of a record by this part of one.
MIN_GAIN: Final = 10.0  # A step that gains less chi-square than this ends the fit.


@dataclass(frozen=True)
class Fit:
    """A fitted candidate with its smoothed paths and residuals, and its last linearisation: the weighted innovations e
    (n,) of all records, their Jacobians with respect to theta (n, P) and to the effects' coordinates (n, Q), the cost,
    the deviation of the unknown force's random walk [usual white forces a sample], and whether the last step gained
    next to nothing, so that no further one would."""

    candidate: Candidate
    paths: tuple[SmoothedPath, ...]
    residuals: tuple[Residual, ...]
    innovations: Array
    slopes: Array
    effect_jacobian: Array
    cost: float
    walk: float
    converged: bool = True


def weights(records: Sequence[Record]) -> Array:
    """1 for every sample of all records (n,) [1], but 0 for the first ones of each, in which the filter settles."""
    parts = [np.ones(record.position.size) for record in records]
    for part in parts:
        part[:STARTING] = 0.0
    return np.concatenate(parts)


def unrepeated(fitted: Fit, records: Sequence[Record], pieces: Sequence[Piece], least: int) -> Array:
    """The part of a fit's innovations (n,) [1] that does not repeat between equal motions; NaN where a motion has no
    equal, and everywhere if fewer than `least` have one."""
    reading = noise(fitted.candidate.nominal)
    groups, whole = repeated(pieces, records, reading), fitted.innovations.copy()
    if sum(map(len, groups)) < least:
        return np.full(whole.size, np.nan)
    whole[weights(records) == 0] = np.nan
    ends = np.cumsum([record.position.size for record in records])[:-1]
    return np.concatenate(scatter(groups, pieces, np.split(whole, ends)))


@dataclass(frozen=True)
class Largest:
    """The largest innovation: its record and sample, and its size in deviations of all innovations [1]."""

    record: int
    sample: int
    deviations: float


def largest(fitted: Fit) -> Largest:
    """The largest innovation [1] of a fit."""
    number = int(np.argmax(np.abs(fitted.innovations)))
    begin = np.cumsum([0, *(seen.innovations.size for seen in fitted.residuals)])
    record = int(np.searchsorted(begin, number, side="right")) - 1
    size = float(np.abs(fitted.innovations[number]) / np.std(fitted.innovations))
    return Largest(record, number - int(begin[record]), size)


def coordinates(effect: Effect) -> Array:
    """The effect's coordinates (Q,) [SI and logarithms of SI]; see the head of the module."""
    rows, size, phase = [], 0.0, None
    for item in parameters(type(effect)):
        number = getattr(effect, item.name)
        if item.role == "amplitude":
            size = number
        elif item.role == "phase":
            phase = number
        elif item.role != "switch":
            rows.append(np.log(max(number, np.finfo(float).tiny)))  # a file may state none of it
    linear = amplitudes(effect)
    if phase is None:
        return np.array([*linear, *rows])
    return np.array([size * np.cos(phase), size * np.sin(phase), *rows])


def coordinate_of(effect: Effect, name: str) -> int:
    """Where among the effect's coordinates the logarithm of a size stands, of a role in POSITIVE; no unit."""
    sizes = [item.name for item in parameters(type(effect)) if item.role in POSITIVE]
    return coordinates(effect).size - len(sizes) + sizes.index(name)


def amplitudes(effect: Effect) -> list[float]:
    """The effect's amplitudes with their signs [SI]; none of one that has a width."""
    return [getattr(effect, item.name) for item in parameters(type(effect)) if item.role == "amplitude"]


def with_coordinates(effect: Effect, where: Array, priors: Priors) -> Effect:
    """The effect at other coordinates (Q,) [SI and logarithms of SI], its shapes, periods and widths kept near their
    ranges in a machine of these priors."""
    items = parameters(type(effect), priors)
    sizes = [item.name for item in items if item.role == "amplitude"]
    phases = [item.name for item in items if item.role == "phase"]
    changed: dict[str, float] = {}
    if phases:
        c, s = where[0], where[1]
        changed |= {sizes[0]: float(np.hypot(c, s)), phases[0]: float(np.arctan2(s, c) % (2 * np.pi))}
        rest = where[2:]
    else:
        changed |= {name: float(number) for name, number in zip(sizes, where, strict=False)}
        rest = where[len(sizes) :]
    shapes = [item for item in items if item.role in POSITIVE]
    for item, number in zip(shapes, rest, strict=True):
        changed[item.name] = float(np.clip(np.exp(number), *bounds_of(item)))
    return replace(effect, **changed)


def bounds_of(item: Parameter) -> tuple[float, float]:
    """The least and the greatest value [SI] that a fit may give to a shape, a period or a width."""
    low, high = item.widest
    is_sampled = item.is_resonance and bool(item.sought)  # it ends where the samples do
    return low / (WIDTH_RANGE_FACTOR if item.role == "width" else PRIOR_ROOM_FACTOR), high * (
        1.0 if is_sampled else PRIOR_ROOM_FACTOR
    )


def prior_std(effect: Effect, priors: Priors) -> Array:
    """Prior standard deviations (Q,) of the coordinates in a machine of these priors: of an amplitude its largest
    typical size [SI], of a logarithm the whole prior range [1]."""
    items = parameters(type(effect), priors)
    size = [max(abs(item.low), abs(item.high)) for item in items if item.role == "amplitude"]
    if any(item.role == "phase" for item in items):
        size = size * 2
    return np.array([*size, *(np.log(item.high / item.low) for item in items if item.role in POSITIVE)])


def effects_prior_std(candidate: Candidate) -> Array:
    """Prior standard deviations (Q,) of the coordinates of all its effects, in their order [SI, 1 for logarithms]."""
    priors = candidate.nominal.priors
    return np.concatenate([np.zeros(0), *(prior_std(effect, priors) for effect in candidate.effects)])


def slopes_of(
    candidate: Candidate,
    records: Sequence[Record],
    paths: Sequence[SmoothedPath],
    residuals: Sequence[Residual],
    walk: float = WALK,
) -> Array:
    """How the innovations (n,) change with the coordinates of the effects, in their order: (n, Q)
    [1/SI and 1 for logarithms]."""
    trials, steps, priors = [], [], candidate.nominal.priors
    for i, effect in enumerate(candidate.effects):
        here, small = coordinates(effect), difference_steps(effect, records, priors)
        for j in range(here.size):
            where = here + small * (np.arange(here.size) == j)
            trials.append(
                (*candidate.effects[:i], with_coordinates(effect, where, priors), *candidate.effects[i + 1 :])
            )
            steps.append(small[j])
    if not trials:
        return np.zeros((sum(record.position.size for record in records), 0))
    return np.asarray(columns(candidate, trials, records, paths, residuals, walk) / np.array(steps))


def parameters_at_bounds(effect: Effect, priors: Priors) -> tuple[Parameter, ...]:
    """The shapes, periods and widths that are where the fit may go no further in a machine of these priors: the law is
    then distorted to stand for another one.

    The step of a staircase does not count: the many steps in a record determine its width to a millionth, so a bound on
    it is not a sign of a wrong law.
    """
    scales = [item for item in parameters(type(effect), priors) if item.role in POSITIVE and not item.is_step]
    ends = [(item, *bounds_of(item)) for item in scales]
    return tuple(item for item, low, high in ends if not low * 1.02 < getattr(effect, item.name) < high / 1.02)


def fine_step(item: Parameter, effect: Effect, records: Sequence[Record]) -> float:
    """The relative change [1] of a parameter within which its response is linear, if that is less than usual; else 0.

    For a period along the path or the command, it is the change by which the last period in the records moves by a part
    of one, unless the law says how fine it is, or its usual range lets only a few periods into a record. What is
    periodic in time restarts in every record with another phase, so that no periods are counted.
    """
    number = float(getattr(effect, item.name))
    usual = item.low <= number <= item.high and not item.stated
    known = (item.points or item.linear_within) and usual
    if item.role != "period" or item.periodic_in == "time" or known:
        return item.linear_within
    signals = [record.command if item.periodic_in == "command" else record.position for record in records]
    extent = max(float(np.ptp(signal)) for signal in signals)
    period = 1 / number if item.is_frequency else number
    return OF_PERIOD * period / max(extent, period)


def difference_steps(effect: Effect, records: Sequence[Record], priors: Priors) -> Array:
    """Steps (Q,) of numerical derivatives by the coordinates: a hundredth of the typical amplitude [SI]; of a logarithm
    DIFFERENCE, or what `fine_step` says [1]."""
    items = parameters(type(effect), priors)
    size = [0.01 * item.typical for item in items if item.role == "amplitude"]
    if any(item.role == "phase" for item in items):
        size = size * 2
    shapes = [fine_step(item, effect, records) or DIFFERENCE[item.role] for item in items if item.role in POSITIVE]
    return np.array([*size, *shapes])


def fit(
    candidate: Candidate,
    records: Sequence[Record],
    *,
    paths: Sequence[SmoothedPath] | None = None,
    iterations: int = 8,
    walk: float = WALK,
) -> Fit:
    """The candidate fitted, from where it stands; walk: of the unknown force [usual white forces a sample]."""
    weight = weights(records)
    known = tuple(paths) if paths else smooth(candidate, records)
    residuals = evaluate(candidate, records, known, walk)
    cost, damping, converged = _cost(candidate, residuals, weight), 1.0, False
    for _ in range(iterations):
        here = _linearised(candidate, records, known, residuals, weight, walk)
        moved, after, now, damping = _search(here, records, weight, damping)
        if after >= cost:
            converged = True
            break
        candidate, residuals, gained, cost = moved, now, cost - after, after
        known = smooth(candidate, records, known)
        residuals = evaluate(candidate, records, known, walk)
        cost = _cost(candidate, residuals, weight)
        if gained < MIN_GAIN:
            converged = True
            break
    return replace(_linearised(candidate, records, known, residuals, weight, walk), converged=converged)


def one_step(candidate: Candidate, records: Sequence[Record], *, walk: float = WALK) -> Fit:
    """The candidate fitted by one step, where it stands so near that the paths and slopes before the step, which it
    keeps, hold behind it, too; walk: of the unknown force [usual white forces a sample]."""
    weight, paths = weights(records), smooth(candidate, records)
    here = _linearised(candidate, records, paths, evaluate(candidate, records, paths, walk), weight, walk)
    moved, cost, residuals, _ = _search(here, records, weight, damping=1.0)
    if cost >= here.cost:
        return here
    return replace(here, candidate=moved, residuals=residuals, innovations=_innovations(residuals, weight), cost=cost)


def cost_with(fitted: Fit, effect: Effect, records: Sequence[Record]) -> float:
    """The cost [1] of a fit with an effect (SI) more, nothing re-fitted."""
    candidate = replace(fitted.candidate, effects=in_order((*fitted.candidate.effects, effect)))
    return _cost(candidate, evaluate(candidate, records, fitted.paths, fitted.walk), weights(records))


def without(fitted: Fit, records: Sequence[Record], left_out: NDArray[np.bool_]) -> Candidate:
    """The fit's candidate (SI), fitted by one more step to the samples that are not left out (n,)."""
    weight = weights(records) * ~left_out
    here = replace(
        fitted,
        innovations=fitted.innovations * weight,
        slopes=fitted.slopes * weight[:, None],
        effect_jacobian=fitted.effect_jacobian * weight[:, None],
        cost=_cost(fitted.candidate, fitted.residuals, weight),
    )
    moved, cost, _, _ = _search(here, records, weight, damping=1.0)
    return moved if cost < here.cost else fitted.candidate


def _linearised(
    candidate: Candidate,
    records: Sequence[Record],
    paths: Sequence[SmoothedPath],
    residuals: Sequence[Residual],
    weight: Array,
    walk: float,
) -> Fit:
    slopes, own = (
        nominal_slopes(candidate, records, residuals, walk),
        slopes_of(candidate, records, paths, residuals, walk),
    )
    slopes *= weight[:, None]
    own *= weight[:, None]
    return Fit(
        candidate,
        tuple(paths),
        tuple(residuals),
        _innovations(residuals, weight),
        slopes,
        own,
        _cost(candidate, residuals, weight),
        walk,
    )


def _search(
    here: Fit, records: Sequence[Record], weight: Array, damping: float
) -> tuple[Candidate, float, tuple[Residual, ...], float]:
    """Levenberg and Marquardt's step: the first damping, from the last one on, with which less is left; its candidate,
    cost, what it leaves and the damping for the next step. If none does, the last tried and its larger cost."""
    candidate, layout = here.candidate, here.candidate.layout
    wide = np.concatenate([layout.deviation, effects_prior_std(candidate)])
    priors = layout.machine.priors
    residual = [candidate.theta / layout.deviation, *(_prior_residual(one, priors) for one in candidate.effects)]
    crossed = here.slopes.T @ here.effect_jacobian
    whole = np.block(
        [[here.slopes.T @ here.slopes, crossed], [crossed.T, here.effect_jacobian.T @ here.effect_jacobian]]
    )
    normal = wide[:, None] * whole * wide + np.eye(wide.size)
    onto = -wide * np.concatenate(
        [here.slopes.T @ here.innovations, here.effect_jacobian.T @ here.innovations]
    ) - np.concatenate(residual)
    low, high = _step_bounds(candidate, wide, records)
    while True:
        step = solve_box_constrained(normal + damping * np.eye(wide.size), onto, low, high) * wide
        moved = _moved(candidate, step)
        residuals = evaluate(moved, records, here.paths, here.walk)
        cost = _cost(moved, residuals, weight)
        if cost < here.cost:
            return moved, cost, residuals, damping / 10
        if damping > MAX_DAMPING:
            return moved, cost, residuals, damping
        damping *= 30


def _step_bounds(candidate: Candidate, wide: Array, records: Sequence[Record]) -> tuple[Array, Array]:
    """The least and the greatest step (P + Q,) [prior standard deviations]: to the bounds of theta, and of an element's
    start a part of its limit only, because an element that begins to slip has another slope. No step is always within
    them: a limit that has shrunk may leave a start beyond it."""
    layout, stride = candidate.layout, np.full(wide.size, np.inf)
    stride[layout.of("initial_friction_state")] = START_STRIDE
    low, high = -stride, stride.copy()
    count = layout.count
    least, most = bounds(layout, candidate.theta)
    low[:count] = np.minimum(np.maximum(low[:count], (least - candidate.theta) / wide[:count]), 0.0)
    high[:count] = np.maximum(np.minimum(high[:count], (most - candidate.theta) / wide[:count]), 0.0)
    end = count
    for effect in candidate.effects:
        items = [one for one in parameters(type(effect), layout.machine.priors) if one.role in POSITIVE]
        end += coordinates(effect).size
        longest = np.array([10 * fine_step(item, effect, records) or STRIDE for item in items])
        shapes = slice(end - longest.size, end)
        low[shapes], high[shapes] = -longest / wide[shapes], longest / wide[shapes]
    return low, high


def solve_box_constrained(normal: Array, onto: Array, low: Array, high: Array) -> Array:
    """The step (P,) that minimises step @ normal @ step / 2 - onto @ step [1] where low <= step <= high."""
    step, free = np.clip(np.zeros(onto.size), low, high), low < high
    if not free.any():
        return step
    factor = cholesky(normal[np.ix_(free, free)])
    given = solve_triangular(factor, onto[free] - normal[np.ix_(free, ~free)] @ step[~free], trans="T")
    step[free] = scipy.optimize.lsq_linear(factor, given, (low[free], high[free]), method="bvls").x
    return step


def _prior_residual(effect: Effect, priors: Priors) -> Array:
    """Coordinates in prior standard deviations (Q,) [1]: of amplitudes from 0; shapes have no preferred value."""
    relative = coordinates(effect) / prior_std(effect, priors)
    shapes = sum(item.role in POSITIVE for item in parameters(type(effect)))
    relative[relative.size - shapes :] = 0.0
    return relative


def _moved(candidate: Candidate, step: Array) -> Candidate:
    layout = candidate.layout
    count = layout.count
    theta = bounded(layout, candidate.theta + step[:count])
    effects, at_ = [], count
    for effect in candidate.effects:
        here = coordinates(effect)
        effects.append(with_coordinates(effect, here + step[at_ : at_ + here.size], layout.machine.priors))
        at_ += here.size
    return replace(candidate, theta=theta, effects=tuple(effects))


def _cost(candidate: Candidate, residuals: Sequence[Residual], weight: Array) -> float:
    """-2 log of the posterior density, up to a constant."""
    e = _innovations(residuals, weight)
    scale = sum(2 * (one.innovations.size - STARTING) * float(np.log(one.deviation)) for one in residuals)
    layout, priors = candidate.layout, candidate.nominal.priors
    residual = [candidate.theta / layout.deviation, *(_prior_residual(one, priors) for one in candidate.effects)]
    return float(e @ e) + scale + sum(float(part @ part) for part in residual)


def _innovations(residuals: Sequence[Residual], weight: Array) -> Array:
    """The innovations of all records (n,) [1], those of the first samples set to 0."""
    return np.concatenate([one.innovations for one in residuals]) * weight
