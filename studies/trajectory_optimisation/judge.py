"""The judge: the whole sequence on nonsmooth, quantised tables; shares nothing with what made the trajectories."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.controller import Controller, References
from models.machine import Machine
from models.records.record import feeding_sequence, motions
from models.records.settling import dispersion, settling_time
from models.simulation.simulator import Response, simulate_many
from models.variation import Variation

Array = NDArray[np.float64]

PERIODS: Final = 3  # of the sequence; the last is judged
BATCH: Final = 40  # tables simulated side by side, which bounds the memory
VIBRATION: Final = 20e-3  # s, the window after the settling time over which the vibration left is looked at
MODE_RANGE: Final = 0.03  # relative error of each frequency
# Of the tables that a design is judged on, either way and evenly; each mode has a frequency error of its own.
RANGE: Final = Variation(friction_force=0.3, friction_length=0.3, mass=0.03, frequency=MODE_RANGE)


@dataclass(frozen=True)
class Outcome:
    """What a table achieved: slowest motion's settling [s] to both tolerances, dispersion [m], thrust [N].

    dispersion_aim, dispersion_specified: 3 sigma after the aimed and the specified time. vibration [m]: largest
    departure of a motion, after the specified time, from its mean over the window: what still moves.
    """

    settling: float
    settling_fine: float
    dispersion_aim: float
    dispersion_specified: float
    peak_thrust: float
    vibration: float
    error: Array  # (motions, n) [m]
    position: Array  # (motions, n) [m] travelled
    command: Array  # (motions, n) [N]


@dataclass(frozen=True)
class Aim:
    """What counts: stroke [m], fine tolerance [m], aimed settling time [s], and how much of a motion is kept [s]."""

    stroke: float
    tolerance: float
    settling_time: float
    shown: float = 0.06


def sequence(machine: Machine, stroke: float, periods: int = PERIODS) -> Array:
    """The target r (n,) [m] of Fig. 5 with strokes of `stroke` [m]."""
    wanted = machine.specification
    return feeding_sequence(stroke, wanted.motions, wanted.interval, machine.sample_time, periods)


def run(
    machines: Sequence[Machine],
    controller: Controller,
    target: Array,
    given: References | Sequence[References] | None,
    seed: int,
) -> list[Response]:
    """The responses of all machines to the target r (n,) [m], in batches."""
    found: list[Response] = []
    for begin in range(0, len(machines), BATCH):
        batch = machines[begin : begin + BATCH]
        its = given if given is None or isinstance(given, References) else given[begin : begin + BATCH]
        found += simulate_many(batch, [controller] * len(batch), target, seed=seed, given=its)
    return found


def judge(
    machines: Sequence[Machine],
    controller: Controller | Sequence[Controller],
    aim: Aim,
    given: References | Sequence[References] | None = None,
    seed: int = 0,
) -> list[Outcome]:
    """What each machine achieves in the last of PERIODS periods; controller, given: for all, or one for each."""
    found: list[Outcome] = []
    target = sequence(machines[0], aim.stroke)
    laws = [controller] * len(machines) if isinstance(controller, Controller) else controller
    for begin in range(0, len(machines), BATCH):
        part = slice(begin, begin + BATCH)
        batch = machines[part]
        its = given if given is None or isinstance(given, References) else given[part]
        responses = simulate_many(batch, laws[part], target, seed=seed, given=its)
        found += [assess(machine, response, aim) for machine, response in zip(batch, responses, strict=True)]
    return found


def assess(machine: Machine, response: Response, aim: Aim) -> Outcome:
    """The outcome over the last period of a response."""
    wanted, ts = machine.specification, machine.sample_time
    period = sequence(machine, aim.stroke, 1)
    last = response.last(period.size)
    every = motions(np.concatenate([period, period]))[: 2 * wanted.motions]
    error = np.array([last.position[one.start : one.stop] - one.target for one in every])
    way = np.array([one.direction for one in every])
    spread = dispersion(error[way > 0])
    shown = round(aim.shown / ts)
    first, window = round(wanted.settling_time / ts), round(VIBRATION / ts)
    still = error[:, first : first + window]
    command = np.array([last.record.command[one.start : one.stop] for one in every])
    return Outcome(
        settling=max(settling_time(one, wanted.tolerance, ts) for one in error),
        settling_fine=max(settling_time(one, aim.tolerance, ts) for one in error),
        dispersion_aim=float(np.max(spread[round(aim.settling_time / ts) :])),
        dispersion_specified=float(np.max(spread[first:])),
        peak_thrust=float(np.max(np.abs(command))),
        vibration=float(np.max(np.abs(still - still.mean(axis=1, keepdims=True)))),
        error=error[:, :shown],
        position=(error * way[:, None] + aim.stroke)[:, :shown],
        command=command[:, :shown],
    )
