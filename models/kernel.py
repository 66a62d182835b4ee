"""The simulator's two hot loops: one scheme, for one machine and, side by side in lanes, for many.

Symbols: m modes, N elements, n samples, p = 2 parts of a sample (before and after the thrust changes), L lanes. For a
lane both loops do the same operations in the same order, so that they agree bit for bit. What the scheme is: see
simulator.py.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.compiled import compiled
from models.controller import pid_step

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Loop(NamedTuple):
    """Machines and controllers as the loops read them; `run_many` takes every shape with a last axis L, but for *.

    Any stands for Array or float, as a lane of an array of shape (L,) is a float.
    """

    sample_time: float  # *
    delays: Integers  # * (2,) whole samples of dead time, and those by which the PID's reference waits
    counts: Integers  # * (p,) substeps
    step: Array  # (p,) length of a substep [s]
    phi: Array  # (p, m, 4) transition of (q, q') over a substep
    gamma: Array  # (p, m, 2) effect of the held input on (q, q')
    stiffness: Array  # (N,)
    limit: Array  # (N,)
    damping: Array  # (N,)
    gains: Array  # (4,) kp, ki, kd, tau of the PID
    thrust_limit: Any
    resolution: Any


class Run(NamedTuple):
    """The signals of a run; `run_many` takes every shape with a last axis L. The last six are written to."""

    reference: Array  # (n,) x_T*
    feedforward: Array  # (n,) u_ff + u_rf
    noise: Array  # (n,) of the scale
    start: Any  # thrust before the first sample's, and the PID's integral
    state: Array  # (m, 2) modes' (q, q')
    z: Array  # (N,) elements
    reading: Array  # (n,) of the scale
    command: Array  # (n,) u_M as the controller puts it out
    position: Array  # (n,) x
    friction: Array  # (n,) f


@compiled
def quantised(position: float, resolution: float) -> float:
    """What a scale of this resolution [m] (0: exact) reads at a position [m]."""
    return position if resolution == 0.0 else math.floor(position / resolution + 0.5) * resolution


@compiled
def clipped(number: float, limit: float) -> float:
    """The nearest number within +-limit; any unit, the same for both [N] or [m]."""
    return max(-limit, min(number, limit))


@compiled
def run_one(loop: Loop, run: Run) -> None:
    """Advances one machine over the n samples of `run`."""
    phi, gamma, state, z = loop.phi, loop.gamma, run.state, run.z
    stiffness, limit, damping = loop.stiffness, loop.limit, loop.damping
    modes, elements = state.shape[0], z.size
    damped = damping.max() > 0.0
    integral, slope, previous = run.start, 0.0, 0.0
    acceleration = x = v = 0.0
    for j in range(modes):
        x += state[j, 0]
        v += state[j, 1]
    at = x  # where the elements stand
    for k in range(run.reference.size):
        force = 0.0
        for i in range(elements):
            stuck = clipped(z[i] + (x - at), limit[i])
            force += clipped(stiffness[i] * stuck + damping[i] * v, stiffness[i] * limit[i])
        run.position[k], run.friction[k] = x, force
        run.reading[k] = quantised(x + run.noise[k], loop.resolution)
        error = run.reference[max(k - loop.delays[1], 0)] - run.reading[k]
        feedback, integral, slope = pid_step(error, previous, integral, slope, loop.gains, loop.sample_time)
        previous = error
        run.command[k] = feedback + run.feedforward[k]
        for part in range(2):
            sent = k - loop.delays[0] - 1 + part
            thrust = clipped(run.command[sent] if sent >= 0 else run.start, loop.thrust_limit)
            h = loop.step[part]
            for _ in range(loop.counts[part]):
                middle = x + 0.5 * h * v
                moved = middle - at
                at = middle
                force = 0.0
                if damped:
                    ahead = v + 0.5 * h * acceleration
                    for i in range(elements):
                        z[i] = clipped(z[i] + moved, limit[i])
                        force += clipped(stiffness[i] * z[i] + damping[i] * ahead, stiffness[i] * limit[i])
                else:
                    for i in range(elements):
                        z[i] = clipped(z[i] + moved, limit[i])
                        force += stiffness[i] * z[i]
                net = thrust - force
                before = v
                x = v = 0.0
                for j in range(modes):
                    q, rate = state[j, 0], state[j, 1]
                    state[j, 0] = phi[part, j, 0] * q + phi[part, j, 1] * rate + gamma[part, j, 0] * net
                    state[j, 1] = phi[part, j, 2] * q + phi[part, j, 3] * rate + gamma[part, j, 1] * net
                    x += state[j, 0]
                    v += state[j, 1]
                acceleration = (v - before) / h


@compiled
def run_many(loop: Loop, run: Run) -> None:
    """Advances L machines over the n samples of `run`; the inner loops run over lanes, to fill vector registers."""
    phi, gamma, state, z = loop.phi, loop.gamma, run.state, run.z
    stiffness, limit, damping = loop.stiffness, loop.limit, loop.damping
    modes, elements, lanes = state.shape[0], z.shape[0], z.shape[1]
    damped = damping.max() > 0.0
    integral, slope, previous = run.start.copy(), np.zeros(lanes), np.zeros(lanes)
    x, v, acceleration = np.zeros(lanes), np.zeros(lanes), np.zeros(lanes)
    moved, ahead, force, thrust = np.zeros(lanes), np.zeros(lanes), np.zeros(lanes), np.zeros(lanes)
    for j in range(modes):
        for lane in range(lanes):
            x[lane] += state[j, 0, lane]
            v[lane] += state[j, 1, lane]
    at = x.copy()
    for k in range(run.reference.shape[0]):
        for lane in range(lanes):
            total = 0.0
            for i in range(elements):
                stuck = clipped(z[i, lane] + (x[lane] - at[lane]), limit[i, lane])
                held = stiffness[i, lane] * stuck + damping[i, lane] * v[lane]
                total += clipped(held, stiffness[i, lane] * limit[i, lane])
            run.position[k, lane], run.friction[k, lane] = x[lane], total
            run.reading[k, lane] = quantised(x[lane] + run.noise[k, lane], loop.resolution[lane])
            error = run.reference[max(k - loop.delays[1], 0), lane] - run.reading[k, lane]
            feedback, integral[lane], slope[lane] = pid_step(
                error, previous[lane], integral[lane], slope[lane], loop.gains[:, lane], loop.sample_time
            )
            previous[lane] = error
            run.command[k, lane] = feedback + run.feedforward[k, lane]
        for part in range(2):
            sent = k - loop.delays[0] - 1 + part
            for lane in range(lanes):
                thrust[lane] = clipped(
                    run.command[sent, lane] if sent >= 0 else run.start[lane], loop.thrust_limit[lane]
                )
            for _ in range(loop.counts[part]):
                for lane in range(lanes):
                    middle = x[lane] + 0.5 * loop.step[part, lane] * v[lane]
                    moved[lane] = middle - at[lane]
                    at[lane] = middle
                    ahead[lane] = v[lane] + 0.5 * loop.step[part, lane] * acceleration[lane]
                    force[lane] = 0.0
                for i in range(elements):
                    if damped:
                        for lane in range(lanes):
                            z[i, lane] = clipped(z[i, lane] + moved[lane], limit[i, lane])
                            held = stiffness[i, lane] * z[i, lane] + damping[i, lane] * ahead[lane]
                            force[lane] += clipped(held, stiffness[i, lane] * limit[i, lane])
                    else:
                        for lane in range(lanes):
                            z[i, lane] = clipped(z[i, lane] + moved[lane], limit[i, lane])
                            force[lane] += stiffness[i, lane] * z[i, lane]
                for lane in range(lanes):
                    acceleration[lane] = v[lane]
                    force[lane] = thrust[lane] - force[lane]
                    x[lane] = v[lane] = 0.0
                for j in range(modes):
                    for lane in range(lanes):
                        q, rate, net = state[j, 0, lane], state[j, 1, lane], force[lane]
                        state[j, 0, lane] = (
                            phi[part, j, 0, lane] * q + phi[part, j, 1, lane] * rate + gamma[part, j, 0, lane] * net
                        )
                        state[j, 1, lane] = (
                            phi[part, j, 2, lane] * q + phi[part, j, 3, lane] * rate + gamma[part, j, 1, lane] * net
                        )
                        x[lane] += state[j, 0, lane]
                        v[lane] += state[j, 1, lane]
                for lane in range(lanes):
                    acceleration[lane] = (v[lane] - acceleration[lane]) / loop.step[part, lane]
