"""Where the machine leaves its model: the force that the fitted model lacks, and on what it depends.

The controller is replayed first, because a record that another controller made is another experiment. Then come the
unknown force with its uncertainty and its noise floor, where its energy lies, on which coordinates it depends, whether
it is a force or an error of the scale, and whether it has a mean or only a variance. Nothing here knows the catalogue
of effects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.criteria import Criteria
from diagnosis.model.fit import Fit, Largest, largest, weights
from diagnosis.model.roughness import variance_by_record
from diagnosis.records.motions import Piece, numbered
from diagnosis.records.units import noise
from diagnosis.refit import FOLLOWED, RATED
from diagnosis.where.controller import Replayed, replayed
from diagnosis.where.coordinates import (
    Coordinate,
    Dependence,
    Explained,
    coordinates,
    explain,
    explain_by_all,
    of_signal,
    parity,
)
from diagnosis.where.dependence import explained_by, of_innovations
from diagnosis.where.energy import (
    PHASES,
    EnergyShares,
    Samples,
    by_band,
    by_wavelength,
    label_samples,
    shares,
    wavelengths,
)
from diagnosis.where.force import FAST_WALK, UnknownForce, borne_out, own_course, smoother_response, unknown_force
from diagnosis.where.side import Side, sides
from diagnosis.which.detectors.scan import NuisanceProjection, partial_out
from models.records.record import Record

Array = NDArray[np.float64]

MIN_MOVING_SAMPLES: Final = 200  # samples in motion below which nothing is said about the scatter


@dataclass(frozen=True)
class Where:
    """The answer to where the model falls short; forces are in newtons of thrust reference.

    controller: the replay of each record. unknown: the force that the fitted model lacks. energy: in which motions,
    phases, bands and wavelengths it lies. dependence: on which coordinates it depends. sides: whether it looks like a
    force or like an error of the reading. samples, coordinates: what is known of every sample, sampled every
    sample_time [s]. gap: what each coordinate explains of the innovations, see dependence.py. course [1]: see
    `force.own_course`. walk [N per sample]: of the force beside which force and reading are compared, where the weights
    do not hold, and variance [1]: what that leaves of each record, see `force.borne_out`. spike: the largest
    innovation, where noise makes none of its size. beyond_rating [N]: the largest command, where the drive followed
    commands beyond its rating.
    """

    controller: tuple[Replayed, ...]
    unknown: UnknownForce
    energy: EnergyShares
    dependence: Dependence
    sides: tuple[Side, ...]
    samples: Samples
    coordinates: tuple[Coordinate, ...]
    sample_time: float
    gap: tuple[Explained, ...] = ()
    course: float = 0.0
    walk: float | None = None
    variance: tuple[float, ...] = ()
    spike: Largest | None = None
    beyond_rating: float | None = None
    criteria: Criteria = Criteria()

    @property
    def force(self) -> Array:
        """The likeliest unknown force (n,) [N] of all records, one after another, its mean over what counts removed."""
        return self.unknown.centred(self.samples)

    @property
    def deviation(self) -> float:
        """Its standard deviation [N]."""
        return float(np.sqrt(np.mean(self.force[self.samples.counts] ** 2)))

    @property
    def is_noise(self) -> bool:
        """Whether the force is no larger than the scale's noise alone would make it."""
        return self.deviation < self.criteria.force_above_noise * self.unknown.noise

    @property
    def coordinate(self) -> Explained:
        """The coordinate that explains the most; those that chance could explain as well come last."""
        return max(self.dependence.coordinates, key=lambda one: (one.is_stated(self.criteria), one.share))

    @property
    def by_coordinate(self) -> dict[str, float]:
        """Share [1] of the gap by coordinate, of those that explain more of it than chance does.

        Where none explains enough to be told, it comes at random: then it is the share of its size, over the
        coordinates on which that depends. Where its size depends on none either, it has a course of its own over time.
        """
        shares = {one.name: one.share if one.p < self.criteria.stated_p_value else 0.0 for one in self.gap}
        if any(one.is_stated(self.criteria) for one in self.gap):
            return shares
        stated = [one for one in self.dependence.scatter if one.is_stated(self.criteria)]
        sizes = {one.name: one.share for one in stated if one.name in shares}
        if not sizes and (self.is_noise or max(shares.values(), default=0.0) > self.course):
            return shares
        return dict.fromkeys(shares, 0.0) | (sizes or {"time": self.course})


def locate(
    fitted: Fit,
    records: Sequence[Record],
    pieces: Sequence[Piece],
    *,
    seed: int = 0,
    spike: float = Criteria().spike,
    replays: Sequence[Replayed] | None = None,
    criteria: Criteria = Criteria(),
    usual: Sequence[float] = (),
) -> Where:
    """Where the fitted model leaves the records; pieces: those of `motions.pieces`; spike [1]: see `Null.spike`.

    replays: of the controller on each record, where they are known already. usual [1]: see `Null.usual`.
    """
    nominal = fitted.candidate.nominal
    motion = numbered(pieces, records)
    settling_time = fitted.candidate.machine.specification.settling_time
    samples = label_samples(records, pieces, motion, weights(records), settling_time, nominal.priors.units)
    known = coordinates(fitted, records, samples)
    unknown = unknown_force(fitted, records, pieces)
    projection, weighed = partial_out(fitted, motion, seed), borne_out(fitted, records, criteria)
    compared = projection if weighed is fitted else partial_out(weighed, motion, seed)
    dependence = _dependence(fitted, records, unknown.centred(samples), known, samples, seed)
    gap = of_innovations(fitted, records, projection, samples, usual)
    most = largest(fitted)
    return Where(
        controller=tuple(replays or (replayed(nominal, record, criteria) for record in records)),
        unknown=unknown,
        energy=_energy(fitted, records, unknown, samples, seed),
        dependence=dependence,
        sides=_sides(weighed, records, compared, known, dependence, samples, seed),
        samples=samples,
        coordinates=known,
        sample_time=records[0].sample_time,
        gap=explained_by(gap, unknown.centred(samples), known, samples, seed),
        course=own_course(fitted, records, unknown.likely.walk / fitted.candidate.usual_white_force),
        walk=None if weighed is fitted else weighed.walk * weighed.candidate.usual_white_force,
        variance=tuple(variance_by_record(weighed).tolist()),
        spike=most if most.deviations > spike else None,
        beyond_rating=nominal.drive.rated_thrust if nominal.sources.get(RATED) == FOLLOWED else None,
        criteria=criteria,
    )


def _energy(fitted: Fit, records: Sequence[Record], unknown: UnknownForce, samples: Samples, seed: int) -> EnergyShares:
    """Shares of the likeliest force's energy; by frequency of the fast one's, which holds the high frequencies."""
    ts, force, variance = records[0].sample_time, unknown.centred(samples), unknown.noise**2
    kinds = [str(kind) for kind in samples.kinds]
    both = samples.kind * len(PHASES) + samples.phase
    pairs = [f"{kind} | {phase}" for kind in kinds for phase in PHASES]
    response = smoother_response(fitted.candidate, ts, FAST_WALK)[0]
    position = np.concatenate([path.path.at_samples for path in fitted.paths])
    between = wavelengths(position)
    return EnergyShares(
        motion=shares(force**2, variance, samples.kind, kinds, samples, seed),
        phase=shares(force**2, variance, samples.phase, PHASES, samples, seed),
        motion_and_phase=shares(force**2, variance, both, pairs, samples, seed),
        band=by_band(unknown.fast.values, response, noise(fitted.candidate.machine), ts, samples, seed),
        wavelength=by_wavelength(force, position, between, unknown.noise, samples, seed),
        wavelengths=between,
    )


def _dependence(
    fitted: Fit, records: Sequence[Record], force: Array, known: Sequence[Coordinate], samples: Samples, seed: int
) -> Dependence:
    """What each coordinate, all together, and the speed's parity explain of the force (n,) [N]."""
    velocity = np.concatenate([path.path.speed[:, 0] for path in fitted.paths])
    return Dependence(
        coordinates=explained_by(of_signal(force, samples), force, known, samples, seed),
        ceiling=explain_by_all(force, known, samples, seed),
        parity=parity(force, Coordinate("velocity", "m/s", velocity, logarithmic=True), samples, seed),
        scatter=_scatter(fitted, records, known, samples, seed),
    )


def _scatter(
    fitted: Fit, records: Sequence[Record], known: Sequence[Coordinate], samples: Samples, seed: int
) -> tuple[Explained, ...]:
    """On what the size of the innovations depends while the table moves; at rest it depends on how the scale rounds."""
    size = np.abs(fitted.innovations)
    moving = replace(samples, counts=samples.counts & (samples.phase < PHASES.index("settle")))
    if np.count_nonzero(moving.counts) < MIN_MOVING_SAMPLES:
        return ()
    change = np.concatenate([np.abs(np.diff(record.command, prepend=record.command[0])) for record in records])
    of = [Coordinate("command_change", "N", change, logarithmic=True)]
    of += [replace(one, values=np.abs(one.values)) for one in known if one.name in {"velocity", "acceleration"}]
    of += [one for one in known if one.name in {"time", "position"}]
    varying = [replace(one, turns=None) for one in of if np.ptp(one.values[moving.counts]) > 0]
    return tuple(sorted((explain(size, one, moving, seed) for one in varying), key=lambda one: -one.share))


def _sides(
    fitted: Fit,
    records: Sequence[Record],
    projection: NuisanceProjection,
    known: Sequence[Coordinate],
    dependence: Dependence,
    samples: Samples,
    seed: int,
) -> tuple[Side, ...]:
    """Time, position and the two coordinates that explain the most, as a force and as an error of the reading."""
    strongest = [one.name for one in dependence.coordinates if one.name != "pitch"][:2]
    chosen = [one for one in known if one.name in {"time", "position", *strongest}]
    return sides(fitted, records, projection, chosen, samples, seed)
