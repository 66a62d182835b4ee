"""What a controller.json holds beside the design itself, so that the law can be written from it alone."""

from __future__ import annotations

from typing import Any

from design.validation import sequence
from design.wiping import wipe, wipe_path, wipe_to_json
from models.controller import Controller, to_json
from models.deployment.coefficients import deployment_to_json, planned
from models.machine import Machine


def controller_to_json(
    machine: Machine,
    controller: Controller,
    stroke: float,
    settling_time: float,
) -> dict[str, Any]:
    """The whole content of controller.json for a feedforward designed for stroke [m] and settling_time [s]; what its
    effects ask for is planned for motions after the wipe, as before it nothing is known of the contacts."""
    content = {
        **to_json(controller, stroke, settling_time),
        **deployment_to_json(machine.drive.rated_thrust, machine.scale.resolution, machine.drive.offset),
        "wipe": wipe_to_json(wipe(machine)),
    }
    if controller.effect_compensation is not None:
        target = sequence(machine, stroke, periods=1)
        thrust = planned(controller, target, wipe_path(machine))
        content["effect_compensation"]["plan"] = {"target_m": target, "thrust_N": thrust}
    return content
