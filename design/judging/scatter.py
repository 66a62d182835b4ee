"""The outcome of a design over small chances: a dither of the reading, and what the friction remembers of its past.

A single simulated run meets one rounding of the scale at each sample. A dither far below the resolution changes these
roundings, and a settling time that hangs on one of them shows it. The past of the friction changes what the elements
hold when the sequence begins; the compensator knows it, as it does behind a wipe.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.validation import Validation, assess, sequence
from design.wiping import carried_on
from models.controller import Controller, References, compensator_path, references
from models.friction import follow, random_pasts
from models.machine import Machine
from models.records.settling import Margin, settling_margin
from models.simulation.simulator import simulate

Array = NDArray[np.float64]

DITHER_STEPS: Final = 0.01  # of the scale's resolution that the dither has: 1 nm on the paper's table
# Of the tolerance that it has at least, where a scale is finer than it has to be.
MIN_DITHER_TOLERANCES: Final = 1 / 2000
PERIODS: Final = 2  # of the sequence; the last is judged


@dataclass(frozen=True)
class Scatter:
    """Outcomes of runs, each with a dither and a past of its own, in the order of the runs: arrays (runs,).

    reversal, slowest: settling times [s] of the first positive motion and of the slowest of all. dispersion [m]: the
    largest 3 sigma after the specified time. margins [m]: how much the slowest motion's error has to change for another
    settling time.
    """

    reversal: Array
    slowest: Array
    dispersion: Array
    margins: Array


def dither_of(machine: Machine) -> float:
    """The standard deviation [m] of the dither: a hundredth of a step of the scale, or 1/2000 of the tolerance."""
    return max(DITHER_STEPS * machine.scale.resolution, MIN_DITHER_TOLERANCES * machine.specification.tolerance)


def scatter(
    machine: Machine,
    controller: Controller,
    count: int,
    seed: int,
    *,
    stroke: float | None = None,
    periods: int = PERIODS,
    given: References | None = None,
    start: Array | None = None,
) -> Scatter:
    """`count` runs of the sequence with strokes of `stroke` [m] (default: the specification's), `periods` times each.

    given: x_T*, u_ff and u_rf of all runs instead of the controller's own; each run then begins with the friction that
    they are made for, whose elements stand at `start` (N,) [m], default 0. seed: of dithers and pasts.
    """
    size, target = dither_of(machine), sequence(machine, stroke, periods)
    noise = math.hypot(machine.scale.noise, size)
    noisy = replace(machine, scale=replace(machine.scale, noise=noise))
    pasts = random_pasts(machine.friction, count, seed)
    virgin = references(controller, target) if given is None else given
    found = []
    for i, past in enumerate(pasts):
        begun, known = (start, virgin) if given is not None else _after_past(machine, controller, past, target, virgin)
        response = simulate(noisy, controller, target, seed=seed + 1 + i, initial_friction=begun, given=known)
        found.append(assess(noisy, response, stroke=stroke, periods=periods))
    return Scatter(
        np.array([one.reversal.settling_time for one in found]),
        np.array([one.slowest.settling_time for one in found]),
        np.array([one.worst_dispersion for one in found]),
        np.array([margin_of(one).nearest for one in found]),
    )


def _after_past(
    machine: Machine, controller: Controller, past: Array, target: Array, virgin: References
) -> tuple[Array, References]:
    """The machine's elements (N,) [m] behind a past (m,) [m], and what a compensator that was led along it puts out."""
    rfm = controller.friction_compensation
    known = virgin if rfm is None else carried_on(rfm, past, compensator_path(controller, target), virgin)
    return follow(machine.friction, past)[1], known


def margin_of(validation: Validation, *, reversal: bool = False) -> Margin:
    """What the settling time of a validation's slowest motion, or of its reversal, hangs on [m], [s]."""
    wanted, ts = validation.machine.specification, validation.machine.sample_time
    motion = validation.reversal if reversal else validation.slowest
    return settling_margin(motion.error, wanted.tolerance, ts)
