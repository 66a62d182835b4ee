"""Where the machine leaves its model: the force that the fitted model lacks, and on what it depends.

The controller's replay comes first, because a record that another controller made is another experiment. Then the
unknown force with its band, the floor, where its energy lies, on which coordinate it depends, whether a force or the
scale does it, whether it is a mean or only a variance. Nothing here knows the catalogue of effects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.model.fit import SPIKE, Fit, Largest, largest, weights
from diagnosis.model.motions import Piece, numbered
from diagnosis.model.residual import noise
from diagnosis.refit import FOLLOWED, RATED
from diagnosis.where.controller import Replayed, replayed
from diagnosis.where.coordinates import (
    SURE,
    Coordinate,
    Explained,
    centred,
    coordinates,
    explain,
    explain_pitch,
    parity,
    together,
)
from diagnosis.where.energy import PHASES, Samples, Shares, by_band, by_wave, labelled, shares
from diagnosis.where.force import FAST, SLOW, Floor, Force, answer, floor, likeliest, unknown, unseen
from diagnosis.where.side import Side, sides
from diagnosis.which.scan import freed
from models.records.record import Record

Array = NDArray[np.float64]

ABOVE_NOISE: Final = 1.2  # times the deviation that noise alone gives, from which on there is a force to locate
FEW: Final = 200  # samples of motion below which nothing is said of the scatter


@dataclass(frozen=True)
class Where:
    """The answer to where; forces in newtons of thrust reference.

    controller: of each record. slow, fast: the unknown force at two settings; likely: at the likeliest, which all
    shares are of. unseen [N]: the deviation that it has where nothing is unknown. motions_by_phase: shares, named
    "kind | phase". together: the share that curves over all coordinates explain, with its interval: the ceiling for
    any effect that they can describe. parity: how much is an even and an odd function of speed. scatter: on what the
    innovations' size depends. samples, coordinates: what is known of every sample, for figures. followed [N]: the
    largest command, where the drive followed beyond its rating. spike: the largest innovation, where no noise makes
    one of its size.
    """

    controller: tuple[Replayed, ...]
    floor: Floor
    slow: Force
    fast: Force
    likely: Force
    unseen: float
    by_motion: Shares
    by_phase: Shares
    motions_by_phase: Shares
    by_band: Shares
    by_wave: Shares
    by_coordinate: tuple[Explained, ...]
    together: tuple[float, float, float]
    parity: tuple[Explained, Explained]
    scatter: tuple[Explained, ...]
    sides: tuple[Side, ...]
    sample_time: float
    samples: Samples
    coordinates: tuple[Coordinate, ...]
    spike: Largest | None = None
    followed: float | None = None

    @property
    def force(self) -> Array:
        """The likely unknown force (n,) [N] of all records, one after another, its mean over what counts taken off."""
        return centred(np.concatenate(self.likely.values), self.samples)

    @property
    def deviation(self) -> float:
        """Its deviation [N]."""
        return float(np.sqrt(np.mean(self.force[self.samples.counts] ** 2)))

    @property
    def is_noise(self) -> bool:
        """Whether the force is no more than the scale's noise makes of it."""
        return self.deviation < ABOVE_NOISE * self.unseen

    @property
    def coordinate(self) -> Explained:
        """The coordinate that explains the most; those that chance could explain as well come last."""
        return max(self.by_coordinate, key=lambda one: (one.p < SURE, one.share))


def where(
    fitted: Fit, records: Sequence[Record], pieces: Sequence[Piece], *, seed: int = 0, spike: float = SPIKE
) -> Where:
    """Where the fitted model leaves the records; pieces: those of `motions.pieces`; spike [1]: see `Null.spike`."""
    machine, ts = fitted.candidate.machine, records[0].sample_time
    nominal = fitted.candidate.layout.machine
    motion = numbered(pieces, records)
    samples = labelled(records, pieces, motion, weights(records), machine.specification.settling_time)
    slow, fast = unknown(fitted, records, SLOW), unknown(fitted, records, FAST)
    likely = unknown(fitted, records, likeliest(fitted, records))
    least = unseen(fitted.candidate, ts, likely)
    d, known = centred(np.concatenate(likely.values), samples), coordinates(fitted, records, samples)
    place = np.concatenate([path.path.at_samples for path in fitted.paths])
    kinds = [str(kind) for kind in samples.kinds]
    both = samples.kind * len(PHASES) + samples.phase
    explained = _explained(d, known, samples, seed)
    speed = Coordinate("velocity", "m/s", np.concatenate([path.path.speed[:, 0] for path in fitted.paths]), bent=True)
    most = largest(fitted)
    return Where(
        controller=tuple(replayed(nominal, record) for record in records),
        floor=floor(fitted, records, pieces, likely),
        slow=slow,
        fast=fast,
        likely=likely,
        unseen=least,
        by_motion=shares(d**2, least**2, samples.kind, kinds, samples, seed),
        by_phase=shares(d**2, least**2, samples.phase, PHASES, samples, seed),
        motions_by_phase=shares(
            d**2, least**2, both, [f"{kind} | {phase}" for kind in kinds for phase in PHASES], samples, seed
        ),
        by_band=by_band(fast.values, answer(fitted.candidate, ts, FAST)[0], noise(machine), ts, samples, seed),
        by_wave=by_wave(d, place, least, samples, seed),
        by_coordinate=explained,
        together=together(d, known, samples, seed),
        parity=parity(d, speed, samples, seed),
        scatter=_scatter(fitted, records, known, samples, seed),
        sides=_sides(fitted, records, motion, known, explained, samples, seed),
        sample_time=ts,
        samples=samples,
        coordinates=known,
        spike=most if most.deviations > spike else None,
        followed=nominal.drive.rated_thrust if nominal.sources.get(RATED) == FOLLOWED else None,
    )


def _explained(d: Array, known: Sequence[Coordinate], samples: Samples, seed: int) -> tuple[Explained, ...]:
    """What each coordinate explains of the force (n,) [N], and the place modulo a pitch."""
    found = [explain(d, one, samples, seed) for one in known]
    for one in known:
        if one.name == "position":
            pitch = explain_pitch(d, one, samples, seed)
            found += [pitch] if pitch else []
    return tuple(sorted(found, key=lambda one: -one.share))


def _scatter(
    fitted: Fit, records: Sequence[Record], known: Sequence[Coordinate], samples: Samples, seed: int
) -> tuple[Explained, ...]:
    """On what the size of the innovations depends while the table moves; at rest it depends on how the scale rounds."""
    size = np.abs(fitted.innovations)
    samples = replace(samples, counts=samples.counts & (samples.phase < PHASES.index("settle")))  # at rest it sticks
    change = np.concatenate([np.abs(np.diff(record.command, prepend=record.command[0])) for record in records])
    of = [Coordinate("command_change", "N", change, bent=True)]
    of += [replace(one, values=np.abs(one.values)) for one in known if one.name in {"velocity", "acceleration"}]
    of += [one for one in known if one.name in {"time", "position"}]
    used = samples.counts
    if np.count_nonzero(used) < FEW:
        return ()
    found = [explain(size, replace(one, turns=False), samples, seed) for one in of if np.ptp(one.values[used]) > 0]
    return tuple(sorted(found, key=lambda one: -one.share))


def _sides(
    fitted: Fit,
    records: Sequence[Record],
    motion: NDArray[np.int64],
    known: Sequence[Coordinate],
    explained: Sequence[Explained],
    samples: Samples,
    seed: int,
) -> tuple[Side, ...]:
    """Time, place and the two coordinates that explain the most, as force and as reading."""
    wanted = {"time", "position", *[one.name for one in explained if one.name != "pitch"][:2]}
    chosen = [one for one in known if one.name in wanted]
    return sides(fitted, records, freed(fitted, motion, seed), chosen, samples, seed)
