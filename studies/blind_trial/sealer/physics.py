"""The machine of the sealed cases: classical Runge-Kutta of fourth order at 42 us on modes and attachments.

Friction is a continuous distribution of slip limits (Iwan 1966, J. Appl. Mech. 33), each nominal contact smeared over
several elements, so that its virgin curve bends where the nominal one has corners. At every stage of a step all
elements are tried from where the step began. What is slow (relaxation, ageing, heat) moves once a step, exactly
under held input. A command that begins to act within a step acts in proportion.
"""

from __future__ import annotations

import math
from typing import Final

import numba
import numpy as np
from numpy.typing import NDArray

from studies.blind_trial.sealer.loop import POINTS, Moving, Run, compiled, mean_input
from studies.blind_trial.sealer.machine import STATES, STEPS, Held, Physics

Array = NDArray[np.float64]

WAVE: Final = (0.25, 0.1)  # second and third harmonic of what repeats in space


@compiled
def wave(x: float, period: float, phase: float) -> float:
    """What repeats in space, with harmonics: in radians about its mean."""
    angle = 2 * math.pi * x / period + phase
    return math.sin(angle) + WAVE[0] * math.sin(2 * angle + phase) + WAVE[1] * math.sin(3 * angle - phase)


@compiled
def contact(p: Physics, x: float, plays: Array) -> float:
    """Displacement that the friction's contacts see: x, or behind three gaps of different widths."""
    if p.gap == 0.0:
        return x
    y = 0.0
    for j in range(3):
        half = 0.5 * p.gap * (0.6 + 0.4 * j)
        y += max(x - half, min(plays[j], x + half)) / 3.0
    return y


@compiled
def elements_force(p: Physics, moved: float, scale: float, z: Array) -> float:
    """Force of all elements after a further displacement, limits times `scale`; z stays.

    Lopsided elements are stiffer on one side and slip at the same force on both.
    """
    stiffness, limit = p.stiffness, p.limit
    above, below = scale / (1.0 + p.lopsided), -scale / (1.0 - p.lopsided)
    total, sizes = 0.0, 0.0
    for i in range(z.size):
        at = min(max(z[i] + moved, below * limit[i]), above * limit[i])
        total += stiffness[i] * at
        sizes += stiffness[i] * abs(at)
    return total + p.lopsided * sizes


@compiled
def thrust_of(p: Physics, u: float, x: float, heat: float, remanent: float) -> float:
    """What the motor makes of the amplifier's output u at x, cogging included."""
    force = u + p.remanence * remanent
    if p.knee > 0.0:
        force = force / (1.0 + (abs(force) / p.knee) ** 3.0) ** (1.0 / 3.0)
    if p.asymmetry != 0.0:
        force *= 1.0 + p.asymmetry * math.tanh(force / 4.0)
    if p.ripple != 0.0:
        force *= 1.0 + p.ripple * wave(x, p.ripple_pitch, p.ripple_phase)
    if p.fade != 0.0:
        force *= 1.0 - p.fade * heat
    if p.cogging != 0.0:
        force += p.cogging * wave(x, p.cogging_pitch, p.cogging_phase)
    return force


@compiled
def outside(p: Physics, x: float, v: float) -> float:
    """Force of the surroundings and of what is proportional to speed, against the motion where positive."""
    force = 0.0
    if p.viscous != 0.0:
        force += p.viscous * p.viscous_speed * math.asinh(v / p.viscous_speed)
    if p.spring != 0.0:
        stretch = x - p.spring_place
        force += p.spring * stretch * (1.0 + (stretch / 0.1) ** 2)
    if p.bump != 0.0:
        force += p.bump * math.exp(-(((x - p.bump_place) / p.bump_width) ** 2))
    if p.eddy != 0.0:
        force += p.eddy * v * math.exp(-(((x - p.eddy_place) / p.eddy_width) ** 2))
    return force


@compiled
def rates(p: Physics, m: Moving, held: Held, y: Array, out: Array) -> None:
    """dy/dt at the states y (STATES,), into `out`."""
    slow, u = m.slow, held.u
    x, v = y[0] + y[2] + y[4], y[1] + y[3] + y[5]
    dry = elements_force(p, contact(p, x, m.gaps) - held.origin, held.scale, m.z)
    dry = dry * slow[8] * (1.0 + p.directional * v / math.hypot(v, p.turn_speed)) - slow[0]
    if p.friction_lag > 0.0:  # two lags in series
        half = 0.5 * p.friction_lag
        out[10], out[11] = (dry - y[10]) / half, (y[10] - y[11]) / half
        dry = y[11]
    else:
        out[10] = out[11] = 0.0
    if p.lag > 0.0:  # second order, damping 0.8
        omega = 1.6 / p.lag
        out[8], out[9] = y[9], omega * omega * (u - y[8]) - 1.6 * omega * y[9]
        u = y[8]
    else:
        out[8] = out[9] = 0.0
    total = thrust_of(p, u, x, slow[6], slow[7]) - dry - outside(p, x, v) + p.offset + held.push
    if p.mass > 0.0:
        stretch = y[6] - x
        if p.mass_gap > 0.0:
            stretch -= max(-p.mass_gap, min(stretch, p.mass_gap))
        pull = p.mass_omega**2 * stretch / (1.0 + p.mass_cubic * stretch * stretch)
        touching = p.mass_gap == 0.0 or stretch != 0.0
        pull += 2 * p.mass_zeta * p.mass_omega * (y[7] - v) if touching else 0.0
        out[6], out[7] = y[7], -pull
        total += p.mass * pull
    else:
        out[6] = out[7] = 0.0
    for i in range(3):
        spring = p.omega[i] ** 2
        if p.parametric != 0.0 and i == 1:
            spring *= 1.0 + p.parametric * math.sin(2 * math.pi * x / p.parametric_length)
        out[2 * i] = y[2 * i + 1]
        out[2 * i + 1] = p.gain[i] * total - 2 * p.zeta[i] * p.omega[i] * y[2 * i + 1] - spring * y[2 * i]


@compiled
def limit_scale(p: Physics, x: float, v: float, acceleration: float, slow: Array) -> float:
    """Factor of all slip limits."""
    scale = 1.0
    if p.stribeck != 0.0:
        scale += p.stribeck / (1.0 + (abs(v) / p.stribeck_speed) ** 1.5)
    if p.place != 0.0:
        scale += p.place * wave(x, p.place_length, p.place_phase)
    if p.aged != 0.0:
        scale += p.aged * (0.6 * slow[4] + 0.4 * slow[5])
    if p.jerky != 0.0:
        scale += p.jerky * math.tanh(abs(acceleration))
    return scale


@compiled
def settle_slow(p: Physics, slow: Array, step: float, moved: float, dry: float, u: float, du: float, t: float) -> None:
    """What is slow, over one step in which the table moved by `moved`."""
    if p.relaxed != 0.0:  # three time scales
        slow[0] = 0.0
        for j in range(3):
            slow[1 + j] += (dry - slow[1 + j]) * -math.expm1(-step / (p.relax_time * 4.0 ** (j - 1)))
            slow[0] += p.relaxed * slow[1 + j] / 3.0
    if p.aged != 0.0:  # two time scales, lost by rolling
        fresh = math.exp(-abs(moved) / p.age_length)
        slow[4] = fresh * (slow[4] - (1.0 - slow[4]) * math.expm1(-step / p.age_time))
        slow[5] = fresh * (slow[5] - (1.0 - slow[5]) * math.expm1(-step / (5.0 * p.age_time)))
    if p.fade != 0.0:  # heat of the coil, 1 at 30 N held
        slow[6] += ((u / 30.0) ** 2 - slow[6]) * -math.expm1(-step / p.fade_time)
    if p.remanence != 0.0:
        slow[7] = max(-p.remanence_force, min(slow[7] + du, p.remanence_force))
    slow[8] = 1.0 - p.warm * math.expm1(-max(t, 0.0) / p.warm_time)


@compiled
def amplifier(p: Physics, u: float) -> float:
    """The drive's input at a command u: what is small and what is rounded."""
    if p.deadband > 0.0:
        u -= p.deadband * math.tanh(u / p.deadband)
    return converted(p, u) if p.dac > 0.0 else u


@compiled
def converted(p: Physics, u: float) -> float:
    """The level [N] of a converter whose three lowest bits weigh more, less and more than they should."""
    code = math.floor(u / p.dac)
    uneven = 1.0 * (code % 2 - 0.5) - 0.7 * (code // 2 % 2 - 0.5) + 1.3 * (code // 4 % 2 - 0.5)
    return float(p.dac * (code + 0.5 + p.ladder * uneven))


@compiled
def reading_of(p: Physics, x: float, acceleration: float, t: float) -> float:
    """The scale's reading before noise and rounding."""
    out = x + p.bracket * acceleration
    if p.creep != 0.0 and t > 0.0:
        out += p.creep * (0.7 * t - 0.3 * p.creep_time * math.expm1(-t / p.creep_time))
    if p.grating != 0.0:
        out += p.grating * wave(x, p.grating_period, p.grating_phase)
    return out


@compiled
def control(p: Physics, r: Run, m: Moving, k: int, t: float) -> None:
    """Reads the scale and puts out a command, which begins to act later."""
    x, v, pid = m.y[0] + m.y[2] + m.y[4], m.y[1] + m.y[3] + m.y[5], m.law
    if r.held[k] == 0.0:
        pid[3] = reading_of(p, x - v * r.stale[k], m.last[0], t) + r.noise[k]
        if p.resolution > 0.0:
            pid[3] = p.resolution * math.floor(pid[3] / p.resolution + 0.5)
    goal = r.reference[k - p.reference_delay] if k >= p.reference_delay else r.reference[0]
    error = goal - pid[3]
    pid[0] += p.ki * p.sample_time * error
    share = p.tau / (p.tau + p.sample_time)
    pid[2] = share * pid[2] + (1.0 - share) * (error - pid[1]) / p.sample_time
    pid[1] = error
    u = p.kp * error + pid[0] + p.kd * pid[2] + r.feedforward[k]
    r.reading[k], r.command[k], m.inputs[k] = pid[3], u, amplifier(p, u)
    start = t + p.dead_time + r.late[k] + p.slower * abs(v)
    m.starts[k] = max(start, m.starts[k - 1]) if k > 0 else start


@compiled
def step(p: Physics, m: Moving, u: float, push: float, now: float, h: float) -> float:
    """One step of length h; the energy lost in friction."""
    y, k, trial, z = m.y, m.k, m.trial, m.z
    x, v = y[0] + y[2] + y[4], y[1] + y[3] + y[5]
    held = Held(u, push, limit_scale(p, x, v, m.last[0], m.slow), contact(p, x, m.gaps))
    rates(p, m, held, y, k[0])
    for stage in range(1, 4):
        part = 0.5 * h if stage < 3 else h
        for i in range(STATES):
            trial[i] = y[i] + part * k[stage - 1, i]
        rates(p, m, held, trial, k[stage])
    for i in range(STATES):
        y[i] += h * (k[0, i] + 2.0 * (k[1, i] + k[2, i]) + k[3, i]) / 6.0
    new, speed = y[0] + y[2] + y[4], y[1] + y[3] + y[5]
    moved = contact(p, new, m.gaps) - held.origin
    for j in range(3):
        half = 0.5 * p.gap * (0.6 + 0.4 * j)
        m.gaps[j] = max(new - half, min(m.gaps[j], new + half))
    above, below = held.scale / (1.0 + p.lopsided), -held.scale / (1.0 - p.lopsided)
    for i in range(z.size):
        z[i] = min(max(z[i] + moved, below * p.limit[i]), above * p.limit[i])
    dry = elements_force(p, 0.0, held.scale, z) * m.slow[8]
    lost = 0.5 * (m.last[1] + dry) * (new - x)
    settle_slow(p, m.slow, h, new - x, dry, u, u - m.last[2], now)
    m.last[0], m.last[1], m.last[2] = (speed - v) / h, dry, u
    return float(lost)


@numba.njit(cache=True, fastmath=True, error_model="numpy")
def run(p: Physics, r: Run, m: Moving, before: int) -> None:
    """Runs the loop over the samples of `r`; its first `before` samples are before the record's time 0."""
    n, h = r.reference.size, p.sample_time / STEPS
    m.slow[8] = 1.0
    dry = elements_force(p, 0.0, 1.0, m.z)
    m.y[10] = m.y[11] = m.last[1] = dry
    m.y[8] = m.law[0] = m.last[2] = m.last[3] = dry - p.offset
    for k in range(n):
        t = (k - before) * p.sample_time
        if k == before:
            r.energy[0] = 0.0
            for i in range(m.z.size):
                r.start[i] = m.z[i]
        control(p, r, m, k, t)
        for s in range(STEPS):
            now = t + s * h
            if s % (STEPS // POINTS) == 0:
                r.position[k, s // (STEPS // POINTS)] = m.y[0] + m.y[2] + m.y[4]
            push = r.force[k] + (r.force[min(k + 1, n - 1)] - r.force[k]) * s / STEPS
            r.energy[0] += step(p, m, mean_input(m, k, now, h), push, now, h)
