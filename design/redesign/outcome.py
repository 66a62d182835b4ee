"""What motions over the specified stroke achieved in a record, measured or simulated: settling and dispersion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.validation import ROUNDING, sequence
from models.machine import Machine
from models.records.record import Motion, Record, motions
from models.records.settling import dispersion, settling_time

Array = NDArray[np.float64]

SAME_STROKE: Final = 0.01  # relative difference of strokes that are the specified one
PERIODS: Final = 2  # of the specified sequence; the last is judged
# Of a record's motions that have to be over the stroke, for the others not to disturb them.
MIN_FULL_STROKE_SHARE: Final = 0.8
LEAST_LEAD: Final = 50  # samples of rest before it


def judged_target(machine: Machine) -> Array:
    """The target r (n,) [m] on which designs are judged: a settling time of rest, then the specified sequence twice."""
    lead = max(round(machine.specification.settling_time / machine.sample_time), LEAST_LEAD)
    return sequence(machine, None, PERIODS, lead)


@dataclass(frozen=True)
class Outcome:
    """Of motions over the specified stroke, by the scale: when the slowest settled [s], the largest 3 sigma of those
    in the positive direction after the specified time [m], how many there were, and how many never settled: such a
    motion counts as long as it lasted."""

    settling: float
    dispersion: float
    motions: int
    never: int

    @property
    def never_share(self) -> float:
        """The share [1] of the motions that never settled."""
        return self.never / self.motions


def outcome(record: Record, machine: Machine) -> Outcome | None:
    """The outcome of a record's motions; None where fewer than two positive ones are over the specified stroke, or
    many are over another.

    What the friction remembers of before the record is in its first motions. So the first period of the specified
    sequence does not count where there are two, and of any other record the first motion.
    """
    wanted, ts = machine.specification, machine.sample_time
    judged = judged_motions(record, machine)
    errors = [record.position[one.start : one.stop] - one.target for one in judged]
    positive = [error for one, error in zip(judged, errors, strict=True) if one.direction > 0]
    if len(positive) < 2:
        return None
    tolerance = wanted.tolerance * (1 + ROUNDING)
    times = np.array([settling_time(error, tolerance, ts) for error in errors])
    lasted = np.array([error.size * ts for error in errors])
    never = np.isinf(times)
    after, shortest = round(wanted.settling_time / ts), min(error.size for error in positive)
    spread = dispersion([error[:shortest] for error in positive])[after:]
    return Outcome(
        float(np.max(np.where(never, lasted, times))),
        float(np.max(spread, initial=0.0)),
        len(judged),
        int(np.sum(never)),
    )


def together(found: Sequence[Outcome]) -> Outcome | None:
    """The outcome of all motions in several records of one design; its 3 sigma is the largest of a record. None of
    none."""
    if not found:
        return None
    return Outcome(
        max(one.settling for one in found),
        max(one.dispersion for one in found),
        sum(one.motions for one in found),
        sum(one.never for one in found),
    )


def tolerance_reached(record: Record, machine: Machine) -> float:
    """The tolerance [m] within which all judged motions of a record would have settled in the specified time."""
    after = round(machine.specification.settling_time / machine.sample_time)
    errors = [record.position[one.start + after : one.stop] - one.target for one in judged_motions(record, machine)]
    return max(float(np.max(np.abs(error), initial=0.0)) for error in errors)


def judged_motions(record: Record, machine: Machine) -> list[Motion]:
    """The motions of a record that `outcome` judges (SI)."""
    found = motions(record.target, float(record.target[0]))
    kept, whole = [one for one in found[1:] if _specified(one, machine)], 2 * machine.specification.motions
    if len(kept) < MIN_FULL_STROKE_SHARE * len(found[1:]):
        return []
    return kept[-whole:] if len(found) >= PERIODS * whole else kept


def _specified(motion: Motion, machine: Machine) -> bool:
    """Whether it is over the specified stroke and lasts longer than it may take to settle."""
    wanted = machine.specification
    stroke = abs(motion.target - motion.origin)
    long_enough = (motion.stop - motion.start) * machine.sample_time > wanted.settling_time
    return abs(stroke - wanted.stroke) <= SAME_STROKE * wanted.stroke and long_enough
