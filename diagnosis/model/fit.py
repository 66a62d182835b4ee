"""Fits a candidate to records: theta and the parameters of its effects jointly, by damped Gauss and Newton's steps.

The cost is that of the posterior: squared whitened innovations and squared deviations from the priors. An effect's
coordinates: an amplitude and a phase as its cosine and sine part, a shape or a width as its logarithm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.model.motions import Piece, repeated, scatter
from diagnosis.model.parameters import bounded
from diagnosis.model.residual import STARTING, WALK, Candidate, Seen, Smoothed, columns, look, nominal_slopes, smooth
from models.effects.base import Effect, Parameter, parameters
from models.records.record import Record

Array = NDArray[np.float64]

ROOM: Final = 1.5  # by which a shape or a width may leave its prior range
SMALL: Final = 20.0  # by which a width may be below its prior range: that is a small effect, and no other law
STRIDE: Final = 0.7  # the most that a step moves the logarithm of a shape or a width
START_STRIDE: Final = 1.0  # the most that a step moves an element's start, in prior deviations
DAMPED: Final = 1e5  # damping beyond which no step is tried
OF_PERIOD: Final = 0.02  # of a period, by which the last one in the travel moves in a step of a derivative
ENOUGH: Final = 10.0  # a step that gains less chi-square ends the fit


FEW: Final = 4  # equal motions, of all groups together, that tell what does not repeat
SPIKE: Final = 8.0  # deviations, of an innovation that no noise makes


@dataclass(frozen=True)
class Fit:
    """A fitted candidate, its paths, what it leaves, and of the last linearisation: the innovations e (n,) of all
    records, which of them count, slopes by theta (n, P), slopes by the effects' coordinates (n, Q), cost."""

    candidate: Candidate
    paths: tuple[Smoothed, ...]
    seen: tuple[Seen, ...]
    innovations: Array
    slopes: Array
    own: Array
    cost: float
    walk: float


def weights(records: Sequence[Record]) -> Array:
    """1 for every sample of all records (n,) that counts, 0 for those in which the state settles; [1]."""
    parts = [np.ones(record.position.size) for record in records]
    for part in parts:
        part[:STARTING] = 0.0
    return np.concatenate(parts)


def unrepeated(fitted: Fit, records: Sequence[Record], pieces: Sequence[Piece]) -> Array:
    """What of a fit's innovations (n,) [1] does not repeat between equal motions; not a number where nothing is equal,
    nor anywhere if fewer than FEW motions are."""
    groups, whole = repeated(pieces, records), fitted.innovations.copy()
    if sum(map(len, groups)) < FEW:
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
    begin = np.cumsum([0, *(seen.innovations.size for seen in fitted.seen)])
    record = int(np.searchsorted(begin, number, side="right")) - 1
    size = float(np.abs(fitted.innovations[number]) / np.std(fitted.innovations))
    return Largest(record, number - int(begin[record]), size)


def coordinates(effect: Effect) -> Array:
    """The effect's coordinates (Q,): see the module's head; [SI and logarithms of SI]."""
    rows, size, phase = [], 0.0, None
    for item in parameters(type(effect)):
        number = getattr(effect, item.name)
        if item.role == "amplitude":
            size = number
        elif item.role == "phase":
            phase = number
        elif item.role != "switch":
            rows.append(np.log(number))
    linear = amplitudes(effect)
    if phase is None:
        return np.array([*linear, *rows])
    return np.array([size * np.cos(phase), size * np.sin(phase), *rows])


def amplitudes(effect: Effect) -> list[float]:
    """The effect's amplitudes with their signs [SI]; none of one that has a width."""
    return [getattr(effect, item.name) for item in parameters(type(effect)) if item.role == "amplitude"]


def at(effect: Effect, where: Array) -> Effect:
    """The effect at other coordinates (Q,) [SI and logarithms of SI], its shapes kept near their prior range."""
    items = parameters(type(effect))
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
    shapes = [item for item in items if item.role in {"shape", "width"}]
    for item, number in zip(shapes, rest, strict=True):
        changed[item.name] = float(np.clip(np.exp(number), *_within(item)))
    return replace(effect, **changed)


def _within(item: Parameter) -> tuple[float, float]:
    """Where a shape or a width may go [SI]."""
    return item.low / (SMALL if item.role == "width" else ROOM), item.high * ROOM


def spread(effect: Effect) -> Array:
    """Prior deviations (Q,) of the coordinates: the largest typical amplitude, and a wide one for a logarithm; [SI]."""
    items = parameters(type(effect))
    size = [max(abs(item.low), abs(item.high)) for item in items if item.role == "amplitude"]
    if any(item.role == "phase" for item in items):
        size = size * 2
    return np.array([*size, *(np.log(item.high / item.low) for item in items if item.role in {"shape", "width"})])


def own_spread(effects: Sequence[Effect]) -> Array:
    """Prior deviations (Q,) of the coordinates of all effects, in their order; [SI and logarithms of SI]."""
    return np.concatenate([np.zeros(0), *(spread(effect) for effect in effects)])


def slopes_of(
    candidate: Candidate, records: Sequence[Record], paths: Sequence[Smoothed], seen: Sequence[Seen], walk: float = WALK
) -> Array:
    """How the innovations (n,) change with the coordinates of the effects, in their order: (n, Q)
    [1/SI and 1 for logarithms]."""
    trials, steps = [], []
    for i, effect in enumerate(candidate.effects):
        here, small = coordinates(effect), difference_steps(effect, fineness(effect, records))
        for j in range(here.size):
            where = here + small * (np.arange(here.size) == j)
            trials.append((*candidate.effects[:i], at(effect, where), *candidate.effects[i + 1 :]))
            steps.append(small[j])
    if not trials:
        return np.zeros((sum(record.position.size for record in records), 0))
    return np.asarray(columns(candidate, trials, records, paths, seen, walk) / np.array(steps))


def at_bounds(effect: Effect) -> bool:
    """Whether a shape or a width stands where the fit may go no further, so that the law is bent to something else.

    Many periods of a usual fine one tell its length to a part of a million: none but its own agrees with them.
    """
    if effect.fine and not effect.period_stated:
        return False
    for item in parameters(type(effect)):
        number = getattr(effect, item.name)
        low, high = _within(item)
        if item.role in {"shape", "width"} and not low * 1.02 < number < high / 1.02:
            return True
    return False


def fineness(effect: Effect, records: Sequence[Record]) -> float:
    """The relative step [1] with which a fit moves the effect's shape or width where its usual one is too large, or 0:
    for a period that a machine states, such that the last one in the records' travel is moved by a part of it."""
    if not effect.period_stated:
        return effect.fine
    travel = max(float(np.ptp(record.position)) for record in records)
    period = float(getattr(effect, effect.period_field))
    return OF_PERIOD * period / max(travel, period)


def difference_steps(effect: Effect, fine: float = 0.0) -> Array:
    """Steps (Q,) of numerical derivatives by the coordinates: a hundredth of the typical amplitude, `fine` of a shape
    or width where that is not 0; [SI]."""
    items = parameters(type(effect))
    size = [0.01 * item.typical for item in items if item.role == "amplitude"]
    if any(item.role == "phase" for item in items):
        size = size * 2
    small = {"shape": 0.02, "width": 0.05}
    shapes = [small[item.role] for item in items if item.role in small]
    return np.array([*size, *(fine or shape for shape in shapes)])


def fit(
    candidate: Candidate,
    records: Sequence[Record],
    *,
    paths: Sequence[Smoothed] | None = None,
    iterations: int = 8,
    walk: float = WALK,
) -> Fit:
    """The candidate fitted, from where it stands; walk: of the unknown force [N a sample]."""
    weight = weights(records)
    known = tuple(paths) if paths else smooth(candidate, records)
    seen = look(candidate, records, known, walk)
    cost, damping = _cost(candidate, seen, weight), 1.0
    for _ in range(iterations):
        here = _linearised(candidate, records, known, seen, weight, walk)
        moved, after, now, damping = _search(here, records, weight, damping)
        if after >= cost:
            break
        candidate, seen, gained, cost = moved, now, cost - after, after
        known = smooth(candidate, records, known)
        seen = look(candidate, records, known, walk)
        cost = _cost(candidate, seen, weight)
        if gained < ENOUGH:
            break
    return _linearised(candidate, records, known, seen, weight, walk)


def one_step(candidate: Candidate, records: Sequence[Record], *, walk: float = WALK) -> Fit:
    """The candidate fitted by one step, where it stands so near that the paths and slopes before the step, which it
    keeps, hold behind it, too; walk: of the unknown force [N a sample]."""
    weight, paths = weights(records), smooth(candidate, records)
    here = _linearised(candidate, records, paths, look(candidate, records, paths, walk), weight, walk)
    moved, cost, seen, _ = _search(here, records, weight, damping=1.0)
    if cost >= here.cost:
        return here
    return replace(here, candidate=moved, seen=seen, innovations=_innovations(seen, weight), cost=cost)


def _linearised(
    candidate: Candidate,
    records: Sequence[Record],
    paths: Sequence[Smoothed],
    seen: Sequence[Seen],
    weight: Array,
    walk: float,
) -> Fit:
    slopes, own = nominal_slopes(candidate, records, seen, walk), slopes_of(candidate, records, paths, seen, walk)
    slopes *= weight[:, None]
    own *= weight[:, None]
    return Fit(
        candidate,
        tuple(paths),
        tuple(seen),
        _innovations(seen, weight),
        slopes,
        own,
        _cost(candidate, seen, weight),
        walk,
    )


def _search(
    here: Fit, records: Sequence[Record], weight: Array, damping: float
) -> tuple[Candidate, float, tuple[Seen, ...], float]:
    """Levenberg and Marquardt's step: the first damping, from the last one on, with which less is left; its candidate,
    cost, what it leaves and the damping for the next step. If none does, the last tried and its larger cost."""
    candidate, layout = here.candidate, here.candidate.layout
    wide = np.concatenate([layout.deviation, own_spread(candidate.effects)])
    stands = np.concatenate([candidate.theta / layout.deviation, *(_stand(effect) for effect in candidate.effects)])
    crossed = here.slopes.T @ here.own
    whole = np.block([[here.slopes.T @ here.slopes, crossed], [crossed.T, here.own.T @ here.own]])
    normal = wide[:, None] * whole * wide + np.eye(wide.size)
    onto = -wide * np.concatenate([here.slopes.T @ here.innovations, here.own.T @ here.innovations]) - stands
    low, high = _room(candidate, wide, records)
    while True:
        step = within(normal + damping * np.eye(wide.size), onto, low, high) * wide
        moved = _moved(candidate, step)
        seen = look(moved, records, here.paths, here.walk)
        cost = _cost(moved, seen, weight)
        if cost < here.cost:
            return moved, cost, seen, damping / 10
        if damping > DAMPED:
            return moved, cost, seen, damping
        damping *= 30


def _room(candidate: Candidate, wide: Array, records: Sequence[Record]) -> tuple[Array, Array]:
    """How far a step may go down and up (P + Q,) [of the prior deviations]: to the bounds, and a part of an element's
    limit for its start, because an element that slips elsewhere has another slope."""
    layout, stride = candidate.layout, np.full(wide.size, np.inf)
    stride[layout.of("initial_friction_state")] = START_STRIDE
    low, high = -stride, stride.copy()
    count = layout.count
    low[:count] = np.maximum(low[:count], (layout.low - candidate.theta) / wide[:count])
    high[:count] = np.minimum(high[:count], (layout.high - candidate.theta) / wide[:count])
    begin = count
    for effect in candidate.effects:
        size = coordinates(effect).size
        shapes = slice(begin + size - _shapes(effect), begin + size)
        longest = 10 * fine if (fine := fineness(effect, records)) else STRIDE
        low[shapes], high[shapes] = -longest / wide[shapes], longest / wide[shapes]
        begin += size
    return low, high


def _shapes(effect: Effect) -> int:
    return sum(item.role in {"shape", "width"} for item in parameters(type(effect)))


def within(normal: Array, onto: Array, low: Array, high: Array) -> Array:
    """The step (P,) that solves normal @ step = onto (P,) [1] where low <= step <= high; the rest is at a bound."""
    step, free = np.zeros(onto.size), np.ones(onto.size, bool)
    for _ in range(onto.size):
        fixed = ~free
        step[free] = np.linalg.solve(normal[np.ix_(free, free)], onto[free] - normal[np.ix_(free, fixed)] @ step[fixed])
        beyond = free & ((step < low) | (step > high))
        if not beyond.any():
            break
        step[beyond] = np.clip(step, low, high)[beyond]
        free &= ~beyond
    return np.asarray(np.clip(step, low, high))


def _stand(effect: Effect) -> Array:
    """Coordinates in prior deviations (Q,): amplitudes about 0; shapes have no preferred value."""
    here, wide = coordinates(effect), spread(effect)
    relative = here / wide
    relative[here.size - _shapes(effect) :] = 0.0
    return relative


def _moved(candidate: Candidate, step: Array) -> Candidate:
    count = candidate.layout.count
    theta = bounded(candidate.layout, candidate.theta + step[:count])
    effects, at_ = [], count
    for effect in candidate.effects:
        here = coordinates(effect)
        effects.append(at(effect, here + step[at_ : at_ + here.size]))
        at_ += here.size
    return replace(candidate, theta=theta, effects=tuple(effects))


def _cost(candidate: Candidate, seen: Sequence[Seen], weight: Array) -> float:
    """-2 log of the posterior, but for a constant."""
    e = _innovations(seen, weight)
    scale = sum(2 * (one.innovations.size - STARTING) * float(np.log(one.deviation)) for one in seen)
    stands = [candidate.theta / candidate.layout.deviation, *(_stand(effect) for effect in candidate.effects)]
    return float(e @ e) + scale + sum(float(stand @ stand) for stand in stands)


def _innovations(seen: Sequence[Seen], weight: Array) -> Array:
    """Those of all records (n,) [1] that count."""
    return np.concatenate([one.innovations for one in seen]) * weight
