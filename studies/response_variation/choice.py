"""The paper's way to choose N: the fit of N elements to a hysteresis curve, and to held-out loops."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from models.friction import Friction, deflections, elements, follow
from models.identification.hysteresis import Identified, branch_of_facts, identify, prediction_error
from models.machine import Machine

Array = NDArray[np.float64]

NOISE: Final = 1 / 330  # of the friction, that of the force; assumed: 0.05 N on the paper's table
FITTED: Final = (0, 1.5, -1.5, 1.5, 1.0, 1.4, -1.5)  # corners of the path, in presliding regions
HELD_OUT: Final = (0, 1.5, -1.5, -0.6, -1.2, 0.3, -0.2, 0.8, 0.4, 0.6, -1.5, 1.5)
MORE: Final = 0.1  # Fewer elements are preferred if their held-out error exceeds the least by at most this fraction.
DAMPED: Final = 3  # Elements whose D_i is identified; with more, the D_i are not identifiable one by one.
INTERVAL: Final = 0.4  # sample times from one point of the loops to the next, where their speed counts
FINER: Final = 7  # elements of the curve for one of the machine's


def error_against_count(
    machine: Machine, seed: int, *, quick: bool, tell: Callable[[float, str], None]
) -> dict[str, Any]:
    """Rms error [N] of N = 1 .. 20 elements on a simulated measurement of a finer hysteresis, fitted and held out.

    The measurement has the scale's resolution and noise of NOISE, along a path as long as the presliding region asks
    for. `chosen`: the fewest elements whose error on the held-out loops is within MORE of the least; the parameters of
    the machine's own N have standard deviations.
    `facts`: the elements that follow from the published facts of the hysteresis alone. `tell(share, text)`: progress.
    """
    rng = np.random.default_rng(seed)
    truth, own = _finer(machine.friction), len(machine.friction.limit)
    fitted, held_out = (_measured(machine, truth, corners, rng) for corners in (FITTED, HELD_OUT))
    counts = sorted({1, 2, 5, 10, own} if quick else {*range(1, 21), own})
    found = {}
    for count in counts:
        tell(sum(c for c in counts if c < count) / sum(counts), f"identifying N = {count} elements")
        found[count] = identify(*fitted, count)
    errors = {count: prediction_error(found[count].friction, *held_out) for count in counts}
    best = min(errors.values())
    return {
        "count": counts,
        "fitted_N": [found[count].rms_error for count in counts],
        "held_out_N": [errors[count] for count in counts],
        "noise_N": _noise(machine),
        "own": own,
        "own_over_least": errors[own] / best,
        "chosen": min(count for count in counts if errors[count] <= (1 + MORE) * best),
        "more": MORE,
        "elements": _parameters(found[own]),
        "facts": _of_facts(machine),
        "damped": _of_speed(machine, rng),
    }


def _of_facts(machine: Machine) -> dict[str, Any]:
    """The two elements that T_fc, K_e1, K_e2 and the boundary of Fig. 3b make, and their rms error [N] to it."""
    facts = machine.presliding
    curve = branch_of_facts(facts.coulomb_force, facts.stiffness_1, facts.stiffness_2, facts.boundary)
    two = identify(*curve, 2)
    return {"limit_m": two.friction.limit, "stiffness_N_per_m": two.friction.stiffness, "rms_N": two.rms_error}


def _of_speed(machine: Machine, rng: np.random.Generator) -> dict[str, Any]:
    """D_i of DAMPED elements [N s/m] from the fitted loops, run so fast that each D_i of the machine acts."""
    friction = machine.friction
    truth, x = _finer(friction), _path(machine, FITTED)
    k, limit, d = np.array(truth.stiffness), np.array(truth.limit), np.repeat(friction.damping, FINER) / FINER
    speed = np.gradient(x, INTERVAL * machine.sample_time)
    force = np.sum(np.clip(k * deflections(limit, x) + d * speed[:, None], -k * limit, k * limit), axis=1)
    force += _noise(machine) * rng.standard_normal(x.size)
    found = identify(_read(machine, x), force, DAMPED, velocity=speed)
    return {
        "speed_m_per_s": np.max(np.abs(speed)),
        "damping_Ns_per_m": found.friction.damping,
        "damping_std_Ns_per_m": found.damping_std,
        "own_Ns_per_m": float(np.sum(friction.damping)),
    }


def _parameters(found: Identified) -> dict[str, Any]:
    return {
        "limit_m": found.friction.limit,
        "limit_std_m": found.limit_std,
        "stiffness_N_per_m": found.friction.stiffness,
        "stiffness_std_N_per_m": found.stiffness_std,
    }


def _finer(friction: Friction) -> Friction:
    """A friction of FINER times as many elements: each one's force spread evenly over the gap to its neighbours."""
    x, force = np.array(friction.limit), np.array(friction.limit) * np.array(friction.stiffness)
    gaps = np.diff(np.log(x))[:-1]
    half = 0.5 * np.median(gaps) if gaps.size else 0.1
    offsets = np.exp(half * np.linspace(-1, 1, FINER))
    limits = (x[:, None] * offsets).ravel()
    return elements(np.repeat(force / FINER, FINER) / limits, limits)


def _measured(
    machine: Machine, truth: Friction, corners: tuple[float, ...], rng: np.random.Generator
) -> tuple[Array, Array]:
    """Displacement [m] as the scale reads it, and force [N] with noise, along a path between the corners."""
    path = _path(machine, corners)
    force, _ = follow(truth, path)
    return _read(machine, path), force + _noise(machine) * rng.standard_normal(force.size)


def _noise(machine: Machine) -> float:
    """Of the measured force [N]."""
    return NOISE * machine.presliding.coulomb_force


def _path(machine: Machine, corners: tuple[float, ...]) -> Array:
    """Between corners [presliding regions], in [m]."""
    return machine.presliding.extent * np.concatenate(
        [np.linspace(a, b, 250, endpoint=False) for a, b in pairwise(corners)]
    )


def _read(machine: Machine, path: Array) -> Array:
    """As the scale reads it [m]."""
    step = machine.scale.resolution
    return np.asarray(np.round(path / step) * step if step else path, float)
