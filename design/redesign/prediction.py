"""What a design is expected to achieve, with an interval: runs on machines that the records allow, on the nonsmooth
simulation.

Each run has a machine of its own, drawn from what is known of the parameters, the noise of its scale, and a past of the
friction that the controller does not know, as when an axis is switched on; and, where records showed a force that no
model explains, such as wind, that force, as it was but at another time.
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
from models.controller import references
from models.friction import follow, random_pasts
from models.machine import Machine
from models.records.record import Record
from models.simulation.simulator import simulate

Array = NDArray[np.float64]

LEVEL: Final = 0.9  # of the interval in which a record is expected


@dataclass(frozen=True)
class Interval:
    """A median and the ends of the interval around it, in the quantity's unit. level: the share [1] of further values
    that are expected in it, which of few values is less than was asked for."""

    median: float
    low: float
    high: float
    level: float = LEVEL

    def holds(self, value: float, slack: float = 0.0) -> bool:
        """Whether a value is in the interval, or off it by no more than the slack, in the same unit."""
        return self.low - slack <= value <= self.high + slack


@dataclass(frozen=True)
class Prediction:
    """Settling times [s] and 3 sigma [m] of runs of one design (runs,), each on a machine of its own; the same machines
    in the same order for every design. saturated: in how many of them the command left the rating; never: how many
    motions of a run never settled, in the median. Such a motion counts as long as it lasted."""

    settling: Array
    dispersion: Array
    saturated: int = 0
    never: float = 0.0

    def interval(self, name: str, level: float = LEVEL) -> Interval:
        """Of "settling" [s] or "dispersion" [m], with so large a share [1] of the runs in it."""
        return interval_of(getattr(self, name), level)


def interval_of(values: Array, level: float = LEVEL) -> Interval:
    """The median of values (n,) in any unit, and the ends between which a share `level` [1] of them lies.

    The ends are order statistics: of n independent values and one more like them, the latter is between the i-th from
    below and the i-th from above with probability (n + 1 - 2 i) / (n + 1), so i is the largest with at least `level`,
    and 1 where there are too few values for it.
    """
    ordered, n = np.sort(values), values.size
    i = max(int(np.floor((1 - level) / 2 * (n + 1) + 1e-9)), 1)
    level = max((n + 1 - 2 * i) / (n + 1), 0.0)
    return Interval(float(np.median(values)), float(ordered[i - 1]), float(ordered[n - i]), level)


def predicted(design: Design, machines: Sequence[Machine], seed: int = 0, left: Sequence[Array] = ()) -> Prediction:
    """Runs of a design on each of `machines`, which could be the machine at hand; SI. seed: of noise and pasts; left:
    the force (n,) [N] that no model explains, of each record that showed one."""
    rows = [_run(design, machine, seed, number, left) for number, machine in enumerate(machines)]
    settling, dispersion, never, saturated = (np.array(column, float) for column in zip(*rows, strict=True))
    return Prediction(settling, dispersion, int(saturated.sum()), float(np.median(never)))


def resampled(left: Sequence[Array], samples: int, seed: int) -> Array:
    """A force (samples,) [N] as it was in one of the records `left` (n,) [N], less its mean, from a time at random on:
    to and fro in time, so that it goes on where the record ends; 0 without records."""
    if not left:
        return np.zeros(samples)
    rng = np.random.default_rng([seed, 41])
    one = left[int(rng.choice(len(left), p=np.array([force.size for force in left]) / sum(map(len, left))))]
    there_and_back = np.concatenate([one, one[::-1]]) - np.mean(one)
    return np.resize(np.roll(there_and_back, -int(rng.integers(there_and_back.size))), samples)


def moved_by(left: Sequence[Array], design: Design, machine: Machine, seed: int = 0) -> float:
    """By how much the force alone moves the axis in the loop, in root mean square over the judged motions [m]."""
    runs = [_response(design, machine, seed, 0, pushed)[0].position for pushed in (left, ())]
    return float(np.sqrt(np.mean((runs[0] - runs[1]) ** 2)))


def _run(
    design: Design, machine: Machine, seed: int, number: int, left: Sequence[Array] = ()
) -> tuple[float, float, int, bool]:
    """(settling [s], 3 sigma [m], motions that never settle, whether it asked for more than the rating) of one run,
    none of whose motions settles if it runs away."""
    with np.errstate(all="ignore"):  # a loop that runs away is a result
        record, push = _response(design, machine, seed, number, left)
        whole = bool(np.all(np.isfinite(record.position)) and np.all(np.isfinite(record.command)))
    saturated = not whole or float(np.max(np.abs(record.command - push))) > machine.drive.rated_thrust
    if not whole:
        return machine.specification.interval, float(np.ptp(record.target)), 2 * machine.specification.motions, True
    found = outcome(record, machine)
    assert found is not None  # the sequence has at least two positive motions
    return found.settling, found.dispersion, found.never, saturated


def _response(design: Design, machine: Machine, seed: int, number: int, left: Sequence[Array]) -> tuple[Record, Array]:
    """The record of one run, and the force (n,) [N] in it that no model explains. It goes in with the feedforward, for
    it acts where the thrust does; that it comes later by the dead time is no matter, as it comes at any time."""
    noise = float(np.hypot(machine.scale.noise, dither_of(machine)))
    noisy = replace(machine, scale=replace(machine.scale, noise=noise))
    past = random_pasts(machine.friction, 1, seed + 1000 + number)[0]
    start, target = follow(machine.friction, past)[1], judged_target(machine)
    known, push = references(design.controller, target), resampled(left, target.size, seed + number)
    given = replace(known, feedforward=known.feedforward + push)
    found = simulate(noisy, design.controller, target, seed=seed + number, initial_friction=start, given=given)
    return found.record, push
