"""The simulator's oracle: the same machine, solved piece by piece; slow, for checking.

Between switches every element either sticks (f_i = K_i (x + x_ri) + D_i v, eq. (3)), is at its force limit while it
still moves (|K_i x_i + D_i v| >= F_i, eq. (7)), or slips at +-F_i: the machine is linear, and its motion a matrix
exponential. The switch times are found to round-off: as the roots of the Chebyshev series of the switching functions
over the interval, which is exact to round-off there, then refined on the exponential itself.

Shares no step of the simulator: other friction formulation (eq. (3) with the displacement x_ri remembered), other
dynamics (dense, continuous), its own PID; a feedback of another structure runs by its matrices.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
import scipy
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm

from models.controller import Controller, references
from models.feedback.law import Law
from models.machine import Machine
from models.plant import state_space

Array = NDArray[np.float64]

DEGREE = 12  # of the Chebyshev series; over MAX_TURN the next terms, (w h / 2)^13 / 13! / 2^12, are round-off
MAX_TURN = 1.0  # rad, of the quickest motion in an interval: a longer one is taken in parts
MOST_SWITCHES = 1000  # in an interval
STICK, LIMITED, SLIP = 0, 1, 2


@dataclass
class _Elements:
    """Where the elements are: regime, and for those that stick or are limited the offset x_ri in x_i = x + x_ri."""

    stiffness: Array
    limit: Array
    damping: Array
    offset: Array
    direction: int = 1
    regime: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        self.regime = np.full(self.limit.size, STICK)

    @property
    def slip_force(self) -> Array:
        return self.stiffness * self.limit

    def linear_force(self) -> tuple[float, float, float]:
        """(K, D, f_0) of the friction f = K x + D v + f_0 while no regime changes."""
        sticking = self.regime == STICK
        constant = (self.stiffness * self.offset)[sticking].sum() + self.direction * self.slip_force[~sticking].sum()
        return float(self.stiffness[sticking].sum()), float(self.damping[sticking].sum()), float(constant)

    def turn(self, direction: int, position: float) -> None:
        """The velocity changes its sign: all that slipped sticks, from its limit on."""
        if direction == self.direction:
            return
        slipping = self.regime == SLIP
        self.offset[slipping] = self.direction * self.limit[slipping] - position
        self.regime[:] = STICK
        self.direction = direction

    def hold_at_limit(self, position: float) -> None:
        """What stands at the limit towards which it moves, slips: there is no switch left to wait for."""
        deflection = self.direction * (position + self.offset)
        self.regime[(self.regime != SLIP) & (deflection >= self.limit * (1 - 1e-13))] = SLIP

    def switches(self) -> Iterator[tuple[int, int, float, float, float]]:
        """(element, next regime, a, b, c): the element switches when a x + b v + c rises through zero."""
        s = self.direction
        for i in range(self.limit.size):
            if self.regime[i] != SLIP:
                yield i, SLIP, s, 0.0, s * self.offset[i] - self.limit[i]
            if self.damping[i] > 0 and self.regime[i] != SLIP:
                sign = 1 if self.regime[i] == STICK else -1
                a, b = sign * s * self.stiffness[i], sign * s * self.damping[i]
                yield i, LIMITED if sign > 0 else STICK, a, b, a * self.offset[i] - sign * self.slip_force[i]


def respond(
    machine: Machine, controller: Controller, target: ArrayLike, *, initial_friction: ArrayLike | None = None
) -> tuple[Array, Array]:
    """(x (n,) [m], friction (n,) [N]) at the samples, for a target (n,) [m]; as `simulator.simulate`, without noise."""
    if machine.scale.noise > 0:
        raise ValueError("the oracle has no noise; give a machine whose scale.noise is 0")
    friction, ts = machine.friction, machine.sample_time
    stiffness, limit = np.array(friction.stiffness), np.array(friction.limit)
    offset = np.zeros(limit.size) if initial_friction is None else np.array(initial_friction, float)
    elements = _Elements(stiffness, limit, np.array(friction.damping), offset)
    start = float(stiffness @ offset) + machine.drive.offset if controller.has_integral else 0.0
    given = references(controller, target)
    known = given.feedforward + given.compensation
    law, rated = controller.law, machine.drive.rated_thrust
    feedback = _Feedback(controller, start) if law is None else _LawFeedback(law, start, rated)
    dynamics = _Dynamics(machine)
    state = np.zeros(dynamics.a.shape[0])
    n = given.position.size
    position, force, command = np.empty(n), np.empty(n), np.empty(n)
    for k in range(n):
        position[k] = dynamics.x @ state
        force[k] = _force(elements, dynamics, state)
        waiting = given.position[max(k - controller.reference_delay, 0)]
        command[k] = feedback.step(waiting, _reading(position[k], machine.scale.resolution), known[k])
        for begin, end, sent in _pieces(machine.plant.dead_time, ts, k):
            thrust = command[sent] if sent >= 0 else start
            bounded = min(max(thrust, -rated), rated)
            state = _advance(elements, dynamics, state, bounded - machine.drive.offset, end - begin)
    return position, force


class _Feedback:
    """The PID of interfaces' law, one error after the other."""

    def __init__(self, controller: Controller, integral: float) -> None:
        self.pid, self.ts = controller.pid, controller.sample_time
        self.integral, self.slope, self.previous = integral, 0.0, 0.0

    def step(self, reference: float, reading: float, known: float) -> float:
        pid, error = self.pid, reference - reading
        a = pid.derivative_filter / (pid.derivative_filter + self.ts)
        self.integral += pid.ki * self.ts * error
        self.slope = a * self.slope + (1 - a) * (error - self.previous) / self.ts
        self.previous = error
        return pid.kp * error + self.integral + pid.kd * self.slope + known


class _LawFeedback:
    """A feedback of any structure, one sample after the other."""

    def __init__(self, law: Law, held: float, rated: float) -> None:
        self.a, self.b, self.c, self.d = (np.array(part) for part in (law.a, law.b, law.c, law.d))
        self.reset, self.state = np.array(law.reset), np.array(law.hold) * held
        self.rated = rated if law.keeps_to_the_rating else math.inf

    def step(self, reference: float, reading: float, known: float) -> float:
        given = np.array([reference, reading])
        wanted = float(self.c @ self.state + self.d @ given) + known
        command = min(max(wanted, -self.rated), self.rated)
        self.state = self.a @ self.state + self.b @ given + self.reset * (command - wanted)
        return command


class _Dynamics:
    """state' = a state + b (thrust - friction), x = x state, v = v state."""

    def __init__(self, machine: Machine) -> None:
        system = state_space(machine.plant)
        self.a, self.b = np.asarray(system.A, float), np.asarray(system.B, float)[:, 0]
        self.x = np.asarray(system.C, float)[0]
        self.v = self.x @ self.a
        nodes = 0.5 * (1 + chebyshev.chebpts2(DEGREE + 1))
        self.nodes = nodes
        self.series = np.linalg.inv(chebyshev.chebvander(2 * nodes - 1, DEGREE))
        self.exponential = lru_cache(maxsize=4096)(self._exponential)
        self.at_nodes = lru_cache(maxsize=512)(self._at_nodes)
        self.longest = lru_cache(maxsize=4096)(self._longest)

    def _exponential(self, stiffness: float, damping: float, duration: float) -> Array:
        """exp(M duration) of (state, held input) under the friction's linear part."""
        n = self.b.size
        m = np.zeros((n + 1, n + 1))
        m[:n, :n] = self.a - np.outer(self.b, stiffness * self.x + damping * self.v)
        m[:n, n] = self.b
        return np.asarray(expm(m * duration))

    def _longest(self, stiffness: float, damping: float) -> float:
        """How long [s] the quickest motion under the friction's linear part takes for MAX_TURN."""
        quickest = np.max(np.abs(np.linalg.eigvals(self.a - np.outer(self.b, stiffness * self.x + damping * self.v))))
        return MAX_TURN / float(quickest) if quickest > 0 else math.inf

    def _at_nodes(self, stiffness: float, damping: float, duration: float) -> Array:
        """(DEGREE + 1, n, n + 1): the states at the Chebyshev nodes of the interval."""
        return np.stack([self._exponential(stiffness, damping, node * duration)[:-1] for node in self.nodes])


def _advance(elements: _Elements, dynamics: _Dynamics, state: Array, thrust: float, duration: float) -> Array:
    """The state after `duration` [s] under a held thrust [N]; the elements move along."""
    left, switches = duration, 0
    while switches < MOST_SWITCHES:
        _face(elements, dynamics, state, thrust)
        k, d, f0 = elements.linear_force()
        start, part = np.append(state, thrust - f0), min(left, dynamics.longest(k, d))
        event = _first_event(elements, dynamics, start, (k, d), part)
        if event is None:
            state = np.asarray(dynamics.exponential(k, d, part)[:-1] @ start)
            left -= part
            if left <= 0:
                return state
            continue
        switches += 1
        when, element, regime = event
        state = np.asarray(dynamics._exponential(k, d, when)[:-1] @ start)
        left -= when
        if element < 0:
            elements.turn(-elements.direction, float(dynamics.x @ state))
            state = state - dynamics.v * (dynamics.v @ state) / (dynamics.v @ dynamics.v)  # v = 0, to the last digit
        else:
            elements.regime[element] = regime
        if left <= 0:
            return state
    raise RuntimeError("the elements switch without end; the machine's parameters are out of any range")


def _face(elements: _Elements, dynamics: _Dynamics, state: Array, thrust: float) -> None:
    """Sets the direction of motion at the start of a piece: that of v, or from rest that of the acceleration."""
    v, x = float(dynamics.v @ state), float(dynamics.x @ state)
    moving = v
    if abs(v) <= 1e-18:
        moving = dynamics.v @ (dynamics.a @ state + dynamics.b * (thrust - _force(elements, dynamics, state)))
    if moving != 0:
        elements.turn(1 if moving > 0 else -1, x)
        elements.hold_at_limit(x)


def _first_event(
    elements: _Elements, dynamics: _Dynamics, start: Array, friction: tuple[float, float], duration: float
) -> tuple[float, int, int] | None:
    """(time, element, next regime) of the first switch within `duration` [s]; element -1: the velocity turns."""
    states = dynamics.at_nodes(*friction, duration) @ start
    x, v = states @ dynamics.x, states @ dynamics.v
    first: tuple[float, int, int] | None = None
    turning = (-1, -1, 0.0, -float(elements.direction), 0.0)
    for element, regime, a, b, c in (turning, *elements.switches()):

        def value(time: float, a: float = a, b: float = b, c: float = c) -> float:
            now = dynamics._exponential(*friction, time)[:-1] @ start
            return float(a * (dynamics.x @ now) + b * (dynamics.v @ now) + c)

        horizon = duration if first is None else first[0]
        when = _rise(dynamics.series @ (a * x + b * v + c), duration, horizon, value)
        if when is not None:
            first = (when, element, regime)
    return first


def _rise(series: Array, duration: float, horizon: float, value: object) -> float | None:
    """The first time in (0, horizon) at which the series over [0, duration] rises through zero, refined on `value`."""
    if np.sum(np.abs(series[1:])) <= abs(series[0]):
        return None  # too far from zero to reach it, or zero throughout
    # Trailing terms of round-off size would only add spurious roots.
    roots = chebyshev.chebroots(chebyshev.chebtrim(series, 1e-15 * np.max(np.abs(series))))
    slope = chebyshev.chebder(series)
    for root in sorted(float(r.real) for r in np.atleast_1d(roots) if abs(r.imag) < 1e-7 and -1 + 1e-9 < r.real <= 1):
        if chebyshev.chebval(root, slope) > 0:
            when = _refined(0.5 * (1 + root) * duration, duration, value)
            return when if when < horizon else None
    return None


def _refined(guess: float, duration: float, value: object) -> float:
    """The root of `value` next to the guess, by bisection between the nearest points of opposite sign."""
    assert callable(value)
    width = 1e-6 * duration
    for _ in range(30):
        low, high = max(guess - width, 0.0), min(guess + width, duration)
        if value(low) < 0 < value(high):
            return float(scipy.optimize.brentq(value, low, high, xtol=1e-18, rtol=8.9e-16))
        width *= 2
    return guess


def _force(elements: _Elements, dynamics: _Dynamics, state: Array) -> float:
    k, d, f0 = elements.linear_force()
    return float(k * (dynamics.x @ state) + d * (dynamics.v @ state) + f0)


def _pieces(dead_time: float, sample_time: float, k: int) -> list[tuple[float, float, int]]:
    """(begin, end, sample whose command acts) of the pieces of sample k in which the thrust is constant."""
    late = dead_time / sample_time
    whole = math.floor(late + 1e-9)
    change = (late - whole) * sample_time
    if change <= 1e-9 * sample_time:
        return [(0.0, sample_time, k - whole)]
    return [(0.0, change, k - whole - 1), (change, sample_time, k - whole)]


def _reading(position: float, resolution: float) -> float:
    return position if resolution == 0 else math.floor(position / resolution + 0.5) * resolution
