"""What a tuned PID is best in, and its value for a PID: exact, over a family of plants, on grids of its own.

Symbols as in the diagram of `design.loop`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from design.family import Member
from design.loop import controller_response, disturbance_response, frequency_response, grid, sensitivities
from models.controller import PID

if TYPE_CHECKING:
    import control

Array = NDArray[np.float64]
Objective = Literal["integral", "band", "step"]

OBJECTIVES: Final[dict[Objective, str]] = {
    "integral": "largest integral gain",
    "band": "least peak of the friction's effect |PS| in a band",
    "step": "least error from the settling time on after a step of friction",
}


@dataclass(frozen=True)
class Goal:
    """What is sought: an objective, for "band" its ends [Hz], for "step" the times [s] between which the error counts.

    integral_time: the longest kp / ki [s]; without a limit the least peak of |PS| in a band needs no integral action.
    Raises ValueError for a band or a step without the numbers that it is about, which go with the machine.
    """

    objective: Objective = "integral"
    band: tuple[float, float] = (math.nan, math.nan)
    integral_time: float = math.inf
    begin: float = math.nan
    end: float = math.nan

    def __post_init__(self) -> None:
        if self.objective == "band" and not 0 < self.band[0] < self.band[1]:
            raise ValueError("band: must be two frequencies, the lower one first")
        if self.objective == "step" and not 0 < self.begin < self.end:
            raise ValueError("begin, end: must be two times, the earlier one first")


def achieved(members: Sequence[Member], pid: PID, goal: Goal) -> float:
    """The goal's value: ki [N/(m s)]; largest |PS| in the band [m/N]; or largest |x| [m] per newton from `begin` on."""
    if goal.objective == "integral":
        return pid.ki
    if goal.objective == "band":
        return max(_in_band(member.plant, pid, goal.band) for member in members)
    return max(float(np.max(np.abs(_step_error(m.plant, pid, goal)))) for m in members if m.nominal)


def _step_error(plant: control.StateSpace, pid: PID, goal: Goal) -> Array:
    """x (n,) [m] per newton from `begin` to `end` after a unit step of d."""
    return disturbance_response(plant, pid, round(goal.end / plant.dt))[round(goal.begin / plant.dt) - 1 :]


def _in_band(plant: control.StateSpace, pid: PID, band: tuple[float, float]) -> float:
    omega = grid(plant, pid, 400)
    ends = 2 * math.pi * np.array(band)
    omega = np.concatenate([[ends[0]], omega[(omega > ends[0]) & (omega < ends[1])], [ends[1]]])
    response = frequency_response(plant, omega)
    return float(np.max(np.abs(sensitivities(response, controller_response(pid, plant.dt, omega))["PS"])))
