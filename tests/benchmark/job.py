"""What every contender has to compute: the sampled loop over a target, as `simulator.simulate` defines it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.controller import default_controller
from models.controller import Controller, references
from models.machine import Machine, load
from models.records.record import feeding_sequence
from models.simulation.kernel import Loop, Run
from models.simulation.simulator import _prepare

Array = NDArray[np.float64]

REPEATS: Final = 3  # of the sequence of Fig. 5: 15 s, 30 000 samples
PIECE: Final = 0.5  # s at the job's begin over which slow contenders are timed: one motion and the rest behind it


@dataclass(frozen=True)
class Job:
    """A machine, its controller and the target r (n,) [m]."""

    machine: Machine
    controller: Controller
    target: Array

    @property
    def duration(self) -> float:
        """Simulated time [s]."""
        return self.target.size * self.machine.sample_time

    def first(self, duration: float) -> Job:
        """The job's first `duration` [s]."""
        return replace(self, target=self.target[: round(duration / self.machine.sample_time)])

    def reversal(self, pause: float = 0.05) -> Job:
        """One motion up, and after `pause` [s] one down, with an exact scale: what errors are measured on.

        Rounding by the scale would hide how exact a solver is.
        """
        machine, wanted = self.machine, self.machine.specification
        exact = replace(machine, scale=replace(machine.scale, resolution=0.0, noise=0.0))
        return Job(exact, self.controller, feeding_sequence(wanted.stroke, 1, pause, machine.sample_time))


def default_job() -> Job:
    """The sequence of Fig. 5 on the default machine, with the controller of `studies.deadbeat_design`."""
    machine = load()
    wanted = machine.specification
    target = feeding_sequence(wanted.stroke, wanted.motions, wanted.interval, machine.sample_time, REPEATS)
    return Job(machine, default_controller(machine), target)


def prepared(job: Job, substeps: int, initial_friction: Array | None = None) -> tuple[Loop, Run]:
    """What the kernels take: machine, controller and signals of the job; initial_friction (N,) [m], default 0."""
    return _prepare(job.machine, job.controller, references(job.controller, job.target), substeps, 0, initial_friction)


def variations(machine: Machine, count: int) -> list[Machine]:
    """`count` machines, the given one first, whose mass and friction differ by up to 5 %; equal dead time."""
    return [_scaled(machine, 1 + 0.05 * i / count, 1 - 0.05 * i / count) for i in range(count)]


def _scaled(machine: Machine, mass: float, friction: float) -> Machine:
    modes = tuple(replace(mode, gain=mode.gain / mass) for mode in machine.plant.modes)
    stiffness = tuple(friction * k for k in machine.friction.stiffness)
    return replace(
        machine,
        plant=replace(machine.plant, modes=modes),
        friction=replace(machine.friction, stiffness=stiffness),
    )
