"""The functions of place, speed, force and time by which a drawn machine deviates from its nominal one, compiled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from studies.blind_trial.sealer.loop import compiled
from studies.blind_trial.sealer.machines import places as at

Array = NDArray[np.float64]


@compiled
def ripples(form: float, x: float, period: float, phase: float, travel: float) -> float:
    """What repeats along the guide: three harmonics (1), or peaks that grow along the travel (2)."""
    angle = 2 * math.pi * x / period + phase
    if form == 1.0:
        return math.sin(angle) + 0.25 * math.cos(2 * angle + phase) + 0.12 * math.sin(3 * angle - phase)
    wave = math.sin(angle)
    return (0.6 * wave + 0.5 * wave * wave * wave) * (1.0 + 0.4 * x / travel)


@compiled
def behind_gaps(form: float, gap: float, x: float, gaps: Array) -> float:
    """What contacts behind a clearance see of x: three clearances side by side (1), or a single one (2)."""
    if form == 2.0:
        return float(max(x - 0.5 * gap, min(gaps[0], x + 0.5 * gap)))
    seen = 0.0
    for j in range(3):
        half = 0.5 * gap * (0.5 + 0.5 * j)
        seen += max(x - half, min(gaps[j], x + half)) / 3.0
    return seen


@compiled
def odd_slope(form: float, state: float, sign: float) -> float:
    """d(state)/d(way in units of its length): Dahl (1), Bouc and Wen (2), elasto-plastic of Dupont et al. 2002 (3)."""
    if form == 1.0:
        return 1.0 - sign * state
    if form == 2.0:
        return 1.0 - state * state * (0.65 if sign * state > 0 else -0.65) - 0.35 * state * state
    if sign * state < 0.6:
        return 1.0
    return 1.0 - 0.5 * (1.0 - math.cos(math.pi * min((sign * state - 0.6) / 0.4, 1.0)))


@compiled
def thrust(c: Array, u: float, x: float, heat: float, remanent: float) -> float:
    """What the motor makes [N] of the amplifier's output u [N] at x [m], cogging included."""
    force = u + c[at.REMANENCE] * remanent
    if c[at.KNEE_FORM] == 1.0:
        force = force / (1.0 + (abs(force) / c[at.KNEE]) ** 3.0) ** (1.0 / 3.0)
    elif c[at.KNEE_FORM] == 2.0:
        force = c[at.KNEE] * math.atan(force / c[at.KNEE])
    if c[at.ASYMMETRY_FORM] == 1.0:
        force *= 1.0 + c[at.ASYMMETRY] * math.tanh(force / c[at.ASYMMETRY_FORCE])
    elif c[at.ASYMMETRY_FORM] == 2.0:
        force += c[at.ASYMMETRY] * (math.hypot(force, c[at.ASYMMETRY_FORCE]) - c[at.ASYMMETRY_FORCE])
    if c[at.RIPPLE_FORM] > 0.0:
        force *= 1.0 + c[at.RIPPLE] * ripples(
            c[at.RIPPLE_FORM], x, c[at.RIPPLE_PITCH], c[at.RIPPLE_PHASE], c[at.TRAVEL]
        )
    force *= 1.0 - c[at.FADE] * heat
    if c[at.COG_FORM] > 0.0:
        force += c[at.COG] * ripples(c[at.COG_FORM], x, c[at.COG_PITCH], c[at.COG_PHASE], c[at.TRAVEL])
    return float(force)


@compiled
def surroundings(c: Array, x: float, v: float) -> float:
    """Force [N] against the motion of what is outside, and of what is a function of speed alone."""
    force = 0.0
    if c[at.DRAG_FORM] == 1.0:
        force += c[at.DRAG] * c[at.DRAG_SPEED] * math.asinh(v / c[at.DRAG_SPEED])
    elif c[at.DRAG_FORM] == 2.0:
        force += c[at.DRAG] * v * (1.0 + abs(v) / c[at.DRAG_SPEED])
    if c[at.SPRING_FORM] == 1.0:
        stretch = (x - c[at.SPRING_PLACE]) / c[at.SPRING_LENGTH]
        force += c[at.SPRING] * c[at.SPRING_LENGTH] * stretch * (1.0 + stretch * stretch)
    elif c[at.SPRING_FORM] == 2.0:
        stretch = (x - c[at.SPRING_PLACE]) / c[at.SPRING_LENGTH]
        force += c[at.SPRING] * c[at.SPRING_LENGTH] * 0.5 * (stretch + math.hypot(stretch, 0.2))
    if c[at.BUMP] != 0.0:
        force += c[at.BUMP] * math.exp(-(((x - c[at.BUMP_PLACE]) / c[at.BUMP_WIDTH]) ** 2))
    if c[at.EDDY] != 0.0:
        force += c[at.EDDY] * v * math.exp(-(((x - c[at.EDDY_PLACE]) / c[at.EDDY_WIDTH]) ** 2))
    return force


@compiled
def limits(c: Array, x: float, v: float, u: float, slow: Array) -> float:
    """Factor of all slip limits."""
    scale = 1.0
    if c[at.STRIBECK_FORM] == 1.0:
        scale += c[at.STRIBECK] / (1.0 + (abs(v) / c[at.STRIBECK_SPEED]) ** 1.5)
    elif c[at.STRIBECK_FORM] == 2.0:
        scale += c[at.STRIBECK] * slow[at.FALLEN]
    if c[at.PLACE_FORM] == 1.0:
        scale += c[at.PLACED] * ripples(1.0, x, c[at.PLACE_LENGTH], c[at.PLACE_PHASE], 1.0)
    if c[at.AGE_FORM] == 1.0:
        scale += c[at.AGE] * (0.6 * slow[at.AGED] + 0.4 * slow[at.AGED_TOO])
    elif c[at.AGE_FORM] == 2.0:
        scale += c[at.AGE] * math.log1p(slow[at.RESTED] / c[at.AGE_TIME])
    if c[at.DIRECTION_FORM] == 2.0:
        scale += c[at.DIRECTION] * math.tanh(v / c[at.DIRECTION_SPEED])
    if c[at.LOAD] != 0.0:
        scale += c[at.LOAD] * abs(u) / c[at.LOAD_FORCE]
    return float(scale)


@compiled
def level(c: Array, x: float, v: float, slow: Array) -> float:
    """Factor of the whole friction force."""
    factor = slow[at.LEVEL] * (1.0 - c[at.SELFHEAT] * (0.6 * slow[at.WARMTH] + 0.4 * slow[at.WARMTH_TOO]))
    if c[at.DIRECTION_FORM] == 1.0:
        factor *= 1.0 + c[at.DIRECTION] * v / math.hypot(v, c[at.DIRECTION_SPEED])
    if c[at.PLACE_FORM] == 2.0:
        turn = math.sin(2 * math.pi * x / c[at.PLACE_LENGTH] + c[at.PLACE_PHASE])
        factor *= 1.0 + c[at.PLACED] * math.tanh(2.5 * turn)
    if c[at.RELAX_FORM] == 2.0:
        factor *= 1.0 - c[at.RELAX] * slow[at.SETTLED]
    return float(factor)


@compiled
def settle(
    c: Array, slow: Array, when: tuple[float, float], moved: tuple[float, float], force: tuple[float, float, float]
) -> None:
    """What is slow, over one step; when: its length and its time [s]; moved: the way [m], and the speed then [m/s];
    force: friction, the amplifier's input, and what it changed by [N]."""
    (h, t), (step, v), (dry, u, du) = when, moved, force
    way = abs(step)
    if c[at.RELAX_FORM] == 1.0:
        slow[at.RELAXED] = 0.0
        for j in range(at.LOG_SPAN):
            slow[at.BRANCH + j] += (dry - slow[at.BRANCH + j]) * -math.expm1(-h / (c[at.RELAX_TIME] * 4.0 ** (j - 2)))
            slow[at.RELAXED] += c[at.RELAX] * slow[at.BRANCH + j] / at.LOG_SPAN
    elif c[at.RELAX_FORM] == 2.0:  # at rest, ever slower, until it slips
        slow[at.SETTLED] += (1.0 - slow[at.SETTLED]) * h / (c[at.RELAX_TIME] * (1.0 + 9.0 * slow[at.SETTLED]))
        slow[at.SETTLED] *= math.exp(-way / c[at.RELAX_LENGTH])
    if c[at.AGE_FORM] == 1.0:  # two time scales, lost over a way
        fresh = math.exp(-way / c[at.AGE_LENGTH])
        slow[at.AGED] = fresh * (slow[at.AGED] - (1.0 - slow[at.AGED]) * math.expm1(-h / c[at.AGE_TIME]))
        slow[at.AGED_TOO] = fresh * (
            slow[at.AGED_TOO] - (1.0 - slow[at.AGED_TOO]) * math.expm1(-h / (5.0 * c[at.AGE_TIME]))
        )
    elif c[at.AGE_FORM] == 2.0:  # Dieterich's age of the contacts
        worn = way / c[at.AGE_LENGTH]
        slow[at.RESTED] = slow[at.RESTED] * math.exp(-worn) + h * (-math.expm1(-worn) / worn if worn > 1e-12 else 1.0)
    if c[at.STRIBECK_FORM] == 2.0:  # the generalised Maxwell-slip model: limits follow over a way
        goal = math.exp(-abs(v) / c[at.STRIBECK_SPEED])
        slow[at.FALLEN] += (goal - slow[at.FALLEN]) * -math.expm1(-way / c[at.STRIBECK_LENGTH])
    if c[at.FADE] != 0.0:
        slow[at.HEAT] += ((u / c[at.FADE_FORCE]) ** 2 - slow[at.HEAT]) * -math.expm1(-h / c[at.FADE_TIME])
    if c[at.REMANENCE] != 0.0:
        slow[at.REMANENT] = max(-c[at.REMANENCE_FORCE], min(slow[at.REMANENT] + du, c[at.REMANENCE_FORCE]))
    if c[at.WARM_FORM] == 1.0:
        slow[at.LEVEL] = 1.0 - c[at.WARM] * math.expm1(-max(t, 0.0) / c[at.WARM_TIME])
    elif c[at.WARM_FORM] == 2.0:  # two bodies
        near, far = math.expm1(-max(t, 0.0) / c[at.WARM_TIME]), math.expm1(-max(t, 0.0) / (6.0 * c[at.WARM_TIME]))
        slow[at.LEVEL] = 1.0 - c[at.WARM] * (0.5 * near + 0.5 * far)
    if c[at.SELFHEAT] != 0.0 and t > 0.0:  # two bodies, heated by what friction dissipates
        power = abs(dry * step) / h / c[at.SELFHEAT_POWER]
        slow[at.WARMTH] += (power - slow[at.WARMTH]) * -math.expm1(-h / c[at.SELFHEAT_TIME])
        slow[at.WARMTH_TOO] += (slow[at.WARMTH] - slow[at.WARMTH_TOO]) * -math.expm1(-h / (5.0 * c[at.SELFHEAT_TIME]))
    if c[at.ODD_FORM] > 0.0:
        sign = 1.0 if step >= 0 else -1.0
        state = slow[at.ODD_STATE] + step / c[at.ODD_LENGTH] * odd_slope(c[at.ODD_FORM], slow[at.ODD_STATE], sign)
        slow[at.ODD_STATE] = max(-1.0, min(state, 1.0))


@compiled
def amplified(c: Array, u: float) -> float:
    """The drive's input [N] at a command u [N]."""
    if c[at.DEADBAND_FORM] == 1.0:
        u -= c[at.DEADBAND] * math.tanh(u / c[at.DEADBAND])
    elif c[at.DEADBAND_FORM] == 2.0:  # a zone with a long tail
        u -= c[at.DEADBAND] * 2.0 / math.pi * math.atan(0.5 * math.pi * u / c[at.DEADBAND])
    if c[at.DAC_FORM] == 1.0:  # bits off their weight
        code = math.floor(u / c[at.DAC])
        uneven = 0.2 * (code % 2 - 0.5) - 0.15 * (code // 2 % 2 - 0.5) + 0.25 * (code // 4 % 2 - 0.5)
        u = c[at.DAC] * (code + 0.5 + uneven)
    elif c[at.DAC_FORM] == 2.0:  # rounded away from zero
        u = c[at.DAC] * (math.ceil(abs(u) / c[at.DAC]) if u > 0 else -math.ceil(abs(u) / c[at.DAC]))
    return u


@compiled
def shown(c: Array, x: float, acceleration: float, t: float) -> float:
    """The scale's reading [m] before noise and rounding."""
    out = x + c[at.BRACKET] * acceleration
    if c[at.CREEP_FORM] == 1.0 and t > 0.0:  # a rate and a creep
        out += c[at.CREEP] * (0.7 * t - 0.3 * c[at.CREEP_TIME] * math.expm1(-t / c[at.CREEP_TIME]))
    elif c[at.CREEP_FORM] == 2.0 and t > 0.0:  # two bodies that warm: the second one late
        near, far = c[at.CREEP_TIME], 5.0 * c[at.CREEP_TIME]
        out += c[at.CREEP] * (t + (near**2 * math.expm1(-t / near) - far**2 * math.expm1(-t / far)) / (near - far))
    if c[at.GRATING_FORM] == 1.0:
        out += c[at.GRATING] * ripples(1.0, x, c[at.GRATING_PERIOD], c[at.GRATING_PHASE], 1.0)
    elif c[at.GRATING_FORM] == 2.0:  # an ellipse off the centre: Heydemann 1981
        angle = 2 * math.pi * x / c[at.GRATING_PERIOD] + c[at.GRATING_PHASE]
        share = 2 * math.pi * c[at.GRATING] / c[at.GRATING_PERIOD]
        sine, cosine = (1.0 + 0.5 * share) * math.sin(angle) + share, math.cos(angle)
        across = sine * math.cos(angle) - cosine * math.sin(angle)
        turn = math.atan2(across, cosine * math.cos(angle) + sine * math.sin(angle))
        out += c[at.GRATING_PERIOD] * turn / (2 * math.pi)
    return float(out)
