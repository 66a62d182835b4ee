"""Commands that act late now and then: no force law repeats them, but they grow with the commands' steps.

A command that is late by a part of a sample acts that long in its predecessor's place: a pulse of force in proportion
to u[k] - u[k-1]. A constant lateness is a dead time, and re-fitted; one that varies differs between motions that are
equal otherwise. So what *differs* among equal motions tells whether it does: a law of force repeats and cancels there.
How much it varies, all motions tell: few steps are large, and of those few are late. What is left is white noise and,
at every step, the mark m of a pulse whose variance is s^2 (u[k] - u[k-1])^2. The locally best test of s = 0 sums
(m'e)^2 with these squares as weights (D. Cox, D. Hinkley, Theoretical Statistics, 1974, section 4.8). Noise does not
know of the command. The scale's rounding does, as it is another while the table moves; so the weights are taken
orthogonal to a constant and to the share of moving.

Where no motion repeats, or only slow ones do, only a model of all that is left can tell: late commands are a white
force whose variance goes with the squared steps of the command. With the likeliest variance (`varying_noise`) the
innovations have to be white, which a law of force does not leave them, and no other variance that a drive may have,
constant or with the speed, the acceleration, the command or the friction, may be nearly as likely. Nor may one with
the squares of the smoothed steps: what a model's form is wrong by, in the current loop or in the contacts, follows the
motion, while a late command is as wrong about a step that answers the noise of a reading.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from diagnosis.model.fit import Fit
from diagnosis.model.kalman import STARTING, SUBSTEPS, Predictor, responses
from diagnosis.model.varying_noise import LANES, linear_part
from diagnosis.records.motions import Piece, pieces, repeated
from diagnosis.records.units import loop_time, noise
from models.effects.motor import TimingJitter
from models.records.record import Record

Array = NDArray[np.float64]

REACH: Final = 400  # samples over which a pulse leaves its mark
MIN_REPEATED_SAMPLES: Final = 500  # samples of repeated motions, below which nothing is said
SELDOM: Final = 2.0  # times the lateness of repeated motions that all may show: more is another law
WINDOW_LOOPS: Final = (4.0, 16.0)  # loop times, over which what is left has to average out as white noise does
MAX_WINDOW_STDS: Final = 3.0  # by which it may do so less, by chance; a load with a clearance comes near
MOST_LATE: Final = 3.0  # samples, rms: that commands may be late
LEAST_GAIN: Final = 20.0  # chi-square, below which no other variance is looked at
STEPS: Final = "steps of the command"
SMOOTHED_LOOPS: Final = 0.5  # loop times: of the steps that follow the motion, the deviation by which they are smoothed
VARIANCES: Final = (1e-3, 1e7)  # of the white force's usual variance, between which another one is sought, in the mean,
FINE: Final = 0.02  # of the logarithm of a variance, within which the likeliest one is
# Around the likeliest variance some of what it gains is gained for a factor of 100: less than this far from it is none.
LEAST_COARSE_GAIN: Final = LEAST_GAIN / 10
RARE: Final = 0.005  # of the samples, with the largest steps, that have no say: not a handful is to decide


@dataclass(frozen=True)
class Lateness:
    """Root mean square of the lateness [s], as all motions show it; its chi-square where motions repeat, and what its
    square scatters by there by chance [s^2]; the chi-square [1] that so much of it adds to what all motions leave."""

    size: float
    gain: float
    scatter: float
    energy: float = 0.0


@dataclass(frozen=True)
class _Met:
    """What is left of a stretch of time, by sample (n,): the mean of (m'e)^2 and its degrees of freedom, the mark's
    energy up to the stretch's end, the squared steps of the command [N^2], and how much of the time the table moves."""

    square: Array
    freedom: Array
    energy: Array
    step: Array
    moving: Array


def lateness(fitted: Fit, records: Sequence[Record]) -> Lateness:
    """How much the commands' lateness varies: as repeated motions show it, or else as all that is left does."""
    ts, machine = records[0].sample_time, fitted.candidate.nominal
    left, found = mark(_predictor(fitted, records)), pieces(records, loop_time(machine))
    signals = [_signals(fitted, i, record) for i, record in enumerate(records)]
    groups = [
        [found[i] for i in group if found[i].start >= STARTING] for group in repeated(found, records, noise(machine))
    ]
    alike = [_met_by(signals, group, left) for group in groups if len(group) > 1]
    each = [_met_by(signals, [piece], left) for piece in found if piece.start >= STARTING]
    if sum(one.step.size for one in alike) < MIN_REPEATED_SAMPLES:
        return _of_all_that_is_left(fitted, records, each, float("inf"))
    slope, spread = _slope(alike, left)
    gain = max(slope / spread, 0.0) ** 2
    if gain < LEAST_GAIN:  # what repeats may be slow
        return _of_all_that_is_left(fitted, records, each, ts**2 * spread)
    size = min(max(_slope(each, left)[0], 0.0), SELDOM**2 * max(slope, 0.0))
    energy = size * sum(float(one.step @ one.energy) for one in each)
    return Lateness(ts * float(np.sqrt(size)), gain, ts**2 * spread, energy)


def _of_all_that_is_left(
    fitted: Fit,
    records: Sequence[Record],
    each: Sequence[_Met],
    scatter: float,
) -> Lateness:
    """The lateness as a white force whose variance goes with the commands' steps. Its gain is that over the likeliest
    other variance, and 0 where what is left is not white. each: what is left of every motion; scatter: of the squared
    lateness of repeated motions [s^2]."""
    none = Lateness(0.0, 0.0, scatter)
    if fitted.candidate.random_forces:  # the filter of a force that shakes has states of its own
        return none
    parts = [
        linear_part(fitted.candidate, record, fitted.residuals[i], i, fitted.walk) for i, record in enumerate(records)
    ]
    envelopes = [_envelopes(fitted, i, record) for i, record in enumerate(records)]
    means = {kind: float(np.mean(np.concatenate([given[kind] for given in envelopes]))) for kind in envelopes[0]}

    def costs(kind: str, logs: Array) -> Array:
        """-2 log of the likelihood with so much variance [N^2] per unit of an envelope, by its logarithms (K,)."""
        sizes = np.exp(logs)
        found = [part.misfits(given[kind], sizes) for part, given in zip(parts, envelopes, strict=True)]
        return np.asarray(np.sum(found, axis=0))

    def room(kind: str) -> Array:
        """Logarithms (K,) between which that of an envelope's size is sought, and none of it."""
        low, high = (size * parts[0].white / means[kind] for size in VARIANCES)
        among = np.linspace(math.log(low), math.log(min(high, MOST_LATE**2) if kind == STEPS else high), LANES - 1)
        return np.array([-np.inf, *among])

    if MOST_LATE**2 * means[STEPS] <= VARIANCES[0] * parts[0].white:  # steps so small that lateness makes no force
        return none
    logs = room(STEPS)
    coarse = costs(STEPS, logs)
    if coarse[0] - coarse.min() < LEAST_COARSE_GAIN:
        return none
    likeliest, cost = _least(partial(costs, STEPS), logs, coarse)
    size, loop = math.exp(likeliest), loop_time(fitted.candidate.nominal) / records[0].sample_time
    innovations = [part.standardised(size * given[STEPS]) for part, given in zip(parts, envelopes, strict=True)]
    if coarse[0] - cost < LEAST_GAIN or not _is_white(innovations, loop):
        return none
    rest = [kind for kind, mean in means.items() if kind != STEPS and mean > 0]
    other = min(_least(partial(costs, kind), room(kind), costs(kind, room(kind)))[1] for kind in rest)
    energy = size * sum(float(one.step @ one.energy) for one in each)
    return Lateness(records[0].sample_time * math.sqrt(size), max(other - cost, 0.0), scatter, energy)


def _least(costs: Callable[[Array], Array], logs: Array, known: Array) -> tuple[float, float]:
    """Where among logarithms the costs are least, and how much [1]: between the neighbours of the least of the known
    ones, of which the first belongs to minus infinity, over and over."""
    logs, known = logs[1:], known[1:]
    while True:
        best = int(np.argmin(known))
        low, high = logs[max(best - 1, 0)], logs[min(best + 1, logs.size - 1)]
        if high - low < FINE:
            return float(logs[best]), float(known[best])
        between = np.linspace(low, high, LANES + 2)[1:-1]
        logs, known = np.concatenate([logs, between]), np.concatenate([known, costs(between)])
        order = np.argsort(logs, kind="stable")
        logs, known = logs[order], known[order]


def _is_white(innovations: Sequence[Array], loop: float) -> bool:
    """Whether standardised innovations (n,) [1] average out over WINDOW_LOOPS of the loop time [samples] as white noise
    does; a law of force leaves them larger for as long as it lasts."""
    whole = sum(e.size for e in innovations)
    for loops in WINDOW_LOOPS:
        window = max(round(loops * loop), 2)
        power = window * sum(float(np.sum(scipy.ndimage.uniform_filter1d(e, window) ** 2)) for e in innovations) / whole
        if power > 1 + MAX_WINDOW_STDS * np.sqrt(2 * window / whole):
            return False
    return True


def _envelopes(fitted: Fit, index: int, record: Record) -> dict[str, Array]:
    """What the variance of a white force may go with, by sample (n,): the squared steps of the command as it acts
    [N^2], those of its course without what answers the noise [N^2], nothing [1], the speed [m/s] and its square, the
    squares of the acceleration, of the command and of the friction [SI]."""
    residual, step = fitted.residuals[index], _steps(fitted, record)
    speed, command = residual.path.speed.mean(axis=1), residual.acts.sent.mean(axis=1)
    width = SMOOTHED_LOOPS * loop_time(fitted.candidate.nominal) / record.sample_time
    return {
        STEPS: step**2,
        "smoothed steps": scipy.ndimage.gaussian_filter1d(step, width) ** 2,
        "constant": np.ones(step.size),
        "speed": np.abs(speed),
        "speed squared": speed**2,
        "acceleration": np.gradient(speed) ** 2,
        "command": (command - command.mean()) ** 2,
        "friction": residual.acts.friction.mean(axis=1) ** 2,
    }


def gained_by_chance(fitted: Fit, records: Sequence[Record]) -> dict[str, float]:
    """By the effect's name, what it gains [1] on a table without any."""
    return {TimingJitter.name: lateness(fitted, records).gain}


def _predictor(fitted: Fit, records: Sequence[Record]) -> Predictor:
    """Of the smoothest record, as one mark serves all."""
    smoothest = min(range(len(records)), key=fitted.candidate.roughness_of)
    return fitted.candidate.predictor(records[0].sample_time, fitted.walk, smoothest)


def mark(model: Predictor) -> Array:
    """What a force of 1 N over the first sample leaves in the whitened innovations: (REACH,) [1]."""
    pulse = np.zeros((1, REACH, SUBSTEPS))
    pulse[0, 0] = 1.0
    return np.asarray(responses(model, pulse)[:, 0])


def _signals(fitted: Fit, index: int, record: Record) -> tuple[Array, Array, Array]:
    """Of a record, (n,) each: the innovations, the squared steps of the commands as they act [N^2], and whether the
    table moves by a step of the scale from sample to sample [1]."""
    machine, path = fitted.candidate.machine, fitted.paths[index].path.position.mean(axis=1)
    moving = np.minimum(np.abs(np.gradient(path)) / (machine.scale.resolution or np.inf), 1.0)
    return fitted.residuals[index].innovations, _steps(fitted, record) ** 2, moving


def _steps(fitted: Fit, record: Record) -> Array:
    """The steps of a record's commands (n,) [N] as they act."""
    delay = round(fitted.candidate.machine.plant.dead_time / record.sample_time)
    return np.diff(record.command, prepend=np.full(delay + 1, record.command[0]))[: record.command.size]


def _met_by(signals: Sequence[tuple[Array, Array, Array]], group: Sequence[Piece], left: Array) -> _Met:
    """Of what differs among equal motions, or of all that one motion leaves; left (REACH,): the mark of a pulse."""
    cut = [[signal[piece.start : piece.stop] for signal in signals[piece.record]] for piece in group]
    e, step, moving = (np.stack(parts) for parts in zip(*cut, strict=True))
    n, freedom = e.shape[1], max(len(group) - 1, 1)
    if len(group) > 1:
        e = e - e.mean(axis=0)
    met = np.stack([scipy.signal.fftconvolve(row, left[::-1])[left.size - 1 :] for row in e])
    energy = np.cumsum(left**2)[np.minimum(np.arange(n)[::-1], left.size - 1)]
    square = np.sum(met**2, axis=0) / freedom
    return _Met(square, np.full(n, float(freedom)), energy, step.mean(axis=0), moving.mean(axis=0))


def _slope(groups: Sequence[_Met], left: Array) -> tuple[float, float]:
    """s^2 [1], of the sample time squared, and its deviation where there is none."""
    alike = scipy.signal.fftconvolve(left, left[::-1]) ** 2  # of the marks of two pulses, by the time between them

    def spread_out(signal: Array) -> Array:
        return np.asarray(scipy.signal.fftconvolve(signal, alike)[left.size - 1 :][: signal.size])

    step, square, energy = (
        np.concatenate([getattr(one, name) for one in groups]) for name in ("step", "square", "energy")
    )
    moving, freedom = (np.concatenate([getattr(one, name) for one in groups]) for name in ("moving", "freedom"))
    few = step <= np.quantile(step, 1 - RARE)
    beside = np.stack([energy, energy * moving], axis=1) * few[:, None]
    weight = np.where(few, step, 0.0)
    weight -= beside @ np.linalg.lstsq(beside, weight, rcond=None)[0]
    expected = np.concatenate([spread_out(one.step) for one in groups])
    gained = float(weight @ expected)
    if gained <= 0:  # no steps but the largest
        return 0.0, float("inf")
    variance = float(square[few].mean() / energy[few].mean())
    spread = variance * float(np.sqrt(2 * np.sum(weight * spread_out(weight) / freedom)))
    return float(weight @ square) / gained, spread / gained
