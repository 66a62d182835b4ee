"""What a design is expected to achieve, with an interval: runs on machines that the records allow, on the nonsmooth
simulation.

Each run has a machine of its own, drawn from what is known of the parameters, the noise of its scale, and a past of the
friction that the controller does not know, as when an axis is switched on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.judging.scatter import dither_of
from design.redesign.designs import Design
from design.redesign.outcome import judged_target, outcome
from models.friction import follow, random_pasts
from models.machine import Machine
from models.simulation.simulator import simulate

Array = NDArray[np.float64]

LEVEL: Final = 0.9  # of the interval in which a record is expected


@dataclass(frozen=True)
class Interval:
    """A median and the ends of the interval around it, in the quantity's unit."""

    median: float
    low: float
    high: float

    def holds(self, value: float, slack: float = 0.0) -> bool:
        """Whether a value is in the interval, or off it by no more than the slack, in the same unit."""
        return self.low - slack <= value <= self.high + slack


@dataclass(frozen=True)
class Prediction:
    """Settling times [s] and 3 sigma [m] of runs of one design (runs,), each on a machine of its own; the same machines
    in the same order for every design. saturated: in how many of them the command left the rating."""

    settling: Array
    dispersion: Array
    saturated: int = 0

    def interval(self, name: str, level: float = LEVEL) -> Interval:
        """Of "settling" [s] or "dispersion" [m], with so large a share [1] of the runs in it."""
        return interval_of(getattr(self, name), level)


def interval_of(values: Array, level: float = LEVEL) -> Interval:
    """The median of values (n,) in any unit, and the ends between which a share `level` [1] of them lies.

    The ends are order statistics: of n independent values and one more like them, the latter is between the i-th from
    below and the i-th from above with probability (n + 1 - 2 i) / (n + 1), so i is the largest with at least `level`.
    """
    ordered, n = np.sort(values), values.size
    i = max(int(np.floor((1 - level) / 2 * (n + 1) + 1e-9)), 1)
    return Interval(float(np.median(values)), float(ordered[i - 1]), float(ordered[n - i]))


def predicted(design: Design, machines: Sequence[Machine], seed: int = 0) -> Prediction:
    """Runs of a design on each of `machines`, which could be the machine at hand; SI. seed: of noise and pasts."""
    rows = [_run(design, machine, seed, number) for number, machine in enumerate(machines)]
    settling, dispersion, saturated = (np.array(column, float) for column in zip(*rows, strict=True))
    return Prediction(settling, dispersion, int(saturated.sum()))


def _run(design: Design, machine: Machine, seed: int, number: int) -> tuple[float, float, bool]:
    """(settling [s], 3 sigma [m], whether it asked for more than the rating) of one run, which never settles if it runs
    away."""
    noise = float(np.hypot(machine.scale.noise, dither_of(machine)))
    noisy = replace(machine, scale=replace(machine.scale, noise=noise))
    past = random_pasts(machine.friction, 1, seed + 1000 + number)[0]
    start = follow(machine.friction, past)[1]
    target = judged_target(machine)
    with np.errstate(all="ignore"):  # a loop that runs away is a result
        response = simulate(noisy, design.controller, target, seed=seed + number, initial_friction=start)
        record = response.record
        whole = bool(np.all(np.isfinite(record.position)) and np.all(np.isfinite(record.command)))
    saturated = not whole or float(np.max(np.abs(record.command))) > machine.drive.rated_thrust
    if not whole:
        return machine.specification.interval, float(np.ptp(target)), True
    found = outcome(record, machine)
    assert found is not None  # the sequence has at least two positive motions
    return found.settling, found.dispersion, saturated
