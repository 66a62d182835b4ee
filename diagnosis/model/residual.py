"""What a candidate model leaves of the records: whitened innovations, and how they depend on every parameter.

A candidate is the nominal machine, theta (parameters.py) and effects. Its friction is evaluated on the position that a
smoother makes of the recorded command and reading, so that what is left is linear in the unknown force; two closed
loops are never compared, because the feedback hides the gap and hysteresis makes them part. n samples, M substeps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from types import MappingProxyType
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from diagnosis.model.kalman import (
    SUBSTEPS,
    Predictor,
    Resonance,
    at_rest,
    beside_start,
    changes,
    discretised,
    innovations,
    predictor,
    smoothed,
)
from diagnosis.model.parallel import parallel_map
from diagnosis.model.parameters import Parameters, applied, initial_state
from diagnosis.model.path import path_through
from diagnosis.records.units import friction_force, noise, white_force
from models.compiled import compiled
from models.effects.base import Effect
from models.effects.catalogue import beyond
from models.machine import Machine
from models.plant import Mode, Plant
from models.records.record import Record
from models.simulation.effect_kernel import Path, Replayed, changed, coupled, kept, replay
from models.variation import Variation, varied_friction

Array = NDArray[np.float64]

# Walks of the unknown force are in the machine's usual white force (`units.white_force`) a sample.
WALK: Final = 0.025  # in the predictor: a fast one swallows slow effects
FIRST_WALK_FRICTION_SHARE: Final = 0.18  # of the friction: in the smoother's first pass, which knows no friction
PASSES: Final = 5  # of the smoother, until friction is known
SMOOTHER_WALK: Final = 0.625  # in the smoother once friction is known
PROBE: Final = 2e-3  # of a sample: by which the dead time is changed for a derivative
INSIDE: Final = 0.998  # of its limit, within which an element is when slopes by its start are taken


@dataclass(frozen=True)
class Candidate:
    """A model of the machine: theta (P,) of the nominal parameters, effects in the catalogue's order, random forces,
    and the white force that it leaves open, by record, over the usual one of the machine file [1]; () if usual."""

    layout: Parameters
    theta: Array
    effects: tuple[Effect, ...] = ()
    random_forces: tuple[Resonance, ...] = ()
    roughness: tuple[float, ...] = ()

    @cached_property
    def machine(self) -> Machine:
        """The nominal machine with theta put in."""
        return applied(self.layout, self.theta)

    @property
    def nominal(self) -> Machine:
        """The nominal machine as it is, without theta."""
        return self.layout.machine

    @property
    def added_effects(self) -> list[Effect]:
        """The effects that the machine file has not."""
        return beyond(self.nominal.effects, self.effects)

    @property
    def rough(self) -> bool:
        """Whether its white force is larger than a good table's, in any record."""
        return max(self.roughness, default=1.0) > 1.0

    @property
    def white_force(self) -> float:
        """The deviation [N] of the white force, of the roughest record."""
        return self.usual_white_force * max(self.roughness, default=1.0)

    @property
    def usual_white_force(self) -> float:
        """The deviation [N] of the white force of a drive that is as smooth as its model."""
        return white_force(self.nominal)

    def roughness_of(self, record: int) -> float:
        """The white force of a record, over the usual one [1]."""
        return self.roughness[record] if self.roughness else 1.0

    def predictor(self, sample_time: float, walk: float, record: int = 0) -> Predictor:
        """Of its machine in the record of this index, for an unknown force that walks by `walk` usual white forces [1]
        a sample of `sample_time` [s]."""
        machine, usual = self.machine, self.usual_white_force
        return predictor(
            machine.plant,
            sample_time,
            walk=walk * usual,
            noise=noise(machine),
            white_force=usual * self.roughness_of(record),
            random_forces=self.random_forces,
            starting_walk=SMOOTHER_WALK * usual,
        )


@dataclass(frozen=True)
class SmoothedPath:
    """A record seen through a candidate: the path, and what the reading's effects added to it (n,) [m]."""

    path: Path
    added: Array
    model: Predictor  # the smoother's
    count: int  # states of the plant's modes


@dataclass(frozen=True)
class Residual:
    """A record as a candidate explains it: whitened innovations (n,), net force (n, M) [N], what acts along the path,
    that path, and the innovations' deviation over that of the reading's noise [1], by which they were divided."""

    innovations: Array
    force: Array
    acts: Replayed
    path: Path
    deviation: float


def unweighted_predictor(candidate: Candidate, sample_time: float, walk: float) -> Predictor:
    """The predictor that shows a force as large as it is: rough drives are weighed by a white force that would hide a
    part of it; walk [usual white forces a sample], sample_time [s]."""
    return replace(candidate, roughness=()).predictor(sample_time, walk)


def _walks(machine: Machine) -> tuple[float, ...]:
    """Of the smoother, pass by pass, from no knowledge of friction [usual white forces a sample]."""
    first = FIRST_WALK_FRICTION_SHARE * friction_force(machine) / white_force(machine)
    return tuple(np.geomspace(max(first, SMOOTHER_WALK), SMOOTHER_WALK, PASSES).tolist())


def initial_command(record: Record) -> float:
    """The command [N] before the first sample: what the feedback held, without a feedforward that sets in there."""
    return float(record.command[0] - record.feedforward[0])


def smooth(
    candidate: Candidate, records: Sequence[Record], before: Sequence[SmoothedPath] | None = None
) -> tuple[SmoothedPath, ...]:
    """Every record's path as the candidate's smoother sees it; `before`: what an earlier candidate saw."""
    machine = candidate.machine

    def path(i: int, record: Record, smoothed_path: SmoothedPath | None) -> SmoothedPath:
        for walk in (SMOOTHER_WALK,) if before else _walks(candidate.nominal):
            smoothed_path = _pass(
                candidate, machine, candidate.predictor(record.sample_time, walk, i), record, i, smoothed_path
            )
        assert smoothed_path is not None
        return smoothed_path

    return tuple(parallel_map(path, range(len(records)), records, before or [None] * len(records)))


def _pass(
    candidate: Candidate, machine: Machine, model: Predictor, record: Record, index: int, before: SmoothedPath | None
) -> SmoothedPath:
    """One run of the smoother with the friction of the path that the one before found, or none."""
    reading = record.position
    if before is None:
        still = Path(
            record.sample_time, np.repeat(reading[:, None], SUBSTEPS, 1), np.zeros((reading.size, SUBSTEPS)),
            reading, record.command,
        )  # fmt: skip
        acts = replay(
            machine.friction,
            (),
            still,
            machine.plant.dead_time,
            thrust_limit=machine.drive.rated_thrust,
            start=initial_command(record),
        )
        force, added = acts.thrust, np.zeros(reading.size)
    else:
        acts = _acts(candidate, machine, record, index, before.path)
        force, added = _net(machine, acts), acts.reading
        reading = reading - beside_plant(candidate, force, acts, record.sample_time)
    start = at_rest(model, reading)
    start[2 * len(machine.plant.modes)] = -force[0, 0]
    states = smoothed(model, force, reading, start)
    return SmoothedPath(
        path_through(states, 2 * len(machine.plant.modes), record, record.position - added - reading),
        added,
        model,
        2 * len(machine.plant.modes),
    )


def evaluate(
    candidate: Candidate, records: Sequence[Record], paths: Sequence[SmoothedPath], walk: float = WALK
) -> tuple[Residual, ...]:
    """What the candidate leaves of every record, its friction and effects evaluated along `paths`;
    walk: of the unknown force [usual white forces a sample]."""
    machine = candidate.machine
    models = [candidate.predictor(record.sample_time, walk, i) for i, record in enumerate(records)]
    each = partial(evaluate_record, candidate, machine)
    return tuple(parallel_map(each, models, records, range(len(records)), paths))


def evaluate_record(
    candidate: Candidate, machine: Machine, model: Predictor, record: Record, index: int, smooth_path: SmoothedPath
) -> Residual:
    """`evaluate` at the record of this index, by a predictor of the machine with theta put in."""
    path = smooth_path.path
    acts = _acts(candidate, machine, record, index, path)
    differs = acts.reading - smooth_path.added
    if np.any(differs != 0):  # the path was smoothed from a reading that had other errors
        path = shifted(smooth_path, differs)
        acts = _acts(candidate, machine, record, index, path)
    force = _net(machine, acts)
    reading = record.position - beside_plant(candidate, force, acts, record.sample_time)
    e = beside_start(model, innovations(model, force, reading, at_rest(model, reading)) / model.deviation)
    return Residual(e, force, acts, path, model.deviation / noise(machine))


def shifted(smoothed_path: SmoothedPath, differs: Array) -> Path:
    """The path, had the reading's error been larger by `differs` (n,) [m]: the smoother is linear."""
    model, path = smoothed_path.model, smoothed_path.path
    states = smoothed(model, np.zeros_like(path.position), -differs, np.zeros(model.C.size))
    still = Record(path.sample_time, *(np.zeros(differs.size) for _ in range(5)))
    moved = path_through(states, smoothed_path.count, still, np.zeros(differs.size))
    return path._replace(
        position=path.position + moved.position,
        speed=path.speed + moved.speed,
        at_samples=path.at_samples + moved.at_samples,
    )


def _acts(
    candidate: Candidate,
    machine: Machine,
    record: Record,
    index: int,
    path: Path,
    known: Mapping[str, Array] = MappingProxyType({}),
) -> Replayed:
    """What acts along a path; known: see `replay`."""
    return replay(
        machine.friction,
        candidate.effects,
        path,
        machine.plant.dead_time,
        state=initial_state(candidate.layout, candidate.theta, index),
        thrust_limit=machine.drive.rated_thrust,
        start=initial_command(record),
        known=known,
    )


def _net(machine: Machine, acts: Replayed) -> Array:
    return acts.thrust - acts.friction + acts.force - machine.drive.offset


def beside_plant(candidate: Candidate, force: Array, acts: Replayed, sample_time: float) -> Array:
    """What the effects add to the plant's motion in the reading (n,) [m]: what they change in it, and the motion of
    their vibration modes, under the net force (n, M) [N] or the friction."""
    added, modes = np.array(acts.reading), [(effect, mode) for effect in candidate.effects for mode in effect.modes()]
    if modes:
        constant = candidate.machine.plant.thrust_constant
        for effect, mode in modes:
            added += modal(mode, constant * driving(effect, force, acts), sample_time)
    return added


def driving(effect: Effect, force: Array, acts: Replayed) -> Array:
    """What drives an effect's modes (n, M) [N]: the net force or, from the equilibrium of its first value, the
    friction."""
    return acts.friction[0, 0] - acts.friction if effect.friction_drives else force


def modal(mode: Mode, force: Array, sample_time: float) -> Array:
    """Motion (n,) [m] of one vibration mode at the samples under a force (n, M) [N], K_t times the thrust reference's,
    from rest."""
    a, b = _of_mode(mode, sample_time)
    given = force @ b.T
    trace, determinant = a[0, 0] + a[1, 1], np.linalg.det(a)
    entering = np.concatenate([[0.0], given[:-1, 0]])
    entering[2:] += a[0, 1] * given[:-2, 1] - a[1, 1] * given[:-2, 0]
    return np.asarray(scipy.signal.lfilter([1.0], [1.0, -trace, determinant], entering))


@lru_cache(maxsize=64)
def _of_mode(mode: Mode, sample_time: float) -> tuple[Array, Array]:
    """How a mode's states (2,) follow from a sample to the next and under the force of its substeps; SI."""
    a, b, _ = discretised(Plant(0.0, 1.0, (mode,)), sample_time)
    return a[:2, :2], b[:2]


def nominal_slopes(
    candidate: Candidate, records: Sequence[Record], residuals: Sequence[Residual], walk: float = WALK
) -> Array:
    """How the whitened innovations of all records, one after another (n,), change with theta: (n, P) [1]."""
    machine, layout = candidate.machine, candidate.layout

    ends = np.cumsum([record.position.size for record in records])
    whole = np.zeros((layout.count, ends[-1])).T  # a column's samples next to each other

    def fill(i: int, record: Record, one: Residual, slopes: Array) -> None:
        model = candidate.predictor(record.sample_time, walk, i)
        _plant_slopes(candidate, record, one, model, slopes)
        _force_slopes(candidate, machine, record, i, one, model, slopes)

    list(parallel_map(fill, range(len(records)), records, residuals, np.split(whole, ends[:-1])))
    return np.asarray(whole)


def _plant_slopes(candidate: Candidate, record: Record, residual: Residual, model: Predictor, slopes: Array) -> None:
    """By differences of the predictor; its gain stays, as any gain is a fair filter."""
    layout, step = candidate.layout, 1e-4
    reading = record.position - beside_plant(candidate, residual.force, residual.acts, record.sample_time)
    start = at_rest(model, reading)
    names = ("payload_mass", "thrust_constant", "mode_gain", "mode_frequency", "mode_damping")
    for j in np.concatenate([layout.of(name) for name in names]):
        theta = candidate.theta.copy()
        theta[j] += step
        a, b = model.A.copy(), model.B.copy()
        size = 2 * len(layout.machine.plant.modes) + 1
        a[:size, :size], b[:size], _ = discretised(applied(layout, theta).plant, record.sample_time)
        moved = innovations(replace(model, A=a, B=b), residual.force, reading, start) / model.deviation
        slopes[:, j] = (beside_start(model, moved) - residual.innovations) / step


def _force_slopes(
    candidate: Candidate,
    machine: Machine,
    record: Record,
    index: int,
    residual: Residual,
    model: Predictor,
    slopes: Array,
) -> None:
    """Of what acts as a force; that of the friction is the elements' own, without effects on it: a fair slope."""
    layout, n = candidate.layout, record.position.size
    limit, z0 = np.array(machine.friction.limit), initial_state(layout, candidate.theta, index)
    later = PROBE * record.sample_time
    late = replay(
        machine.friction, candidate.effects, residual.path, machine.plant.dead_time + later, state=z0,
        thrust_limit=machine.drive.rated_thrust, start=initial_command(record),
        known=kept(residual.acts, coupled({"thrust"}, candidate.effects)),
    )  # fmt: skip
    starts = layout.of("initial_friction_state").reshape(layout.records, -1)[index]
    names = ("dead_time", "amplifier_offset", "friction_level", "presliding_stiffness", "presliding_limit")
    order = np.concatenate([*(layout.of(name) for name in names), starts])
    force = np.empty((order.size, n, SUBSTEPS))
    force[0] = (late.thrust - residual.acts.thrust) / later
    force[1], force[2] = -1.0, -residual.acts.friction
    elements = np.stack([-np.array(machine.friction.stiffness), limit, z0])
    _element_slopes(residual.path.position.ravel(), elements, force[3:].reshape(3, limit.size, n * SUBSTEPS))
    slopes[:, order] = changes(model, force)
    damping = layout.of("contact_damping")
    if damping.size:
        slopes[:, damping] = changes(model, _by_damping(candidate, machine, record, index, residual)[None])
    stronger = layout.of("thrust_constant")  # of the plant so far; it makes friction and the file's offset smaller
    for name, size in (("friction_level", 1.0), ("amplifier_offset", layout.machine.drive.offset)):
        slopes[:, stronger] -= size * slopes[:, layout.of(name)]


def _by_damping(candidate: Candidate, machine: Machine, record: Record, index: int, residual: Residual) -> Array:
    """How the net force changes with the contacts' damping over their stiffness (n, M) [N/s]."""
    step = PROBE * record.sample_time
    more = replace(machine, friction=varied_friction(machine.friction, Variation(contact_damping=step)))
    known = kept(residual.acts, coupled({"friction"}, candidate.effects))
    return np.asarray((_net(more, _acts(candidate, more, record, index, residual.path, known)) - residual.force) / step)


@compiled
def _element_slopes(points: Array, elements: Array, slopes: Array) -> None:
    """Of each element's force: by the logarithm of its stiffness, of its limit, and by its start; (3, N, points).

    elements (3, N): factor of the displacement [N/m], limit [m], displacement at the first point [m]. One at its limit
    is taken a little from it: it can leave it, though the slope there is zero where the table moves on.
    """
    for i in range(elements.shape[1]):
        factor, limit = elements[0, i], elements[1, i]
        z = min(max(elements[2, i], -INSIDE * limit), INSIDE * limit)
        by_limit, by_start = 0.0, 1.0
        for k in range(points.size):
            if k > 0:
                z += points[k] - points[k - 1]
            if abs(z) > limit:
                z = limit if z > 0.0 else -limit
                by_limit, by_start = z, 0.0
            slopes[0, i, k] = factor * z
            slopes[1, i, k] = factor * by_limit
            slopes[2, i, k] = factor * by_start


def columns(
    candidate: Candidate,
    trials: Sequence[Sequence[Effect]],
    records: Sequence[Record],
    paths: Sequence[SmoothedPath],
    residuals: Sequence[Residual],
    walk: float = WALK,
) -> Array:
    """By how much the whitened innovations of all records, one after another, differ with each of the `trials` in place
    of the candidate's effects, to first order: (n, trials) [1]."""
    machine = candidate.machine

    def part(i: int, record: Record, path: SmoothedPath, one: Residual) -> Array:
        force, reading = np.empty((len(trials), *one.force.shape)), np.empty((len(trials), record.position.size))
        before = beside_plant(candidate, one.force, one.acts, record.sample_time)
        for j, trial in enumerate(trials):
            other = replace(candidate, effects=tuple(trial))
            force[j], reading[j] = _with_others(other, candidate, machine, record, i, path, one)
        force -= one.force
        reading -= before
        model = candidate.predictor(record.sample_time, walk, i)
        return changes(model, force, -reading if np.any(reading) else None)

    return np.concatenate(list(parallel_map(part, range(len(records)), records, paths, residuals)))


def _with_others(
    other: Candidate,
    candidate: Candidate,
    machine: Machine,
    record: Record,
    index: int,
    path: SmoothedPath,
    residual: Residual,
) -> tuple[Array, Array]:
    """The net force (n, M) [N] with the effects of another candidate of equal theta, and what these add to the plant's
    motion in the reading (n,) [m]."""
    same = kept(residual.acts, changed(candidate.effects, other.effects))
    acts = _acts(other, machine, record, index, residual.path, same)
    if np.any(acts.reading != residual.acts.reading):
        acts = _acts(other, machine, record, index, shifted(path, acts.reading - path.added))
    force = _net(machine, acts)
    return force, beside_plant(other, force, acts, record.sample_time)
