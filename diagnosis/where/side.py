"""Force or reading: whether the residual looks like a force on the table or like an error of the position scale.

Both leave different marks in the innovations: an error of the reading does not move the table, but it shifts the
position at which the model evaluates the friction. Curves over the same coordinate, once as a force and once as an
addition to the reading, are compared by how much they lower the chi-square of the innovations on held-out motions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.criteria import Criteria
from diagnosis.model.fit import Fit, weights
from diagnosis.model.kalman import adjoint, changes
from diagnosis.model.parameters import initial_state
from diagnosis.model.residual import shifted
from diagnosis.where.coordinates import Coordinate, by_motion, folds, hat_functions, held_out
from diagnosis.where.energy import Samples
from diagnosis.which.detectors.scan import MAX_SPECTRUM_BINS, NuisanceProjection
from models.effects.priors import REFERENCE, Units
from models.records.record import Record
from models.simulation.effect_kernel import replay

Array = NDArray[np.float64]

# Differences with respect to a reading, friction included, take a step of so many of the reading's deviations.
PROBE: Final = 0.5
# The range [m], on the reference table, in which a period of the scale's error is searched.
FINE_PERIODS_M: Final = (3e-6, 5e-5)


@dataclass(frozen=True)
class Side:
    """Held-out gain in chi-square [1] of curves over one coordinate, as a force and as an addition to the reading;
    pitch [m]: the period, of a fine periodic error."""

    coordinate: str
    force: float
    reading: float
    pitch: float | None = None


def sides(
    fitted: Fit,
    records: Sequence[Record],
    projection: NuisanceProjection,
    chosen: Sequence[Coordinate],
    samples: Samples,
    seed: int = 0,
) -> tuple[Side, ...]:
    """The chosen coordinates as a force and, for time and position, as a reading; and a fine period of the position.

    The same columns make both: a scale whose error turns with the motion would else be described by the force alone.
    """
    found = []
    for coordinate in chosen:
        basis, _ = hat_functions(coordinate, samples.counts)
        turned = np.hstack([basis, basis * coordinate.turns[:, None]]) if coordinate.turns is not None else basis
        force = _gain(as_force(fitted, records, turned), projection, records, samples, seed)
        may = coordinate.name in {"time", "position"}
        reading = (
            _gain(_as_reading(fitted, records, turned, samples.units), projection, records, samples, seed)
            if may
            else 0.0
        )
        found.append(Side(coordinate.name, force, reading))
    place = next((one for one in chosen if one.name == "position"), None)
    if place is not None and float(np.ptp(place.values)) > 2 * _fine_range(samples)[1]:
        found.append(_fine(fitted, records, projection, place, samples, seed))
    return tuple(found)


def force_or_reading(found: Sequence[Side], criteria: Criteria = Criteria()) -> str:
    """ "force", "scale", "either" or "neither"."""
    force, reading = (max((getattr(one, part) for one in found), default=0.0) for part in ("force", "reading"))
    if max(force, reading) < criteria.side_min_gain:
        return "neither"
    if force > criteria.side_ratio * reading:
        return "force"
    return "scale" if reading > criteria.side_ratio * force else "either"


def _gain(
    columns: Array, projection: NuisanceProjection, records: Sequence[Record], samples: Samples, seed: int
) -> float:
    """Held-out gain in chi-square of the innovations by columns (n, k)."""
    whole = projection(columns * weights(records)[:, None])
    grams, slopes = by_motion(whole, projection.e, samples.motion)
    gains, _ = held_out(grams, -slopes, folds(grams.shape[0], seed))
    return max(float(gains.sum()), 0.0)


def as_force(fitted: Fit, records: Sequence[Record], basis: Array) -> Array:
    """Change (n, k) [1] of the whitened innovations by forces of 1 N times the basis (n, k)."""
    parts, begin = [], 0
    for i, record in enumerate(records):
        here = basis[begin : begin + record.position.size]
        begin += record.position.size
        force = np.repeat(here.T[:, :, None], fitted.residuals[i].force.shape[1], axis=2)
        model = fitted.candidate.predictor(record.sample_time, fitted.walk, i)
        parts.append(changes(model, force))
    return np.concatenate(parts)


def _as_reading(fitted: Fit, records: Sequence[Record], basis: Array, units: Units) -> Array:
    """Change of the whitened innovations (n, k) by additions of PROBE times the basis (n, k) to the reading."""
    parts, begin = [], 0
    for i, record in enumerate(records):
        here = PROBE * units.reading * basis[begin : begin + record.position.size]
        begin += record.position.size
        force = np.stack([_friction_change(fitted, record, i, added) for added in here.T])
        model = fitted.candidate.predictor(record.sample_time, fitted.walk, i)
        parts.append(changes(model, force, -here.T))
    return np.concatenate(parts)


def _friction_change(fitted: Fit, record: Record, index: int, added: Array) -> Array:
    """Change of the friction (n, M) [N] where the reading is off by `added` (n,) [m]."""
    if not np.any(added):
        return np.zeros_like(fitted.residuals[index].force)
    candidate, machine, seen = fitted.candidate, fitted.candidate.machine, fitted.paths[index]
    friction = [
        replay(
            machine.friction, candidate.effects, path, machine.plant.dead_time,
            state=initial_state(candidate.layout, candidate.theta, index),
            thrust_limit=machine.drive.rated_thrust, start=float(record.command[0]),
        ).friction
        for path in (seen.path, shifted(seen, added))
    ]  # fmt: skip
    return np.asarray(friction[0] - friction[1])


def _fine(
    fitted: Fit,
    records: Sequence[Record],
    projection: NuisanceProjection,
    place: Coordinate,
    samples: Samples,
    seed: int,
) -> Side:
    """Sines of the position at the period that agrees best with an error of the reading, as a force and as a reading;
    less what a search over so many periods gains by chance."""
    pitch, tried = _fine_pitch(fitted, records, projection, _fine_range(samples))
    angle = 2 * np.pi * place.values / pitch
    basis = np.column_stack([np.cos(angle), np.sin(angle)])
    chance = 2 * float(np.log(tried))
    force = _gain(as_force(fitted, records, basis), projection, records, samples, seed)
    reading = _gain(_as_reading(fitted, records, basis, samples.units), projection, records, samples, seed)
    return Side("fine period", max(force - chance, 0.0), max(reading - chance, 0.0), pitch)


def _fine_range(samples: Samples) -> tuple[float, float]:
    """The range [m] in which a period of the scale's error is searched on this machine."""
    sizes = (samples.units.contact / REFERENCE.contact, samples.units.reading / REFERENCE.reading)
    return FINE_PERIODS_M[0] * min(sizes), FINE_PERIODS_M[1] * max(sizes)


def _fine_pitch(
    fitted: Fit, records: Sequence[Record], projection: NuisanceProjection, within: tuple[float, float]
) -> tuple[float, int]:
    """(the period [m] within a range that agrees best with an error of the reading, number of periods searched)."""
    extent, begin = max(float(np.ptp(record.position)) for record in records), 0
    width = max(within[0] / 6, 2 * max(extent, 2 * within[1]) / MAX_SPECTRUM_BINS)
    count = int(2 ** np.ceil(np.log2(2 * max(extent, 2 * within[1]) / width)))
    power = np.zeros(count // 2 + 1)
    for i, record in enumerate(records):
        model = fitted.candidate.predictor(record.sample_time, fitted.walk, i)
        reading = adjoint(model, projection.e[begin : begin + record.position.size])[1]
        begin += record.position.size
        bins = np.floor((record.position - record.position.min()) / width).astype(int)
        power += np.abs(np.fft.rfft(np.bincount(bins, reading, count))) ** 2
    frequency = np.fft.rfftfreq(count, width)
    inside = np.flatnonzero((frequency >= 1 / within[1]) & (frequency <= 1 / within[0]))
    best = inside[int(np.argmax(power[inside]))]
    return float(1 / frequency[best]), int(inside.size)
