"""The forms in which a machine file states a feedback, and the law that each of them is.

Cascade, at sample k, with r after its delay, e = r - x, a = tau / (tau + T_s), g = (1 - a) / T_s, and differences over
a sample, r'[k] = (r[k] - r[k-1]) / T_s:

    v[k] = a v[k-1] + g (x[k] - x[k-1])                     the measured speed
    w[k] = Kp e[k] + f r'[k]                                its set point
    I[k] = I[k-1] + Kv T_s / Tn (w[k] - v[k])
    u_fb = F(z) (Kv (b w[k] - v[k]) + I[k] + m r''[k])

PID: that of `models.controller.PID`, with b r in place of r in the proportional part and c r in the derivative one.
F(z) are the filters, one second-order section after the other. They filter what the feedback puts out, not the
feedforwards u_ff and u_rf that are added behind it. An anti-windup of time constant T_t moves I by T_s / T_t of what
the rating cuts off the command.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.controller import GAIN, PID, SET_POINT_REASON
from models.feedback.law import Law
from models.quantity import show, value

Array = NDArray[np.float64]
System = tuple[Array, Array, Array, Array]

SECTIONS: Final = 20  # that a controller may have: drives have up to ten, and each is computed at every sample
SECTIONS_REASON: Final = f"drives have up to ten filters; the simulator computes {SECTIONS} at most"
BEHIND: Final = "it would filter all motion"
FILTERED: Final = "no loop filters what is slower, and none samples what is faster"


@dataclass(frozen=True)
class Cascade:
    """A proportional controller of the position above a PI controller of the speed, as most drives have it.

    >>> Cascade(position_gain=85.0, velocity_gain=4000.0, integral_time=12e-3).velocity_feedforward
    0.0
    """

    position_gain: float = value(
        "1/s", "gain Kp of the position's controller", above=0, at_most=1e6, because="no axis follows a position faster"
    )
    velocity_gain: float = value(
        "N s/m", "proportional gain Kv of the speed's controller", above=0, at_most=1e12, because=GAIN
    )
    integral_time: float = value(
        "s",
        "integral time Tn of the speed's controller (0: no integral)",
        at_least=0,
        at_most=1000,
        because="a slower integral takes part in no motion",
        default=0.0,
    )
    velocity_filter: float = value(
        "s",
        "time constant tau of the measured speed's filter",
        at_least=0,
        at_most=100,
        because=BEHIND,
        default=0.0,
    )
    velocity_feedforward: float = value(
        "1",
        "share f of the reference's speed in the speed's set point",
        at_least=0,
        at_most=2,
        because=SET_POINT_REASON,
        default=0.0,
    )
    acceleration_feedforward: float = value(
        "kg",
        "force m per acceleration of the reference",
        at_least=0,
        at_most=1e9,
        because="no axis is heavier",
        default=0.0,
    )
    proportional_weight: float = value(
        "1",
        "weight b of the speed's set point in the proportional part",
        at_least=0,
        at_most=2,
        because=SET_POINT_REASON,
        default=1.0,
    )


@dataclass(frozen=True)
class Notch:
    """F(s) = (s^2 + 2 d zeta w s + w^2) / (s^2 + 2 zeta w s + w^2): d at its frequency, also as it is sampled."""

    frequency: float = value("Hz", "frequency of the notch", at_least=0.1, at_most=1e7, because=FILTERED)
    damping: float = value(
        "1", "damping ratio zeta of its poles", above=0, at_most=10, because="it would filter all motion"
    )
    depth: float = value("1", "its gain d at its frequency (0: none passes)", at_least=0, at_most=1, default=0.0)


@dataclass(frozen=True)
class LowPass:
    """F(s) = w^2 / (s^2 + 2 zeta w s + w^2), sampled so that its gain at w stays 1 / (2 zeta)."""

    frequency: float = value("Hz", "corner frequency", at_least=0.1, at_most=1e7, because=FILTERED)
    damping: float = value(
        "1", "damping ratio zeta", above=0, at_most=10, because="it would filter all motion", default=math.sqrt(0.5)
    )


@dataclass(frozen=True)
class Section:
    """A second-order section by its coefficients of z^0, z^-1 and z^-2, as a drive's manual may state it."""

    numerator: tuple[float, ...] = value("1", "coefficients b0, b1, b2", at_least=-1e6, at_most=1e6, most=3)
    denominator: tuple[float, ...] = value("1", "coefficients a0, a1, a2", at_least=-1e6, at_most=1e6, most=3)

    def __post_init__(self) -> None:
        """A section that is unstable, or that no constant passes, holds no axis."""
        b, a = self.numerator, self.denominator
        if a[0] == 0:
            raise ValueError("denominator: its first coefficient must not be 0; state a0, 1 as a rule")
        if len(a) > 1 and np.max(np.abs(np.roots(a)), initial=0.0) >= 1:
            raise ValueError("denominator: the section is unstable; its poles must lie within the unit circle")
        if not abs(sum(b) / sum(a)) >= 1e-6:
            raise ValueError("numerator: a constant does not pass the section, so that the axis could hold no force")


@dataclass(frozen=True)
class Filters:
    """The filters of a feedback's output: its notches, then its low passes, then sections by their coefficients."""

    notch: tuple[Notch, ...] = ()
    low_pass: tuple[LowPass, ...] = ()
    section: tuple[Section, ...] = ()

    def __post_init__(self) -> None:
        """Each is computed at every sample."""
        if self.count > SECTIONS:
            raise ValueError(f"{self.count} are more than {SECTIONS}: {SECTIONS_REASON}")

    @property
    def count(self) -> int:
        """How many there are [-]."""
        return len(self.notch) + len(self.low_pass) + len(self.section)

    @property
    def frequencies(self) -> Mapping[str, float]:
        """The frequency [Hz] of each notch and low pass by its name here, such as "notch.1"."""
        kinds: Sequence[tuple[str, Sequence[Notch | LowPass]]] = (("notch", self.notch), ("low_pass", self.low_pass))
        return {f"{kind}.{i + 1}": one.frequency for kind, ones in kinds for i, one in enumerate(ones)}


NO_FILTERS: Final = Filters()


def sections(filters: Filters, sample_time: float) -> Array:
    """Rows b0, b1, b2, a0 = 1, a1, a2 (F, 6) [1] of the filters at a sample time [s], as scipy.signal.sosfilt has them.

    Notches and low passes by the bilinear transform, prewarped at their frequency.
    """
    rows = [_bilinear(one, (1.0, 2 * one.depth * one.damping, 1.0), sample_time) for one in filters.notch]
    rows += [_bilinear(one, (0.0, 0.0, 1.0), sample_time) for one in filters.low_pass]
    rows += [_padded(one.numerator, one.denominator) for one in filters.section]
    return np.array(rows).reshape(-1, 6)


def _bilinear(one: Notch | LowPass, above: tuple[float, float, float], sample_time: float) -> Array:
    """A section of s / w with the numerator `above`, highest power first; its z^-1 from s / w = (1 - z^-1) / (1 + z^-1)
    over tan(w T_s / 2)."""
    t = math.tan(math.pi * one.frequency * sample_time)

    def sampled(p: tuple[float, float, float]) -> list[float]:
        return [p[0] + p[1] * t + p[2] * t * t, 2 * (p[2] * t * t - p[0]), p[0] - p[1] * t + p[2] * t * t]

    return _padded(sampled(above), sampled((1.0, 2 * one.damping, 1.0)))


def _padded(numerator: Sequence[float], denominator: Sequence[float]) -> Array:
    row = np.zeros(6)
    row[: len(numerator)], row[3 : 3 + len(denominator)] = numerator, denominator
    return np.asarray(row / row[3], float)


def law_of(feedback: PID | Cascade, filters: Filters, anti_windup: float, sample_time: float) -> Law:
    """The law of a feedback and its filters; times [s]. anti_windup: the time constant T_t, 0 for none."""
    core = _pid(feedback, sample_time) if isinstance(feedback, PID) else _cascade(feedback, sample_time)
    rows = sections(filters, sample_time)
    integral = feedback.ki if isinstance(feedback, PID) else feedback.integral_time
    has_integral = integral > 0
    a, b, c, d = core
    hold = np.zeros(len(a))
    if has_integral:
        hold[0] = 1.0 / float(np.prod(rows[:, :3].sum(axis=1) / rows[:, 3:].sum(axis=1)))
    for row in rows:
        constant = float(c @ hold)  # what the section is given while the integral holds a newton
        b0, b1, b2, _, a1, a2 = row
        begin = np.array([[b1 - a1 * b0], [b2 - a2 * b0]])
        inner = np.array([[-a1, 1.0], [-a2, 0.0]])
        a = np.block([[a, np.zeros((len(a), 2))], [begin @ c[None, :], inner]])
        b = np.vstack([b, begin @ d[None, :]])
        hold = np.concatenate([hold, np.linalg.solve(np.eye(2) - inner, begin[:, 0] * constant)])
        c, d = np.concatenate([b0 * c, [1.0, 0.0]]), b0 * d
    reset = np.zeros(len(a))
    if anti_windup > 0 and has_integral:
        reset[0] = sample_time / anti_windup
    flat = (tuple(part.tolist()) for part in (c, d, hold, reset))
    return Law(sample_time, _rows(a), _rows(b), *flat)


def _rows(matrix: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in matrix.tolist())


def _pid(pid: PID, ts: float) -> System:
    """States I[k-1], unless ki = 0, and what d[k] owes to the past."""
    keep = pid.pole(ts)
    slope = (1 - keep) / ts
    a, c = np.diag([1.0, keep]), np.array([1.0, pid.kd])
    turned = np.array([pid.derivative_weight, -1.0])  # the signal whose derivative is taken
    b = np.vstack([pid.ki * ts * np.array([1.0, -1.0]), (keep - 1) * slope * turned])
    d = pid.kp * np.array([pid.proportional_weight, -1.0]) + b[0] + pid.kd * slope * turned
    return (a, b, c, d) if pid.ki > 0 else (a[1:, 1:], b[1:], c[1:], d)


def _cascade(cascade: Cascade, ts: float) -> System:
    """States I[k-1], unless Tn = 0, what v[k] owes to the past, r[k-1] and r[k-2]."""
    keep = cascade.velocity_filter / (cascade.velocity_filter + ts)
    slope = (1 - keep) / ts
    rate = 1 / cascade.integral_time if cascade.integral_time > 0 else 0.0
    kp, kv, f = cascade.position_gain, cascade.velocity_gain, cascade.velocity_feedforward
    jerk = cascade.acceleration_feedforward / ts**2
    wanted, wanted_d = np.array([0.0, 0.0, -f / ts, 0.0]), np.array([kp + f / ts, -kp])  # w from states and inputs
    speed, speed_d = np.array([0.0, 1.0, 0.0, 0.0]), np.array([0.0, slope])  # v
    climb, climb_d = kv * ts * rate * (wanted - speed), kv * ts * rate * (wanted_d - speed_d)  # I[k] - I[k-1]
    weight = cascade.proportional_weight
    a = np.zeros((4, 4))
    a[0] = climb
    a[0, 0], a[1, 1], a[3, 2] = 1.0, keep, 1.0
    b = np.array([climb_d, [0.0, (keep - 1) * slope], [1.0, 0.0], [0.0, 0.0]])
    c = kv * (weight * wanted - speed) + climb + np.array([1.0, 0.0, -2 * jerk, jerk])
    d = kv * (weight * wanted_d - speed_d) + climb_d + np.array([jerk, 0.0])
    return (a, b, c, d) if rate > 0 else (a[1:, 1:], b[1:], c[1:], d)


def nearest_pid(cascade: Cascade) -> PID:
    """The PID that has the cascade's loop but for its speed's filter, which the PID has on its derivative alone.

    Kv (Kp e + e' + (Kp e + e') / (Tn s)): kp = Kv (Kp + 1 / Tn), ki = Kv Kp / Tn, kd = Kv.
    """
    rate = 1 / cascade.integral_time if cascade.integral_time > 0 else 0.0
    kp, kv = cascade.position_gain, cascade.velocity_gain
    return PID(kv * (kp + rate), kv * kp * rate, kv, cascade.velocity_filter)


def described(cascade: Cascade) -> str:
    """The cascade in words: "a P/PI cascade with 85 1/s, 4000 N s/m, 12 ms", and what else it has; SI."""
    return f"a P/PI cascade with {', '.join(_figures(cascade))}"


def _figures(cascade: Cascade) -> Iterator[str]:
    yield show(cascade.position_gain, "1/s")
    yield show(cascade.velocity_gain, "N s/m")
    if cascade.integral_time > 0:
        yield show(cascade.integral_time, "s")
    if cascade.velocity_filter > 0:
        yield f"a velocity filter of {show(cascade.velocity_filter, 's')}"
    if cascade.velocity_feedforward > 0:
        yield f"{100 * cascade.velocity_feedforward:.4g} % of velocity feedforward"
    if cascade.acceleration_feedforward > 0:
        yield f"an acceleration feedforward of {show(cascade.acceleration_feedforward, 'kg')}"
    if cascade.proportional_weight != 1:
        yield f"a proportional weight of {cascade.proportional_weight:.4g}"
