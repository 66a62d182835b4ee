"""What of a specification a design cannot meet, and why: by what would have to be absent for it to be met."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.effect_compensation import left_out
from design.judging.known_range import excess, fastest
from design.judging.sticking import named_modes, sticking
from design.redesign.designs import Design
from design.redesign.prediction import Prediction, predicted
from design.validation import sequence
from models.controller import references
from models.effects.catalogue import named
from models.machine import Machine
from models.quantity import keeps_to, listed, show

Array = NDArray[np.float64]

NARROWED: Final = "a further record would narrow it"
RUNS_PER_MACHINE: Final = 5  # of each machine that lacks something, from other pasts of the friction


def unmet(
    design: Design, machine: Machine, prediction: Prediction, seed: int = 0, left: Sequence[Array] = ()
) -> tuple[str, ...]:
    """Sentences: what is not met, each with its reason; empty where the specification is met in every run (SI).

    machine: as it is known now. prediction: the design's, on machines that the records allow. left: the force (n,) [N]
    of each record that no model explains, which acts in the prediction.
    """
    told = list(design.notes)
    if late_runs(prediction, machine):
        told.append(_late(design, machine, prediction, seed, left))
    floor = 3 * machine.scale.reading_deviation
    dispersion = prediction.interval("dispersion")
    if dispersion.median < 2 * floor:
        told.append(
            f"the predicted 3 sigma, {show(dispersion.median, 'm', 2)} in the median, is not far above the scale's "
            f"own: noise and rounding of its readings alone make {show(floor, 'm', 2)}"
        )
    return (*told, *_beyond(design, machine))


def late_runs(prediction: Prediction, machine: Machine) -> int:
    """In how many of its runs a design settles after the specified time, which `unmet` gives the reason for."""
    wanted = machine.specification.settling_time
    return sum(not keeps_to(float(one), wanted) for one in prediction.settling)


def _late(design: Design, machine: Machine, prediction: Prediction, seed: int, left: Sequence[Array]) -> str:
    """Why motions settle late: the first of these that, left out, makes them settle in time."""
    wanted, settling = machine.specification, prediction.interval("settling")
    late = late_runs(prediction, machine)
    head = (
        f"settling within {show(wanted.settling_time, 's')} is not met in every run: {late} of "
        f"{prediction.settling.size} are late, with {show(settling.low, 's', 3)} to {show(settling.high, 's', 3)} in "
        f"{settling.level:.0%}"
    )
    if left and _in_time(design, machine, seed) and not _in_time(design, machine, seed, left):
        return f"{head}; it is the force that no model explains"
    stays = left_out(machine)
    quiet = replace(machine, scale=replace(machine.scale, noise=0.0))
    plain = replace(machine, effects=tuple(one for name, one in named(machine.effects).items() if name not in stays))
    ways: list[tuple[str, Machine]] = [
        (f"it is the uncertainty of the parameters; {NARROWED}", machine),
        ("it is the scale's noise", quiet),
    ]
    if stays:
        names = listed([name.replace("_", " ") for name in stays])
        ways.append((f"it is {names}, which cannot be met ahead", plain))
    for why, without in ways:
        if _in_time(design, without, seed):
            return f"{head}; {why}"
    if not keeps_to(design.settling_time + machine.plant.dead_time, wanted.settling_time):
        return (
            f"{head}; the reference rests after {show(design.settling_time, 's')}, and the table follows it by the "
            f"dead time of {show(machine.plant.dead_time, 's')}"
        )
    found = sticking(machine, design.controller.feedback)
    if found is not None and found.modes:
        return f"{head}; while the friction sticks, the model's loop is unstable for {named_modes(found)}"
    return f"{head}; the friction that the compensator does not know at the start, and the feedback's own speed, decide"


def _in_time(design: Design, machine: Machine, seed: int, left: Sequence[Array] = ()) -> bool:
    """Whether the machine itself, with nothing drawn but the past of its friction, settles in time; left: a force
    (n,) [N] that acts on it."""
    found = predicted(design, [machine] * RUNS_PER_MACHINE, seed, left)
    return keeps_to(float(np.max(found.settling)), machine.specification.settling_time)


def _beyond(design: Design, machine: Machine) -> Sequence[str]:
    """What the design asks for beyond the records."""
    known = references(design.controller, sequence(machine, None, 1))
    force = float(np.max(np.abs(known.feedforward + known.compensation)))
    speed = fastest(known.position, machine.sample_time, machine)
    return [
        f"its {one.what} of {show(one.needed, one.unit, 3)} is beyond the records, which cover "
        f"{show(one.covered, one.unit, 3)}: there the model is extrapolated"
        for one in excess(machine, force, speed)
    ]
