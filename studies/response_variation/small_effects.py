"""What the paper leaves out as quite small in the micrometre motion (IV.C), and what it does not publish: in numbers.

Stiction, as a rise of every contact's limit at rest; viscous friction; and the dampers D_i of eq. (4).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, Final

import numpy as np

from design.validation import validate
from models.controller import Controller
from models.effects.friction_laws import Stribeck, ViscousFriction
from models.friction import elements
from models.machine import Machine
from models.quantity import show
from studies.response_variation.published import outcomes

LIGHT: Final = 0.02  # of critical damping that the dampers D_i give the mass on its stuck contacts


def small_effects(machine: Machine, controller: Controller) -> list[dict[str, Any]]:
    """Settling [s] and dispersion [m] of the machine as it is, and with each of the three, under one controller.

    The force [N] of each is its largest over the motions without compensation, of the speed that these have.
    """
    base = validate(machine, controller.without_compensation())
    speed = float(np.max(np.abs(np.diff(base.response.position)))) / machine.sample_time
    stiffness = np.array(machine.friction.stiffness)
    critical = 2 * math.sqrt(machine.plant.mass * float(np.sum(stiffness)))
    damped = elements(stiffness, machine.friction.limit, LIGHT * critical * stiffness / np.sum(stiffness))
    drag, stribeck = ViscousFriction.typical(machine.priors), Stribeck.typical(machine.priors)
    cases: tuple[tuple[str, str, Machine, float], ...] = (
        ("as it is", "", machine, 0.0),
        (
            "stiction",
            f"limits {100 * stribeck.rise:.0f} % higher at rest, lost over {show(stribeck.speed, 'm/s', 2)}",
            replace(machine, effects=(*machine.effects, stribeck)),
            stribeck.rise * machine.friction.coulomb_force,
        ),
        (
            "viscous friction",
            show(drag.coefficient, "N s/m", 2),
            replace(machine, effects=(*machine.effects, drag)),
            drag.coefficient * speed,
        ),
        (
            "dampers D_i of eq. (4)",
            f"{show(LIGHT * critical, 'N s/m', 2)} in all, in proportion to K_i",
            replace(machine, friction=damped),
            LIGHT * critical * speed,
        ),
    )
    return [_row(*case, controller) for case in cases]


def _row(name: str, size: str, machine: Machine, force: float, controller: Controller) -> dict[str, Any]:
    without, compensated = validate(machine, controller.without_compensation()), validate(machine, controller)
    bare, kept = outcomes(without), outcomes(compensated)
    return {
        "name": name,
        "size": size,
        "force_N": force,
        "reversal_settling_s": bare["reversal_settling_s"],
        "dispersion_without_m": bare["dispersion_m"],
        "compensated_settling_s": compensated.slowest.settling_time,
        "dispersion_with_m": kept["dispersion_m"],
    }
