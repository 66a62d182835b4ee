"""A drawn machine in its loop: Runge-Kutta of fourth order on modes and attachments, several steps a sample.

Friction is a set of elements that stick and slip (Iwan 1966), tried at every stage from where the step began. What is
slow (relaxation, ageing, heat) moves once a step. A step ends where a command begins to act: on a scale of a nanometre
it shows when within a step that was.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numpy.typing import NDArray

from studies.blind_trial.sealer.loop import POINTS, Moving, Run, alone, compiled
from studies.blind_trial.sealer.machines import places as at
from studies.blind_trial.sealer.machines.mechanics import (
    amplified,
    behind_gaps,
    level,
    limits,
    odd_slope,
    settle,
    shown,
    surroundings,
    thrust,
)
from studies.blind_trial.sealer.machines.truth import ATTACHED, Truth

Array = NDArray[np.float64]


@compiled
def element_force(p: Truth, z: Array, moved: float, behind: float, scale: float) -> float:
    """Force [N] of all elements after a further displacement; z stays. behind: that of contacts behind a clearance."""
    stiffness, limit, total = p.stiffness, p.limit, 0.0
    if p.c[at.GAP_FORM] == 0.0:
        for i in range(z.size):
            total += stiffness[i] * min(max(z[i] + moved, -scale * limit[i]), scale * limit[i])
        return float(total)
    for i in range(z.size):
        step = moved if p.c[at.GAP_FORM] == 2.0 and i % 2 == 0 else behind
        total += stiffness[i] * min(max(z[i] + step, -scale * limit[i]), scale * limit[i])
    return float(total)


@compiled
def friction(p: Truth, m: Moving, x: float, v: float, held: tuple[float, float, float]) -> float:
    """Friction [N] at a place and speed within a step; held: where it began, where the contacts behind gaps were then
    [m], and the factor of the limits."""
    c, (origin, behind, scale) = p.c, held
    seen = behind_gaps(c[at.GAP_FORM], c[at.GAP], x, m.gaps) - behind if c[at.GAP_FORM] > 0.0 else 0.0
    dry = element_force(p, m.z, x - origin, seen, scale)
    if c[at.ODD_FORM] > 0.0:
        sign = 1.0 if x >= origin else -1.0
        state = m.slow[at.ODD_STATE]
        state += (x - origin) / c[at.ODD_LENGTH] * odd_slope(c[at.ODD_FORM], state, sign)
        dry = (1.0 - c[at.ODD]) * dry + c[at.ODD] * c[at.ODD_FORCE] * state
    return float(dry * level(c, x, v, m.slow) - m.slow[at.RELAXED])


@compiled
def place_of(p: Truth, y: Array) -> float:
    """Position [m] of the table."""
    x = y[2 * p.gain.size + 7]
    for i in range(p.gain.size):
        x += y[2 * i]
    return float(x)


@compiled
def speed_of(p: Truth, y: Array) -> float:
    """Speed [m/s] of the table."""
    v = y[2 * p.gain.size + 8]
    for i in range(p.gain.size):
        v += y[2 * i + 1]
    return float(v)


@compiled
def rates(
    p: Truth, m: Moving, y: Array, inputs: tuple[float, float], held: tuple[float, float, float], out: Array
) -> None:
    """dy/dt at the states y, into `out`; inputs: the amplifier's and a push [N]; held: as `friction` has them."""
    c, n, (u, push) = p.c, 2 * p.gain.size, inputs
    x, v = place_of(p, y), speed_of(p, y)
    dry = friction(p, m, x, v, held)
    for i in range(n, n + ATTACHED):
        out[i] = 0.0
    if c[at.LAG_FORM] == 1.0:  # two lags in series
        half = 0.5 * c[at.LAG]
        out[n + 5], out[n + 6] = (dry - y[n + 5]) / half, (y[n + 5] - y[n + 6]) / half
        dry = y[n + 6]
    elif c[at.LAG_FORM] == 2.0:  # one lag, shorter at speed
        out[n + 5] = (dry - y[n + 5]) / max(c[at.LAG] / (1.0 + abs(v) / c[at.LAG_SPEED]), 2.0 * c[at.STEP])
        dry = y[n + 5]
    if c[at.CURRENT_FORM] == 1.0:  # second order, damping 0.7
        omega = 1.4 / c[at.CURRENT]
        out[n + 2], out[n + 3] = y[n + 3], omega * omega * (u - y[n + 2]) - 1.4 * omega * y[n + 3]
        u = y[n + 2]
    elif c[at.CURRENT_FORM] == 2.0:  # three equal lags in series
        third = c[at.CURRENT] / 3.0
        out[n + 2], out[n + 3] = (u - y[n + 2]) / third, (y[n + 2] - y[n + 3]) / third
        out[n + 4] = (y[n + 3] - y[n + 4]) / third
        u = y[n + 4]
    total = thrust(c, u, x, m.slow[at.HEAT], m.slow[at.REMANENT]) - dry - surroundings(c, x, v) + p.offset + push
    if c[at.MASS_FORM] == 1.0:  # a mass on a spring at the table, perhaps behind a gap or with a softening spring
        stretch = y[n] - x
        if c[at.MASS_GAP] > 0.0:
            stretch -= max(-c[at.MASS_GAP], min(stretch, c[at.MASS_GAP]))
        pull = c[at.MASS_OMEGA] ** 2 * stretch / (1.0 + c[at.MASS_CUBIC] * stretch * stretch)
        if c[at.MASS_GAP] == 0.0 or stretch != 0.0:
            pull += 2 * c[at.MASS_ZETA] * c[at.MASS_OMEGA] * (y[n + 1] - v)
        out[n], out[n + 1] = y[n + 1], -pull
        total += c[at.MASS] * pull
    elif c[at.MASS_FORM] == 2.0:  # one more mode, of either sign, whose spring hardens
        swing = c[at.MASS_OMEGA] ** 2 * y[n + 7] * (1.0 + c[at.MASS_CUBIC] * y[n + 7] * y[n + 7])
        out[n + 7] = y[n + 8]
        out[n + 8] = c[at.MASS] * total - 2 * c[at.MASS_ZETA] * c[at.MASS_OMEGA] * y[n + 8] - swing
    for i in range(p.gain.size):
        damped = 2 * p.zeta[i] * p.omega[i] * y[2 * i + 1]
        out[2 * i] = y[2 * i + 1]
        out[2 * i + 1] = p.gain[i] * total - damped - p.omega[i] ** 2 * y[2 * i]


@compiled
def feedback(p: Truth, law: Array, goal: float, reading: float) -> float:
    """The controller's output [N] at a delayed reference and a reading [m]; law: its states."""
    g, ts = p.control, p.sample_time
    keep = g[at.TAU] / (g[at.TAU] + ts)
    if g[at.KIND] == 0.0:
        law[0] += g[at.KI] * ts * (goal - reading)
        turned = g[at.C] * goal - reading
        law[1] = keep * law[1] + (1.0 - keep) * (turned - law[2]) / ts
        law[2] = turned
        return float(g[at.KP] * (g[at.B] * goal - reading) + law[0] + g[at.KD] * law[1])
    law[1] = keep * law[1] + (1.0 - keep) * (reading - law[2]) / ts
    law[2] = reading
    wanted = g[at.KPOS] * (goal - reading) + g[at.F] * (goal - law[3]) / ts
    jerk = (goal - 2.0 * law[3] + law[4]) / (ts * ts)
    law[4], law[3] = law[3], goal
    if g[at.TN] > 0.0:
        law[0] += g[at.KVEL] * ts / g[at.TN] * (wanted - law[1])
    return float(g[at.KVEL] * (g[at.B] * wanted - law[1]) + law[0] + g[at.M] * jerk)


@compiled
def sample(p: Truth, r: Run, m: Moving, k: int, t: float) -> None:
    """Reads the scale and puts out a command, which begins to act later."""
    x, v = place_of(p, m.y), speed_of(p, m.y)
    if r.held[k] == 0.0:
        m.law[5] = shown(p.c, x - v * r.stale[k], m.last[0], t) + r.noise[k]
        if p.resolution > 0.0:
            m.law[5] = p.resolution * math.floor(m.law[5] / p.resolution + 0.5)
    goal = r.reference[k - p.delay] if k >= p.delay else r.reference[0]
    u = feedback(p, m.law, goal, m.law[5]) + r.feedforward[k]
    r.reading[k], r.command[k], m.inputs[k] = m.law[5], u, amplified(p.c, u)
    start = t + p.dead_time + r.late[k] + p.c[at.SLOWER] * abs(v)
    m.starts[k] = max(start, m.starts[k - 1]) if k > 0 else start


@compiled
def advance(p: Truth, m: Moving, u: float, push: float, now: float, h: float) -> None:
    """One step of length h [s]."""
    c, y, size = p.c, m.y, m.y.size
    x, v = place_of(p, y), speed_of(p, y)
    scale = limits(c, x, v, u, m.slow)
    behind = behind_gaps(c[at.GAP_FORM], c[at.GAP], x, m.gaps) if c[at.GAP_FORM] > 0.0 else 0.0
    held = (x, behind, scale)
    rates(p, m, y, (u, push), held, m.k[0])
    for stage in range(1, 4):
        part = 0.5 * h if stage < 3 else h
        for i in range(size):
            m.trial[i] = y[i] + part * m.k[stage - 1, i]
        rates(p, m, m.trial, (u, push), held, m.k[stage])
    for i in range(size):
        y[i] += h * (m.k[0, i] + 2.0 * (m.k[1, i] + m.k[2, i]) + m.k[3, i]) / 6.0
    new, speed = place_of(p, y), speed_of(p, y)
    seen = 0.0
    if c[at.GAP_FORM] > 0.0:
        seen = behind_gaps(c[at.GAP_FORM], c[at.GAP], new, m.gaps) - behind
        for j in range(3):
            half = 0.5 * c[at.GAP] * (1.0 if c[at.GAP_FORM] == 2.0 else 0.5 + 0.5 * j)
            m.gaps[j] = max(new - half, min(m.gaps[j], new + half))
    for i in range(m.z.size):
        moved = new - x if c[at.GAP_FORM] == 0.0 or (c[at.GAP_FORM] == 2.0 and i % 2 == 0) else seen
        m.z[i] = min(max(m.z[i] + moved, -scale * p.limit[i]), scale * p.limit[i])
    dry = element_force(p, m.z, 0.0, 0.0, scale)
    settle(c, m.slow, (h, now), (new - x, speed), (dry, u, u - m.last[2]))
    m.last[0], m.last[1], m.last[2] = (speed - v) / h, dry, u


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def run(p: Truth, r: Run, m: Moving, before: int) -> None:
    """Runs the loop over the samples of `r`; its first `before` samples are before the record's time 0."""
    n, h, each = r.reference.size, p.sample_time / p.steps, p.steps // POINTS
    size = 2 * p.gain.size
    m.slow[at.LEVEL], m.slow[at.FALLEN] = 1.0, 1.0
    dry = element_force(p, m.z, 0.0, 0.0, 1.0)
    m.last[1] = m.y[size + 5] = m.y[size + 6] = dry
    m.law[0] = m.last[2] = m.last[3] = m.y[size + 2] = m.y[size + 4] = dry - p.offset
    m.y[size + 3] = dry - p.offset if p.c[at.CURRENT_FORM] == 2.0 else 0.0
    for j in range(at.LOG_SPAN):
        m.slow[at.BRANCH + j] = dry
    for k in range(n):
        t = (k - before) * p.sample_time
        if k == before:
            r.start[:] = m.z
        sample(p, r, m, k, t)
        for s in range(p.steps):
            now = t + s * h
            if s % each == 0:
                r.position[k, s // each] = place_of(p, m.y)
            push = r.force[k] + (r.force[min(k + 1, n - 1)] - r.force[k]) * s / p.steps
            end = now + h
            while end - now > 1e-3 * h:
                part = alone(m, k, now, end - now)
                advance(p, m, m.last[3], push, now, part)
                now += part
