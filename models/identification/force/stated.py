"""What effects that a machine file states make of a record: the force that is left for friction and inertia.

Along a measured path the commands become what the drive makes of them, and what pulls at the axis from outside is added
(models/simulation/effect_kernel.replay). An effect that delays commands counts in the delay, one that a clock drives
has another phase in every record, and one that acts on the scale or through the contacts is no force beside friction.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.effects.base import Effect
from models.friction import elements
from models.machine import Machine
from models.simulation.effect_kernel import Path, replay, touched

Array = NDArray[np.float64]

BESIDE_FRICTION: Final = frozenset({"thrust", "force"})  # keys of effect_kernel.ACTING
_NO_FRICTION: Final = elements(np.zeros(1), np.ones(1))


def along_the_path(machine: Machine) -> tuple[Effect, ...]:
    """The machine's effects whose force a measured path and the commands tell."""
    return tuple(one for one in machine.effects if _tells(one))


def _tells(effect: Effect) -> bool:
    acts = touched(effect)
    return bool(acts) and acts <= BESIDE_FRICTION and not (effect.depends_on_time or effect.input_delay() > 0)


def left_out(machine: Machine) -> tuple[str, ...]:
    """The names of the machine's effects that act on friction or on the scale, apart from a drag in proportion to the
    speed: a fit of friction by elements holds them for friction's own."""
    return tuple(
        one.name
        for one in machine.effects
        if touched(one) - BESIDE_FRICTION and not one.depends_on_time and one.viscous_drag() == 0
    )


def left_for_friction(
    effects: tuple[Effect, ...], path: Array, speed: Array, command: Array, sample_time: float
) -> Array:
    """The force (n,) [N] that friction, inertia and drag take up: the commands (n,) [N] as the drive makes them a
    thrust, and what pulls from outside, along a path (n,) [m] at a speed (n,) [m/s]."""
    if not effects:
        return command
    course = Path(sample_time, path[:, None], speed[:, None], path, command)
    acts = replay(_NO_FRICTION, effects, course, 0.0)
    return np.asarray(acts.thrust[:, 0] + acts.force[:, 0])
