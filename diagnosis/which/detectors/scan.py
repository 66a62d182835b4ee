"""Every effect of the catalogue against what a fit leaves: one pass over grids of their shapes, by linear algebra.

An effect's columns are the changes that it would make in the innovations at a point of its grid. The nominal parameters
and the effects already in the model are partialled out of columns and innovations, within their priors (Frisch, Waugh
and Lovell). Products of what remains are summed for each motion, so that a fold of a cross-validation costs small sums.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.fft import rfft
from scipy.linalg import cho_factor, cho_solve

from diagnosis.model.fit import PRIOR_ROOM_FACTOR, Fit, effects_prior_std, weights
from diagnosis.model.kalman import adjoint
from diagnosis.model.parallel import parallel_map
from diagnosis.model.residual import columns, driving
from diagnosis.which.detectors.resonances import resonances
from models.compiled import compiled
from models.effects.base import VISIBLE_SIGNALS, Effect, Place, parameters
from models.effects.catalogue import in_order
from models.effects.parameter import POSITIVE, Parameter
from models.effects.priors import Priors
from models.plant import Mode
from models.records.record import Record

Array = NDArray[np.float64]
Columns = Mapping[Effect, NDArray[Any]]  # (n, 1) or (n, 2) each [1]

FOLDS: Final = 6  # Cross-validation folds.
# Points of a grid over a shape or width of a decade or two, where its declaration says nothing.
SHAPE_POINTS: Final = 6
BATCH: Final = 24  # Columns that are filtered in one pass.
# A range with fewer lines of a spectrum than this gets this many evenly spaced points instead.
MIN_RANGE_LINES: Final = 8
PEAKS: Final = 4  # The strongest lines of each decade of a spectrum that become points of a grid.
OVERTONES: Final = 3  # The jumps of a staircase have overtones, so a line may be of one up to this order.
MIN_ORTHOGONAL_FRACTION: Final = 0.3
"""A column is reused in another fit only if at least this share of its energy is orthogonal to the fit's own
parameters: of what they mostly explain, too little remains for it to be the same in both."""
HIGHEST: Final = 0.8  # of half the sampling rate: above, the samples hold too little of an oscillation to name it
MAX_SPECTRUM_BINS: Final = 1 << 24  # A spectrum over a coordinate has no more: 0.13 GB.
PADDED: Final = {"position": 8, "reading": 2, "command": 2, "time": 2}
"""Times its coordinate's extent over which a spectrum is taken, so that a line is found between its bins."""


@dataclass(frozen=True)
class Finding:
    """An effect at its best point of the grid, and by how much it reduces chi-square on all motions and on held-out
    motions [1]; forbidden: by how much one of the other sign would at most, where it can have only one."""

    effect: Effect
    gain: float
    held_out: float
    forbidden: float = 0.0


@dataclass(frozen=True)
class NuisanceProjection:
    """The projection that partials out a model's parameters: the innovations e (n,) after it, each sample's motion
    (n,), each motion's fold, the basis (n, B) of the parameters and the Cholesky factor of its normal equations."""

    e: Array
    segment: NDArray[np.int64]
    fold: NDArray[np.int64]
    basis: Array
    factor: tuple[Array, bool]

    def __call__(self, given: NDArray[Any]) -> NDArray[Any]:
        """Columns (n, k) with the model's parameters partialled out [1], in the precision in which they are given."""
        basis = self._single if given.dtype == np.float32 else self.basis
        parts = cho_solve(self.factor, (basis.T @ given).astype(float, copy=False))
        out = basis @ parts.astype(given.dtype, copy=False)
        return np.asarray(np.subtract(given, out, out=out))

    @cached_property
    def in_fold(self) -> Array:
        """Whether a motion is in a fold, as a number (FOLDS, S) [1]: sums over folds are products with it."""
        return np.asarray(self.fold == np.arange(FOLDS)[:, None], float)

    @cached_property
    def _single(self) -> NDArray[np.float32]:
        """The basis in single precision, in which a scan's thousand columns are projected three times as fast. Its
        rounding is a ten-millionth of a column, and so far below what any column has to gain."""
        return self.basis.astype(np.float32)


def partial_out(fitted: Fit, segment: NDArray[np.int64], seed: int = 0) -> NuisanceProjection:
    """The projection for a fit; segment (n,): the number of the motion that each sample belongs to. Its e is [1]."""
    candidate = fitted.candidate
    layout, theta = candidate.layout, candidate.theta
    margin = 0.01 * (layout.high - layout.low)
    inside = (theta > layout.low + margin) & (theta < layout.high - margin)
    free = np.where(inside, layout.deviation, 0.0)  # a parameter at its bound is held there
    basis = np.hstack([fitted.slopes * free, fitted.effect_jacobian * effects_prior_std(candidate)])
    factor = cho_factor(basis.T @ basis + np.eye(basis.shape[1]))
    count = int(segment.max()) + 1
    fold = np.random.default_rng(seed).permutation(count) % FOLDS
    pull = np.concatenate([theta / layout.deviation, np.zeros(fitted.effect_jacobian.shape[1])]) * (
        np.any(basis != 0, axis=0)
    )
    e = fitted.innovations - basis @ cho_solve(factor, basis.T @ fitted.innovations + pull)
    return NuisanceProjection(e, segment, fold, basis, factor)


def scan(
    fitted: Fit,
    records: Sequence[Record],
    projection: NuisanceProjection,
    left_out: Collection[str] = (),
    known: Columns = MappingProxyType({}),
) -> tuple[list[Finding], Columns]:
    """The catalogue's effects, each at the point of its grid that gains the most on held-out motions, best first; and
    columns (n, k) [1], in single precision, that another fit of these references can reuse, as they are the same to
    first order (see MIN_ORTHOGONAL_FRACTION).

    known: such columns of another fit with the same random forces, used in place of columns along this fit's path.
    """
    trials: list[Effect] = []
    for name, kind in fitted.candidate.nominal.kinds.items():
        if name not in left_out and kind.shown_in() in VISIBLE_SIGNALS:
            trials += grid(kind, fitted, records, projection)
    found, columns = dict[str, Finding](), dict[Effect, NDArray[Any]]()
    inside = {effect.name for effect in fitted.candidate.effects}
    known = {effect: given for effect, given in known.items() if effect.name not in inside}  # its own kind differs more
    batches = [*_batched([e for e in trials if e not in known]), *_batched([e for e in trials if e in known])]
    for findings, kept in parallel_map(lambda batch: _findings(batch, fitted, records, projection, known), batches):
        columns |= kept
        for finding in findings:
            before = found.setdefault(finding.effect.name, finding)
            best = max(before, finding, key=lambda one: one.held_out)
            found[finding.effect.name] = replace(best, forbidden=max(before.forbidden, finding.forbidden))
    return sorted(found.values(), key=lambda finding: -finding.held_out), columns


def _batched(trials: Sequence[Effect]) -> Iterator[tuple[Effect, ...]]:
    for i in range(0, len(trials), BATCH):
        yield tuple(trials[i : i + BATCH])


def _findings(
    batch: Sequence[Effect], fitted: Fit, records: Sequence[Record], projection: NuisanceProjection, known: Columns
) -> tuple[list[Finding], Columns]:
    raw = [known[effect] for effect in batch] if batch[0] in known else linear_columns(batch, fitted, records)
    priors = fitted.candidate.nominal.priors
    products, slopes = by_segment(projection(np.hstack(raw, dtype=np.float32)), projection)
    found, kept, begin = list[Finding](), dict[Effect, NDArray[Any]](), 0
    for effect, given in zip(batch, raw, strict=True):
        end = begin + given.shape[1]
        found.append(finding_of(effect, products[:, begin:end], slopes[:, begin:end], projection, priors))
        shown = products[:, begin:end, 0].sum() > MIN_ORTHOGONAL_FRACTION * np.sum(given**2)
        if shown and not effect.differentiates:
            kept[effect] = given.astype(np.float32, copy=effect not in known)
        begin = end
    return found, kept


def linear_columns(batch: Sequence[Effect], fitted: Fit, records: Sequence[Record]) -> list[NDArray[Any]]:
    """The change of the innovations by each effect's linear parts: (n, 1) or (n, 2) [1] each."""
    parts = [linear_parts(effect, fitted.candidate.nominal.priors) for effect in batch]
    variants = list(itertools.chain.from_iterable(parts))
    added = [in_order((*fitted.candidate.effects, variant)) for variant in variants]
    whole = columns(fitted.candidate, added, records, fitted.paths, fitted.residuals, fitted.walk)
    whole *= weights(records)[:, None]
    ends = np.cumsum(list(map(len, parts)))
    return np.split(whole, ends[:-1], axis=1)


def finding_of(
    effect: Effect, products: Array, slopes: Array, projection: NuisanceProjection, priors: Priors
) -> Finding:
    """The effect's amplitude by least squares in a machine of these priors, and its gains [1], from the sums of
    `by_segment` for its one or two columns: products (S, k, 2), slopes (S, k)."""
    k = slopes.shape[1]
    grams = products[:, :, :1] * np.eye(k)
    if k == 2:  # a sine and a cosine
        grams[:, 0, 1] = grams[:, 1, 0] = products[:, 0, 1]
    ridge = np.diag(1e-9 * np.diag(grams.sum(axis=0)) + 1e-12)
    total, slope = grams.sum(axis=0) + ridge, slopes.sum(axis=0)
    best = -np.linalg.solve(total, slope)
    gain = float(-(2 * slope @ best + best @ total @ best))
    if not _possible(effect, best):
        return Finding(effect, 0.0, 0.0, forbidden=gain)
    gram, by = np.tensordot(projection.in_fold, grams, 1), projection.in_fold @ slopes
    trained = -np.linalg.solve(total - gram, (slope - by)[:, :, None])
    held_out = -float(np.sum(trained * (2 * by[:, :, None] + gram @ trained)))
    return Finding(sized(effect, best, priors), gain, held_out)


def _possible(effect: Effect, factor: Array) -> bool:
    """Whether the amplitude or width times this factor has a sign that the effect can have."""
    if factor.size > 1:
        return True
    item = next(item for item in parameters(type(effect)) if item.role in {"amplitude", "width"})
    return bool(factor[0] > 0 or item.low < 0)


def by_segment(given: NDArray[Any], projection: NuisanceProjection) -> tuple[Array, Array]:
    """Sums over each of S motions of products of columns (n, k) after the projection: of each with itself and with the
    next (S, k, 2), and with the innovations (S, k); all [1]. One pass, because the columns of a batch are large."""
    products, slopes = (
        np.zeros((projection.fold.size, given.shape[1], 2)),
        np.zeros((projection.fold.size, given.shape[1])),
    )
    _sums(given, projection.e, projection.segment, products, slopes)
    return products, slopes


@compiled
def _sums(given: NDArray[Any], e: Array, segment: NDArray[np.int64], products: Array, slopes: Array) -> None:
    n, k = given.shape
    for t in range(n):
        s = segment[t]
        for i in range(k):
            slopes[s, i] += given[t, i] * e[t]
            products[s, i, 0] += given[t, i] * given[t, i]
        for i in range(k - 1):
            products[s, i, 1] += given[t, i] * given[t, i + 1]


def quadratures(effect: Effect) -> tuple[Effect, ...]:
    """The effect as it is, or with a phase the same at 0 and at a quarter turn; SI."""
    phases = [item.name for item in parameters(type(effect)) if item.role == "phase"]
    if not phases:
        return (effect,)
    return tuple(replace(effect, **{phases[0]: angle}) for angle in (0.0, np.pi / 2))


def linear_parts(effect: Effect, priors: Priors) -> tuple[Effect, ...]:
    """What the effect is a sum of, each at its typical size (SI) in a machine of these priors: its quadratures, or a
    part for each of its amplitudes."""
    items = [item for item in parameters(type(effect), priors) if item.role == "amplitude"]
    if len(items) < 2:
        return quadratures(effect)
    alone = ({item.name: item.typical if item is one else 0.0 for item in items} for one in items)
    return tuple(replace(effect, **sizes) for sizes in alone)


def sized(effect: Effect, factor: Array, priors: Priors) -> Effect:
    """The effect with its amplitude or width times a factor (1,), or with the sizes (2,) of its linear parts; [1]."""
    items = parameters(type(effect), priors)
    several = [item for item in items if item.role == "amplitude"]
    if factor.size == len(several) > 1:
        return replace(effect, **{item.name: item.typical * float(f) for item, f in zip(several, factor, strict=True)})
    if factor.size == 2:
        size = next(item.name for item in items if item.role == "amplitude")
        angle = next(item.name for item in items if item.role == "phase")
        c, s = factor
        return replace(
            effect,
            **{size: getattr(effect, size) * float(np.hypot(c, s)), angle: float(np.arctan2(s, c) % (2 * np.pi))},
        )
    changed = {}
    for item in items:
        if item.role == "amplitude":
            changed[item.name] = getattr(effect, item.name) * float(factor[0])
        elif item.role == "width" and not item.periodic_in:
            changed[item.name] = getattr(effect, item.name) * float(np.clip(factor[0], 0.3, 3.0))
    return replace(effect, **changed)


def grid(kind: type[Effect], fitted: Fit, records: Sequence[Record], projection: NuisanceProjection) -> list[Effect]:
    """The effect at the points of its grid: shapes and widths spaced by logarithm, periods evenly in their frequency or
    from a spectrum, every law of a switch."""
    priors, axes = fitted.candidate.nominal.priors, []
    if (placed := kind.placed(fitted.candidate.nominal.plant)) is not None:
        return list(placed)
    nyquist = 0.5 / records[0].sample_time
    for item in parameters(kind, priors):
        if item.role == "switch":
            axes.append([(item.name, law) for law in range(int(item.high) + 1)])
        elif item.periodic_in and (item.stated or not item.points):  # a grid's points might all be too far off
            found = _from_spectrum(item, item.widest, kind, fitted, records, projection)
            axes.append([(item.name, point) for point in np.array(found)])
        elif item.role in POSITIVE:
            found = []
            if item.is_resonance:  # narrower than the distance of two points
                high = min(item.high, HIGHEST * nyquist)
                ranges = [(item.widest[0], item.low), (item.low, high), (high, item.widest[1])]
                within = [one for one in ranges if one[1] > PRIOR_ROOM_FACTOR * one[0]]
                found = _ringing(item, within, kind, fitted, records, projection)
            elif item.widest[0] < item.low / PRIOR_ROOM_FACTOR:
                found = _from_spectrum(item, (item.widest[0], item.low), kind, fitted, records, projection)
            shown = _points(item) if item.unit != "Hz" else _points(item)[_points(item) <= HIGHEST * nyquist]
            axes.append([(item.name, point) for point in (*shown, *np.array(found))])
    return [replace(kind.typical(priors), **dict(point)) for point in itertools.product(*axes)]


def _ringing(
    item: Parameter,
    ranges: Sequence[tuple[float, float]],
    kind: type[Effect],
    fitted: Fit,
    records: Sequence[Record],
    projection: NuisanceProjection,
) -> list[float]:
    """Frequencies [Hz] of a mode within each of some ranges [Hz], where the records ring most as it would."""
    typical = kind.typical(fitted.candidate.nominal.priors)
    forces = (driving(typical, one.force, one.acts).mean(axis=1) for one in fitted.residuals)
    parts = ((force, left) for force, (_, _, left) in zip(forces, adjoints(fitted, records, projection), strict=True))

    def mode(frequency: float) -> Mode:
        return replace(typical, **{item.name: frequency}).modes()[0]

    return resonances(parts, records[0].sample_time, ranges, mode, PEAKS)


def _points(item: Parameter) -> Array:
    """The points [SI] of a parameter's grid."""
    count = item.points or SHAPE_POINTS
    if item.points_per_decade:
        count = max(item.points_per_decade, round(item.points_per_decade * np.log10(item.high / item.low)))
    if item.role != "period":
        return np.geomspace(item.low, item.high, count)
    if item.is_frequency:
        return np.linspace(item.low, item.high, count)
    return np.asarray(1 / np.linspace(1 / item.high, 1 / item.low, count))


def adjoints(
    fitted: Fit, records: Sequence[Record], projection: NuisanceProjection
) -> Iterator[tuple[Record, Array, Array]]:
    """For each record the gradient of half of chi-square with respect to a force (n,) [1/N] and to an error of the
    reading (n,) [1/m] at each sample."""
    begin = 0
    for i, record in enumerate(records):
        model = fitted.candidate.predictor(record.sample_time, fitted.walk, i)
        force, reading = adjoint(model, projection.e[begin : begin + record.position.size])
        begin += record.position.size
        yield record, force.sum(axis=1), reading


def _from_spectrum(
    item: Parameter,
    within: Sequence[float],
    kind: type[Effect],
    fitted: Fit,
    records: Sequence[Record],
    projection: NuisanceProjection,
) -> list[float]:
    """Values [SI] of a periodic parameter within a range [SI], at the peaks of the spectrum, over its coordinate, of
    what the model leaves.

    That is the error of the reading, or of the force, which is weighted by what the law's periodic factor multiplies.
    """
    spans = []
    for record, force, reading in adjoints(fitted, records, projection):
        left = reading if kind.shown_in() == "reading" else force * _multiplied(kind, item, record)
        spans.append((_coordinate(item.periodic_in, record, fitted), left))
    if item.role == "width":
        most = PRIOR_ROOM_FACTOR * within[1]
        found = peaks(spans, within[0], most, PADDED[item.periodic_in])
        return sorted({n * step for step in found for n in range(1, OVERTONES + 1) if n * step <= most})
    low, high = (1 / within[1], 1 / within[0]) if item.is_frequency else within
    periods = peaks(spans, low, high, PADDED[item.periodic_in])
    return [1 / period for period in periods] if item.is_frequency else periods


def _coordinate(name: str, record: Record, fitted: Fit) -> Array:
    """The coordinate (n,) [m], [N] or [s] of a spectrum; a command counts when it acts, after the dead time."""
    if name == "time":
        return np.arange(record.position.size, dtype=float) * record.sample_time
    if name == "command":
        delay = round(fitted.candidate.machine.plant.dead_time / record.sample_time)
        return np.concatenate([np.full(delay, record.command[0]), record.command])[: record.command.size]
    return record.position


def _multiplied(kind: type[Effect], item: Parameter, record: Record) -> Array:
    """What (n,) the periodic factor of a law multiplies in the force, but for its size, by where the law acts: the
    command on the way to the thrust, the friction, of which the sign of the speed is the main part, or nothing [1]."""
    place = min(kind.hooks)
    if item.periodic_in == "command" or place in {Place.FORCE, Place.PATH}:
        return np.ones(record.position.size)
    return np.sign(np.gradient(record.position)) if place in {Place.LIMIT, Place.FRICTION} else record.command


def peaks(spans: Sequence[tuple[Array, Array]], low: float, high: float, padded: int = 2) -> list[float]:
    """The periods between low and high at which sines of a coordinate agree the most with weights (n,), over all spans
    [unit of the coordinate], of each decade the first few: what is left of long waves would hide all short ones.
    padded: times its extent that the spectrum is taken over; from 4 on the lines of a peak count once [1]. Periods
    below about MAX_SPECTRUM_BINS^-1 of the extent are not searched for: memory is bounded."""
    extent = max(float(np.ptp(coordinate)) for coordinate, _ in spans)
    width = max(low / 8, padded * max(extent, 2 * high) / MAX_SPECTRUM_BINS)
    count = int(2 ** np.ceil(np.log2(padded * max(extent, 2 * high) / width)))
    if (1 / low - 1 / high) * count * width < MIN_RANGE_LINES:  # a range too narrow for a spectrum
        return [float(1 / wave) for wave in np.linspace(1 / high, 1 / low, MIN_RANGE_LINES)]
    power = np.zeros(count // 2 + 1, np.float32)  # single precision does: lines are only ranked by it
    size = max(float(np.max(np.abs(weight))) for _, weight in spans) or 1.0
    for coordinate, weight in spans:
        bins = np.floor((coordinate - coordinate.min()) / width).astype(int)
        power += np.abs(rfft(np.bincount(bins, weight / size, count).astype(np.float32))) ** 2
    frequency = np.fft.rfftfreq(count, width)
    edges = np.geomspace(1 / high, 1 / low, 1 + max(round(np.log10(high / low)), 1))
    found: list[float] = []
    for begin, end in itertools.pairwise(edges):
        inside = np.flatnonzero((frequency >= begin) & (frequency <= end))
        most = len(found) + PEAKS
        for i in inside[np.argsort(-power[inside])]:
            apart = 1 / (extent * frequency[i]) if padded >= 4 else 2e-3
            if all(abs(1 / frequency[i] - period) > apart * period for period in found):
                found.append(float(1 / frequency[i]))
            if len(found) == most:
                break
    return found
