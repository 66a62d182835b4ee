"""Which structure of controller would make a record's commands, where the stated one does not: a PID or a P/PI cascade.

Both are fitted to the feedback's part of the command, u - u_ff, from the logged reference r and position x. A constant
and the first samples are free, because the states before the record are unknown. Symbols as in
models/feedback/forms.py; e = r - x, n samples.

PID: linear in kp b, kp, ki, kd c and kd, once its filter is given. Cascade: linear in Kv and m, once Kp, 1 / Tn, f and
its filter are given; they begin at the PID that has the same loop, where Kp and 1 / Tn are the roots of
z^2 - kp / kd z + ki / kd.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from models.controller import PID
from models.feedback.forms import Cascade, described
from models.quantity import show
from models.records.record import Record

Array = NDArray[np.float64]
Columns = Callable[[Array], list[Array]]  # what the commands are linear in, by the free numbers
Fit = tuple[list[float], Array, float]  # the free numbers, the columns' factors, and the rms [N] left

MAX_FITTED_SAMPLES: Final = 5_000  # samples that are fitted, those in which the reference moves most
LATEST: Final = 8  # samples by which the reference may wait
FILTERS: Final = (0.0, 0.1, 0.3, 1.0, 2.0, 5.0, 10.0, 30.0)  # samples: a search for a filter begins at these times
AS_GOOD_RATIO: Final = 1.05  # times what another structure leaves, up to which a simpler one is as good
EXACT: Final = 1e-9  # of the commands' standard deviation: round-off, which tells no structures apart
WHOLE: Final = 1e-3  # distance within which a share is 0 or 1, and a filter's time constant [samples] 0
RATES: Final = (1e-3, 1e6)  # 1/s: of a position's gain and of 1 / Tn, which at the least is 0
FILTER: Final = (0.0, 100.0)  # samples: of a filter's time constant
CASCADE: Final = ((math.log(RATES[0]), math.log(RATES[1])),) * 2 + ((0.0, 2.0), FILTER)  # bounds of its free numbers
WEIGHTS: Final = (-0.1, 2.1)  # set-point weights that a fit to a noisy log may show; others make no controller
DELAYS: Final = 3  # at which a cascade is tried
MIN_FITTED_SAMPLES: Final = 200  # samples below which nothing is fitted


@dataclass(frozen=True)
class Structure:
    """A controller that was fitted, in words, the rms difference [N] to the logged commands that it leaves, and how
    many figures it has that are neither 0 nor 1."""

    words: str
    leaves: float
    figures: int


@dataclass(frozen=True)
class _Signals:
    """What the fits are made of, each (n,): u - u_ff [N], r and x from the first x on [m]; samples from `begin` on
    count."""

    sample_time: float
    command: Array
    reference: Array
    position: Array
    begin: int

    def late(self, delay: int) -> _Signals:
        """The same with the reference so many samples later."""
        waiting = np.concatenate([np.full(delay, self.reference[0]), self.reference])[: self.reference.size]
        return replace(self, reference=waiting)

    def slope(self, signal: Array, filter_samples: float = 0.0) -> Array:
        """The difference of a signal (n,) over a sample [its unit per s], filtered."""
        keep = filter_samples / (filter_samples + 1)
        difference = np.diff(signal, prepend=signal[0]) / self.sample_time
        return np.asarray(scipy.signal.lfilter([1 - keep], [1, -keep], difference), float)

    def integral(self, signal: Array) -> Array:
        """The integral of a signal (n,) over time [its unit times s]."""
        return np.asarray(self.sample_time * np.cumsum(signal), float)

    def fitted(self, columns: Sequence[Array]) -> tuple[Array, Array]:
        """The factors of the columns (n,) that fit best beside a constant, and the commands (n - begin,) [N] left.

        By the normal equations of scaled columns, solved once more for what the first solution leaves.
        """
        table = np.column_stack([*columns, np.ones(self.command.size)])[self.begin :]
        size = np.maximum(np.max(np.abs(table), axis=0), 1e-300)
        table /= size
        gram, left, factors = table.T @ table, self.command[self.begin :], np.zeros(size.size)
        for _ in range(2):
            step = np.linalg.lstsq(gram, table.T @ left, rcond=None)[0]
            factors, left = factors + step, left - table @ step
        return (factors / size)[:-1], left


def structure(record: Record, begin: int) -> Structure | None:
    """The structure that leaves least of a record's commands [N], the simplest of those that leave the same.

    begin: the sample from which on what was before the record counts no more. None where there is too little to fit.
    """
    known = _signals(record, begin)
    if known is None:
        return None
    begins = _begins(known)
    found = [*_pids(begins), *_cascades(begins)]
    same = [one for one in found if one.leaves <= _as_good(known, min(one.leaves for one in found))]
    fewest = min(one.figures for one in same)
    simplest = [one for one in same if one.figures == fewest]
    return replace(simplest[0], words=" or ".join(dict.fromkeys(one.words for one in simplest)))


def _as_good(known: _Signals, left: float) -> float:
    """What another structure may leave to be as good as one that leaves `left`; rms [N]."""
    return AS_GOOD_RATIO * max(left, EXACT * float(np.std(known.command)))


def judged_samples(record: Record, begin: int) -> slice:
    """The samples by which a structure is judged: of those in which the reference moves most, those from `begin` on."""
    part = _part(record, begin)
    return slice(part.start + begin, part.stop)


def _part(record: Record, begin: int) -> slice:
    """The samples that are fitted: those in which the reference moves most, and twice as many as do not count."""
    n = record.position.size
    moved = np.cumsum(np.abs(np.diff(record.reference, prepend=record.reference[0])))
    length = min(n, max(MAX_FITTED_SAMPLES, 2 * begin))
    first = int(np.argmax(moved[length - 1 :] - moved[: n - length + 1]))
    return slice(first, first + length)


def _signals(record: Record, begin: int) -> _Signals | None:
    """The part of a record that is fitted."""
    if record.position.size - begin < MIN_FITTED_SAMPLES or np.ptp(record.reference) == 0:
        return None
    part = _part(record, begin)
    origin = record.position[part.start]
    command = (record.command - record.feedforward)[part]
    return _Signals(record.sample_time, command, record.reference[part] - origin, record.position[part] - origin, begin)


def _rms(left: Array) -> float:
    return float(np.sqrt(np.mean(left**2)))


@dataclass(frozen=True)
class _Begin:
    """Where the searches begin: signals with the reference `delay` samples later, the filter's time constant [samples]
    with which a law that has all terms of both structures leaves least, and what it leaves [N]."""

    delay: int
    known: _Signals
    filtered: float
    leaves: float

    def said(self, words: str) -> str:
        """The words with the reference's delay, where there is one."""
        return f"{words}, its reference {self.delay} sample{'s' * (self.delay > 1)} late" if self.delay else words


def _begins(known: _Signals) -> list[_Begin]:
    """One for every delay of the reference."""
    found = []
    for delay in range(LATEST + 1):
        late = known.late(delay)

        def every(free: Array, late: _Signals = late) -> list[Array]:
            return _every_term(late, free[0])

        coarse = {time: _rms(late.fitted(every(np.array([time])))[1]) for time in FILTERS}
        (time,), _, left = _searched(late, every, [min(FILTERS, key=coarse.__getitem__)], [FILTER])
        found.append(_Begin(delay, late, time, left))
    return found


def _every_term(known: _Signals, time: float) -> list[Array]:
    """What both structures are linear in, with a filter's time constant [samples]."""
    r, e = known.reference, known.reference - known.position  # on a long way x is all but r
    turned = [known.slope(r, time), known.slope(e, time)]
    plain = [r, e, known.integral(e), known.slope(r), known.slope(known.slope(r))]
    return [*plain, *turned, *map(known.integral, turned)]


def _pids(begins: Sequence[_Begin]) -> Iterator[Structure]:
    """The best PID of the error, and the best one with set-point weights."""
    yield min(map(_pid, begins), key=lambda one: one.leaves)
    if weighted := [one for begin in begins for one in _weighted_pid(begin)]:
        yield min(weighted, key=lambda one: one.leaves)


def _pid(begin: _Begin) -> Structure:
    known = begin.known
    error = known.reference - known.position
    sums = known.integral(error)

    def columns(free: Array) -> list[Array]:
        return [error, sums, known.slope(error, free[0])]

    (time,), gains, leaves = _simplified(known, columns, [begin.filtered], [FILTER], [(0, 0.0)])
    kp, ki, kd = gains.tolist()
    pid = PID(kp, ki, kd, time * known.sample_time)
    return Structure(begin.said(_pid_in_words(pid)), leaves, 3 + (time > 0))


def _weighted_pid(begin: _Begin) -> Iterator[Structure]:
    """The PID with set-point weights, unless no controller has such weights."""
    known = begin.known
    r, x = known.reference, known.position
    sums = known.integral(r - x)

    def columns(free: Array) -> list[Array]:
        return [r, x, sums, known.slope(r, free[0]), known.slope(x, free[0])]

    (time,), factors, leaves = _simplified(known, columns, [begin.filtered], [FILTER], [(0, 0.0)])
    by_r, kp, ki, by_speed, kd = (factors * [1, -1, 1, 1, -1]).tolist()
    weights = (_share(by_r, kp), _share(by_speed, kd))
    if not WEIGHTS[0] < min(weights) <= max(weights) < WEIGHTS[1]:
        return
    figures = 3 + (time > 0) + sum(weight not in {0.0, 1.0} for weight in weights)
    yield Structure(begin.said(_pid_in_words(PID(kp, ki, kd, time * known.sample_time, *weights))), leaves, figures)


def _cascades(begins: Sequence[_Begin]) -> Iterator[Structure]:
    """The best P/PI cascade, if there is one at all.

    It begins at the PID with nearly its loop, at the delays with which every term of both structures leaves least:
    those terms make up for two samples of delay.
    """
    floor = _as_good(begins[0].known, min(one.leaves for one in begins))
    tried = [
        (fit, begin)
        for begin in [one for one in begins if one.leaves <= floor][:DELAYS]
        for rates in _rates(begin)
        for fit in [_searched(begin.known, _cascade_terms(begin.known), rates, CASCADE)]
    ]
    if tried:
        floor = _as_good(begins[0].known, min(leaves for (_, _, leaves), _ in tried))
        (free, _, _), begin = next(one for one in tried if one[0][2] <= floor)
        yield from _cascade(begin, free)


def _rates(begin: _Begin) -> Iterator[list[float]]:
    """The free numbers of a cascade with nearly the loop of the PID that fits: Kp and 1 / Tn in both orders."""
    known, time = begin.known, begin.filtered
    r, x = known.reference, known.position
    e = r - x  # on a long way x is all but r
    columns = [e, known.integral(e), known.slope(r, time), known.slope(e, time), known.slope(known.slope(r))]
    kp, ki, more, kd, _ = known.fitted(columns)[0]
    by_speed = kd + more
    if kd <= 0 or kp <= 0:
        return
    most = 0.5 * kp / kd + np.sqrt(max((0.5 * kp / kd) ** 2 - ki / kd, 0.0))
    rates = np.log(np.clip([most, ki / kd / most], *RATES))
    for ordered in (rates, rates[::-1]):
        yield [*ordered, by_speed / kd, time]


def _cascade_terms(known: _Signals, *, with_mass: bool = True) -> Columns:
    """What a cascade is linear in, by the free numbers ln Kp, ln 1 / Tn, f and the filter's time constant [samples];
    with_mass: with an acceleration feedforward."""
    error = known.reference - known.position
    speed = known.slope(known.reference)
    acceleration = known.slope(speed)

    def columns(free: Array) -> list[Array]:
        wanted = np.exp(free[0]) * error + free[2] * speed - known.slope(known.position, free[3])
        rate = np.exp(free[1]) if free[1] > CASCADE[1][0] else 0.0
        return [wanted + rate * known.integral(wanted), acceleration][: 1 + with_mass]

    return columns


def _cascade(begin: _Begin, free: list[float]) -> Iterator[Structure]:
    """The cascade near these free numbers, as simple as it can be; none where its gain or its mass is negative."""
    known, columns = begin.known, _cascade_terms(begin.known)
    free, _, _ = _simplified(known, columns, free, CASCADE, [(3, 0.0), (2, 0.0), (2, 1.0)])
    gain, rate, share, time = free
    if share == 1 and time == 0:  # gain and rate change places without another command
        gain, rate = max(gain, rate), min(gain, rate)
    held = [(i, value) for i, value in ((2, share), (3, time)) if value in {0.0, 1.0}]
    slow = [(1, CASCADE[1][0])]
    (gain, rate, share, time), factors, leaves = _simplified(
        known, columns, [gain, rate, share, time], CASCADE, slow, dict(held)
    )
    bare = _simplified(
        known, _cascade_terms(known, with_mass=False), [gain, rate, share, time], CASCADE, slow, dict(held)
    )
    if bare[2] <= _as_good(known, leaves):
        (gain, rate, share, time), factors, leaves = bare
    kv, mass = (*factors, 0.0)[:2]
    if kv > 0 and mass >= 0:
        time_constant = 1 / np.exp(rate) if rate > CASCADE[1][0] else 0.0
        gains = float(np.exp(gain)), float(kv), float(time_constant)
        cascade = Cascade(*gains, time * known.sample_time, share, float(mass))
        figures = 2 + (time_constant > 0) + (time > 0) + (share not in {0.0, 1.0}) + (mass > 0)
        yield Structure(begin.said(_in_words(cascade)), leaves, int(figures))


def _simplified(
    known: _Signals,
    columns: Columns,
    begin: Sequence[float],
    bounds: Sequence[tuple[float, float]],
    simpler: Sequence[tuple[int, float]],
    held: Mapping[int, float] = MappingProxyType({}),
) -> Fit:
    """The best fit, with each of the free numbers (index, value) that it does as well with set to that value."""
    best = _searched(known, columns, begin, bounds, held)
    for index, value in simpler:
        if index in held:
            continue
        fixed = {**held, index: value}
        fit = _searched(known, columns, best[0], bounds, fixed)
        if fit[2] <= _as_good(known, best[2]):
            best, held = fit, fixed
    return best


def _searched(
    known: _Signals,
    columns: Columns,
    begin: Sequence[float],
    bounds: Sequence[tuple[float, float]],
    fixed: Mapping[int, float] = MappingProxyType({}),
) -> Fit:
    """The free numbers with which the columns fit best, those in `fixed` held."""
    whole, size = np.array(begin, float), max(float(np.std(known.command)), 1e-300)
    whole[list(fixed)] = list(fixed.values())
    free = [i for i in range(whole.size) if i not in fixed]
    if free:
        low, high = np.transpose([bounds[i] for i in free])

        def left(numbers: Array) -> Array:
            whole[free] = numbers
            return known.fitted(columns(whole))[1] / size

        found = scipy.optimize.least_squares(
            left, np.clip(whole[free], low, high), bounds=(low, high), xtol=1e-10, ftol=1e-10, gtol=1e-14, max_nfev=50
        )
        whole[free] = found.x
    factors, rest = known.fitted(columns(whole))
    return whole.tolist(), factors, _rms(rest)


def _share(part: float, whole: float) -> float:
    """The part over the whole [1], 0 or 1 where it nearly is."""
    return _whole(part / whole) if whole else 1.0


def _whole(number: float) -> float:
    return float(round(number)) if abs(number - round(number)) < WHOLE else number


def _in_words(cascade: Cascade) -> str:
    """The cascade, and its other pair of gain and time where commands cannot tell the two apart."""
    words = described(cascade)
    if cascade.velocity_feedforward == 1 and cascade.velocity_filter == 0 and cascade.integral_time > 0:
        gain, time = 1 / cascade.integral_time, 1 / cascade.position_gain
        words += f" (or {show(gain, '1/s')} and {show(time, 's')}, which makes the same commands)"
    return words


def _pid_in_words(pid: PID) -> str:
    figures = [show(pid.kp, "N/m"), show(pid.ki, "N/(m s)"), show(pid.kd, "N s/m")]
    if pid.derivative_filter > 0:
        figures.append(f"a derivative filter of {show(pid.derivative_filter, 's')}")
    if not pid.plain:
        figures.append(f"set-point weights of {pid.proportional_weight:.4g} and {pid.derivative_weight:.4g}")
    return f"a PID with {', '.join(figures)}"
