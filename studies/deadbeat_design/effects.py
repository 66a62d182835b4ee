"""A machine's effects on its motions, and how much of them a controller that knows them compensates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from design.controller import assemble
from design.deadbeat import Deadbeat, DesignError
from design.effect_compensation import designed_for, designed_with_effects, left_out, with_effects
from design.validation import Validation, validate
from models.controller import Controller
from models.effects.base import Effect
from models.effects.catalogue import named
from models.machine import Machine
from models.plant import Plant


@dataclass(frozen=True)
class Written:
    """The controller that is written, which knows the machine's effects, its feedforward, the plant that this is for,
    its validation, and what the effects add to results.json."""

    controller: Controller
    deadbeat: Deadbeat
    plant: Plant
    validation: Validation
    results: dict[str, Any]


def compensate(
    machine: Machine,
    plain: Deadbeat,
    judged: tuple[Validation, Validation],
    synthesise: Callable[[Machine], Deadbeat],
    seed: int,
) -> Written:
    """The controller that compensates the machine's effects, beside the one that does not.

    judged: the latter's validations, without and with its RFM. synthesise: the feedforward for another plant.
    """
    whole, deadbeat, refused = machine, plain, ""
    if designed_for(machine) != machine.plant:
        try:
            whole, deadbeat, refused = designed_with_effects(machine, synthesise)
        except DesignError as error:
            refused = str(error)
    bare, controller = assemble(machine, plain), assemble(whole, deadbeat)
    knowing = with_effects(controller, machine)
    stroke = plain.stroke
    found = validate(machine, knowing, stroke=stroke, seed=seed)
    cases = (
        ("without compensation", judged[0], bare.without_compensation(), machine),
        ("with the RFM", judged[1], bare, machine),
        ("with the RFM and the effects", found, controller, whole),
    )
    rows = []
    for name, one, law, plant in cases:
        ideal = validate(replace(plant, effects=()), law, stroke=stroke, seed=seed)
        rows.append({"name": name, **_row(one), "gap_m": _gap(one, ideal)})
    met = knowing.effect_compensation
    results = {
        "rows": rows,
        "met": [] if met is None else list(named(met.effects)),
        "designed_for": [name for name, one in named(machine.effects).items() if _in_plant(one, machine, whole)],
        "refused": refused,
        "left_out": left_out(machine),
    }
    return Written(knowing, deadbeat, whole.plant, found, {"effects": results})


def _in_plant(effect: Effect, machine: Machine, whole: Machine) -> bool:
    """Whether the plant of `whole`, beyond the machine's, has the modes or the delay of the effect."""
    longer = whole.plant.dead_time > machine.plant.dead_time
    return bool(effect.modes() and whole.plant.modes != machine.plant.modes) or (longer and effect.input_delay() > 0)


def _row(one: Validation) -> dict[str, float]:
    return {
        "reversal_s": one.reversal.settling_time,
        "settling_s": one.slowest.settling_time,
        "dispersion_m": one.worst_dispersion,
        "peak_thrust_N": one.peak_thrust,
    }


def _gap(one: Validation, ideal: Validation) -> float:
    """Root mean square [m] of the difference that the effects make to the table's position, over the last period."""
    return float(np.sqrt(np.mean((one.response.position - ideal.response.position) ** 2)))
