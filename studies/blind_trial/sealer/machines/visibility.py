"""How visible an effect is on a drawn machine: its distance, in noise units, from the nearest machine within what is
known of it. As on the one table (see `distance`): innovations of a predictor of the nominal machine, whitened for the
scale's noise and a slowly wandering force, less what the nominal parameters explain within their tolerances. The
contacts turn the scale's noise into noise of the friction, as nobody knows the path better than the scale shows it; on
stiff contacts and coarse scales this is most of the noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from studies.blind_trial.sealer.distance import applied, contact_force, innovations
from studies.blind_trial.sealer.loop import Log
from studies.blind_trial.sealer.machines.axis import Axis
from studies.blind_trial.sealer.machines.drawing import sampled
from studies.blind_trial.sealer.machines.simulation import SMEARED, elements

Array = NDArray[np.float64]

WANDER: Final = 1e-3  # of the friction, by which the slow force wanders in a second, one standard deviation
SMOOTH: Final = 21  # samples over which a wrong reading is smoothed before friction is looked up there


@dataclass(frozen=True)
class Predictor:
    """The nominal machine, its filter's gain and the innovations' deviation [m]."""

    axis: Axis
    gain: Array
    deviation: float


def predictor(axis: Axis) -> Predictor:
    """The stationary Kalman filter of the nominal machine, with a random walk of the force and with what the friction
    is off by where it is looked up at a reading instead of the true position."""
    a, b, c = _with_force(axis)
    felt = a[:, -1] * np.append(np.ones(b.size - 1), 0.0)  # by a constant force of 1 N over a sample
    s = a.shape[0]
    q = np.zeros((s, s))
    q[-1, -1] = (WANDER * axis.friction) ** 2 * axis.sample_time
    q += 1e-3 * q[-1, -1] * np.outer(np.append(b[:-1], 0), np.append(b[:-1], 0))  # keeps the problem regular
    q += min(axis.stiffness.sum() * axis.read, axis.friction) ** 2 * np.outer(felt, felt)
    unit = 1.0 / axis.read
    p = solve_discrete_are(a.T, c[:, None] * unit, q, np.array([[1.0]]), balanced=True)
    variance = float(c @ p @ c + axis.read**2)
    return Predictor(axis, p @ c / variance, float(np.sqrt(variance)))


def _with_force(axis: Axis) -> tuple[Array, Array, Array]:
    a, b, c = sampled(axis)
    whole = np.zeros((b.size + 1, b.size + 1))
    whole[:-1, :-1], whole[:-1, -1], whole[-1, -1] = a, b, 1.0
    return whole, np.append(b, 0.0), np.append(c, 0.0)


def seen_path(log: Log) -> Array:
    """Where friction is looked up (n, POINTS) [m]: the true position, moved by what the scale slowly misreads."""
    wrong = log.reading - log.position[:, 0]
    around = np.convolve(np.pad(wrong, SMOOTH // 2, mode="edge"), np.full(SMOOTH, 1 / SMOOTH), mode="valid")
    return np.asarray(log.position + around[:, None])


def missed(model: Predictor, log: Log) -> Array:
    """Innovations (n,) [1] of the nominal machine over an exact log."""
    axis = model.axis
    held = contact_force(seen_path(log), *elements(axis), log.start)
    force = applied(log.command, log.earlier, axis.dead_time / axis.sample_time) - held
    return innovations(*_with_force(axis), model.gain, force, log.reading) / model.deviation


def explained(model: Predictor, log: Log) -> Array:
    """What innovations (n, P) change by with one standard deviation of each nominal value, and with the start."""
    axis, known, path = model.axis, model.axis.known, seen_path(log)
    (stiffness, limit), parts = elements(axis), len(SMEARED)
    nominal, nothing = _with_force(axis), np.zeros(log.command.size)

    def contact(i: int, wider: float = 1.0, moved: float = 0.0) -> Array:
        own = slice(i * parts, (i + 1) * parts)
        start = np.clip(log.start[own] + moved, -wider * limit[own], wider * limit[own])
        return contact_force(path, stiffness[own], wider * limit[own], start)

    def answer(force: Array) -> Array:
        return innovations(*nominal, model.gain, force, nothing)

    held = [contact(i) for i in range(axis.limit.size)]
    late = axis.dead_time / axis.sample_time
    u = applied(log.command, log.earlier, late)
    force = u - np.sum(held, axis=0)
    base = innovations(*nominal, model.gain, force, log.reading)
    found = [innovations(*_with_force(other), model.gain, force, log.reading) - base for other in _moved(axis)]
    stiff = [known.stiffness * answer(-one) for one in held]
    found += [*stiff, known.friction_level / known.stiffness * np.sum(stiff, axis=0)]
    found += [answer(held[i] - contact(i, wider=1 + known.limit)) for i in range(axis.limit.size)]
    later = applied(log.command, log.earlier, late + known.dead_time / axis.sample_time)
    found += [answer(later - u), answer(np.full(u.size, known.offset))]
    for i in range(axis.limit.size):
        inward = -np.sign(log.start[i * parts + parts // 2]) * 0.1 * axis.limit[i]
        found.append(10.0 * answer(held[i] - contact(i, moved=inward)))  # the start is hardly known
    found.append(answer(np.full(u.size, axis.friction)))  # nor is what the drive held before the record
    return np.stack(found, axis=1) / model.deviation


def _moved(axis: Axis) -> list[Axis]:
    """The nominal machine moved by one standard deviation in each parameter of its modes."""

    def off(array: Array, i: int, share: float) -> Array:
        moved = array.copy()
        moved[i] *= 1 + share
        return moved

    known = axis.known
    vibrating = range(1, axis.gain.size)
    return [
        replace(axis, gain=off(axis.gain, 0, known.mass)),
        *(replace(axis, gain=off(axis.gain, i, known.mode_gain)) for i in vibrating),
        *(replace(axis, frequency=off(axis.frequency, i, known.frequency)) for i in vibrating),
        *(replace(axis, damping=off(axis.damping, i, known.damping)) for i in vibrating),
    ]


@dataclass(frozen=True)
class Reference:
    """A machine's experiment without effects: the predictor, and of each record the innovations (n,), and (n, P) how
    the nominal parameters move them."""

    model: Predictor
    clean: tuple[Array, ...]
    moves: tuple[Array, ...]


def reference(axis: Axis, logs: Sequence[Log]) -> Reference:
    """From exact logs of the nominal machine; done once for all cases of a machine."""
    model = predictor(axis)
    clean = tuple(missed(model, log) for log in logs)
    return Reference(model, clean, tuple(explained(model, log) for log in logs))


def distance(known: Reference, logs: Sequence[Log]) -> float:
    """D of exact logs of this machine with effects in it, from the same start; what the predictor itself neglects, such
    as how friction changes within a sample, is taken off."""
    starts = known.model.axis.limit.size + 1  # of the contacts, and the force
    shared = known.moves[0].shape[1] - starts
    size = shared + starts * len(logs)
    normal, slope, total = np.eye(size), np.zeros(size), 0.0
    for i, (log, moves) in enumerate(zip(logs, known.moves, strict=True)):
        base = missed(known.model, log) - known.clean[i]
        places = np.concatenate([np.arange(shared), shared + i * starts + np.arange(starts)])
        normal[np.ix_(places, places)] += moves.T @ moves
        slope[places] += moves.T @ base
        total += float(base @ base)
    return float(np.sqrt(max(total - slope @ np.linalg.solve(normal, slope), 0.0)))
