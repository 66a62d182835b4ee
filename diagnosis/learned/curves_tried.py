"""The curves that a law without a name may be: a coordinate, how the force turns with it, and knots.

The coordinates are those of `models.effects.measured`, and their values are what the effect itself sees along the
smoothed path, so that what is learned is what a file then does. Knots are spaced evenly over time; over position
closer where the force bends; and elsewhere by asinh, from a size of the machine's own upwards.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.model.fit import Fit, weights
from diagnosis.model.residual import initial_command
from diagnosis.model.unknown_force import unknown_less_mean
from diagnosis.records.units import units
from diagnosis.where.coordinates import SLOWEST, by_motion, held_out
from models.effects.measured import IN_PROPORTION, SIGNED, UNITS, Measured
from models.effects.priors import Units
from models.records.record import Record
from models.simulation.effect_kernel import Path, replay

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

KNOTS: Final = 12
FINE_KNOTS: Final = 36  # knots over position, where a law may be narrow, and over time
REFINED_COORDINATES: Final = ("position",)  # coordinates over which knots are closer where the force bends
WAY_PARTS: Final = 10  # parts of the way, of which those that bend most make half of all bending where a law is narrow
BINS_PER_KNOT: Final = 4  # to a knot, in which the force is averaged for that
TURN: Final = (6.0, 0.05)  # deviations of the reading, and contacts' lengths: the way back that makes a reversal
FIRST: Final = 0.1  # of the friction, of the contacts' length: where knots over the command and the path begin
SHORTLIST: Final = 4  # curves that are fitted to the innovations
MAX_COORDINATE: Final = 1e4  # SI: a line over a coordinate goes so far at least, whatever the record shows
SYMMETRIES: Final[Mapping[str, tuple[str, ...]]] = {
    "time": ("plain", "directional", *IN_PROPORTION),
    "position": ("plain", "directional", *IN_PROPORTION),
    "speed": ("plain", "odd", "directional"),
    "acceleration": ("plain", "odd"),
    "command": ("plain", "odd", "directional"),
    "rest": ("plain", "directional"),
    "path": ("directional",),
}
"""What is tried over each coordinate; an even curve is a plain one over both signs."""
NOMINAL: Final = ("acceleration", "command")
"""Over these a straight line is a nominal value: the mass, the thrust constant."""


@dataclass(frozen=True)
class Curve:
    """A curve that is tried: the table without forces, and its hat functions (n, K) [1] at all samples. Of an odd one
    the first knot, at 0, has no force and no hat function. factor (n,): what the table's numbers are multiplied by, the
    direction [1], the speed [m/s] or the thrust reference [N], or 1."""

    law: Measured
    hats: Array
    factor: Array

    @property
    def named(self) -> tuple[str, str]:
        """Its coordinate and its symmetry [-]."""
        return self.law.coordinate, self.law.symmetry

    def with_force(self, force: Array) -> Measured:
        """The table with forces (K,) [N] for its hat functions."""
        first = (0.0,) * (len(self.law.knots) - self.hats.shape[1])
        return _table(self.law, (*first, *map(float, force)))

    @property
    def acting(self) -> Array:
        """What one unit at each knot is on the table, at all samples (n, K) [N]."""
        return self.hats * self.factor[:, None]

    def units_of_force(self) -> tuple[Measured, ...]:
        """For each hat function the table that has 1 N at its knot."""
        return tuple(self.with_force(row) for row in np.eye(self.hats.shape[1]))

    def own_part(self, used: NDArray[np.bool_]) -> Array:
        """The matrix (K, K) [1] that leaves of forces at the knots what no nominal value does: without the straight
        line through 0 nearest to them over the samples used (n,), where that is a mass or a thrust constant, and of a
        law that turns with the direction, or is in proportion to the thrust, without its mean, which is the friction's
        level or the thrust constant."""
        knots = np.array(self.law.knots[-self.hats.shape[1] :])
        hats = self.hats[used]
        if self.law.symmetry == "directional":
            return np.asarray(np.eye(knots.size) - np.mean(hats, axis=0))
        if self.law.symmetry == "thrust":
            return np.asarray(np.eye(knots.size) - np.average(hats, axis=0, weights=self.factor[used] ** 2))
        if self.law.coordinate not in NOMINAL:
            return np.eye(knots.size)
        line = hats @ knots
        return np.asarray(np.eye(knots.size) - np.outer(knots, line @ hats) / (line @ line))

    def bends(self) -> Array:
        """The second differences of the forces: (K' - 2, K) [1]; over knots that are closer in places those of a
        straight line are none there, too."""
        count = len(self.law.knots)
        whole = np.diff(np.eye(count), 2, axis=0)
        if _is_refined(*self.named):
            apart = np.diff(self.law.knots)
            slopes = np.diff(np.eye(count), axis=0) / apart[:, None]
            whole = np.diff(slopes, axis=0) * 0.5 * (apart[1:] + apart[:-1])[:, None]
        return np.asarray(whole[:, count - self.hats.shape[1] :])


def _table(law: Measured, force: tuple[float, ...]) -> Measured:
    return Measured(law.coordinate, law.knots, force, law.symmetry, slow=law.slow, turn=law.turn)


def curves(fitted: Fit, records: Sequence[Record]) -> Iterator[Curve]:
    """Every curve that the records can show: over each coordinate that varies, in each symmetry (SI)."""
    for coordinate in UNITS:
        yield from curves_over(coordinate, SYMMETRIES[coordinate], fitted, records)


def curves_over(coordinate: str, symmetries: Sequence[str], fitted: Fit, records: Sequence[Record]) -> Iterator[Curve]:
    """The curves over one coordinate that the records can show, in each of these symmetries (SI)."""
    known, used = units(fitted.candidate.nominal, records), weights(records) > 0
    slow, turn = slow_and_turn(known)
    sizes = {"rest": {"slow": slow}, "path": {"turn": turn}}.get(coordinate, {})
    values = coordinate_values(coordinate, fitted, records, known)
    for symmetry in symmetries if np.ptp(values[used]) > 0 else ():
        size, factor = (
            np.abs(values) if symmetry in {"even", "odd"} else values,
            _factor(symmetry, fitted, records, known),
        )
        knots = _knots(coordinate, symmetry, size[used], known)
        if _is_refined(coordinate, symmetry):
            force = unknown_less_mean(fitted, records)[0]
            knots = _where_it_bends(knots, size[used], (force * factor)[used])
        if len(knots) > 2:
            hats = np.column_stack([np.interp(size, knots, row) for row in np.eye(len(knots))])
            hats = hats[:, 1:] * np.sign(values)[:, None] if symmetry == "odd" else hats
            law = Measured(coordinate, tuple(knots), (0.0,) * len(knots), symmetry, **sizes)  # type: ignore[arg-type]
            yield Curve(law, hats, factor)


def _is_refined(coordinate: str, symmetry: str) -> bool:
    """Whether knots are closer where the force itself bends."""
    return coordinate in REFINED_COORDINATES and symmetry not in IN_PROPORTION


def _factor(symmetry: str, fitted: Fit, records: Sequence[Record], known: Units) -> Array:
    """What the numbers of a table are multiplied by at all samples (n,): see `Curve`."""
    if symmetry == "directional":
        return directions(fitted)
    if symmetry in IN_PROPORTION:
        return coordinate_values("speed" if symmetry == "drag" else "command", fitted, records, known)
    return np.ones(weights(records).size)


def slow_and_turn(known: Units) -> tuple[float, float]:
    """The speed [m/s] below which a table of these units rests, and the way back [m] that makes a reversal."""
    return SLOWEST * known.contact / known.loop, max(TURN[0] * known.reading, TURN[1] * known.contact)


def coordinate_values(coordinate: str, fitted: Fit, records: Sequence[Record], known: Units) -> Array:
    """What the effect sees as this coordinate at all samples (n,), one record after another, in its unit [SI]."""
    machine = fitted.candidate.machine
    slow, turn = slow_and_turn(known)
    shown = max(_farthest(coordinate, one.path) for one in fitted.residuals)
    far = max(MAX_COORDINATE, 2 * shown, 10 * known.thrust if coordinate == "command" else 0.0)
    line = Measured(coordinate, (-far, far), (-far, far), slow=slow, turn=turn)  # type: ignore[arg-type]
    seen = [
        replay(
            machine.friction,
            [line],
            one.path,
            machine.plant.dead_time,
            thrust_limit=machine.drive.rated_thrust,
            start=initial_command(record),
        ).force[:, -1]
        for one, record in zip(fitted.residuals, records, strict=True)
    ]
    return np.concatenate(seen)


def _farthest(coordinate: str, path: Path) -> float:
    """How far a path goes over a coordinate at most [SI]; 0 for the command, which no path bounds."""
    step, speed = path.sample_time / path.speed.shape[1], path.speed.ravel()
    if coordinate == "acceleration":
        return float(np.max(np.abs(np.diff(speed, prepend=0.0))) / step)
    if coordinate in {"time", "rest"}:
        return float(step * speed.size)
    if coordinate == "speed":
        return float(np.max(np.abs(speed)))
    return 0.0 if coordinate == "command" else 2 * float(np.max(np.abs(path.position)))


def _knots(coordinate: str, symmetry: str, values: Array, known: Units) -> list[float]:
    """Knots over the values of a coordinate (n,) [SI]; those of an odd law begin at 0."""
    low, high = (0.0 if symmetry == "odd" else float(values.min())), float(values.max())
    count = FINE_KNOTS if coordinate in {"time", "position"} else KNOTS * (1 + (coordinate in SIGNED and low < 0))
    slow, _ = slow_and_turn(known)
    size = {
        "speed": slow,
        "acceleration": slow / known.loop,
        "command": FIRST * known.force,
        "rest": known.loop,
        "path": FIRST * known.contact,
    }.get(coordinate)
    if size is None:
        return [float(knot) for knot in np.linspace(low, high, count)]
    even = np.linspace(np.arcsinh(low / size), np.arcsinh(high / size), count)
    return [float(knot) for knot in np.unique(size * np.sinh(even))]


def _where_it_bends(knots: Sequence[float], values: Array, force: Array) -> list[float]:
    """As many knots as these even ones, up to half of them closer where the mean force (n,) [N] bends over the values
    (n,) [SI]: a rail's joint is narrow, and may be anywhere on a long way. For straight lines between knots, their
    density goes best with the curvature to the power of 2/5 (C. de Boor, A Practical Guide to Splines, 1978, chapter
    XII). The even ones where it bends all over, as a spring does."""
    ends = np.linspace(knots[0], knots[-1], BINS_PER_KNOT * len(knots) + 1)
    bins = np.clip(np.searchsorted(ends, values, side="right") - 1, 0, ends.size - 2)
    counts, sums = (np.bincount(bins, of, ends.size - 1) for of in (None, force))
    seen = np.flatnonzero(counts)
    middle = 0.5 * (ends[1:] + ends[:-1])
    mean = np.interp(middle, middle[seen], sums[seen] / counts[seen])
    smooth = np.convolve(np.pad(mean, BINS_PER_KNOT, mode="edge"), np.ones(BINS_PER_KNOT) / BINS_PER_KNOT, "same")[
        BINS_PER_KNOT:-BINS_PER_KNOT
    ]
    curved = np.abs(np.gradient(np.gradient(smooth)))
    if np.sum(np.sort(curved)[-curved.size // WAY_PARTS :]) < 0.5 * np.sum(curved):
        return list(knots)
    bent = curved**0.4
    density = bent / max(float(bent.mean()), 1e-300) + 1.0
    share = np.concatenate([[0.0], np.cumsum(density)]) / float(np.sum(density))
    return [float(knot) for knot in np.interp(np.linspace(0.0, 1.0, len(knots)), share, ends)]


def shortlists(
    fitted: Fit, records: Sequence[Record], motion: Integers, kind: Integers, types: Sequence[int]
) -> dict[int | None, list[Curve]]:
    """The curves that explain the most of the smoothed unknown force on kinds of motion left out in turn, best first:
    of all motions under None, and under each of the `types` without its motions. Empty where no curve explains any of
    the force; where none does without a type, the first of all stands for it.

    motion (n,): of each sample; kind: of each motion [-]. It is a shortlist: the smoother rounds what is quick off.
    """
    force, used = unknown_less_mean(fitted, records)
    tried = list(curves(fitted, records))
    sums = [by_motion(one.acting * used[:, None], force, motion) for one in tried]

    def best(out: int | None) -> list[Curve]:
        among = kind != out
        gains = [float(held_out(grams[among], slopes[among], kind[among])[0].sum()) for grams, slopes in sums]
        order = sorted(range(len(tried)), key=lambda i: -gains[i])[:SHORTLIST]
        return [tried[i] for i in order if gains[i] > 0]

    of_all = best(None)
    return {None: of_all, **{out: best(out) or of_all[:1] for out in types}} if of_all else {}


def directions(fitted: Fit) -> Array:
    """What the friction's contacts hold over what they can hold (n,) [1]: the direction, continuous at a reversal."""
    friction = fitted.candidate.machine.friction
    most = float(np.dot(friction.stiffness, friction.limit))
    return np.concatenate([one.acts.friction[:, -1] for one in fitted.residuals]) / most
