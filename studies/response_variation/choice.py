"""The paper's way to choose N: how well N elements follow a hysteresis curve, and loops that the fit has not seen."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from models.friction import Friction, elements, follow
from models.identification.hysteresis import identify, prediction_error

Array = NDArray[np.float64]

NOISE: Final = 0.05  # N, of the force; assumed
RESOLUTION: Final = 1e-7  # m, of the displacement
FITTED: Final = (0, 150, -150, 150, 100, 140, -150)  # corners of the path [um]
HELD_OUT: Final = (0, 150, -150, -60, -120, 30, -20, 80, 40, 60, -150, 150)
FINER: Final = 7  # elements of the curve for one of the machine's


def error_against_count(friction: Friction, seed: int, *, quick: bool) -> dict[str, Any]:
    """Rms error [N] of N = 1 .. 20 elements on a simulated measurement of a finer hysteresis, fitted and held out.

    The measurement has the scale's resolution and noise of NOISE; the parameters of N = 10 come with their deviations.
    """
    rng = np.random.default_rng(seed)
    truth = _finer(friction)
    fitted, held_out = (_measured(truth, corners, rng) for corners in (FITTED, HELD_OUT))
    counts = (1, 2, 5, 10) if quick else range(1, 21)
    found = {count: identify(*fitted, count) for count in counts}
    ten = found[10]
    return {
        "count": list(counts),
        "fitted_N": [found[count].rms_error for count in counts],
        "held_out_N": [prediction_error(found[count].friction, *held_out) for count in counts],
        "noise_N": NOISE,
        "ten": {
            "limit_m": ten.friction.limit,
            "limit_std_m": ten.limit_std,
            "stiffness_N_per_m": ten.friction.stiffness,
            "stiffness_std_N_per_m": ten.stiffness_std,
        },
    }


def _finer(friction: Friction) -> Friction:
    """A friction of FINER times as many elements: each one's force spread evenly over the gap to its neighbours."""
    x, force = np.array(friction.limit), np.array(friction.limit) * np.array(friction.stiffness)
    gaps = np.diff(np.log(x))[:-1]
    half = 0.5 * np.median(gaps) if gaps.size else 0.1
    offsets = np.exp(half * np.linspace(-1, 1, FINER))
    limits = (x[:, None] * offsets).ravel()
    return elements(np.repeat(force / FINER, FINER) / limits, limits)


def _measured(truth: Friction, corners: tuple[int, ...], rng: np.random.Generator) -> tuple[Array, Array]:
    """Displacement as the scale reads it, and force with noise, along a path between the corners [um]."""
    path = np.concatenate([np.linspace(a, b, 250, endpoint=False) for a, b in pairwise(corners)])
    force, _ = follow(truth, path * 1e-6)
    read = np.round(path * 1e-6 / RESOLUTION) * RESOLUTION
    return read, force + NOISE * rng.standard_normal(force.size)
