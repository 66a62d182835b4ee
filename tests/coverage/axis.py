"""An axis that nobody here designed, and its simulator; shares no code with models/, only the format of a record.

The linear part, modes, drag and a current loop of first order, is integrated exactly over a substep by one matrix
exponential (scipy). Friction, spring-slider elements that follow the virgin curve F (1 - exp(-x / l)), acts at the
thrust's input by the position in the middle of the substep, extrapolated from its beginning. Feedback is a P/PI cascade
or a PID in parallel form, both after Astrom and Haegglund, Advanced PID Control.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Array = NDArray[np.float64]

SUBSTEPS: Final = 8
ELEMENTS: Final = 24


@dataclass(frozen=True)
class Axis:
    """mass [kg], drag [N s/m], lag and dead_time [s]; gain (m,) [1/kg], frequency (m,) [Hz] and damping (m,) [1] of the
    vibration modes; Coulomb friction [N] over a length [m]; offset [N]; the encoder's step and noise [m]; cascade:
    feedback by a P/PI cascade, else by a PID, whose loop crosses at `bandwidth` [Hz]."""

    sample_time: float
    mass: float
    drag: float
    lag: float
    dead_time: float
    gain: Array
    frequency: Array
    damping: Array
    coulomb: float
    length: float
    offset: float
    step: float
    noise: float
    cascade: bool
    bandwidth: float

    def response(self, frequency: Array) -> NDArray[np.complex128]:
        """x over u (n,) [m/N] at frequencies (n,) [Hz], continuous, while friction is constant."""
        s = 2j * np.pi * frequency
        w = 2 * np.pi * self.frequency[:, None]
        modal = self.gain[:, None] / (s**2 + 2 * self.damping[:, None] * w * s + w**2)
        free = 1 / (self.mass * s**2) + np.sum(modal, axis=0)
        return np.asarray(np.exp(-s * self.dead_time) / (1 + self.lag * s) * free / (1 + self.drag * s * free))


@dataclass(frozen=True)
class Log:
    """What a drive logs (n,): set point and position [m], injected force and command [N]."""

    target: Array
    feedforward: Array
    command: Array
    position: Array


def drawn(seed: int, modes: int) -> Axis:
    """A random axis with so many vibration modes: masses over 2.7 decades, four sample times, either sign of gains."""
    draw = np.random.default_rng(seed)
    ts = (1e-4, 2.5e-4, 5e-4, 1e-3)[seed % 4]
    mass = float(np.exp(draw.uniform(np.log(0.5), np.log(250.0))))
    top = 0.25 / ts
    # Neighbours are at least a factor of 1.35 apart: closer ones are another question, that of resolution.
    low, high = np.log(25.0), np.log(min(top, 600.0))
    frequency = np.sort(np.exp(draw.uniform(low, high, modes)))
    while modes > 1 and np.min(np.diff(np.log(frequency))) < np.log(1.35):
        frequency = np.sort(np.exp(draw.uniform(low, high, modes)))
    share = np.exp(draw.uniform(np.log(0.05), np.log(0.6), modes)) * np.where(draw.uniform(size=modes) < 0.5, -1, 1)
    damping = np.exp(draw.uniform(np.log(0.006), np.log(0.05), modes))
    bandwidth = float(min(draw.uniform(4.0, 8.0), 0.15 * frequency[0] if modes else 8.0))
    # In anti-phase only where the loop gain at the mode stays below 0.3, so that every loop is stable.
    share = np.where(0.6 * damping * frequency > bandwidth * np.abs(share), share, np.abs(share))
    coulomb = mass * float(np.exp(draw.uniform(np.log(0.1), np.log(1.0))))
    return Axis(
        sample_time=ts,
        mass=mass,
        drag=mass * float(np.exp(draw.uniform(np.log(0.3), np.log(10.0)))) * (draw.uniform() < 0.6),
        lag=float(np.exp(draw.uniform(np.log(0.3), np.log(1.5)))) * max(ts, 1e-4) * (draw.uniform() < 0.6),
        dead_time=float(draw.uniform(0.3, 3.2)) * ts,
        gain=share / mass,
        frequency=frequency,
        damping=damping,
        coulomb=coulomb,
        length=float(np.exp(draw.uniform(np.log(3e-6), np.log(3e-5)))),
        offset=float(draw.uniform(-0.2, 0.2)) * coulomb,
        step=float(draw.choice([1e-9, 5e-9, 2e-8])),
        noise=float(draw.choice([1e-9, 3e-9, 1e-8])),
        cascade=bool(draw.uniform() < 0.5),
        bandwidth=bandwidth,
    )


def run(axis: Axis, target: Array, feedforward: Array, seed: int) -> Log:
    """The closed loop over a set point (n,) [m] with a force (n,) [N] added to the command, from rest, unstrained."""
    draw = np.random.default_rng(seed)
    whole = int(axis.dead_time / axis.sample_time)
    rest = axis.dead_time - whole * axis.sample_time
    first = min(max(round(SUBSTEPS * rest / axis.sample_time), 1), SUBSTEPS - 1)
    lengths = np.array([rest / first, (axis.sample_time - rest) / (SUBSTEPS - first)])
    older, newer = (_discrete(axis, h) for h in lengths)
    noise = axis.noise * draw.standard_normal(target.size)
    edges = axis.length * np.geomspace(0.05, 6.0, ELEMENTS)
    slope = axis.coulomb / axis.length * np.exp(-np.concatenate([[0.0], edges]) / axis.length)
    stiffness = slope[:-1] - slope[1:]  # so that the virgin curve has the exponential's slopes
    stiffness *= axis.coulomb / float(stiffness @ edges)
    command, position = _loop(
        older, newer, lengths, first, whole, stiffness, edges, law(axis), target, feedforward, noise, axis.step,
        axis.offset, axis.sample_time, axis.cascade,
    )  # fmt: skip
    return Log(target, feedforward, command, position)


def _discrete(axis: Axis, h: float) -> tuple[Array, Array, Array]:
    """(Phi, Gamma of a held command, Gamma of a held force): states x_0, v_0, x_i, v_i ..., and the thrust last."""
    count = axis.gain.size + 1
    n = 2 * count + 1
    a, b, f = np.zeros((n, n)), np.zeros((n, 1)), np.zeros((n, 1))
    gains = np.concatenate([[1 / axis.mass], axis.gain])
    w = 2 * np.pi * np.concatenate([[0.0], axis.frequency])
    zeta = np.concatenate([[0.0], axis.damping])
    for i in range(count):
        a[2 * i, 2 * i + 1] = 1.0
        a[2 * i + 1, 2 * i] = -(w[i] ** 2)
        a[2 * i + 1, 2 * i + 1] -= 2 * zeta[i] * w[i]
        f[2 * i + 1, 0] = -gains[i]
        a[2 * i + 1, 1:-1:2] -= gains[i] * axis.drag
        if axis.lag > 0:
            a[2 * i + 1, -1] = gains[i]
        else:
            b[2 * i + 1, 0] = gains[i]
    if axis.lag > 0:
        a[-1, -1], b[-1, 0] = -1 / axis.lag, 1 / axis.lag
    whole = np.zeros((n + 2, n + 2))
    whole[:n, :n], whole[:n, n : n + 1], whole[:n, n + 1 :] = a, b, f
    moved = expm(whole * h)
    return moved[:n, :n].copy(), moved[:n, n].copy(), moved[:n, n + 1].copy()


def law(axis: Axis) -> Array:
    """Gains of the feedback: of a cascade (Kv [1/s], Kp [N s/m], Ti [s]), of a PID (kp, ki, kd, filter), tuned on the
    rigid mass to cross at the axis' bandwidth."""
    w = 2 * np.pi * axis.bandwidth
    if axis.cascade:
        return np.array([w / 3, axis.mass * w, 5 / w, 0.0])
    return np.array([axis.mass * w**2 / 2, axis.mass * w**3 / 15, axis.mass * w * 0.9, axis.sample_time])


@numba.njit(cache=True)
def _loop(  # type: ignore[no-untyped-def]  # noqa: PLR0913, PLR0917
    older, newer, lengths, first, whole, stiffness, edges, law, target, feedforward, noise, step, offset, ts,
    cascade
):  # fmt: skip
    n, m = target.size, (older[0].shape[0] - 1) // 2
    command, position = np.zeros(n), np.zeros(n)
    state, z = np.zeros(older[0].shape[0]), np.zeros(edges.size)
    integral, before, rate = 0.0, 0.0, 0.0
    x_before, at = 0.0, 0.0
    for k in range(n):
        x = 0.0
        for i in range(m):
            x += state[2 * i]
        read = np.round((x + noise[k]) / step) * step
        position[k] = read
        error = target[k] - read
        if cascade:
            speed = (read - x_before) / ts if k else 0.0
            wrong = law[0] * error - speed
            integral += wrong * ts / law[2]
            u = law[1] * (wrong + integral)
        else:
            integral += law[1] * ts * error
            keep = law[3] / (law[3] + ts)
            rate = keep * rate + (1 - keep) * (error - before) / ts
            u = law[0] * error + integral + law[2] * rate
        x_before, before = read, error
        command[k] = u + feedforward[k]
        for sub in range(SUBSTEPS):
            # until the rest of the dead time is over the older command acts, then the newer one
            part = older if sub < first else newer
            sent = k - whole - (1 if sub < first else 0)
            held = command[sent] if sent >= 0 else 0.0
            h = lengths[0] if sub < first else lengths[1]
            x, v = 0.0, 0.0
            for i in range(m):
                x += state[2 * i]
                v += state[2 * i + 1]
            middle = x + 0.5 * h * v
            friction = offset
            for i in range(edges.size):
                z[i] = min(max(z[i] + middle - at, -edges[i]), edges[i])
                friction += stiffness[i] * z[i]
            at = middle
            state = part[0] @ state + part[1] * held + part[2] * friction
    return command, position
