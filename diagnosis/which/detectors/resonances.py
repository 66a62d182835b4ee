"""The frequencies at which the readings of some records ring as a vibration mode would under their net force.

By how much what the model leaves, as an error of the reading, goes with a mode's motion is a sum over all frequencies:
the force holds the noise of earlier readings, as the loop is closed, and only whole responses are causal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len, rfft
from scipy.ndimage import uniform_filter1d

from models.plant import Mode

Array = NDArray[np.float64]
Spectra = Sequence[tuple[Array, NDArray[np.complex128], Array]]

SMOOTHED: Final = 0.5  # of the lowest frequency: the width over which the power of what is left is smoothed
FREQUENCY_STEP_DAMPINGS: Final = 2.0  # of the mode's damping ratio: relative distance of two frequencies that are tried
FINER: Final = 3  # steps between two of them, about those that resemble best
ABOUT: Final = 2.0  # a mode's response counts from its frequency over this to its frequency times this


def resonances(
    parts: Iterable[tuple[Array, Array]], sample_time: float, ranges: Sequence[tuple[float, float]],
    mode: Callable[[float], Mode], most: int,
) -> list[float]:  # fmt: skip
    """The frequencies [Hz] within each of some ranges, of up to `most` modes that resemble best what is left.

    parts: of each record the net force (n,) [N], its mean from each reading to the next, and the gradient of
        chi-square by an error of the reading (n,) [1/m].
    mode: that of a frequency [Hz].
    """
    if not ranges:
        return []
    width = SMOOTHED * min(low for low, _ in ranges)
    spectra = [_spectra(force, gradient, sample_time, width) for force, gradient in parts]
    return [found for low, high in ranges for found in _peaks(spectra, low, high, mode, most)]


def _peaks(spectra: Spectra, low: float, high: float, mode: Callable[[float], Mode], most: int) -> list[float]:
    step = FREQUENCY_STEP_DAMPINGS * mode(low).damping
    tried = np.geomspace(low, high, 2 + round(np.log(high / low) / step))
    score = np.array([_score(mode(one), spectra) for one in tried])
    inner = np.flatnonzero((score[1:-1] >= score[:-2]) & (score[1:-1] >= score[2:])) + 1
    peaks = (tried[i - 1 : i + 2] for i in inner[np.argsort(-score[inner])][:most])
    finer = (np.geomspace(before, after, 2 * FINER + 1) for before, _, after in peaks)
    return [float(max(near, key=lambda one: _score(mode(one), spectra))) for near in finer]


def _spectra(
    force: Array, gradient: Array, sample_time: float, width: float
) -> tuple[Array, NDArray[np.complex128], Array]:
    """Frequencies (n,) [Hz]; the cross spectrum (n,) of the force and the gradient; that of the force's power with the
    gradient's, smoothed over a width [Hz]."""
    size = next_fast_len(2 * force.size, real=True)
    given, left = rfft(force - np.mean(force), size), rfft(gradient, size)
    # Smoothed by its logarithm, as a resonance would otherwise stand in its own way.
    power = np.log(np.maximum(np.abs(left) ** 2, np.finfo(float).tiny))
    power = np.exp(uniform_filter1d(power, max(round(width * size * sample_time), 3)))
    frequency = np.fft.rfftfreq(size, sample_time)
    hold = np.sinc(frequency * sample_time) * np.exp(-1j * np.pi * frequency * sample_time)
    given *= hold
    return np.asarray(frequency), np.asarray(np.conj(given) * left), np.asarray(np.abs(given) ** 2 * power)


def _score(mode: Mode, spectra: Spectra) -> float:
    """By how much what is left goes with the mode's motion, over what it would by chance, squared [1]."""
    agrees, chance = 0.0, 0.0
    natural = 2 * np.pi * mode.frequency
    for frequency, cross, weight in spectra:
        about = slice(*np.searchsorted(frequency, [mode.frequency / ABOUT, mode.frequency * ABOUT]))
        w = 2 * np.pi * frequency[about]
        response = 1 / (natural**2 - w**2 + 2j * mode.damping * natural * w)
        agrees += float(np.vdot(cross[about], response).real)
        chance += float(np.sum(np.abs(response) ** 2 * weight[about]))
    return agrees**2 / chance if chance > 0 else 0.0
