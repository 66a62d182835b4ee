"""What a model leaves of records: in newtons, micrometres and milliseconds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.model.kalman import STARTING
from diagnosis.model.parallel import parallel_map
from diagnosis.model.residual import Candidate, SmoothedPath, beside_plant, evaluate
from diagnosis.model.unknown_force import unknown_force
from diagnosis.null import simulated
from diagnosis.records.motions import rms
from diagnosis.which.detectors.random_force import with_sines
from models.machine import Machine
from models.records.record import Record, motions
from models.records.settling import settling_time
from models.simulation.effect_kernel import touched

Array = NDArray[np.float64]

EXACT: Final = 1e-15  # m of noise, far below any reading's; a scale without noise would be given some


@dataclass(frozen=True)
class Gap:
    """What a model leaves: unknown force (its deviation) [N], position in the closed loop [m], settling [s]."""

    force: float
    position: float
    settling: float | None

    def to_json(self) -> dict[str, Any]:
        """As results.json has it."""
        return {"force_N": self.force, "position_m": self.position, "settling_s": self.settling}


@dataclass(frozen=True)
class Errors:
    """What a model leaves of records, by record: the unknown force (n,) [N] and by how much the position in the closed
    loop is another (n,) [m], both NaN before the state has settled; settling: rows (first sample, difference [s])."""

    force: tuple[Array, ...]
    position: tuple[Array, ...]
    settling: tuple[Array, ...]

    def gap(self) -> Gap:
        """Their root mean squares, and the mean difference of the settling times."""
        differences = np.concatenate([rows[:, 1] for rows in self.settling])
        return Gap(rms(self.force), rms(self.position), float(np.mean(differences)) if differences.size else None)


@dataclass(frozen=True)
class EffectMagnitude:
    """How much an effect does along the records, in root mean square: to the force on the axis [N], and to the position
    that is read [m]; None where it acts on the other alone."""

    force: float | None
    position: float | None

    def to_json(self) -> dict[str, Any]:
        """As results.json has it."""
        return {"force_N": self.force, "position_m": self.position}


def effect_magnitude(
    name: str, candidate: Candidate, records: Sequence[Record], paths: Sequence[SmoothedPath]
) -> EffectMagnitude | None:
    """What the members of this name do to a model along `paths`, those of the machine file included; None where the
    model has none. So effects whose amplitudes are shares of something else are compared in newtons."""
    members = [effect for effect in candidate.effects if effect.name == name]
    if not members:
        return None
    without = replace(candidate, effects=tuple(effect for effect in candidate.effects if effect.name != name))
    reach = frozenset[str]().union(*map(touched, members))
    (with_it, with_it_read), (rest, rest_read) = (_seen(one, records, paths) for one in (candidate, without))
    force = rms([np.ravel(one - other) for one, other in zip(with_it, rest, strict=True)])
    position = rms([one - other for one, other in zip(with_it_read, rest_read, strict=True)])
    reads = "reading" in reach or any(effect.modes() for effect in members)
    return EffectMagnitude(force if reach - {"reading"} else None, position if reads else None)


def _seen(
    candidate: Candidate, records: Sequence[Record], paths: Sequence[SmoothedPath]
) -> tuple[list[Array], list[Array]]:
    """By record the net force (n, M) [N], and what is read beside the path (n,) [m]."""
    made = evaluate(candidate, records, paths)
    moved = [
        beside_plant(candidate, one.force, one.acts, record.sample_time)
        for one, record in zip(made, records, strict=True)
    ]
    return [one.force for one in made], moved


def force_share(before: float, after: float) -> float:
    """The part [1] of the energy of the unknown force that is taken off, by its deviations [N]."""
    return 1 - (after / before) ** 2 if before > 0 else 0.0


def errors_of(
    candidate: Candidate,
    records: Sequence[Record],
    paths: Sequence[SmoothedPath],
    driving: Sequence[Record] | None = None,
) -> Errors:
    """What a candidate leaves of the records, a constant force included; driving: the records that drive its closed
    loop, where that is more than they map (`baseline.Baseline.driving`)."""
    machine = candidate.machine

    def left(i: int, record: Record, drives: Record) -> tuple[Array, Array]:
        made = simulated(quiet(candidate), drives, i, 0)
        apart = made.position - record.position
        apart[:STARTING] = np.nan
        return apart, settling_differences(record, made, machine)

    apart, settling = zip(*parallel_map(left, range(len(records)), records, driving or records), strict=True)
    return Errors(unknown_force(candidate, records, paths), apart, settling)


def quiet(candidate: Candidate, noise: float = EXACT) -> Candidate:
    """The candidate with a drive that is as smooth as its model and a scale that reads exactly, or with noise [m]."""
    machine = candidate.nominal
    still = replace(machine, scale=replace(machine.scale, noise=noise, resolution=0.0))
    return with_sines(replace(candidate, layout=replace(candidate.layout, machine=still), roughness=()))


def settling_differences(record: Record, made: Record, machine: Machine) -> Array:
    """Rows (first sample, by how much its settling differs between record and simulation [s]), one a motion; none for a
    record whose target does not go in steps."""
    wanted, found = machine.specification, list[tuple[float, float]]()
    steps = np.count_nonzero(np.diff(record.target))
    if not 0 < steps < record.target.size / 20:
        return np.zeros((0, 2))
    for motion in motions(record.target, float(record.reference[0])):
        part = slice(motion.start, motion.stop)
        times = [
            settling_time(one.position[part] - motion.target, wanted.tolerance, record.sample_time)
            for one in (record, made)
        ]
        longest = (motion.stop - motion.start) * record.sample_time
        found.append((float(motion.start), abs(min(times[0], longest) - min(times[1], longest))))
    return np.array(found)
