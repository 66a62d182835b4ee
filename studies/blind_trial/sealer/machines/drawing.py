"""Draws machines, and rejects those that could not run: unstable, close to it, or with modes above Nyquist.

A rejected draw is repeated from the same generator until one passes; how many were rejected, and why, is counted.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from studies.blind_trial.sealer.machines.axis import Axis, knowledge

Array = NDArray[np.float64]

MASS: Final = (0.3, 300.0)  # [kg]
FRICTION: Final = (0.3, 60.0)  # [N]
REACH: Final = (5e-6, 500e-6)  # [m]
RESOLUTION: Final = (1e-9, 1e-6)  # [m]
SAMPLE_TIMES: Final = (1e-4, 1.25e-4, 2e-4, 2.5e-4, 4e-4, 5e-4, 6.25e-4, 8e-4, 1e-3, 1.25e-3, 1.6e-3, 2e-3)  # [s]
FREQUENCIES: Final = (15.0, 500.0)  # [Hz]
CROSSOVER: Final = (15.0, 80.0)  # [Hz]
ELEMENTS: Final = (3, 30)
MODES: Final = 4
OFF: Final = (0.01, 0.15)  # how far a nominal file's mass may be off
STYLES: Final = ("PID", "PI-D", "P/PI")
PEAK: Final = 2.2  # largest sensitivity of the loop, rolling or stuck
SEEN: Final = 8.0  # steps of the scale, at least, in the longest presliding displacement
FASTEST: Final = 0.8  # of Nyquist's frequency, above which a mode is not drawn
NOISY: Final = 0.04  # of the rated thrust, above which the command follows the scale's noise
STIFFEST: Final = 0.15  # of the sample rate, above which presliding would resonate between samples


def spread(rng: np.random.Generator, ends: tuple[float, float]) -> float:
    """A number drawn evenly in its logarithm."""
    return float(np.exp(rng.uniform(np.log(ends[0]), np.log(ends[1]))))


def draw_axis(rng: np.random.Generator) -> tuple[Axis, Counter[str]]:
    """A machine that can run, and the reasons for which draws before it were rejected."""
    rejected: Counter[str] = Counter()
    while True:
        axis = _drawn(rng)
        why = unfit(axis)
        if not why:
            return axis, rejected
        rejected[why] += 1


def unfit(axis: Axis) -> str:
    """Why a machine can't run; empty where it can."""
    if axis.reach < SEEN * axis.resolution:
        return "the scale does not resolve presliding"
    if np.sqrt(axis.stiffness.sum() / axis.mass) / (2 * np.pi) > STIFFEST / axis.sample_time:
        return "presliding resonates between samples"
    if noise_force(axis) > NOISY * axis.rated:
        return "the scale's noise drives the motor"
    for stiffness in (0.0, float(axis.stiffness.sum())):
        if not stable(axis, stiffness):
            return "the loop is unstable"
        if sensitivity(axis, stiffness) > PEAK:
            return "the loop has too little margin"
    return ""


def _drawn(rng: np.random.Generator) -> Axis:
    ts = float(rng.choice(SAMPLE_TIMES))
    mass, friction, crossover = spread(rng, MASS), spread(rng, FRICTION), spread(rng, CROSSOVER)
    dead = float(rng.uniform(0.0, 3.0)) * ts if rng.random() < 0.85 else 0.0
    gain, frequency, damping = _modes(rng, mass, min(FREQUENCIES[1], FASTEST * 0.5 / ts))
    stiffness, limit = _elements(rng, friction)
    resolution = spread(rng, RESOLUTION)
    speed, acceleration = spread(rng, (0.01, 0.5)), spread(rng, (0.2, 8.0))
    style = str(rng.choice(STYLES))
    return Axis(
        sample_time=ts,
        dead_time=dead,
        gain=gain,
        frequency=frequency,
        damping=damping,
        stiffness=stiffness,
        limit=limit,
        resolution=resolution,
        noise=resolution * float(rng.uniform(0.2, 1.0)),
        control=_controller(rng, style, mass, 2 * np.pi * crossover),
        delay=round(dead / ts),
        crossover=crossover,
        rated=(mass * acceleration + 1.5 * friction) * float(rng.uniform(2.0, 4.0)),
        speed=speed,
        acceleration=acceleration,
        travel=spread(rng, (max(5e-3, 20 * limit.max()), 0.3)),
        known=knowledge(spread(rng, OFF) / 2, friction, ts),
        style=style,
    )


def _modes(rng: np.random.Generator, mass: float, highest: float) -> tuple[Array, Array, Array]:
    count = int(rng.integers(0, MODES + 1))
    frequency = np.sort(np.exp(rng.uniform(np.log(FREQUENCIES[0]), np.log(highest), count)))
    gain = np.exp(rng.uniform(np.log(0.01), np.log(0.6), count)) * rng.choice([1.0, 1.0, -1.0], count) / mass
    damping = np.exp(rng.uniform(np.log(0.004), np.log(0.06), count))
    rigid = np.array([1.0 / mass])
    return np.append(rigid, gain), np.append(0.0, frequency), np.append(0.0, damping)


def _elements(rng: np.random.Generator, friction: float) -> tuple[Array, Array]:
    """Stiffness [N/m] and limit [m] of contacts whose limits span one to two and a half decades."""
    count = int(rng.integers(ELEMENTS[0], ELEMENTS[1] + 1))
    longest = spread(rng, REACH)
    limit = longest * 10.0 ** -np.sort(rng.uniform(0.0, rng.uniform(1.0, 2.5), count))[::-1]
    limit[-1] = longest
    force = rng.dirichlet(np.full(count, 2.0)) * friction
    return force / limit, limit


def _controller(rng: np.random.Generator, style: str, mass: float, omega: float) -> dict[str, float]:
    """A controller tuned on the rigid body for a crossover at omega [rad/s]."""
    tau = float(rng.choice([0.0, 1.0])) / (omega * rng.uniform(6.0, 15.0))
    if style == "P/PI":
        return {
            "kind": 1.0,
            "tau": tau,
            "b": 1.0,
            "kpos": omega / rng.uniform(2.5, 6.0),
            "kvel": mass * omega * rng.uniform(0.85, 1.0),
            "tn": rng.uniform(3.0, 12.0) / omega,
            "f": float(rng.choice([0.0, 1.0])),
            "m": mass * float(rng.choice([0.0, 1.0])),
        }
    lead, slow = rng.uniform(2.0, 4.0), rng.uniform(5.0, 15.0)
    kd = mass * omega / np.hypot(1.0, 1.0 / lead)
    kp = kd * omega / lead
    weights = {"b": 1.0, "c": 1.0} if style == "PID" else {"b": float(rng.choice([1.0, 0.6])), "c": 0.0}
    return {"kind": 0.0, "kp": kp, "ki": kp * omega / slow, "kd": kd, "tau": tau, **weights}


def sampled(axis: Axis, stiffness: float = 0.0) -> tuple[Array, Array, Array]:
    """Modes sampled with a held force, friction stuck with a stiffness [N/m]: A (2m, 2m), B (2m,), C (2m,)."""
    m = axis.gain.size
    omega = 2 * np.pi * axis.frequency
    whole = np.zeros((2 * m + 1, 2 * m + 1))
    for i in range(m):
        whole[2 * i, 2 * i + 1] = 1.0
        whole[2 * i + 1, 2 * i] = -(omega[i] ** 2)
        whole[2 * i + 1, 2 * i + 1] = -2 * axis.damping[i] * omega[i]
        whole[2 * i + 1, -1] = axis.gain[i]
        whole[2 * i + 1, 0:-1:2] -= axis.gain[i] * stiffness
    moved = expm(whole * axis.sample_time)
    c = np.zeros(2 * m)
    c[::2] = 1.0
    return moved[:-1, :-1], moved[:-1, -1], c


def delayed(axis: Axis, stiffness: float = 0.0) -> tuple[Array, Array, Array]:
    """The sampled plant behind its dead time, the last commands among its states."""
    a, b, c = sampled(axis, stiffness)
    late = axis.dead_time / axis.sample_time
    whole, n = int(np.floor(late + 1e-9)), b.size
    part = late - whole
    first, second = _split(axis, stiffness, part)
    size = n + whole + 1
    big_a, big_b = np.zeros((size, size)), np.zeros(size)
    big_a[:n, :n] = a
    if whole == 0:  # the states behind the plant's are the last commands, the newest first
        big_b[:n] = second
    else:
        big_a[:n, n + whole - 1] = second
    big_a[:n, n + whole] += first
    big_b[n] = 1.0
    for i in range(1, whole + 1):
        big_a[n + i, n + i - 1] = 1.0
    return big_a, big_b, np.append(c, np.zeros(whole + 1))


def _split(axis: Axis, stiffness: float, part: float) -> tuple[Array, Array]:
    """What a force held over the first `part` of a sample moves, and one over the rest."""
    _, whole, _ = sampled(axis, stiffness)
    _, rest, _ = sampled(replace(axis, sample_time=axis.sample_time * max(1.0 - part, 1e-9)), stiffness)
    return whole - rest, rest


def controller(axis: Axis) -> tuple[Array, Array, Array, float]:
    """The feedback from -x to u: A, B, C, D, of two states, the integral and what the filter remembers."""
    g, ts = axis.control, axis.sample_time
    keep = g["tau"] / (g["tau"] + ts)
    slope = (1.0 - keep) / ts
    if g["kind"] == 0.0:
        kp, ki, kd = g["kp"], g["ki"], g["kd"]
        # states: integral before this sample; what the derivative owes to the past
        a = np.diag([1.0, keep])
        b = np.array([ki * ts, (keep - 1.0) * slope])
        return a, b, np.array([1.0, kd]), kp + ki * ts + kd * slope
    kpos, kvel = g["kpos"], g["kvel"]
    rate = ts / g["tn"] if g["tn"] > 0 else 0.0
    a = np.array([[1.0, kvel * rate], [0.0, keep]])
    b = np.array([kvel * rate * (kpos + slope), (keep - 1.0) * slope])
    return a, b, np.array([1.0, kvel * (1.0 + rate)]), kvel * (1.0 + rate) * (kpos + slope)


def noise_force(axis: Axis) -> float:
    """Deviation [N] of the command that the scale's noise and rounding make, the loop open."""
    a, b, c, d = controller(axis)
    state, total = b.copy(), d * d
    for _ in range(200):
        total += float(c @ state) ** 2
        state = a @ state
    return float(np.sqrt(total)) * axis.read


def stable(axis: Axis, stiffness: float) -> bool:
    """Whether the closed loop's poles are inside the unit circle."""
    a, b, c = delayed(axis, stiffness)
    ca, cb, cc, cd = controller(axis)
    closed = np.block([[a - cd * np.outer(b, c), np.outer(b, cc)], [-np.outer(cb, c), ca]])
    return bool(np.abs(np.linalg.eigvals(closed)).max() < 1.0 - 1e-9)


def sensitivity(axis: Axis, stiffness: float, points: int = 1000) -> float:
    """Largest |1 / (1 + L)| from 1 Hz to Nyquist's frequency, and at the modes."""
    nyquist = 0.5 / axis.sample_time
    near = (axis.frequency[1:, None] * (1.0 + np.linspace(-0.1, 0.1, 81))).ravel()
    f = np.concatenate([np.geomspace(1.0, nyquist, points), near[near < nyquist]])
    z = np.exp(2j * np.pi * f * axis.sample_time)
    return float(np.max(1.0 / np.abs(1.0 + _response(delayed(axis, stiffness), z) * _response(controller(axis), z))))


def _response(
    system: tuple[Array, Array, Array] | tuple[Array, Array, Array, float], z: NDArray[np.complex128]
) -> NDArray[np.complex128]:
    a, b, c = system[:3]
    direct = system[3] if len(system) == 4 else 0.0
    states = np.linalg.solve(z[:, None, None] * np.eye(b.size) - a, np.broadcast_to(b[:, None], (z.size, b.size, 1)))
    return np.asarray(direct + states[..., 0] @ c)
