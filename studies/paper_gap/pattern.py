"""What the paper saw of its compensated table, as conditions on a simulated sequence; judged by the scale's reading.

As in the paper, the position is what the scale shows, and 3 sigma is that of the five positive motions at each time
from the step on, its largest value after the settling time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.controller import Controller
from models.machine import Machine
from models.records.record import feeding_sequence, motions
from models.records.settling import dispersion, settling_time
from models.simulation.simulator import Response, simulate

Array = NDArray[np.float64]

COARSE: Final = 10  # substeps in a sample
PERIODS: Final = 2  # of the sequence; the last one is judged
ROUNDING: Final = 1e-9  # relative; readings are multiples of the resolution, and exactly 2.0 um are within +-2 um


@dataclass(frozen=True)
class Pattern:
    """The three conditions after the settling time: the reversal within `tolerance` [m], an inching motion beyond it
    by a step of the scale [m] or more, and 3 sigma = `dispersion` +- `margin` [m].
    """

    tolerance: float
    step: float
    dispersion: float
    margin: float

    def distance(self, seen: Seen) -> float:
        """How far [m] the outcome is from the pattern: the largest miss of the three conditions, 0 for none."""
        rounding = ROUNDING * self.tolerance
        misses = (
            seen.reversal_error - self.tolerance,
            self.tolerance + self.step - seen.inching_error,
            abs(seen.dispersion - self.dispersion) - self.margin,
        )
        return max(miss if miss > rounding else 0.0 for miss in misses)


@dataclass(frozen=True)
class Seen:
    """Outcome of one sequence: settling times [s], largest errors after the settling time [m], and 3 sigma [m].

    inching: of each inching motion, in order; the errors are those of the reversal and of the worst inching motion.
    """

    reversal_settling: float
    inching: tuple[float, ...]
    reversal_error: float
    inching_error: float
    dispersion: float

    @property
    def inching_settling(self) -> float:
        """Of the slowest inching motion [s]; inf for never."""
        return max(self.inching)

    def to_json(self) -> dict[str, float]:
        """The outcome as results.json holds it, SI."""
        return {
            "reversal_settling_s": self.reversal_settling,
            "inching_settling_s": self.inching_settling,
            "reversal_error_m": self.reversal_error,
            "inching_error_m": self.inching_error,
            "dispersion_m": self.dispersion,
        }


def sequence(machine: Machine, lead: int = 0) -> Array:
    """The target r (n,) [m]: `lead` samples of rest, then PERIODS times the sequence of Fig. 5."""
    wanted = machine.specification
    period = feeding_sequence(wanted.stroke, wanted.motions, wanted.interval, machine.sample_time)
    return np.concatenate([np.zeros(lead), np.tile(period, PERIODS)])


def run(machine: Machine, controller: Controller, lead: int = 0, substeps: int = COARSE) -> Response:
    """The sequence, from rest, on the nonsmooth machine with its effects; `lead` and `substeps` in samples."""
    return simulate(machine, controller, sequence(machine, lead), substeps=substeps)


def errors(machine: Machine, response: Response) -> Array:
    """Errors (motions, n) [m] of the last period's positive motions by the scale, from the step on, the reversal first.

    Raises ValueError if the first of them is none.
    """
    record = response.record
    last = [one for one in motions(record.target)[-2 * machine.specification.motions :] if one.direction > 0]
    if not last[0].reversal:
        raise ValueError("the sequence does not begin with a reversal; give one made by `sequence`")
    return np.array([record.position[one.start : one.stop] - one.target for one in last])


def seen(machine: Machine, error: Array) -> Seen:
    """The outcome of errors (motions, n) [m], the reversal first."""
    wanted, ts = machine.specification, machine.sample_time
    after = round(wanted.settling_time / ts)
    settled = [settling_time(one, wanted.tolerance * (1 + ROUNDING), ts) for one in error]
    largest = np.max(np.abs(error[:, after:]), axis=1)
    return Seen(
        settled[0],
        tuple(settled[1:]),
        float(largest[0]),
        float(np.max(largest[1:])),
        float(np.max(dispersion(error)[after:])),
    )
