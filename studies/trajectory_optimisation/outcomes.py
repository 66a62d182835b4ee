"""The outcome of a trajectory on each table: the whole sequence, on nonsmooth, quantised tables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.trajectory.scenarios import Errors
from design.validation import Validation, assess, respond, sequence
from models.controller import Controller, References
from models.machine import Machine
from studies.perturbed import MODE_RANGE, RANGE

Array = NDArray[np.float64]

SHOWN: Final = 2.4  # settling times of each motion that are kept for the figures
VIBRATION: Final = 0.8  # settling times after the first one over which the vibration left is looked at
# What a trajectory should be insensitive to, one standard deviation each: friction as far as learning leaves it wrong.
ERRORS: Final = Errors(0.02, 0.02, RANGE.mass / math.sqrt(3), MODE_RANGE / math.sqrt(3))


@dataclass(frozen=True)
class Outcome:
    """The outcome on one table: slowest motion's settling [s] to both tolerances, dispersion [m], thrust [N].

    dispersion_aim, dispersion_specified: 3 sigma after the aimed and the specified time. vibration [m]: largest
    departure of a motion, after the specified time, from its mean over the window: residual vibration. Of the position
    and the command the first SHOWN settling times are kept, at most a motion.
    """

    settling: float
    settling_fine: float
    dispersion_aim: float
    dispersion_specified: float
    peak_thrust: float
    vibration: float
    error: Array  # (motions, n) [m]
    position: Array  # (motions, m) [m] travelled, m <= n
    command: Array  # (motions, m) [N]


@dataclass(frozen=True)
class Aim:
    """The requirements: stroke [m], fine tolerance [m], and aimed settling time [s]."""

    stroke: float
    tolerance: float
    settling_time: float


def judge(
    machines: Sequence[Machine],
    controller: Controller | Sequence[Controller],
    aim: Aim,
    given: References | Sequence[References] | None = None,
    seed: int = 0,
    starts: Sequence[Array] | None = None,
) -> list[Outcome]:
    """The outcome on each machine in the last period of the sequence; controller, given: for all, or one for each.

    starts: where each table's elements (N,) [m] stand before the sequence; default 0.
    """
    if not machines:
        return []
    target = sequence(machines[0], aim.stroke)
    responses = respond(machines, controller, target, given=given, seed=seed, initial_friction=starts)
    return [
        outcome_of(assess(machine, response, stroke=aim.stroke), aim)
        for machine, response in zip(machines, responses, strict=True)
    ]


def outcome_of(validation: Validation, aim: Aim) -> Outcome:
    """The part of a validation that this study needs."""
    machine, achieved = validation.machine, validation.achieved
    wanted, ts = machine.specification, machine.sample_time
    first, window = round(wanted.settling_time / ts), round(VIBRATION * wanted.settling_time / ts)
    error = np.array([one.error for one in achieved])
    shown = min(round(SHOWN * wanted.settling_time / ts), error.shape[1])
    direction = np.array([one.motion.direction for one in achieved])
    still = error[:, first : first + window]
    command = validation.response.record.command
    return Outcome(
        settling=validation.slowest.settling_time,
        settling_fine=validation.settling_within(aim.tolerance),
        dispersion_aim=validation.dispersion_after(aim.settling_time),
        dispersion_specified=validation.worst_dispersion,
        peak_thrust=validation.peak_thrust,
        vibration=float(np.max(np.abs(still - still.mean(axis=1, keepdims=True)))),
        error=error,
        position=(error * direction[:, None] + aim.stroke)[:, :shown],
        command=np.array([command[one.motion.start : one.motion.start + shown] for one in achieved]),
    )
