"""How far the gap shrinks: what each stage of the search leaves, in newtons, micrometres and milliseconds, and closure.

The closure C = (G_refit^2 - G_effect^2) / (G_refit^2 - G_floor^2) compares the innovations of the re-fitted nominal
machine with those of the model with the effects, on motions on which the effects' parameters were not fitted. The floor
is what the same method leaves of a record that this very model made, simulated: quantisation, noise and what the method
itself neglects are in it. Where a drive is rougher than its model and motions repeat, the floor is what does not, and
all three are of those motions only. They are weighted over frequency by the share of the gap in what the re-fit leaves
(N. Wiener's filter): the floor's noise is another in the simulation, and elsewhere would only blur the difference.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from diagnosis.model.fit import Fit, effects_prior_std, unrepeated, weights
from diagnosis.model.kalman import smoothed
from diagnosis.model.motions import Piece, repeated, rms, scatter
from diagnosis.model.parallel import parallel_map
from diagnosis.model.residual import STARTING, Candidate, Seen, Smoothed, look, noise, seeing, smooth
from diagnosis.null import simulated
from diagnosis.which.scan import FOLDS, Freed
from models.effects.base import Effect
from models.effects.catalogue import in_order
from models.effects.structure import FloorVibration
from models.machine import Machine
from models.records.record import Record, motions
from models.records.settling import settling_time

Array = NDArray[np.float64]

SEEN_BY: Final = 0.05  # [N a sample] of the walk with which the unknown force is told in newtons
BOOTSTRAP: Final = 1000
BANDS: Final = 40  # of frequency, equally wide on a logarithmic scale
LEAST_SHARE: Final = 1e-3  # that a band counts at least


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
class HowFar:
    """The gaps by stage, in order, each with what was added; the floor and where it is from: "simulated" or "repeats";
    the closure and its 95 % interval [1]."""

    stages: tuple[tuple[str, Gap], ...]
    floor: Gap
    source: str
    closure: float
    interval: tuple[float, float]

    def to_json(self) -> dict[str, Any]:
        """As interfaces fix it, and the stages between."""
        named = dict(self.stages)
        last = self.stages[-1][1]
        return {
            "gap_as_delivered": named["as delivered"].to_json(),
            "gap_refitted": named["re-fitted"].to_json(),
            "gap_after": last.to_json(),
            "floor": self.floor.to_json(),
            "floor_source": self.source,
            "closure": self.closure,
            "closure_interval": list(self.interval),
            "held_out": True,
            "stages": [{"added": name, **gap.to_json()} for name, gap in self.stages],
        }


@dataclass(frozen=True)
class Late:
    """Innovations (n,) [m] of a record with commands that are late now and then, and the part [1] of what these add
    that the true ones add: so few are late that a simulation needs more of them for a mean."""

    innovations: Array
    part: float

    def energy(self, floor: Array) -> float:
        """What the late commands add to the sum of squares of the floor (n,) [m^2]."""
        return self.part * float(self.innovations @ self.innovations - floor @ floor)


@dataclass(frozen=True)
class Least:
    """The floor: its innovations (n,) [m] by draw, no number where it is not known; what late commands add; `spread`,
    the variance of what a complete model leaves over the floor, in that of one mean square of white noise; where it is
    from ("simulated" or "repeats"); its gap, which is asked for once an answer stands."""

    innovations: tuple[Array, ...]
    late: tuple[Late, ...]
    spread: float
    source: str
    gap: Callable[[], Gap]


@dataclass(frozen=True)
class Closed:
    """The closure on motions left out, its 95 % interval [1], by how much what is left exceeds the floor, in deviations
    of their noise [1], and that floor."""

    closure: float
    interval: tuple[float, float]
    excess: float
    floor: Least


def with_sines(candidate: Candidate) -> Candidate:
    """The candidate with a sine of equal power in the place of each random force, as a simulation can have it."""
    sines = [FloorVibration(2**0.5 * one.level, one.frequency, 0.0) for one in candidate.shaken]
    return replace(candidate, effects=in_order((*candidate.effects, *sines)), shaken=())


def mirrored(
    candidate: Candidate, records: Sequence[Record], seed: int, extra: Sequence[Effect] = ()
) -> tuple[Record, ...]:
    """Records that the candidate makes of the same references, with noise; `extra` effects besides."""
    whole = with_sines(candidate)
    whole = replace(whole, effects=in_order((*whole.effects, *extra)))
    return tuple(parallel_map(lambda i, record: simulated(whole, record, i, seed + i), range(len(records)), records))


def left_of(candidate: Candidate, records: Sequence[Record], walk: float, *, passes: int = 2) -> Array:
    """Innovations (n,) [m] of all records, one after another, seen through the candidate itself."""
    paths: tuple[Smoothed, ...] | None = None
    for _ in range(passes):
        paths = smooth(candidate, records, paths)
    assert paths is not None
    return signal(look(candidate, records, paths, walk), candidate.machine) * weights(records)


def signal(seen: Sequence[Seen], machine: Machine) -> Array:
    """Innovations (n,) [m] of all records."""
    return np.concatenate([one.innovations * one.deviation * noise(machine) for one in seen])


def held_out(fitted: Fit, own: Freed) -> Array:
    """Innovations (n,), whitened [1], each with the effects' coordinates fitted without the motions of its own fold."""
    if fitted.own.shape[1] == 0:
        return fitted.innovations
    layout = fitted.candidate.layout
    basis = fitted.slopes * layout.deviation
    factor = cho_factor(basis.T @ basis + np.eye(basis.shape[1]))
    given = fitted.own * effects_prior_std(fitted.candidate)
    given = given - basis @ cho_solve(factor, basis.T @ given)
    e = fitted.innovations.copy()
    fold = own.fold[own.segment]
    for number in range(FOLDS):
        train = fold != number
        gram = given[train].T @ given[train] + np.eye(given.shape[1])
        step = -np.linalg.solve(gram, given[train].T @ fitted.innovations[train])
        e[~train] += given[~train] @ step
    return e


def closure(
    before: Array, after: Array, floors: Sequence[Array], segment: NDArray[np.int64], late: Sequence[Late] = ()
) -> tuple[float, tuple[float, float]]:
    """The closure and its 95 % interval by a bootstrap over motions; innovations (n,) [m], each sample's motion.

    late: what commands that are late at random add to the floors; that is explained, though no model takes it off.
    """
    count, share = int(segment.max()) + 1, gap_share(before, floors)
    energies = [weighted(one, share) ** 2 for one in (before, after)]
    energies.append(np.mean([weighted(floor, share) ** 2 for floor in floors], axis=0))
    if late:
        more = np.mean([one.part * weighted(one.innovations, share) ** 2 for one in late], axis=0)
        energies[1] = energies[1] - more + late[0].part * energies[2]
    sums = np.stack([np.bincount(segment, energy, count) for energy in energies])
    draws = np.random.default_rng(0).integers(0, count, (BOOTSTRAP, count))
    drawn = sums[:, draws].sum(axis=2)
    low, high = np.quantile(_closed(drawn), [0.025, 0.975])
    return float(_closed(sums.sum(axis=1))), (float(low), float(high))


def gap_share(before: Array, floors: Sequence[Array]) -> Array:
    """The share (n // 2 + 1,) [1] of what the re-fit leaves (n,) [m] that the floors have not, by frequency."""
    power = np.abs(np.fft.rfft(before)) ** 2
    least = np.mean([np.abs(np.fft.rfft(floor)) ** 2 for floor in floors], axis=0)
    edges = np.unique(np.geomspace(1, power.size, BANDS + 1).astype(int))
    band = np.clip(np.searchsorted(edges, np.arange(power.size), side="right") - 1, 0, None)
    gap, all_of_it = (np.bincount(band, one) for one in (power - least, power))
    return np.clip(gap / np.maximum(all_of_it, 1e-300), LEAST_SHARE, 1.0)[band]


def weighted(innovations: Array, share: Array) -> Array:
    """Innovations (n,) [m] with each frequency's energy times its share (n // 2 + 1,) [1]."""
    return np.asarray(np.fft.irfft(np.fft.rfft(innovations) * np.sqrt(share), innovations.size))


def _closed(sums: Array) -> Array:
    gap = np.maximum(sums[0] - sums[2], 1e-30)
    return np.asarray(np.clip((sums[0] - sums[1]) / gap, -1.0, 1.0))


def gap(candidate: Candidate, records: Sequence[Record], paths: Sequence[Smoothed]) -> Gap:
    """What a candidate leaves of the records."""
    force, apart, late = _left(candidate, records, paths)
    differs = [time for times in late for time in times]
    return Gap(rms(force), rms(apart), float(np.mean(differs)) if differs else None)


def _left(
    candidate: Candidate, records: Sequence[Record], paths: Sequence[Smoothed]
) -> tuple[tuple[Array, ...], tuple[Array, ...], tuple[list[float], ...]]:
    """By record: the unknown force (n,) [N], by how much the position in the closed loop is another (n,) [m], and the
    same of each motion's settling [s]; no number before the state has settled."""
    machine = candidate.machine
    model = seeing(candidate, records[0].sample_time, SEEN_BY)

    def left(i: int, record: Record, seen: Seen) -> tuple[Array, Array, list[float]]:
        start = np.zeros(model.C.size)
        start[0] = record.position[0]
        states = smoothed(model, seen.force, record.position - seen.acts.reading, start)
        unknown = states[:, 2 * len(machine.plant.modes)]
        made = simulated(quiet(candidate), record, i, 0)
        apart = made.position - record.position
        unknown[:STARTING] = apart[:STARTING] = np.nan
        # a constant force is an offset of the amplifier, and costs nothing
        return unknown - np.nanmean(unknown), apart, _late(record, made, machine)

    force, apart, late = zip(
        *parallel_map(left, range(len(records)), records, look(candidate, records, paths)), strict=True
    )
    return force, apart, late


def measured(fitted: Fit, records: Sequence[Record], pieces: Sequence[Piece]) -> Least:
    """The floor from what does not repeat between equal motions. An effect that does not repeat is floor here."""
    groups = repeated(pieces, records)

    def scattered() -> Gap:
        force, apart, _ = _left(fitted.candidate, records, fitted.paths)
        return Gap(rms(scatter(groups, pieces, force)), rms(scatter(groups, pieces, apart)), None)

    size = fitted.seen[0].deviation * noise(fitted.candidate.machine)
    spread = len(groups) / (sum(map(len, groups)) - len(groups))
    return Least((unrepeated(fitted, records, pieces) * size,), (), spread, "repeats", scattered)


def quiet(candidate: Candidate) -> Candidate:
    """The candidate with a scale that reads exactly."""
    machine = candidate.layout.machine
    still = replace(machine, scale=replace(machine.scale, noise=1e-15, resolution=0.0))
    return with_sines(replace(candidate, layout=replace(candidate.layout, machine=still)))


def _late(record: Record, made: Record, machine: Machine) -> list[float]:
    """How much the settling of each motion differs between record and simulation [s]."""
    wanted, found = machine.specification, []
    steps = np.count_nonzero(np.diff(record.target))
    if not 0 < steps < record.target.size / 20:
        return []
    for motion in motions(record.target, float(record.reference[0])):
        part = slice(motion.start, motion.stop)
        times = [
            settling_time(one.position[part] - motion.target, wanted.tolerance, record.sample_time)
            for one in (record, made)
        ]
        longest = (motion.stop - motion.start) * record.sample_time
        found.append(abs(min(times[0], longest) - min(times[1], longest)))
    return found
