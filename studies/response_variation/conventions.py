"""What the paper's method leaves open, and this project chose: the deadbeat's objective, and the divisor of sigma.

The paper says that x_T* settles within 20 ms without vibration (III.A), which many sequences of thrust do, and that
sigma is a standard deviation of five motions (V.B), which is divided by their number or by one less.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from design.controller import assemble_bare, design_deadbeat, usable_thrust
from design.deadbeat import OBJECTIVES, Constraints, Objective
from design.validation import Validation
from models.controller import Controller
from models.machine import Machine


@dataclass(frozen=True)
class Convention:
    """The deadbeat's objective, whether x_T* may go back, and whether sigma is divided by one less than the motions."""

    objective: Objective = "thrust_difference"
    monotone: bool = False
    one_less: bool = False

    @property
    def words(self) -> str:
        """The deadbeat's part in words."""
        return OBJECTIVES[self.objective] + (", never backwards" if self.monotone else "")


CHOSEN: Final = Convention()  # Of the whole project.
FEEDFORWARDS: Final[tuple[tuple[Objective, bool], ...]] = (
    ("thrust_difference", False),
    ("thrust_difference", True),
    ("thrust", False),
    ("peak_thrust", False),
    ("mode_robustness", False),
)


def bare(machine: Machine, convention: Convention) -> Controller:
    """The machine's controller without friction compensation, by a convention. Raises DesignError."""
    limits = Constraints(thrust=usable_thrust(machine), monotone=convention.monotone)
    return assemble_bare(machine, design_deadbeat(machine, objective=convention.objective, constraints=limits))


def three_sigma(validation: Validation, convention: Convention) -> float:
    """The largest 3 sigma [m] after the settling time, with the convention's divisor."""
    motions = len(validation.positive)
    return validation.worst_dispersion * (math.sqrt(motions / (motions - 1)) if convention.one_less else 1.0)
