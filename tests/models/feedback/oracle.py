"""Feedbacks as their equations stand in models/feedback/forms.py, in plain Python and sample by sample.

Shares nothing with the law, its matrices and its kernels but the values that a machine file states.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence

from models.controller import PID
from models.feedback.forms import Cascade, Filters, LowPass, Notch


class Feedback:
    """One feedback at its sample time; `step` gives u of r, x and u_ff."""

    def __init__(
        self,
        stated: PID | Cascade,
        filters: Filters,
        ts: float,
        *,
        anti_windup: float = 0.0,
        limit: float = math.inf,
        held: float = 0.0,
    ) -> None:
        self.stated, self.ts, self.anti_windup, self.limit = stated, ts, anti_windup, limit
        tuned: list[Notch | LowPass] = [*filters.notch, *filters.low_pass]
        self.filters = [Difference(*coefficients(one, ts)) for one in tuned]
        self.filters += [Difference(one.numerator, one.denominator) for one in filters.section]
        self.integral = held
        for one in reversed(self.filters):  # the last one puts out what is held
            self.integral = one.rest(self.integral)
        self.references, self.positions, self.slope, self.speed = [0.0, 0.0], [0.0], 0.0, 0.0

    def step(self, r: float, x: float, known: float) -> float:
        core = self._pid if isinstance(self.stated, PID) else self._cascade
        u = core(r, x)
        for one in self.filters:
            u = one.step(u)
        wanted = u + known
        self.references, self.positions = [r, self.references[0]], [x]
        if self.anti_windup == 0:
            return wanted
        command = min(max(wanted, -self.limit), self.limit)
        self.integral += self.ts / self.anti_windup * (command - wanted)
        return command

    def _pid(self, r: float, x: float) -> float:
        pid = self.stated
        assert isinstance(pid, PID)
        a, b, c = (
            pid.derivative_filter / (pid.derivative_filter + self.ts),
            pid.proportional_weight,
            pid.derivative_weight,
        )
        self.integral += pid.ki * self.ts * (r - x)
        change = c * (r - self.references[0]) - (x - self.positions[0])
        self.slope = a * self.slope + (1 - a) * change / self.ts
        return pid.kp * (b * r - x) + self.integral + pid.kd * self.slope

    def _cascade(self, r: float, x: float) -> float:
        of = self.stated
        assert isinstance(of, Cascade)
        a = of.velocity_filter / (of.velocity_filter + self.ts)
        self.speed = a * self.speed + (1 - a) * (x - self.positions[0]) / self.ts
        wanted = of.position_gain * (r - x) + of.velocity_feedforward * (r - self.references[0]) / self.ts
        if of.integral_time > 0:
            self.integral += of.velocity_gain * self.ts / of.integral_time * (wanted - self.speed)
        acceleration = (r - 2 * self.references[0] + self.references[1]) / self.ts**2
        proportional = of.velocity_gain * (of.proportional_weight * wanted - self.speed)
        return proportional + self.integral + of.acceleration_feedforward * acceleration


class Difference:
    """b / a as its difference equation, by the past inputs and outputs themselves."""

    def __init__(self, b: Sequence[float], a: Sequence[float]) -> None:
        self.b, self.a = [one / a[0] for one in b], [one / a[0] for one in a]
        self.inputs, self.outputs = [0.0] * len(b), [0.0] * len(a)

    def rest(self, held: float) -> float:
        """The input for which it puts out `held` for ever."""
        before = held * sum(self.a) / sum(self.b)
        self.inputs, self.outputs = [before] * len(self.b), [held] * len(self.a)
        return before

    def step(self, u: float) -> float:
        self.inputs = [u, *self.inputs[:-1]]
        y = sum(b * one for b, one in zip(self.b, self.inputs, strict=True))
        y -= sum(a * one for a, one in zip(self.a[1:], self.outputs, strict=False))
        self.outputs = [y, *self.outputs[:-1]]
        return y


def coefficients(one: Notch | LowPass, ts: float) -> tuple[list[float], list[float]]:
    """b and a by the poles and zeros themselves, each moved by the prewarped bilinear transform."""
    w = 2 / ts * math.tan(math.pi * one.frequency * ts)
    poles = [moved(s, ts) for s in roots(one.damping, w)]
    zeros = [moved(s, ts) for s in roots(one.damping * one.depth, w)] if isinstance(one, Notch) else [-1 + 0j, -1 + 0j]
    b, a = ([1.0, -(p + q).real, (p * q).real] for p, q in (zeros, poles))
    gain = sum(a) / sum(b)
    return [gain * value for value in b], a


def moved(s: complex, ts: float) -> complex:
    return (2 / ts + s) / (2 / ts - s)


def roots(damping: float, w: float) -> list[complex]:
    return [w * (-damping + sign * cmath.sqrt(damping**2 - 1)) for sign in (1, -1)]
