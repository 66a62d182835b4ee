"""The loops with effects: the closed loop of models/simulation/kernel.py with hooks, and the replay along a given path.

In both, everything within a substep is taken at its middle: second order in its length.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.compiled import compiled, inlined
from models.effects.base import MOVED, U_LAW, E, Effect, H, Place, T, U, V, X
from models.feedback.law import LawArrays, advance, output
from models.friction import Friction
from models.plant import delay_split
from models.simulation.hooks import COMMAND, CONTROL, FORCE, FRICTION, LIMIT, PATH, READING, THRUST, Hooks, act, pack
from models.simulation.kernel import Loop, Run, clipped, pid_step, quantised

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

KI: Final = 1  # The integral gain in `gains` of a Loop.
ACTING: Final = {
    "thrust": frozenset({Place.COMMAND, Place.THRUST}),
    "friction": frozenset({Place.PATH, Place.LIMIT, Place.FRICTION}),
    "force": frozenset({Place.FORCE}),
    "reading": frozenset({Place.READING}),
}
"""What acts along a path, and the hooks that change it."""
ONCE: Final = frozenset({Place.READING, Place.COMMAND})  # hooks that are called once a sample, not every substep


class Path(NamedTuple):
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
    """What acts along a path: thrust, friction, force (n, M) [N] at the middle of each substep, linear between these;
    reading (n,) [m] less the position.

    sent: the commands as the drive takes them in, after the dead time and the limit (n, M) [N]; thrust: what all that
    acts on it makes of them. force: the external one. state: the elements' displacements (N,) [m] at the end.
    """

    sent: Array
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
    known: Mapping[str, Array] = MappingProxyType({}),
) -> Replayed:
    """Friction and effects along a path, without plant and controller; effects in the catalogue's order.

    dead_time [s]; of the thrust in a sample interval in which it changes, see `_shares`. state: the elements'
    displacements (N,) [m] before the path, default 0. thrust_limit [N]. start [N]: the command before the first,
    default that one. known: what is to be taken from an earlier answer for the same path, see `kept`; only the rest is
    computed.
    """
    anew = ACTING.keys() - known.keys()
    course = Path(path.sample_time, *(np.ascontiguousarray(signal, float) for signal in path[1:]))
    contact, empty = _contact(friction, state), np.empty((0, 0))
    acting = [effect for effect in effects if not touched(effect).isdisjoint(anew)]
    hooks = pack(acting, contact.shape[1])
    found = dict(known)
    if not anew.isdisjoint({"reading", "thrust"}):
        if any(effect.hooks.keys() & ONCE for effect in acting):
            reading, taken = _sampled(course, hooks, contact)
        else:
            reading, taken = np.zeros_like(course.command), course.command
        if "reading" in anew:
            found["reading"] = reading
        if "thrust" in anew:
            before = float(course.command[0] if start is None else start)
            found["sent"] = _sent(taken, course, dead_time, thrust_limit, before)
    if "thrust" in anew and not any(Place.THRUST in effect.hooks for effect in acting):
        found["thrust"] = np.array(found["sent"])
    flags = np.array([name in anew and name not in found for name in ("thrust", "friction", "force")])
    if flags.any():
        thrust, rubbing, force = (np.empty_like(course.position) if flag else empty for flag in flags)
        elements = np.array([friction.limit, *([friction.damping] if any(friction.damping) else [])])
        _along(course, elements, hooks, contact, found["sent"], (thrust, rubbing, force), flags)
        found = {"thrust": thrust, "friction": rubbing, "force": force} | found
        found["state"] = contact[0] if flags[1] else known["state"]
    return Replayed(**found)


def kept(acts: Replayed, anew: Collection[str]) -> dict[str, Array]:
    """What of an answer of `replay` stays, by field (SI), where only `anew`, keys of ACTING, is computed again."""
    also = {"thrust": ("sent",), "friction": ("state",)}
    names = [field for name in ACTING if name not in anew for field in (name, *also.get(name, ()))]
    return {name: getattr(acts, name) for name in names}


def touched(effect: Effect) -> frozenset[str]:
    """What an effect acts on: keys of ACTING."""
    return frozenset(name for name, places in ACTING.items() if not places.isdisjoint(effect.hooks))


def changed(before: Sequence[Effect], now: Sequence[Effect]) -> frozenset[str]:
    """What acts otherwise along a path with the effects `now` than with those `before`: keys of ACTING.

    Other commands change all that effects make of a thrust reference: any of their hooks may look at it.
    """
    differing = [effect for effect in (*before, *now) if before.count(effect) != now.count(effect)]
    found = frozenset[str]().union(*map(touched, differing))
    if any(Place.COMMAND in effect.hooks for effect in differing):
        found = found.union(*map(touched, now))
    return coupled(found, now)


def coupled(anew: Collection[str], effects: Sequence[Effect]) -> frozenset[str]:
    """What has to be computed anew together: an effect's hooks share their memory; keys of ACTING."""
    found = frozenset(anew)
    while True:
        more = found.union(*(touched(effect) for effect in effects if not touched(effect).isdisjoint(found)))
        if more == found:
            return found
        found = more


def _contact(friction: Friction, state: ArrayLike | None) -> Array:
    """Rows z, stiffness and limit of the elements; see base.py."""
    z = np.zeros(len(friction.limit)) if state is None else np.asarray(state, float)
    return np.array([z, friction.stiffness, friction.limit])


def _sent(taken: Array, course: Path, dead_time: float, thrust_limit: float, before: float) -> Array:
    """The thrust reference (n, M) [N] of the commands that the drive takes in (n,) [N], after `before` [N]."""
    n, parts = course.position.shape
    delay, rest = delay_split(dead_time, course.sample_time)
    late = np.clip(np.concatenate([np.full(delay + 1, before), taken])[: n + 1], -thrust_limit, thrust_limit)
    sent = np.empty((n, parts))
    _mixed(late, _shares(rest / course.sample_time, parts), sent)
    return sent


def _shares(switched: float, parts: int) -> Array:
    """What share (M,) [1] the earlier of two thrusts has at each substep's middle, where the later follows it after a
    part `switched` [1] of the sample interval: such that a force that is linear between the middles has the thrust's
    impulse, and moves a mass as far in the interval."""
    share: Array = np.clip(switched * parts - np.arange(parts), 0.0, 1.0)  # of each substep: the impulse
    if parts == 1 or not 0.0 < switched < 1.0:
        return np.asarray(share)
    place = (np.arange(parts) + 0.5) / parts - 0.5
    moment = -switched * (1.0 - switched) / 2  # of the earlier thrust about the interval's middle
    return np.asarray(share + 12.0 * (moment - np.mean(place * share) / (1.0 - 1.0 / parts**2)) * place)


@compiled
def _mixed(late: Array, share: Array, sent: Array) -> None:
    """sent (n, M): of each thrust in `late` (n + 1,) the share (M,) [1] at a substep's middle, of the next the rest."""
    for k in range(sent.shape[0]):
        for j in range(sent.shape[1]):
            sent[k, j] = share[j] * late[k] + (1.0 - share[j]) * late[k + 1]


@compiled
def _sampled(course: Path, hooks: Hooks, contact: Array) -> tuple[Array, Array]:
    """What acts once a sample: the reading less the position (n,) [m], and the commands as the drive takes them in."""
    at, speed, command = course.at_samples, course.speed, course.command
    now, last = np.zeros(8), speed.shape[1] - 1
    reading, taken = np.empty(command.size), np.empty(command.size)
    for k in range(command.size):
        now[T], now[X], now[H], now[U] = k * course.sample_time, at[k], course.sample_time, command[k]
        now[V] = 0.5 * (speed[k - 1, last] + speed[k, 0]) if k > 0 else speed[0, 0]
        reading[k] = act(READING, at[k], hooks, now, contact) - at[k]
        taken[k] = act(COMMAND, command[k], hooks, now, contact)
    return reading, taken


@compiled
def _along(
    course: Path,
    elements: Array,
    hooks: Hooks,
    contact: Array,
    sent: Array,
    acting: tuple[Array, Array, Array],
    anew: Flags,
) -> None:
    """What acts every substep: thrust, friction and external force (n, M), each written to where `anew` (3,) says so.

    elements: see `friction_step`. sent (n, M): the thrust as it comes from the drive.
    """
    position, speed, now = course.position, course.speed, np.zeros(8)
    thrust, friction, force = acting
    n, parts = position.shape
    h = course.sample_time / parts
    at = contact_position = course.at_samples[0]
    for k in range(n):
        for j in range(parts):
            middle = position[k, j]
            now[T], now[X], now[V], now[H] = (k * parts + j + 0.5) * h, middle, speed[k, j], h
            now[U], now[MOVED] = sent[k, j], middle - at
            if anew[0]:
                thrust[k, j] = act(THRUST, sent[k, j], hooks, now, contact)
            if anew[2]:
                force[k, j] = act(FORCE, 0.0, hooks, now, contact)
            if anew[1]:
                contact_position, friction[k, j] = friction_step(
                    middle, contact_position, elements, hooks, now, contact
                )
            at = middle


@compiled
def run_effects(loop: Loop, run: Run, hooks: Hooks, law: LawArrays, origin: float, by_friction: int) -> None:
    """Advances one machine over the n samples of `run`; what `models.simulation.kernel.run_one` does, with hooks, and
    with any linear feedback in place of the PID where `law` has states.

    All positions are from the place where the run begins, `origin` [m]: only the hooks are told where that is.

    The plant's modes in `loop` have those of the effects behind them, the last `by_friction` of which the friction
    drives alone, by what it differs from that of the start: positions are from the equilibrium there. The feedback's
    integral, if it has one, holds the external force of the start, too.
    """
    follows_law = law.c.size > 0
    phi, gamma, state = loop.phi, loop.gamma, run.state
    modes, n = state.shape[0], run.reference.size
    damped = np.any(loop.damping != 0.0)
    contact, elements = np.empty((3, run.z.size)), np.empty((2 if damped else 1, run.z.size))
    for i in range(run.z.size):
        contact[0, i], contact[1, i], contact[2, i] = run.z[i], loop.stiffness[i], loop.limit[i]
        elements[0, i] = loop.limit[i]
        if damped:
            elements[1, i] = loop.damping[i]
    now, taken = np.zeros(8), np.empty(n)
    kept_memory, trial_contact = np.empty(hooks.memory.size), np.empty(contact.shape)
    put(hooks.memory, kept_memory)
    now[X], now[H] = origin, 0.5 * loop.step[1]
    held = act(FORCE, 0.0, hooks, now, contact)
    has_integral = law.has_integral if follows_law else loop.gains[KI] > 0.0
    start = run.start - held if has_integral else run.start
    put(kept_memory, hooks.memory)
    for i in range(law.state.size):
        law.state[i] = law.hold[i] * start
    integral, slope, previous = start, 0.0, 0.0
    acceleration = x = v = 0.0
    for j in range(modes):
        x += state[j, 0]
        v += state[j, 1]
    at = contact_position = x  # of the table when its contacts were last moved, and of these contacts
    elapsed = 0.0  # time since then
    for k in range(n):
        now[T], now[X], now[V], now[H] = k * loop.sample_time, origin + x, v, loop.sample_time
        run.position[k] = x
        seen = act(READING, origin + x, hooks, now, contact) - origin
        run.reading[k] = quantised(seen + run.noise[k], loop.resolution)
        error = run.reference[max(k - loop.delays[1], 0)] - run.reading[k]
        if follows_law:
            waiting = run.reference[max(k - loop.delays[1], 0)]
            feedback = output(law, waiting, run.reading[k])
            wanted = feedback + run.feedforward[k]
            command = clipped(wanted, loop.thrust_limit) if law.keeps_to_the_rating else wanted
            advance(law, waiting, run.reading[k], command - wanted)
        else:
            feedback, integral, slope = pid_step(error, previous, integral, slope, loop.gains, loop.sample_time)
            command = feedback + run.feedforward[k]
        previous = error
        now[U], now[E], now[U_LAW] = command, error, feedback
        run.command[k] = act(CONTROL, command, hooks, now, contact)
        now[U] = run.command[k]
        taken[k] = act(COMMAND, run.command[k], hooks, now, contact)
        put(hooks.memory, kept_memory)  # the friction at x, but all contacts stay in place
        for i in range(3):
            put(contact[i], trial_contact[i])
        now[H], now[MOVED] = elapsed if k > 0 else 0.5 * loop.step[1], x - at
        run.friction[k] = friction_step(x, contact_position, elements, hooks, now, trial_contact)[1]
        put(kept_memory, hooks.memory)
        for part in range(2):
            sent = k - loop.delays[0] - 1 + part
            thrust = clipped(taken[sent] if sent >= 0 else start, loop.thrust_limit)
            h = loop.step[part]
            for i in range(loop.counts[part]):
                middle, ahead = x + 0.5 * h * v, v + 0.5 * h * acceleration
                now[T] = k * loop.sample_time + part * loop.counts[0] * loop.step[0] + (i + 0.5) * h
                now[X], now[V], now[H], now[U], now[MOVED] = origin + middle, ahead, h, thrust, middle - at
                driven = act(THRUST, thrust, hooks, now, contact) - loop.offset
                external = act(FORCE, 0.0, hooks, now, contact)
                now[H] = elapsed + 0.5 * h
                contact_position, force = friction_step(middle, contact_position, elements, hooks, now, contact)
                at, elapsed = middle, 0.5 * h
                net = driven - force + external
                before = v
                x = v = 0.0
                for j in range(modes):
                    q, rate = state[j, 0], state[j, 1]
                    input_force = net if j < modes - by_friction else run.friction[0] - force
                    state[j, 0] = phi[part, j, 0] * q + phi[part, j, 1] * rate + gamma[part, j, 0] * input_force
                    state[j, 1] = phi[part, j, 2] * q + phi[part, j, 3] * rate + gamma[part, j, 1] * input_force
                    x += state[j, 0]
                    v += state[j, 1]
                acceleration = (v - before) / h
    put(contact[0], run.z)


@inlined
def put(numbers: Array, place: Array) -> None:
    """Copies numbers (n,) [any unit] to where others stand. Where one array is assigned to another, the compiler adds
    all that may be said of their shapes, which takes it longer than many a loop."""
    for i in range(place.size):
        place[i] = numbers[i]


@inlined
def friction_step(
    position: float, previous_contact: float, elements: Array, hooks: Hooks, now: Array, contact: Array
) -> tuple[float, float]:
    """Moves the friction's contacts along with the table to `position` [m]: their own position then [m], friction [N].

    previous_contact: the contacts' position before, which a path hook makes differ from the table's. elements: X_i [m],
    and in a second row, where any is damped, D_i [N s/m]. now: of this move, with the table's MOVED, which becomes that
    of the contacts.
    """
    contact_position = act(PATH, position, hooks, now, contact)
    now[MOVED] = moved = contact_position - previous_contact
    factor = act(LIMIT, 1.0, hooks, now, contact)
    force = 0.0
    for i in range(elements.shape[1]):
        furthest = factor * elements[0, i]
        displaced = clipped(contact[0, i] + moved, furthest)
        contact[2, i], contact[0, i] = furthest, displaced
        force += contact[1, i] * displaced
    if elements.shape[0] > 1:
        force = 0.0
        for i in range(elements.shape[1]):
            stuck, damping = contact[1, i] * contact[0, i], elements[1, i]
            force += stuck if damping == 0.0 else clipped(stuck + damping * now[V], contact[1, i] * contact[2, i])
    return contact_position, act(FRICTION, force, hooks, now, contact)
