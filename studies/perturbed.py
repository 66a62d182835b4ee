"""Tables that are off in one thing or in everything at once, on which a design that is to hold anywhere is judged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from models.machine import Machine
from models.variation import Variation, varied

MODE_RANGE: Final = 0.03  # relative error of each frequency
# Of the tables that a design is judged on, either way and evenly; each mode has a frequency error of its own.
RANGE: Final = Variation(friction_force=0.3, friction_length=0.3, mass=0.03, frequency=MODE_RANGE)
MODE_GAIN: Final = 0.2  # relative errors, either way and evenly
DAMPING: Final = 0.5
DEAD_TIME: Final = 0.2
OFFSET_FRICTION_SHARE: Final = 2 / 16.5  # of the Coulomb force: 2 N on the default machine
# Of the specified tolerance: what a design that meets all of this is to settle within.
STRICT_TOLERANCE_SHARE: Final = 0.25
TOGETHER: Final = "all together"


@dataclass(frozen=True)
class Perturbed:
    """What the tables are off by: the variation's ranges, whether the friction's start is unknown, and whether the
    scale is noisy."""

    within: Variation
    start: bool = False
    noise: bool = False


def perturbations(machine: Machine) -> dict[str, Perturbed]:
    """Each perturbation that changes this machine by its name, and all of them together as the last, TOGETHER.

    A rigid axis has no modes and one without a dead time none that could be off: tables "off in" them would be the
    machine itself.
    """
    gain = tuple(0.0 if mode.frequency == 0 else MODE_GAIN for mode in machine.plant.modes)
    parts: dict[str, dict[str, Any]] = {
        "friction's force and length": {
            "friction_force": RANGE.friction_force,
            "friction_length": RANGE.friction_length,
        },
        "mass and mode frequencies" if machine.plant.flexible else "mass": {
            "mass": RANGE.mass,
            "frequency": MODE_RANGE,
        },
        "mode gains": {"modal_gain": gain},
        "damping": {"damping": DAMPING},
        "dead time": {"dead_time": DEAD_TIME * machine.plant.dead_time},
        "constant force": {"offset": OFFSET_FRICTION_SHARE * machine.friction.coulomb_force},
    }
    as_it_is = varied(machine, Variation())
    each = {name: Variation(**part) for name, part in parts.items()}
    found = {name: Perturbed(within) for name, within in each.items() if varied(machine, within) != as_it_is}
    found["friction's state at the start"] = Perturbed(Variation(), start=True)
    if machine.scale.noisy() != machine.scale:
        found["scale's noise"] = Perturbed(Variation(), noise=True)
    together = {key: most for part in parts.values() for key, most in part.items()}
    found[TOGETHER] = Perturbed(Variation(**together), start=True, noise=True)
    return found
