"""The frequency response of the plant from a record with a known excitation, in open or closed loop.

With r the excitation, u the command and x the position, S_ab their cross spectra:

    P(f) = S_xr(f) / S_ur(f)

which is free of the bias that S_xu / S_uu has under feedback, as r is independent of the noise (Ljung, System
Identification, 13.5; Pintelon and Schoukens, 2.6). A periodic one is averaged over its periods, without leakage;
a random one over Hann windows. A single sweep is at each frequency once, so there is nothing to average: P is X / U of
the whole record, its variance the scatter about a local model (see `_swept`). Frequencies f [Hz]; M periods or windows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.records.record import Record

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

WEAKEST: Final = 1e-2  # of the strongest line of the excitation: lines below are not looked at
LOWEST: Final = 8  # lines under a window that are left out: slow motion leaks into them
ONCE: Final = 0.5  # of a line's power in a single window: a sweep went by there
SURELY: Final = 3.0  # times its neighbours' noise, from which on a line of a periodic excitation has more of its own
NEIGHBOURS: Final = 4  # lines on each side over which the noise's power is averaged
LOCAL: Final = 8  # lines on each side over which the local model of one sweep holds
DEGREE: Final = 2  # of that model's polynomials
FEWEST: Final = 4 * (2 * LOCAL + 1)  # lines of one sweep
OCTAVES: Final = 2.0  # that one sweep covers at least
SKIRT: Final = 0.02  # of the sweep's power below its lowest line and above its highest: what its start and stop leak
LED: Final = 0.9  # coherence of command and sweep: below, feedback of the noise leads the command
SEEN: Final = 0.5  # coherence of position and sweep: below, the position moves by less than the scale resolves


@dataclass(frozen=True)
class FrequencyResponse:
    """P (n,) [m/N] at frequencies (n,) [Hz], the variance of each |error|^2 (NaN: unknown) and the coherence (n,).

    sample_time [s]: a response of the plant behind a zero-order hold at the samples; 0: of the continuous plant.
    rolling: the record never stood still nor turned round, so that rolling friction was constant and bends nothing.
    command: the spectrum U (n,) [any unit] of one record that is neither periodic nor windowed: X / U then holds what
    the record's two ends leave of each mode, too; None: no such part.
    """

    frequency: Array
    response: Complex
    variance: Array
    coherence: Array
    sample_time: float
    rolling: bool = False
    command: Complex | None = None


def period(signal: Array) -> int | None:
    """The shortest period [samples] with which a signal (n,) [any unit] repeats at least twice, or None."""
    active = np.flatnonzero(np.abs(signal) > 0)
    if active.size < 32:
        return None
    s = signal[active[0] : active[-1] + 1]
    n = s.size
    spectrum = np.fft.rfft(s, 2 * n)
    product = np.fft.irfft(np.abs(spectrum) ** 2)[:n]
    energy = np.concatenate([[0.0], np.cumsum(s**2)])
    lag = np.arange(1, n // 2)
    apart = energy[n - lag] + energy[n] - energy[lag] - 2 * product[lag]
    repeats = lag[apart < 1e-6 * energy[n]]
    repeats = repeats[repeats > 8]
    return int(repeats[0]) if repeats.size else None


def measured(record: Record, windows: int = 15) -> FrequencyResponse:
    """P from a record that is excited through its feedforward; see the module's head.

    windows: for a random excitation. Raises ValueError for a record without an excitation, or of one that shows little.
    """
    excitation = record.feedforward
    if np.ptp(excitation) == 0:
        raise ValueError("the record has no excitation: its feedforward is constant; log the excitation there")
    length = period(excitation)
    signals = (excitation, record.command, record.position)
    if length is None:
        r, u, x = _windows(signals, windows)
        if _passes_once(r):
            return _swept(record)
        count = 0.6 * r.shape[0]  # windows that overlap by half are not independent
        size, lowest = 2 * (r.shape[1] - 1), LOWEST
        first, last = 0, record.position.size
    else:
        first, last = _stretch(excitation, length)
        r, u, x = _periods([signal[first:last] for signal in signals], length)
        count, size, lowest = float(r.shape[0]), length, 1
    if r.shape[0] < 2:
        raise ValueError("the excitation repeats less than three times; record more periods of it")
    frequency = np.fft.rfftfreq(size, record.sample_time)
    power = np.mean(np.abs(r) ** 2, axis=0)
    used = (power > WEAKEST**2 * np.max(power[1:])) & (frequency < 0.45 / record.sample_time)
    used[:lowest] = False
    r, u, x, power = r[:, used], u[:, used], x[:, used], power[used]
    cross_x, cross_u = np.mean(x * np.conj(r), axis=0), np.mean(u * np.conj(r), axis=0)
    response = cross_x / cross_u
    error = np.sum(np.abs(x - response * u) ** 2, axis=0) / (r.shape[0] - 1)
    smooth = _smoothed(error)
    error = np.where(error > SURELY * smooth, error, smooth)  # at a mode that still rings, more than its neighbours
    variance = error * power / (count * np.abs(cross_u) ** 2)
    coherence = np.abs(cross_x) ** 2 / (np.mean(np.abs(x) ** 2, axis=0) * power)
    rolling = _rolling(record.position[first:last], record.sample_time)
    return FrequencyResponse(frequency[used], response, variance, coherence, record.sample_time, rolling)


def _passes_once(excitation: Complex) -> bool:
    """Whether an excitation with spectra (M, f) of windows is at each frequency for part of the time only."""
    power = np.abs(excitation) ** 2
    total = np.sum(power, axis=0)
    strong = total > WEAKEST**2 * np.max(total)
    return bool(np.median(np.max(power[:, strong], axis=0) / total[strong]) > ONCE)


def _swept(record: Record) -> FrequencyResponse:
    """P from one sweep that does not repeat: X / U at the lines of the whole record, while the sweep lasts.

    There X = P U + (what the ends leave) + noise, without a bias of windows or of smoothing; modes.fit models the ends.
    Under feedback this is consistent with the noise's own power as weight (the direct method; Forssell and Ljung,
    Closed-loop identification revisited, Automatica 1999). Raises ValueError for a sweep too short, narrow or weak.
    """
    active = np.flatnonzero(np.abs(record.feedforward) > 0)
    part, ts = record.part(int(active[0]), int(active[-1]) + 1), record.sample_time
    n = part.position.size
    level = part.position - np.linspace(part.position[0], part.position[-1], n)  # a ramp leaks into every line
    r, u, x = (np.fft.rfft(signal) / n for signal in (part.feedforward, part.command, level))
    frequency, passed = np.fft.rfftfreq(n, ts), np.cumsum(np.abs(r[1:]) ** 2)
    passed = np.concatenate([[0.0], passed / passed[-1]])
    swept = (passed > SKIRT) & (passed < 1 - SKIRT) & (frequency < 0.45 / ts)
    if np.sum(swept) < FEWEST:
        raise ValueError(
            f"the sweep of {n * ts:.3g} s has {np.sum(swept)} lines; {FEWEST} are needed, sweep for longer"
        )
    noise, coherence, commanded = (_smoothed(values) for values in _local(r, u, x))
    used = swept & (commanded > LED) & (coherence > SEEN)
    if np.sum(used) < FEWEST:
        raise ValueError("the sweep is too weak: position or command is noise at most lines; sweep with more force")
    f, u = np.asarray(frequency[used], np.float64), u[used]
    if f[-1] < 2**OCTAVES * f[0]:
        raise ValueError(
            f"the sweep shows {f[0]:.3g} to {f[-1]:.3g} Hz only; sweep over {OCTAVES:g} octaves, with more force"
        )
    rolling = _rolling(part.position, ts)
    begun, moved = max(round(0.003 / ts), 1), abs(part.position - part.position[0])
    if rolling and moved[begun] < 0.5 * moved[-1] * begun / n:
        raise ValueError("the sweep begins before the axis rolls: friction still builds up; let it roll for a second")
    return FrequencyResponse(f, x[used] / u, noise[used] / np.abs(u) ** 2, coherence[used], ts, rolling, u)


def _local(r: Complex, u: Complex, x: Complex) -> tuple[Array, Array, Array]:
    """Power of the noise x - P u and the coherences of x and of u with r (n,), from spectra (n,) of one record.

    Least squares of x and u over each line and its neighbours, as r times polynomials of frequency (Pintelon and
    Schoukens, System Identification, 2012, 7.2); on r, since u holds the fed back noise. Without a polynomial for what
    the ends leave, which looks like a sweep's own first and last second: the ends count as noise here, as does what the
    polynomials miss at a sharp mode.
    """
    n, width = r.size, 2 * LOCAL + 1
    near = np.clip(np.arange(n) - LOCAL, 0, n - width)[:, None] + np.arange(width)
    powers = np.linspace(-1, 1, width)[:, None] ** np.arange(DEGREE + 1)
    q, triangle = np.linalg.qr(r[near, None] * powers)
    both = np.stack([x[near], u[near]], axis=2)
    share = q.conj().swapaxes(1, 2) @ both
    left = both - q @ share
    gain = np.linalg.solve(triangle, share)[:, 0]
    noise = np.sum(np.abs(left[:, :, 0] - (gain[:, 0] / gain[:, 1])[:, None] * left[:, :, 1]) ** 2, axis=1)
    explained, rest = (np.sum(np.abs(part) ** 2, axis=1) for part in (share, left))
    coherence = explained / (explained + rest)
    return noise / (width - q.shape[2]), coherence[:, 0], coherence[:, 1]


def _stretch(excitation: Array, length: int) -> tuple[int, int]:
    """First and last sample of the whole periods, the first of them left out: the response was not periodic yet."""
    active = np.flatnonzero(np.abs(excitation) > 0)
    first = int(active[0]) + length
    return first, first + (int(active[-1]) + 1 - first) // length * length


def _periods(signals: list[Array], length: int) -> tuple[Complex, Complex, Complex]:
    """Spectra (M, f) of each period; what moves along steadily is taken off."""
    spectra = []
    for signal in signals:
        rows = signal.reshape(-1, length)
        means = rows.mean(axis=1)
        slope = (means[-1] - means[0]) / ((rows.shape[0] - 1) * length) if rows.shape[0] > 1 else 0.0
        level = signal - slope * np.arange(signal.size)
        spectra.append(np.fft.rfft(level.reshape(-1, length), axis=1) / length)
    return spectra[0], spectra[1], spectra[2]


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


def _rolling(position: Array, sample_time: float) -> bool:
    """Whether the axis moved in one direction throughout, judged over 10 ms so that noise does not count."""
    span = max(round(0.01 / sample_time), 1)
    moved = position[span:] - position[:-span]
    return bool(np.all(moved > 0) or np.all(moved < 0))
