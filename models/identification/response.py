"""The frequency response of the plant from a record with a known excitation, in open or closed loop.

With r the excitation, u the command and x the position, S_ab their cross spectra:

    P(f) = S_xr(f) / S_ur(f)

which is free of the bias that S_xu / S_uu has under feedback, as r is independent of the noise (Ljung, System
Identification, 13.5; Pintelon and Schoukens, 2.6). A periodic one is taken over its whole periods, without
leakage; a random one over Hann windows. A single sweep is at each frequency once, so there is nothing to average: P is
X / U of the whole record. What the two ends of a record leave in X / U is modelled with the modes (modal/fitting.py);
the noise of a periodic excitation and of a sweep is what is left beside it (modal/local_rational.py). Frequencies f
[Hz]; M periods or windows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from models.identification.modal.local_rational import LOCAL as NOISE_LOCAL
from models.identification.modal.local_rational import distortion_between_lines, noise_between_lines, noise_under_sweep
from models.records.checks import quantisation
from models.records.record import Record

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

ROLLED: Final = 20  # samples over which an axis that rolls has moved on,
STEPPED: Final = 5.0  # and steps of its scale
BACK: Final = 5.0  # deviations of the reading's noise: by more it surely moved backwards
FOURTH: Final = math.sqrt(70.0)  # a fourth difference has so many deviations of white noise
MEDIAN: Final = 0.6745  # of |x| of a normal x with deviation 1
BEGUN: Final = 6  # samples after which a sweep's axis has half of its speed, unless friction still builds up
WEAKEST: Final = 1e-2  # of the strongest line of the excitation: lines below are not looked at
LOWEST: Final = 8  # lines under a window that are left out: slow motion leaks into them
ONCE: Final = 0.5  # of a line's power in a single window: a sweep went by there
# Times its neighbours' noise, from which on a line of a periodic excitation has more of its own.
MIN_NOISE_RATIO: Final = 3.0
NEIGHBOURS: Final = 4  # lines on each side over which the noise's power is averaged
FOREIGN: Final = 25.0  # times its neighbours' median, from which on what a line has beside the sweep is another signal
THIRD: Final = 2 ** (1 / 6)  # factor to either side over which the noise's power of one sweep is taken to be smooth
MEDIANS_PER_OCTAVE: Final = 24  # medians in an octave, between which that power is interpolated
LOCAL: Final = 8  # lines on each side over which the local model of one sweep holds
DEGREE: Final = 2  # of that model's polynomials
FEWEST: Final = 4 * (2 * LOCAL + 1)  # lines of one sweep
OCTAVES: Final = 2.0  # that one sweep covers at least
SKIRT: Final = 0.02  # of the sweep's time below its lowest line and above its highest, where its start and stop leak
LED: Final = 0.9  # coherence of command and sweep: below, feedback of the noise leads the command
BEFORE: Final = 0.95  # of the frequency at which a sweep comes by again: its skirt is there earlier
SWEEP_END_NYQUIST_SHARE: Final = 0.8  # of half the rate: a sweep that gets there may have gone on beyond
# Of both energies, below which a signal and the same one some samples later are alike, and from which on they differ.
ALIKE, UNLIKE = 1e-6, 0.5
SHORTEST: Final = 8  # samples of a period, at least
SEEN: Final = 0.5  # coherence of position and sweep: below, the position moves by less than the scale resolves


@dataclass(frozen=True)
class FrequencyResponse:
    """P (n,) [m/N] at frequencies (n,) [Hz], the variance of each |error|^2 (NaN: unknown) and the coherence (n,).

    sample_time [s]: a response of the plant behind a zero-order hold at the samples; 0: of the continuous plant.
    rolling: the record never stood still nor turned round, so that rolling friction was constant and bends nothing.
    command: the spectrum U (n,) [any unit] of one record without a window: X / U then holds what the record's two ends
    leave of each mode, too; None: no such part. settled [s]: for how long before it the excitation was the same, so
    that what dies out in that time is the same at both ends; 0 for a single sweep. turned: the share [1] of the samples
    in which an axis that was to roll moved back, as a mode that is excited too strongly makes it. slope: of the line
    that was taken off the position [m per sample]; a spring to ground pulls along it. levelled: whether a line was
    taken off the command, too, as of an axis that a spring is known to hold. hold [s]: for how long a command
    is held, where the samples are further apart, as in a log of every fourth one; None: from one to the next.
    """

    frequency: Array
    response: Complex
    variance: Array
    coherence: Array
    sample_time: float
    rolling: bool = False
    command: Complex | None = None
    settled: float = 0.0
    turned: float = 0.0
    slope: float = 0.0
    levelled: bool = False
    hold: float | None = None

    @property
    def held(self) -> float:
        """For how long a command is held [s]; 0: a response of the continuous plant."""
        return self.sample_time if self.hold is None else self.hold


def period(signal: Array) -> int | None:
    """The shortest period [samples] with which a signal (n,) [any unit] repeats at least twice, or None."""
    active = np.flatnonzero(np.abs(signal) > 0)
    if active.size < 32:
        return None
    s = signal[active[0] : active[-1] + 1]
    s, n = s - np.mean(s), s.size
    spectrum = np.fft.rfft(s, 2 * n)
    product = np.fft.irfft(np.abs(spectrum) ** 2)[:n]
    energy = np.concatenate([[0.0], np.cumsum(s**2)])
    lag = np.arange(1, n // 2)
    both = energy[n - lag] + energy[n] - energy[lag]
    apart = both - 2 * product[lag]
    other = np.logical_or.accumulate(apart > UNLIKE * both)  # before, a smooth signal has hardly changed
    repeats = lag[(apart < ALIKE * energy[n]) & other & (lag > SHORTEST)]
    return int(repeats[0]) if repeats.size else None


def repeated_span(signal: Array, length: int) -> tuple[int, int]:
    """(first, stop) sample of a signal (n,) [any unit] that repeats every `length` samples, with the zeros at both ends
    that belong to its periods."""
    active = np.flatnonzero(np.abs(signal) > 0)
    first, stop = int(active[0]), int(active[-1]) + 1
    inner = np.flatnonzero(signal[first + length - 1 : first : -1])
    before = min(int(inner[0]) if inner.size else 0, first)
    behind = np.flatnonzero(signal[max(stop - length, 0) : stop])
    after = min(int(behind[0]) if behind.size else 0, signal.size - stop)
    return first - before, stop + after


def measured(record: Record, windows: int = 15, *, sprung: bool = False) -> FrequencyResponse:
    """P from a record that is excited through its feedforward; see the module's head.

    windows: for a random excitation. sprung: whether a spring to ground is known to hold the axis, so that the command
    rises along the way. Raises ValueError for a record without an excitation, or of one that shows little.
    """
    excitation = record.feedforward
    if np.ptp(excitation) == 0:
        raise ValueError("the record has no excitation: its feedforward is constant; log the excitation there")
    length = period(excitation)
    if length is not None:
        return _repeated(record, length)
    r, u, x = _windows((excitation, record.command, record.position), windows)
    if _passes_once(r):
        return _swept(record, sprung=sprung)
    if r.shape[0] < 2:
        raise ValueError("the record is too short for windows; excite for longer, or with a period")
    frequency = np.asarray(np.fft.rfftfreq(2 * (r.shape[1] - 1), record.sample_time), np.float64)
    used = _strong(r, frequency, record.sample_time, LOWEST)
    r, u, x = r[:, used], u[:, used], x[:, used]
    response, coherence = _averaged(r, u, x)
    error = np.sum(np.abs(x - response * u) ** 2, axis=0) / (r.shape[0] - 1)
    error = _apart(error, _smoothed(error))
    count = 0.6 * r.shape[0]  # windows that overlap by half are not independent
    cross_u = np.mean(u * np.conj(r), axis=0)
    variance = error * np.mean(np.abs(r) ** 2, axis=0) / (count * np.abs(cross_u) ** 2)
    rolling = _rolling(record.position)
    turned = _turned(record.position)
    return FrequencyResponse(frequency[used], response, variance, coherence, record.sample_time, rolling, turned=turned)


def _repeated(record: Record, length: int) -> FrequencyResponse:
    """P from an excitation with a period of `length` samples: X / U at its lines in the spectrum of all whole periods.

    The lines between show the noise. What is not the same at both ends, such as a mode that still rings, is left in
    X / U. Raises ValueError for less than two periods behind the first one, in which the response was not periodic yet.
    """
    ts, (first, stop) = record.sample_time, repeated_span(record.feedforward, length)
    first += length
    count = (stop - first) // length
    if count < 2:
        raise ValueError("the excitation repeats less than three times; record more periods of it")
    part = record.part(first, first + count * length)
    level = _level(part.position)
    r, u, x = (_periods(signal, length) for signal in (part.feedforward, part.command, level))
    frequency = np.asarray(np.fft.rfftfreq(length, ts), np.float64)
    used = _strong(r, frequency, ts, 1)
    lines = count * np.flatnonzero(used)
    whole_u, whole_x = (np.fft.rfft(signal) / signal.size for signal in (part.command, level))
    z = np.exp(2j * np.pi * np.fft.rfftfreq(level.size))
    noise = noise_between_lines(whole_x, whole_u, z, lines, count)
    noise = _apart(noise, _typical(noise))
    noise = _apart(distortion_between_lines(whole_x, whole_u, z, lines, count), noise)
    led = _commanded(r[:, used], u[:, used])
    used[used], noise = led, noise[led]
    response, coherence = _averaged(r[:, used], u[:, used], x[:, used])
    command = np.mean(u[:, used], axis=0)
    rolling = _rolling(part.position)
    return FrequencyResponse(
        frequency[used],
        response,
        noise / np.abs(command) ** 2,
        coherence,
        ts,
        rolling,
        command,
        length * ts,
        _turned(part.position),
        _slope(part.position),
    )


def _strong(excitation: Complex, frequency: Array, sample_time: float, lowest: int) -> NDArray[np.bool_]:
    """Which lines (f,) an excitation with spectra (M, f) excites, from the `lowest` one on."""
    power = np.mean(np.abs(excitation) ** 2, axis=0)
    used = (power > WEAKEST**2 * np.max(power[1:])) & (frequency < 0.45 / sample_time)
    used[:lowest] = False
    return np.asarray(used)


def _averaged(r: Complex, u: Complex, x: Complex) -> tuple[Complex, Array]:
    """P = S_xr / S_ur (f,) from spectra (M, f), and the coherence of x and r."""
    cross_x, cross_u = np.mean(x * np.conj(r), axis=0), np.mean(u * np.conj(r), axis=0)
    power_x, power_r = np.mean(np.abs(x) ** 2, axis=0), np.mean(np.abs(r) ** 2, axis=0)
    return cross_x / cross_u, np.abs(cross_x) ** 2 / (power_x * power_r)


def _commanded(excitation: Complex, command: Complex) -> NDArray[np.bool_]:
    """At which lines (f,) the command's mean over the periods is the excitation's, from spectra (M, f): of its power at
    most 1 - LED is what feedback makes of the noise, which draws X / U towards minus the inverse of the feedback."""
    cross = np.mean(command * np.conj(excitation), axis=0)
    coherence = np.abs(cross) ** 2 / (np.mean(np.abs(command) ** 2, axis=0) * np.mean(np.abs(excitation) ** 2, axis=0))
    return np.asarray(1 - coherence < (1 - LED) * len(command) * coherence)


def _apart(error: Array, usual: Array) -> Array:
    """The usual power of the errors, but that of a line of its own where that is surely more (n,)."""
    return np.where(error > MIN_NOISE_RATIO * usual, error, usual)


def _passes_once(excitation: Complex) -> bool:
    """Whether an excitation with spectra (M, f) of windows is at each frequency for part of the time only."""
    power = np.abs(excitation) ** 2
    total = np.sum(power, axis=0)
    strong = total > WEAKEST**2 * np.max(total)
    return bool(np.median(np.max(power[:, strong], axis=0) / total[strong]) > ONCE)


def _swept(record: Record, *, sprung: bool) -> FrequencyResponse:
    """P from one sweep that does not repeat: X / U at the lines of the whole record, while the sweep lasts.

    There X = P U + (what the ends leave) + noise, without a bias of windows or of smoothing; modes.fit models the ends.
    Under feedback this is consistent with the noise's own power as weight (the direct method; Forssell and Ljung,
    Closed-loop identification revisited, Automatica 1999). Raises ValueError for a sweep too short, narrow or weak.
    """
    active = np.flatnonzero(np.abs(record.feedforward) > 0)
    part, ts = record.part(int(active[0]), int(active[-1]) + 1), record.sample_time
    n = part.position.size
    force = _level(part.command) if sprung else part.command
    r, u, x = (np.fft.rfft(signal) / n for signal in (part.feedforward, force, _level(part.position)))
    frequency, (low, high) = np.fft.rfftfreq(n, ts), _band(part.feedforward, ts)
    folded = _folded_from(part.feedforward, ts)
    swept = (frequency > low) & (frequency < min(high, 0.45 / ts, folded))
    if np.sum(swept) < FEWEST and folded < high:
        raise ValueError(
            f"the sweep goes beyond half the log's rate, and only below {folded:.3g} Hz nothing of it is folded back; "
            f"log it with less than {ts:.3g} s from sample to sample, or end it at {0.4 / ts:.3g} Hz"
        )
    if np.sum(swept) < FEWEST:
        raise ValueError(
            f"the sweep of {n * ts:.3g} s has {np.sum(swept)} lines; {FEWEST} are needed, sweep for longer"
        )
    of_x, of_u, beside, plant = _local(r, u, x)
    coherence, commanded = _smoothed(of_x), _smoothed(of_u)
    used = _past_the_start(swept & (commanded > LED) & (coherence > SEEN))
    if np.sum(used) < FEWEST:
        raise ValueError("the sweep is too weak: position or command is noise at most lines; sweep with more force")
    z = np.exp(2j * np.pi * frequency * ts)
    lines = np.flatnonzero(used)
    noise = noise_under_sweep(x, u, r, z, lines)
    noise = _apart(noise, _smooth(noise, lines))
    inside = np.convolve(swept, np.ones(2 * LOCAL + 1), "same") > 2 * LOCAL  # the sweep's ends look like tones, too
    noise = noise + _leaked(beside, plant, inside)[lines]
    f, u = np.asarray(frequency[used], np.float64), u[used]
    if f[-1] < 2**OCTAVES * f[0]:
        raise ValueError(
            f"the sweep shows {f[0]:.3g} to {f[-1]:.3g} Hz only; sweep over {OCTAVES:g} octaves, with more force"
        )
    rolling = _rolling(part.position)
    begun, moved = _samples_to_move(part.position, BEGUN), abs(part.position - part.position[0])
    if rolling and moved[begun] < 0.5 * moved[-1] * begun / n:
        raise ValueError("the sweep begins before the axis rolls: friction still builds up; let it roll for a second")
    variance, turned = noise / np.abs(u) ** 2, _turned(part.position)
    slope = _slope(part.position)
    return FrequencyResponse(
        f, x[used] / u, variance, coherence[used], ts, rolling, u, turned=turned, slope=slope, levelled=sprung
    )


def _band(sweep: Array, sample_time: float) -> tuple[float, float]:
    """The frequencies [Hz] between which a sweep (n,) [any unit] is for all but SKIRT of its time at either end, from
    its half-waves; none where it has none. By its power, one whose force grows with the frequency would begin far above
    its lowest."""
    spans = _half_waves(sweep)
    if not spans.size:
        return math.inf, 0.0
    order = np.argsort(-spans, kind="stable")
    passed = np.cumsum(spans[order]) / np.sum(spans)
    low, high = spans[order][np.searchsorted(passed, (SKIRT, 1 - SKIRT))]
    return 0.5 / (low * sample_time), 0.5 / (high * sample_time)


def _half_waves(sweep: Array) -> Array:
    """How long the half-waves of a sweep (n,) [any unit] are, one after another [samples]."""
    s = sweep - np.mean(sweep)
    crossed = np.flatnonzero(s[:-1] * s[1:] < 0)
    return np.diff(crossed + s[crossed] / (s[crossed] - s[crossed + 1]))


def _folded_from(sweep: Array, sample_time: float) -> float:
    """The frequency [Hz] from which on a sweep (n,) [any unit] that goes beyond half the rate comes by a second time,
    folded back; infinite where it stays well below that."""
    spans = _half_waves(sweep)
    if spans.size < FEWEST:
        return math.inf
    course = 0.5 / (median_filter(spans, 2 * LOCAL + 1) * sample_time)
    peak = int(np.argmax(course))
    if course[peak] < SWEEP_END_NYQUIST_SHARE * 0.5 / sample_time:
        return math.inf
    return BEFORE * float(max(np.min(course[: peak + 1]), np.min(course[peak:])))


def _past_the_start(used: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The lines (n,) in use less the lowest ones that stand apart from the others by more than the local model reaches,
    if it reaches over all of them: there the sweep is lost in what else the ends of the record leak, which is as smooth
    as its start."""
    lines, reach = np.flatnonzero(used), 2 * LOCAL + 1
    apart = np.flatnonzero(np.diff(lines) > reach)
    few = apart[apart < reach]
    found = used.copy()
    if few.size:
        found[: lines[few[-1] + 1]] = False
    return found


def _local(r: Complex, u: Complex, x: Complex) -> tuple[Array, Array, Array, Array]:
    """The coherences of x and of u with r (n,), the power of what each line of x has beside the sweep (n,) [m2], and
    |P|^2 as the lines around it have it (n,), from spectra (n,) of one record.

    Least squares of x and u over each line and its neighbours, as r times polynomials of frequency (Pintelon and
    Schoukens, System Identification, 2012, 7.2); on r, since u holds the fed back noise. Without a polynomial for what
    the ends leave, which looks like a sweep's own first and last second. A line that its neighbours do not foretell is
    another signal's, as that of cogging under an axis that rolls: there X / U is what the feedback answers to it, and
    not the plant. Foretold from the others alone, by the leverage of its own equation.
    """
    n, width = r.size, 2 * LOCAL + 1
    near = np.clip(np.arange(n) - LOCAL, 0, n - width)[:, None] + np.arange(width)
    powers = np.linspace(-1, 1, width)[:, None] ** np.arange(DEGREE + 1)
    q, _ = np.linalg.qr(r[near, None] * powers)
    both = np.stack([x[near], u[near]], axis=2)
    share = q.conj().swapaxes(1, 2) @ both
    explained, rest = (np.sum(np.abs(part) ** 2, axis=1) for part in (share, both - q @ share))
    coherence = explained / (explained + rest)
    own = np.arange(n), np.arange(n) - near[:, 0]
    told = both[own] - (both - q @ share)[own] / np.maximum(1 - np.sum(np.abs(q[own]) ** 2, axis=1), 1e-9)[:, None]
    plant = np.divide(told[:, 0], told[:, 1], out=np.zeros(n, complex), where=told[:, 1] != 0)
    return coherence[:, 0], coherence[:, 1], np.abs(x - plant * u) ** 2, np.abs(plant) ** 2


def _leaked(beside: Array, plant: Array, inside: NDArray[np.bool_]) -> Array:
    """The power (n,) [m2] that other signals may have in each line, from that of what each line has beside the sweep
    (n,) [m2]; plant: |P|^2 (n,); inside (n,): where such a signal can be told from the sweep.

    A signal of one frequency that stands out from its neighbours leaves so much in its own line, and in all others at
    most what a record that is no whole number of its periods makes of it, 1 / (pi k) in k lines' distance, as it acts
    with the thrust. That is so smooth that X / U seems to be free of noise.
    """
    alone = np.where(inside & (beside > FOREIGN * _typical(beside, LOCAL)), beside, 0.0)
    away = np.abs(np.arange(1 - alone.size, alone.size))
    alone = np.divide(alone, plant, out=alone, where=plant > 0)
    leaked = plant * scipy.signal.fftconvolve(alone, 1 / np.maximum(np.pi * away, 1.0) ** 2, "valid")
    return np.asarray(np.maximum(leaked, 0.0), float)


def _level(signal: Array) -> Array:
    """A signal (n,) less the straight line from its first to its last sample, which leaks into every line: what a
    rolling axis goes, and what a spring takes to hold it there."""
    return np.asarray(signal - np.linspace(signal[0], signal[-1], signal.size))


def _slope(position: Array) -> float:
    """The slope of that line [m per sample]."""
    return float(position[-1] - position[0]) / (position.size - 1)


def _periods(signal: Array, length: int) -> Complex:
    """Spectra (M, f) of each period."""
    return np.fft.rfft(signal.reshape(-1, length), axis=1) / length


def _windows(signals: tuple[Array, ...], count: int) -> tuple[Complex, Complex, Complex]:
    """Spectra (M, f) under Hann windows that overlap by half, each without its mean and trend."""
    n = signals[0].size
    length = 2 * n // (count + 1) // 2 * 2
    window = np.hanning(length + 1)[:-1]
    starts = range(0, n - length + 1, length // 2)
    line = np.linspace(-1, 1, length)
    spectra = []
    for signal in signals:
        rows = np.stack([signal[start : start + length] for start in starts])
        rows = rows - rows.mean(axis=1, keepdims=True)
        rows = rows - np.outer(rows @ line / (line @ line), line)
        spectra.append(np.fft.rfft(rows * window, axis=1) / length)
    return spectra[0], spectra[1], spectra[2]


def _smoothed(power: Array) -> Array:
    """The mean over each line and its neighbours: noise has a smooth spectrum, its estimate from M periods has not."""
    width = np.ones(2 * NEIGHBOURS + 1)
    return np.asarray(np.convolve(power, width, "same") / np.convolve(np.ones(power.size), width, "same"))


def _typical(power: Array, neighbours: int = NEIGHBOURS) -> Array:
    """The median over each line and its neighbours: the noise beside a line is one of few that came out too large."""
    padded = np.pad(power, neighbours, mode="reflect")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * neighbours + 1), axis=1))


def _smooth(power: Array, lines: NDArray[np.intp]) -> Array:
    """The power (n,) of one sweep's noise at some lines (n,), from medians over a THIRD of an octave around each.

    The power at each line is of few equations (modal/local_rational.py), and too large beside a sharp mode. As a weight
    it would make deviations too small by its scatter, and those of a narrow mode too large. Towards the ends the
    windows stay centred, as noise may be steep.
    """
    last = lines.size - 1
    grid = np.geomspace(lines[0], lines[-1], 2 + int(MEDIANS_PER_OCTAVE * np.log2(lines[-1] / lines[0])))
    centres = np.unique(np.minimum(np.searchsorted(lines, grid), last))
    medians = []
    for centre in centres:
        below, above = np.searchsorted(lines, [lines[centre] / THIRD, lines[centre] * THIRD])
        half = min(max(centre - below, above - centre, NOISE_LOCAL), centre, last - centre)
        half = max(half, NEIGHBOURS)
        medians.append(np.median(power[max(centre - half, 0) : centre + half + 1]))
    return np.asarray(np.exp(np.interp(np.log(lines), np.log(lines[centres]), np.log(medians))), np.float64)


def _rolling(position: Array) -> bool:
    """Whether the axis, at position (n,) [m], moved in one direction throughout; over so many samples that noise does
    not count."""
    span = _samples_to_move(position, ROLLED)
    moved = position[span:] - position[:-span]
    return bool(np.all(moved > 0) or np.all(moved < 0))


def _turned(position: Array) -> float:
    """The share [1] of the samples in which an axis that was to roll, at position (n,) [m], surely moved back.

    However little it goes back, rolling friction turns round. Fourth differences show the noise: a motion slower than
    the samples hardly has any, and their median leaves out where a fast mode was shaken. 0 for an axis
    that does not get on by more than it is shaken: it was not to roll.
    """
    if abs(position[-1] - position[0]) < np.ptp(_level(position)):
        return 0.0
    span = _samples_to_move(position, 1)
    moved = (position[span:] - position[:-span]) * np.sign(position[-1] - position[0])
    noise = float(np.median(np.abs(np.diff(position, 4)))) / (MEDIAN * FOURTH)
    noise = max(noise, quantisation(position) / math.sqrt(12))
    return float(np.mean(moved < -BACK * math.sqrt(2) * noise))


def _samples_to_move(position: Array, least: int) -> int:
    """Samples in which the axis, at position (n,) [m], moves on at its mean speed: `least`, or as many more as STEPPED
    steps of the scale need, since a slow axis that rolls stays on one reading for a while."""
    speed = abs(float(position[-1] - position[0])) / max(position.size - 1, 1)
    steps = STEPPED * quantisation(position) / speed if speed > 0 else 0.0
    return min(max(least, math.ceil(steps)), position.size - 1)
