"""Modes beyond the usual range of their frequency: where what is left goes with a mode's motion."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from diagnosis.which.detectors.resonances import FREQUENCY_STEP_DAMPINGS, resonances
from models.plant import Mode

SAMPLE = 1e-3
LOW, HIGH = 40.0, 400.0


def mode(frequency: float) -> Mode:
    return Mode(1e-3, frequency, 0.02)


def moved(force: NDArray[np.float64], one: Mode) -> NDArray[np.float64]:
    """How far a mode moves (n,) [m] under a force (n,) [N] that is held, by a recursion of its own."""
    w = 2 * np.pi * one.frequency
    num, den, _ = cont2discrete(([one.gain], [1.0, 2 * one.damping * w, w**2]), SAMPLE)
    return np.asarray(lfilter(num.ravel(), den, force))


@pytest.mark.parametrize("frequency", [47.0, 133.0, 301.0])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_modes_of_either_sign_are_found_within_a_step(frequency: float, sign: float) -> None:
    rng = np.random.default_rng(round(frequency))
    parts = []
    for n in (5_000, 8_000):  # as a force has: much below the range, some in it
        force = lfilter([1.0], [1.0, -0.97], rng.standard_normal(n))
        motion = sign * moved(force, mode(frequency))
        parts.append((force, motion + np.std(motion) * rng.standard_normal(n)))
    found = resonances(parts, SAMPLE, [(LOW, HIGH)], mode, 4)
    assert len(found) <= 4
    assert found[0] == pytest.approx(frequency, rel=FREQUENCY_STEP_DAMPINGS * 0.02)


def test_what_only_shakes_is_no_resonance() -> None:
    """A strong hum that the force does not make stands behind a weak mode that it does."""
    rng = np.random.default_rng(1)
    n = 20_000
    force = rng.standard_normal(n)
    motion = moved(force, mode(220.0))
    hum = 10 * np.std(motion) * np.sin(2 * np.pi * 90.0 * SAMPLE * np.arange(n))
    found = resonances([(force, motion + hum)], SAMPLE, [(LOW, HIGH)], mode, 4)
    assert any(one == pytest.approx(220.0, rel=0.04) for one in found)
