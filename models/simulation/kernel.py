"""The simulator's two hot loops: one scheme, for one machine and, side by side in lanes, for many.

Symbols: m modes, N elements, n samples, p = 2 parts of a sample (before and after the thrust changes), L machines. For
each machine both loops do the same operations in the same order, so that they agree bit for bit. What the scheme is:
see simulator.py.

`run_many` fills vector registers with the same number of several machines. For that the compiler has to see, in each
loop over lanes, how long it is, that neighbours lie next to each other in memory, and that no rows overlap: LANES
machines at a time are copied into a few local arrays whose last axis is LANES, and the hot loops touch only those.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.compiled import compiled, inlined

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

LANES: Final = 32  # machines side by side; loops of 16 are unrolled before they are vectorised, and so stay scalar
CHUNK: Final = 32  # samples whose signals are turned into lanes at a time, few enough for the first-level cache

# Rows of the local arrays of `run_many`, whose last axis are the lanes.
X, V, AT, MOVED, AHEAD, ACCELERATION, NET, THRUST, H, HALF = range(10)  # `now`: AT, where the elements stand; HALF of H
INTEGRAL, SLOPE, PREVIOUS = range(3)  # `memory` of the PID: I, d, e[k-1]
Z, LIMIT, STIFFNESS, DAMPING, SLIPPING = range(5)  # `element`: SLIPPING, its force at its limit
THRUST_LIMIT, RESOLUTION, STEP, START, OFFSET = 4, 5, 6, 8, 9  # `fixed`, behind the four gains; of STEP there are two
GAMMA: Final = 4  # `effect`, behind the four entries of phi
REFERENCE, FEEDFORWARD, NOISE = range(3)  # `given`
READING, COMMAND, POSITION, FRICTION = range(4)  # `logged`


class Loop(NamedTuple):
    """Machines and controllers as the loops read them; `run_many` takes every shape with a first axis L, but for *.

    Any stands for Array or float, as an entry of an array of shape (L,) is a float.
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
    offset: Any  # constant force [N] that the thrust has to hold


class Run(NamedTuple):
    """The signals of a run; `run_many` takes every shape with a first axis L. The last six are written to."""

    reference: Array  # (n,) x_T*
    feedforward: Array  # (n,) u_ff + u_rf
    noise: Array  # (n,) of the scale
    start: Any  # thrust before the first sample's, and the PID's integral; 0 for a PID without one
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
def pid_step(
    error: float, previous: float, integral: float, slope: float, gains: Array, sample_time: float
) -> tuple[float, float, float]:
    """One sample of the PID: (u_fb [N], I [N], d [m/s]) from e[k], e[k-1] [m], I, d at k-1; gains (kp, ki, kd, tau)."""
    keep = gains[3] / (gains[3] + sample_time)
    integral = integral + gains[1] * sample_time * error
    slope = keep * slope + (1.0 - keep) * (error - previous) / sample_time
    return gains[0] * error + integral + gains[2] * slope, integral, slope


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
            thrust = clipped(run.command[sent] if sent >= 0 else run.start, loop.thrust_limit) - loop.offset
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
    """Advances L machines over the n samples of `run`, LANES at a time."""
    for first in range(0, run.z.shape[0], LANES):
        _run_lanes(loop, run, first)


@inlined
def _substep(element: Array, mode: Array, effect: Array, now: Array, part: int, damped: bool) -> None:
    """One substep of every lane; rows: see the head of the module."""
    x, v, at, moved, ahead = now[X], now[V], now[AT], now[MOVED], now[AHEAD]
    acceleration, net, thrust, h, half = now[ACCELERATION], now[NET], now[THRUST], now[H], now[HALF]
    for lane in range(LANES):
        middle = x[lane] + half[lane] * v[lane]
        moved[lane] = middle - at[lane]
        at[lane] = middle
        ahead[lane] = v[lane] + half[lane] * acceleration[lane]
        acceleration[lane] = v[lane]
        net[lane] = 0.0
    for i in range(element.shape[0]):
        if damped:
            for lane in range(LANES):
                z = clipped(element[i, Z, lane] + moved[lane], element[i, LIMIT, lane])
                held = element[i, STIFFNESS, lane] * z + element[i, DAMPING, lane] * ahead[lane]
                net[lane] += clipped(held, element[i, SLIPPING, lane])
                element[i, Z, lane] = z
        else:
            for lane in range(LANES):
                z = clipped(element[i, Z, lane] + moved[lane], element[i, LIMIT, lane])
                net[lane] += element[i, STIFFNESS, lane] * z
                element[i, Z, lane] = z
    for lane in range(LANES):
        net[lane] = thrust[lane] - net[lane]
        x[lane] = 0.0
        v[lane] = 0.0
    for j in range(mode.shape[0]):
        for lane in range(LANES):
            q, rate, force = mode[j, 0, lane], mode[j, 1, lane], net[lane]
            by_q, by_rate = effect[part, j, 0, lane], effect[part, j, 1, lane]
            mode[j, 0, lane] = by_q * q + by_rate * rate + effect[part, j, GAMMA, lane] * force
            by_q, by_rate = effect[part, j, 2, lane], effect[part, j, 3, lane]
            mode[j, 1, lane] = by_q * q + by_rate * rate + effect[part, j, GAMMA + 1, lane] * force
            x[lane] += mode[j, 0, lane]
            v[lane] += mode[j, 1, lane]
    if damped:
        for lane in range(LANES):
            acceleration[lane] = (v[lane] - acceleration[lane]) / h[lane]


@compiled
def _run_lanes(loop: Loop, run: Run, first: int) -> None:
    """Advances the machines from `first` on, one in each lane; lanes to spare repeat the last machine."""
    n, modes, elements, delay = run.reference.shape[1], run.state.shape[1], run.z.shape[1], loop.delays[0]
    mode = np.empty((modes, 2, LANES))  # q, q'
    effect = np.empty((2, modes, 6, LANES))  # phi, gamma
    element = np.empty((elements, 5, LANES))
    fixed = np.empty((10, LANES))
    now = np.zeros((10, LANES))
    x, v, at, thrust, h, half = now[X], now[V], now[AT], now[THRUST], now[H], now[HALF]
    memory = np.zeros((3, LANES))
    sent = np.empty((delay + 2, LANES))  # commands under way, in a ring
    given, logged = np.empty((3, CHUNK, LANES)), np.empty((4, CHUNK, LANES))
    _load(loop, run, first, mode, effect, element, fixed)
    damped = False
    for lane in range(LANES):
        memory[INTEGRAL, lane] = fixed[START, lane]
        for i in range(delay + 2):
            sent[i, lane] = fixed[START, lane]
        for i in range(elements):
            damped = damped or element[i, DAMPING, lane] > 0.0
    for j in range(modes):
        for lane in range(LANES):
            x[lane] += mode[j, 0, lane]
            v[lane] += mode[j, 1, lane]
    for lane in range(LANES):
        at[lane] = x[lane]
    for k in range(n):
        if k % CHUNK == 0:
            _gather(run, first, k, loop.delays[1], given)
        _control(element, fixed, now, memory, given, logged, k % CHUNK, loop.sample_time)
        for lane in range(LANES):
            sent[k % (delay + 2), lane] = logged[COMMAND, k % CHUNK, lane]
        for part in range(2):
            under_way = (k - delay - 1 + part) % (delay + 2)
            for lane in range(LANES):
                thrust[lane] = clipped(sent[under_way, lane], fixed[THRUST_LIMIT, lane]) - fixed[OFFSET, lane]
                h[lane] = fixed[STEP + part, lane]
                half[lane] = 0.5 * h[lane]
            for _ in range(loop.counts[part]):
                _substep(element, mode, effect, now, part, damped)
        if k % CHUNK == CHUNK - 1 or k == n - 1:
            _scatter(logged, run, first, k)
    _store(mode, element, run, first)


@compiled
def _control(
    element: Array,
    fixed: Array,
    now: Array,
    memory: Array,
    given: Array,
    logged: Array,
    s: int,
    sample_time: float,
) -> None:
    """What the controller does at a sample; reading, command, x and f go to logged[:, s]. Rows: see the head."""
    x, v, at = now[X], now[V], now[AT]
    for lane in range(LANES):
        logged[POSITION, s, lane] = x[lane]
        logged[FRICTION, s, lane] = 0.0
    for i in range(element.shape[0]):
        for lane in range(LANES):
            stuck = clipped(element[i, Z, lane] + (x[lane] - at[lane]), element[i, LIMIT, lane])
            held = element[i, STIFFNESS, lane] * stuck + element[i, DAMPING, lane] * v[lane]
            logged[FRICTION, s, lane] += clipped(held, element[i, SLIPPING, lane])
    for lane in range(LANES):
        reading = quantised(x[lane] + given[NOISE, s, lane], fixed[RESOLUTION, lane])
        error = given[REFERENCE, s, lane] - reading
        feedback, memory[INTEGRAL, lane], memory[SLOPE, lane] = pid_step(
            error,
            memory[PREVIOUS, lane],
            memory[INTEGRAL, lane],
            memory[SLOPE, lane],
            fixed[:THRUST_LIMIT, lane],
            sample_time,
        )
        memory[PREVIOUS, lane] = error
        logged[READING, s, lane] = reading
        logged[COMMAND, s, lane] = feedback + given[FEEDFORWARD, s, lane]


@compiled
def _load(loop: Loop, run: Run, first: int, mode: Array, effect: Array, element: Array, fixed: Array) -> None:
    """Turns into lanes what is known before the first sample; number by number, as copies of whole arrays take the
    compiler many times as long."""
    for lane in range(LANES):
        machine = min(first + lane, run.z.shape[0] - 1)
        for j in range(mode.shape[0]):
            for i in range(2):
                mode[j, i, lane] = run.state[machine, j, i]
        for part in range(2):
            fixed[STEP + part, lane] = loop.step[machine, part]
            for j in range(mode.shape[0]):
                for i in range(GAMMA):
                    effect[part, j, i, lane] = loop.phi[machine, part, j, i]
                for i in range(2):
                    effect[part, j, GAMMA + i, lane] = loop.gamma[machine, part, j, i]
        for i in range(element.shape[0]):
            element[i, Z, lane] = run.z[machine, i]
            element[i, LIMIT, lane] = loop.limit[machine, i]
            element[i, STIFFNESS, lane] = loop.stiffness[machine, i]
            element[i, DAMPING, lane] = loop.damping[machine, i]
            element[i, SLIPPING, lane] = loop.stiffness[machine, i] * loop.limit[machine, i]
        for i in range(THRUST_LIMIT):
            fixed[i, lane] = loop.gains[machine, i]
        fixed[THRUST_LIMIT, lane] = loop.thrust_limit[machine]
        fixed[RESOLUTION, lane] = loop.resolution[machine]
        fixed[START, lane] = run.start[machine]
        fixed[OFFSET, lane] = loop.offset[machine]


@compiled
def _gather(run: Run, first: int, begin: int, wait: int, given: Array) -> None:
    """Turns into lanes the reference, which waits, the feedforward and the noise of the samples from `begin` on."""
    for lane in range(LANES):
        machine = min(first + lane, run.z.shape[0] - 1)
        reference, feedforward, noise = run.reference[machine], run.feedforward[machine], run.noise[machine]
        for s in range(min(CHUNK, reference.size - begin)):
            given[REFERENCE, s, lane] = reference[max(begin + s - wait, 0)]
            given[FEEDFORWARD, s, lane] = feedforward[begin + s]
            given[NOISE, s, lane] = noise[begin + s]


@compiled
def _scatter(logged: Array, run: Run, first: int, last: int) -> None:
    """Turns lanes into the signals of each machine, for the samples of the chunk up to `last`."""
    begin = last - last % CHUNK
    for lane in range(min(LANES, run.z.shape[0] - first)):
        machine = first + lane
        reading, command, position, friction = (
            run.reading[machine],
            run.command[machine],
            run.position[machine],
            run.friction[machine],
        )
        for k in range(begin, last + 1):
            reading[k] = logged[READING, k - begin, lane]
            command[k] = logged[COMMAND, k - begin, lane]
            position[k] = logged[POSITION, k - begin, lane]
            friction[k] = logged[FRICTION, k - begin, lane]


@compiled
def _store(mode: Array, element: Array, run: Run, first: int) -> None:
    """Turns lanes into the state of each machine after the last sample."""
    for lane in range(min(LANES, run.z.shape[0] - first)):
        for j in range(mode.shape[0]):
            for i in range(2):
                run.state[first + lane, j, i] = mode[j, i, lane]
        for i in range(element.shape[0]):
            run.z[first + lane, i] = element[i, Z, lane]
