"""Every effect of the catalogue against what a fit leaves: one pass over grids of their shapes, by linear algebra.

An effect's columns are what it would change of the innovations at a point of its grid. Columns and innovations are
freed of all that the nominal parameters and the effects already in the model explain (with their priors); the rest is
compared motion by motion, so that every fold of a cross-validation is small algebra on sums.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from diagnosis.model.fit import ROOM, Fit, own_spread, weights
from diagnosis.model.kalman import adjoint
from diagnosis.model.parallel import parallel_map
from diagnosis.model.residual import columns
from models.compiled import compiled
from models.effects.base import SHOWN, Effect, parameters
from models.effects.catalogue import in_order
from models.records.record import Record

Array = NDArray[np.float64]
Columns = Mapping[Effect, NDArray[Any]]  # (n, 1) or (n, 2) each [1]
Weight = Callable[[Record], Array]

FOLDS: Final = 6
POINTS: Final = 6  # of a grid over a shape of a decade or two
GRID: Final = {"frequency": 22, "length": 18, "pitch": 10, "damping": 2}  # points of these shapes
DECADE: Final = {"distance": 2}  # and of these in each decade
BATCH: Final = 24  # columns that are filtered side by side
LINES: Final = 8  # of a spectrum that have to lie within a range, and points of a grid where fewer do
PEAKS: Final = 4  # of a spectrum that are looked at
REMAINS: Final = 0.3  # of a column that the model's own parameters must leave for it to be another fit's as well


@dataclass(frozen=True)
class Finding:
    """An effect at its best point of the grid; what it gains of chi-square on all motions, and on motions held out."""

    effect: Effect
    gain: float
    held_out: float


@dataclass(frozen=True)
class Freed:
    """What the model's own parameters do not explain: e (n,), the segment of every sample (n,), their folds, the basis
    (n, B) of the own parameters and the Cholesky factor of its normal equations."""

    e: Array
    segment: NDArray[np.int64]
    fold: NDArray[np.int64]
    basis: Array
    factor: tuple[Array, bool]

    def __call__(self, given: NDArray[Any]) -> Array:
        """Columns (n, k) freed likewise."""
        out = self.basis @ cho_solve(self.factor, self.basis.T @ given)
        return np.asarray(np.subtract(given, out, out=out))


def freed(fitted: Fit, segment: NDArray[np.int64], seed: int = 0) -> Freed:
    """The innovations of a fit, freed [1]; segment (n,): the number of the motion that each sample belongs to."""
    candidate = fitted.candidate
    layout, theta = candidate.layout, candidate.theta
    margin = 0.01 * (layout.high - layout.low)
    inside = (theta > layout.low + margin) & (theta < layout.high - margin)
    free = np.where(inside, layout.deviation, 0.0)  # what stands at its bound stays there
    basis = np.hstack([fitted.slopes * free, fitted.own * own_spread(candidate.effects)])
    factor = cho_factor(basis.T @ basis + np.eye(basis.shape[1]))
    count = int(segment.max()) + 1
    fold = np.random.default_rng(seed).permutation(count) % FOLDS
    pull = np.concatenate([theta / layout.deviation, np.zeros(fitted.own.shape[1])]) * (np.any(basis != 0, axis=0))
    e = fitted.innovations - basis @ cho_solve(factor, basis.T @ fitted.innovations + pull)
    return Freed(e, segment, fold, basis, factor)


def scan(
    fitted: Fit,
    records: Sequence[Record],
    own: Freed,
    left_out: Collection[str] = (),
    known: Columns = MappingProxyType({}),
) -> tuple[list[Finding], Columns]:
    """The catalogue's effects, each at the point of its grid that gains the most on held-out motions, best first; and
    columns (n, k) [1] of points of the grids, in single precision, that are the same to first order in another fit of
    these references. Not those that the model's own parameters mostly explain: too little remains of them.

    known: such columns of another fit whose random forces are the same, in place of what this one's path would give.
    """
    trials: list[Effect] = []
    for name, kind in fitted.candidate.layout.machine.kinds.items():
        if name not in left_out and kind.shown_in() in SHOWN:
            trials += grid(kind, fitted, records, own)
    found, columns = dict[str, Finding](), dict[Effect, NDArray[Any]]()
    inside = {effect.name for effect in fitted.candidate.effects}
    known = {effect: given for effect, given in known.items() if effect.name not in inside}  # its own kind differs more
    batches = [*_batched([e for e in trials if e not in known]), *_batched([e for e in trials if e in known])]
    for findings, kept in parallel_map(lambda batch: _findings(batch, fitted, records, own, known), batches):
        columns |= kept
        for finding in findings:
            name = finding.effect.name
            if name not in found or finding.held_out > found[name].held_out:
                found[name] = finding
    return sorted(found.values(), key=lambda finding: -finding.held_out), columns


def _batched(trials: Sequence[Effect]) -> Iterator[tuple[Effect, ...]]:
    for i in range(0, len(trials), BATCH):
        yield tuple(trials[i : i + BATCH])


def _findings(
    batch: Sequence[Effect], fitted: Fit, records: Sequence[Record], own: Freed, known: Columns
) -> tuple[list[Finding], Columns]:
    raw = [known[effect] for effect in batch] if batch[0] in known else _columns(batch, fitted, records)
    products, slopes = by_segment(own(np.hstack(raw)), own)
    found, kept, begin = list[Finding](), dict[Effect, NDArray[Any]](), 0
    for effect, given in zip(batch, raw, strict=True):
        end = begin + given.shape[1]
        found.append(judged(effect, products[:, begin:end], slopes[:, begin:end], own))
        if products[:, begin:end, 0].sum() > REMAINS * np.sum(given**2):
            kept[effect] = given.astype(np.float32, copy=effect not in known)
        begin = end
    return found, kept


def _columns(batch: Sequence[Effect], fitted: Fit, records: Sequence[Record]) -> list[NDArray[Any]]:
    """What each effect's quadratures change of the innovations: (n, 1) or (n, 2) [1] each."""
    variants = [variant for effect in batch for variant in quadratures(effect)]
    added = [in_order((*fitted.candidate.effects, variant)) for variant in variants]
    whole = columns(fitted.candidate, added, records, fitted.paths, fitted.seen, fitted.walk)
    whole *= weights(records)[:, None]
    ends = np.cumsum([len(quadratures(effect)) for effect in batch])
    return np.split(whole, ends[:-1], axis=1)


def judged(effect: Effect, products: Array, slopes: Array, own: Freed) -> Finding:
    """The effect's amplitude by least squares, and its gains [1], from what `by_segment` says of its one or two freed
    columns: products (S, k, 2), slopes (S, k)."""
    k = slopes.shape[1]
    grams = products[:, :, :1] * np.eye(k)
    if k == 2:  # a sine and a cosine
        grams[:, 0, 1] = grams[:, 1, 0] = products[:, 0, 1]
    ridge = (1e-9 * np.trace(grams.sum(axis=0)) + 1e-12) * np.eye(k)
    total, slope = grams.sum(axis=0) + ridge, slopes.sum(axis=0)
    best = -np.linalg.solve(total, slope)
    if not _possible(effect, best):
        return Finding(effect, 0.0, 0.0)
    gain = float(-(2 * slope @ best + best @ total @ best))
    held_out = 0.0
    for fold in range(FOLDS):
        inside = own.fold == fold
        gram, by = grams[inside].sum(axis=0), slopes[inside].sum(axis=0)
        trained = -np.linalg.solve(total - gram, slope - by)
        held_out -= float(2 * by @ trained + trained @ gram @ trained)
    return Finding(sized(effect, best), gain, held_out)


def _possible(effect: Effect, factor: Array) -> bool:
    """Whether the amplitude or width times this factor has a sign that the effect can have."""
    if factor.size > 1:
        return True
    item = next(item for item in parameters(type(effect)) if item.role in {"amplitude", "width"})
    return bool(factor[0] > 0 or item.low < 0)


def by_segment(given: Array, own: Freed) -> tuple[Array, Array]:
    """Of freed columns (n, k), in each of S segments: products of each with itself and with the next (S, k, 2), and
    with the innovations (S, k); all [1]. One pass over a whole batch: its columns pass through memory once."""
    products, slopes = np.zeros((own.fold.size, given.shape[1], 2)), np.zeros((own.fold.size, given.shape[1]))
    _sums(given, own.e, own.segment, products, slopes)
    return products, slopes


@compiled
def _sums(given: Array, e: Array, segment: NDArray[np.int64], products: Array, slopes: Array) -> None:
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


def sized(effect: Effect, factor: Array) -> Effect:
    """The effect with its amplitude or width times a factor (1,), or with a cosine and a sine part (2,); [1]."""
    items = parameters(type(effect))
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
        elif item.role == "width" and not effect.fine:
            changed[item.name] = getattr(effect, item.name) * float(np.clip(factor[0], 0.3, 3.0))
    return replace(effect, **changed)


def grid(kind: type[Effect], fitted: Fit, records: Sequence[Record], own: Freed) -> list[Effect]:
    """The effect at the points of its grid: shapes and widths spaced by logarithm, periods from spectra, switches
    both ways."""
    typical = kind.typical()
    spectrum, axes = SPECTRA.get(kind.name), []  # for the first of the shapes
    if spectrum is None and kind.period_stated and kind.name in ALONG:  # a grid's points may all be too far off
        spectrum = partial(_along_the_path, ALONG[kind.name])
    for item in parameters(kind):
        if item.role in {"shape", "width"}:
            points = _points(item.name, item.low, item.high)
            if spectrum:
                points, spectrum = np.array(spectrum(item.low, item.high, fitted, records, own)), None
            axes.append([(item.name, point) for point in points])
        elif item.role == "switch":
            axes.append([(item.name, point) for point in (item.low, item.high)])
    return [replace(typical, **dict(point)) for point in itertools.product(*axes)]


def _points(name: str, low: float, high: float) -> Array:
    many = GRID.get(name, POINTS)
    if name in DECADE:
        many = max(DECADE[name], round(DECADE[name] * np.log10(high / low)))
    if name in {"length", "pitch"}:
        return np.asarray(1 / np.linspace(1 / high, 1 / low, many))
    return np.geomspace(low, high, many)


def adjoints(fitted: Fit, records: Sequence[Record], own: Freed) -> Iterator[tuple[Record, Array, Array]]:
    """For each record what any force (n,) and any reading (n,) would have in common with the innovations
    [1/N], [1/m]."""
    model = fitted.candidate.predictor(records[0].sample_time, fitted.walk)
    begin = 0
    for record in records:
        force, reading = adjoint(model, own.e[begin : begin + record.position.size])
        begin += record.position.size
        yield record, force.sum(axis=1), reading


def _by_place(low: float, high: float, fitted: Fit, records: Sequence[Record], own: Freed) -> list[float]:
    """Periods [m] at the peaks of the spectrum over position of the reading's error."""
    spans = [(record.position, reading) for record, _, reading in adjoints(fitted, records, own)]
    return peaks(spans, low, high)


def _along_the_path(
    weight: Weight, low: float, high: float, fitted: Fit, records: Sequence[Record], own: Freed
) -> list[float]:
    """Periods [m] at the peaks of the spectrum over position of the force's error, weighted [1]."""
    spans = [(one.position, force * weight(one)) for one, force, _ in adjoints(fitted, records, own)]
    return peaks(spans, low, high, padded=8)


def _by_command(low: float, high: float, fitted: Fit, records: Sequence[Record], own: Freed) -> list[float]:
    """Steps [N] at the peaks of the spectrum over command of the force's error."""
    delay = round(fitted.candidate.machine.plant.dead_time / records[0].sample_time)
    spans = []
    for record, force, _ in adjoints(fitted, records, own):
        late = np.concatenate([np.full(delay, record.command[0]), record.command])[: record.command.size]
        spans.append((late, force))
    found = peaks(spans, low, ROOM * high)  # a jump has overtones: what is found may be one
    return sorted({n * step for step in found for n in (1, 2, 3) if n * step <= ROOM * high})


def _by_time(low: float, high: float, fitted: Fit, records: Sequence[Record], own: Freed) -> list[float]:
    """Frequencies [Hz] at the peaks of the spectrum over time of the force's error."""
    spans = [
        (np.arange(force.size, dtype=float) * record.sample_time, force)
        for record, force, _ in adjoints(fitted, records, own)
    ]
    return [1 / period for period in peaks(spans, 1 / high, 1 / low)]


ALONG: Final[Mapping[str, Weight]] = {
    "cogging": lambda record: np.ones(record.position.size),
    "thrust_ripple": lambda record: record.command,
    "position_dependent_friction": lambda record: np.sign(np.gradient(record.position)),
}
"""What the sine over position is multiplied by in these effects' forces."""

SPECTRA: Final = {"scale_periodic_error": _by_place, "dac_quantisation": _by_command, "floor_vibration": _by_time}


def peaks(spans: Sequence[tuple[Array, Array]], low: float, high: float, padded: int = 2) -> list[float]:
    """The periods between low and high at which sines of a coordinate agree the most with weights (n,), over all spans
    [unit of the coordinate]. padded: times its extent that the spectrum is taken over; from 4 on the lines of a peak
    count once [1]."""
    width = low / 8
    extent = max(float(np.ptp(coordinate)) for coordinate, _ in spans)
    count = int(2 ** np.ceil(np.log2(padded * max(extent, 2 * high) / width)))
    if (1 / low - 1 / high) * count * width < LINES:  # a range too narrow for a spectrum
        return [float(1 / wave) for wave in np.linspace(1 / high, 1 / low, LINES)]
    power = np.zeros(count // 2 + 1)
    for coordinate, weight in spans:
        bins = np.floor((coordinate - coordinate.min()) / width).astype(int)
        power += np.abs(np.fft.rfft(np.bincount(bins, weight, count))) ** 2
    frequency = np.fft.rfftfreq(count, width)
    inside = np.flatnonzero((frequency >= 1 / high) & (frequency <= 1 / low))
    found: list[float] = []
    for i in inside[np.argsort(-power[inside])]:
        apart = 1 / (extent * frequency[i]) if padded >= 4 else 2e-3
        if all(abs(1 / frequency[i] - period) > apart * period for period in found):
            found.append(float(1 / frequency[i]))
        if len(found) == PEAKS:
            break
    return found
