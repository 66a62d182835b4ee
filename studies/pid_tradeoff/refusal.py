"""Why no PID keeps to the bounds, in words, and what to do."""

from __future__ import annotations

import math

from design.family import slopes
from design.judging.sticking import cause_of, state_of, sticking
from design.limits import highest_crossover
from design.pid.problem import TuningError
from models.machine import Machine
from models.quantity import show


def refusal(machine: Machine, error: TuningError, ms: float) -> str:
    """Why no PID was found up to |S| <= ms [1], and what to do. Where the friction of the model does work on the axis
    through a mode of negative gain, neither bounds nor the dead time are the reason."""
    found = sticking(machine)
    if found is None or not found.modes:
        return f"{error}{_dead_time(machine, ms)}"
    tried = "; ".join(f"{attempt.start}: {attempt.outcome}" for attempt in error.attempts)
    return (
        f"{error.reason} ({tried}); with the present feedback, too, {state_of(found)}. The cause is {cause_of(found)}; "
        "keep the present feedback and judge it by a record"
    )


def _dead_time(machine: Machine, ms: float) -> str:
    """The dead time as a reason why no PID keeps to |S| <= ms [1]; empty where it is not long.

    Behind a reversal the mass swings on the undamped contacts, which a loop can damp up to its crossover only.
    """
    crossover = float(highest_crossover(machine.plant, machine.sample_time, ms)[0])
    swing = math.sqrt(max(slopes(machine).values()) / machine.plant.mass)
    if crossover >= swing:
        return ""
    return (
        f"; within |S| <= {ms:g} a dead time of {show(machine.plant.dead_time, 's')} allows a crossover of at most "
        f"{show(crossover / (2 * math.pi), 'Hz', 3)}, below the {show(swing / (2 * math.pi), 'Hz', 3)} at which the "
        "mass swings on its contacts: shorten the dead time"
    )
