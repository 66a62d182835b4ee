"""The paper's observations of its compensated table, as conditions on a simulated sequence, by the scale's reading.

As in the paper, the position is what the scale shows, and 3 sigma is that of the five positive motions at each time
from the step on, its largest value after the settling time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.validation import ROUNDING, Validation, validate
from models.controller import Controller
from models.machine import Machine

Array = NDArray[np.float64]

COARSE_SUBSTEPS: Final = 10  # substeps in a sample, of most outcomes;
CONVERGED: Final = 40  # of those that come within MAX_DISTANCE_STEPS of what was published, which alone are counted
MAX_DISTANCE_STEPS: Final = 3.0  # steps of the scale
PERIODS: Final = 2  # of the sequence; the last one is judged


@dataclass(frozen=True)
class Pattern:
    """The three conditions after the settling time: the reversal within `tolerance` [m], an inching motion beyond it
    by a step of the scale [m] or more, and 3 sigma = `dispersion` +- `margin` [m].
    """

    tolerance: float
    step: float
    dispersion: float
    margin: float

    def distance(self, outcome: Outcome) -> float:
        """Distance [m] of the outcome from the pattern: the largest violation of the three conditions, else 0."""
        late = self._violation(self.tolerance + self.step - outcome.inching_error)
        return max(late, self.loose_distance(outcome))

    def loose_distance(self, outcome: Outcome) -> float:
        """The same [m] without the second condition: the reversal in time, and 3 sigma as published."""
        reversal = self._violation(outcome.reversal_error - self.tolerance)
        return max(reversal, self._violation(abs(outcome.dispersion - self.dispersion) - self.margin))

    def near(self, outcome: Outcome) -> bool:
        """Whether an outcome is so near that it is worth a simulation at CONVERGED substeps."""
        return self.loose_distance(outcome) <= MAX_DISTANCE_STEPS * self.step

    def _violation(self, miss: float) -> float:
        return miss if miss > ROUNDING * self.tolerance else 0.0


@dataclass(frozen=True)
class Outcome:
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


def by_scale(machine: Machine, controller: Controller, lead: int = 0, substeps: int = COARSE_SUBSTEPS) -> Validation:
    """The sequence on the nonsmooth machine with its effects, as the scale shows it; `lead`, `substeps` in samples."""
    return validate(machine, controller, periods=PERIODS, reading="scale", lead=lead, substeps=substeps)


def positive_errors(validation: Validation) -> Array:
    """The errors (motions, n) [m] of the positive motions, each from its step on, the reversal first."""
    return np.array([one.error for one in validation.positive])


def outcome_of(validation: Validation) -> Outcome:
    """The outcome of a validation, for the conditions of the pattern."""
    machine = validation.machine
    after = round(machine.specification.settling_time / machine.sample_time)
    largest = [float(error) for error in np.max(np.abs(positive_errors(validation)[:, after:]), axis=1)]
    return Outcome(
        validation.reversal.settling_time,
        tuple(one.settling_time for one in validation.inching),
        largest[0],
        max(largest[1:]),
        validation.worst_dispersion,
    )
