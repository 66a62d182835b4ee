"""The loops with effects: the closed loop of models/kernel.py with hooks, and the replay along a given path.

In both, everything within a substep is taken at its middle: second order in its length.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.compiled import compiled
from models.effects.base import MOVED, U_LAW, E, Effect, H, T, U, V, X
from models.effects.calling import COMMAND, CONTROL, FORCE, FRICTION, LIMIT, PATH, READING, THRUST, Hooks, act, pack
from models.friction import Friction
from models.kernel import Loop, Run, clipped, pid_step, quantised
from models.plant import delay_split

Array = NDArray[np.float64]

RUBBING: Final = frozenset({"path", "limit", "friction"})  # hooks of the friction and of what its contacts see


@dataclass(frozen=True)
class Path:
    """Where the table went: position (n, M) [m] and speed (n, M) [m/s] at the middles of M equal substeps of each
    sample interval, that from sample k to k + 1; at_samples (n,) [m]; the logged command (n,) [N]; sample_time [s].
    """

    sample_time: float
    position: Array
    speed: Array
    at_samples: Array
    command: Array


@dataclass(frozen=True)
class Replayed:
    """What acts along a path: thrust, friction, force (n, M) [N] over each substep; reading (n,) [m] less the position.

    thrust: of what the drive takes in of the commands, after the dead time and all that acts on the thrust. force: the
    external one. state: the elements' displacements (N,) [m] at the end.
    """

    thrust: Array
    friction: Array
    force: Array
    reading: Array
    state: Array


def replay(
    friction: Friction,
    effects: Sequence[Effect],
    path: Path,
    dead_time: float,
    *,
    state: ArrayLike | None = None,
    thrust_limit: float = math.inf,
    start: float | None = None,
    rubbing: Array | None = None,
) -> Replayed:
    """Friction and effects along a path, without plant and controller; effects in the catalogue's order.

    dead_time [s], of which a substep in which the thrust changes takes its share. state: the elements' displacements
    (N,) [m] before the path, default 0. thrust_limit [N]. start [N]: the command before the first, default that one.
    rubbing (n, M) [N]: the friction, where it is known from an earlier call; then no element moves. Raises ValueError
    for effects on the friction beside it.
    """
    if rubbing is not None and any(rubs(effect) for effect in effects):
        raise ValueError("rubbing: a friction that effects act on can't be known before; leave it out")
    course = _Course(path.sample_time, *(np.ascontiguousarray(signal, float) for signal in _signals(path)))
    n, parts = course.position.shape
    contact = _contact(friction, state)
    hooks = pack(effects, contact.shape[1])
    reading, acting = np.empty(n), np.empty((3, n, parts))
    taken = _sampled(course, hooks, contact, reading)
    before = float(course.command[0] if start is None else start)
    delay, rest = delay_split(dead_time, path.sample_time)
    sent = np.clip(np.concatenate([np.full(delay + 1, before), taken])[: n + 1], -thrust_limit, thrust_limit)
    length = path.sample_time / parts
    share = np.clip(rest / length - np.arange(parts), 0.0, 1.0)  # of a substep that passes before the thrust changes
    acting[0] = share * sent[:-1, None] + (1.0 - share) * sent[1:, None]
    if rubbing is not None:
        acting[1] = rubbing
    _along(course, np.array([friction.limit, friction.damping]), hooks, contact, acting, rubbing is None)
    return Replayed(acting[0], acting[1], acting[2], reading, contact[0])


def rubs(effect: Effect) -> bool:
    """Whether an effect acts on the friction or on what its contacts see."""
    return not RUBBING.isdisjoint(effect.hooks)


class _Course(NamedTuple):
    """A Path as the loops read it."""

    sample_time: float
    position: Array
    speed: Array
    at_samples: Array
    command: Array


def _signals(path: Path) -> tuple[Array, ...]:
    return path.position, path.speed, path.at_samples, path.command


def _contact(friction: Friction, state: ArrayLike | None) -> Array:
    """Rows z, stiffness and limit of the elements; see base.py."""
    z = np.zeros(len(friction.limit)) if state is None else np.asarray(state, float)
    return np.array([z, friction.stiffness, friction.limit])


@compiled
def _sampled(course: _Course, hooks: Hooks, contact: Array, reading: Array) -> Array:
    """What acts once a sample: the commands as the drive takes them in (n,), and `reading` (n,) is written to."""
    at, speed, command = course.at_samples, course.speed, course.command
    now, taken, last = np.zeros(8), np.empty(command.size), speed.shape[1] - 1
    for k in range(command.size):
        now[T], now[X], now[H], now[U] = k * course.sample_time, at[k], course.sample_time, command[k]
        now[V] = 0.5 * (speed[k - 1, last] + speed[k, 0]) if k > 0 else speed[0, 0]
        reading[k] = act(READING, at[k], hooks, now, contact) - at[k]
        taken[k] = act(COMMAND, command[k], hooks, now, contact)
    return taken


@compiled
def _along(course: _Course, elements: Array, hooks: Hooks, contact: Array, acting: Array, rubbing: bool) -> None:
    """What acts every substep; elements: see `rubbed`. acting (3, n, M): thrust, as it comes from the drive, friction
    and external force, which are written to; the friction only if `rubbing`.
    """
    position, speed, now = course.position, course.speed, np.zeros(8)
    n, parts = position.shape
    h = course.sample_time / parts
    at = seen = course.at_samples[0]
    for k in range(n):
        for j in range(parts):
            thrust, middle = acting[0, k, j], position[k, j]
            now[T], now[X], now[V], now[H] = (k * parts + j + 0.5) * h, middle, speed[k, j], h
            now[U], now[MOVED] = thrust, middle - at
            acting[0, k, j] = act(THRUST, thrust, hooks, now, contact)
            acting[2, k, j] = act(FORCE, 0.0, hooks, now, contact)
            if rubbing:
                seen, acting[1, k, j] = rubbed(middle, seen, elements, hooks, now, contact)
            at = middle


@compiled
def run_effects(loop: Loop, run: Run, hooks: Hooks) -> None:
    """Advances one machine over the n samples of `run`; what `models.kernel.run_one` does, with hooks.

    The plant's modes in `loop` have those of the effects behind them. The PID's integral holds the external force of
    the start, too.
    """
    phi, gamma, state = loop.phi, loop.gamma, run.state
    modes, n = state.shape[0], run.reference.size
    contact, elements = np.empty((3, run.z.size)), np.empty((2, run.z.size))
    contact[0], contact[1], contact[2] = run.z, loop.stiffness, loop.limit
    elements[0], elements[1] = loop.limit, loop.damping
    now, aside, trial, taken = np.zeros(8), np.empty(hooks.memory.size), contact.copy(), np.empty(n)
    aside[:], now[H] = hooks.memory, 0.5 * loop.step[1]
    start = run.start - act(FORCE, 0.0, hooks, now, contact)
    hooks.memory[:] = aside
    integral, slope, previous = start, 0.0, 0.0
    acceleration = x = v = 0.0
    for j in range(modes):
        x += state[j, 0]
        v += state[j, 1]
    at = seen = x  # where the table stood when its contacts were last moved, and where they saw themselves
    behind = 0.0  # time since then
    for k in range(n):
        now[T], now[X], now[V], now[H] = k * loop.sample_time, x, v, loop.sample_time
        run.position[k] = x
        run.reading[k] = quantised(act(READING, x, hooks, now, contact) + run.noise[k], loop.resolution)
        error = run.reference[max(k - loop.delays[1], 0)] - run.reading[k]
        feedback, integral, slope = pid_step(error, previous, integral, slope, loop.gains, loop.sample_time)
        previous = error
        command = feedback + run.feedforward[k]
        now[U], now[E], now[U_LAW] = command, error, feedback
        run.command[k] = act(CONTROL, command, hooks, now, contact)
        now[U] = run.command[k]
        taken[k] = act(COMMAND, run.command[k], hooks, now, contact)
        aside[:], trial[:] = hooks.memory, contact  # the friction at x, but everything stays where it is
        now[H], now[MOVED] = behind if k > 0 else 0.5 * loop.step[1], x - at
        run.friction[k] = rubbed(x, seen, elements, hooks, now, trial)[1]
        hooks.memory[:] = aside
        for part in range(2):
            sent = k - loop.delays[0] - 1 + part
            thrust = clipped(taken[sent] if sent >= 0 else start, loop.thrust_limit)
            h = loop.step[part]
            for i in range(loop.counts[part]):
                middle, ahead = x + 0.5 * h * v, v + 0.5 * h * acceleration
                now[T] = k * loop.sample_time + part * loop.counts[0] * loop.step[0] + (i + 0.5) * h
                now[X], now[V], now[H], now[U], now[MOVED] = middle, ahead, h, thrust, middle - at
                driven = act(THRUST, thrust, hooks, now, contact) - loop.offset
                external = act(FORCE, 0.0, hooks, now, contact)
                now[H] = behind + 0.5 * h
                seen, force = rubbed(middle, seen, elements, hooks, now, contact)
                at, behind = middle, 0.5 * h
                net = driven - force + external
                before = v
                x = v = 0.0
                for j in range(modes):
                    q, rate = state[j, 0], state[j, 1]
                    state[j, 0] = phi[part, j, 0] * q + phi[part, j, 1] * rate + gamma[part, j, 0] * net
                    state[j, 1] = phi[part, j, 2] * q + phi[part, j, 3] * rate + gamma[part, j, 1] * net
                    x += state[j, 0]
                    v += state[j, 1]
                acceleration = (v - before) / h
    run.z[:] = contact[0]


@compiled
def rubbed(at: float, seen: float, elements: Array, hooks: Hooks, now: Array, contact: Array) -> tuple[float, float]:
    """Moves the friction's contacts to the position `at` [m]: (where they now see themselves [m], friction [N]).

    seen: where they saw themselves before. elements: rows X_i [m] and D_i [N s/m]. now: of this move, with MOVED the
    table's, and afterwards the contacts'.
    """
    sight = act(PATH, at, hooks, now, contact)
    now[MOVED] = sight - seen
    factor = act(LIMIT, 1.0, hooks, now, contact)
    force = 0.0
    limit, damping = elements[0], elements[1]
    for i in range(limit.size):
        contact[2, i] = factor * limit[i]
        contact[0, i] = clipped(contact[0, i] + now[MOVED], contact[2, i])
        stuck = contact[1, i] * contact[0, i]
        force += stuck if damping[i] == 0.0 else clipped(stuck + damping[i] * now[V], contact[1, i] * contact[2, i])
    return sight, act(FRICTION, force, hooks, now, contact)
