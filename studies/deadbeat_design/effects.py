"""A machine's effects on its motions, and how much of them a controller that knows them compensates."""

from __future__ import annotations

from collections.abc import Callable, Mapping
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
from studies.wording import effects_listed


@dataclass(frozen=True)
class Written:
    """The controller that is written, which knows the machine's effects, its feedforward, the plant that this is for,
    its validation, and what the effects add to results.json."""

    controller: Controller
    deadbeat: Deadbeat
    plant: Plant
    validation: Validation
    results: dict[str, Any]


@dataclass(frozen=True)
class Knowing:
    """The feedforward that knows the machine's effects, and the plant that it is for; `refused` says why that plant
    lacks what they add to it, and is empty if it has it."""

    deadbeat: Deadbeat
    plant: Plant
    refused: str = ""


def _goes_by_place(effect: Effect) -> bool:
    """Whether a force is another one for the same motion from another place; that of a spring is a constant more."""
    return effect.coordinate in {"", "position"} and effect.spring_to_ground() == 0


def by_place_rows(results: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Where motions have to begin for the plan to be theirs, for the terminal; nothing where that is all the same."""
    names = results.get("effects", {}).get("by_place", ())
    if not names:
        return []
    kinds = list(dict.fromkeys(name.partition(".")[0] for name in names))
    told = (
        "it is for motions from where the position reads 0, and so is what is said here; from elsewhere "
        f"{effects_listed(kinds)} pull{'s' if len(kinds) == 1 else ''} otherwise, so that it may do harm: design with "
        "the phases of that place, or run without the plan"
    )
    return [("WARNING, plan of effects that go by the place", told)]


def knowing(machine: Machine, plain: Deadbeat, synthesise: Callable[[Machine], Deadbeat]) -> Knowing:
    """The feedforward for the plant with the modes and delays of the machine's effects; `plain`, which is for the plant
    without, where there is none. synthesise: the feedforward for another plant."""
    if designed_for(machine) == machine.plant:
        return Knowing(plain, machine.plant)
    try:
        whole, deadbeat, refused = designed_with_effects(machine, synthesise)
    except DesignError as error:
        return Knowing(plain, machine.plant, str(error))
    return Knowing(deadbeat, whole.plant, refused)


def compensate(
    machine: Machine, plain: Deadbeat, known: Knowing, judged: tuple[Validation, Validation], seed: int
) -> Written:
    """The controller that compensates the machine's effects, beside the one that does not.

    judged: the latter's validations, without and with its RFM.
    """
    whole, deadbeat, refused = replace(machine, plant=known.plant), known.deadbeat, known.refused
    bare, controller = assemble(machine, plain), assemble(machine, deadbeat, known.plant)
    informed = with_effects(controller, machine)
    stroke = plain.stroke
    found = validate(machine, informed, stroke=stroke, seed=seed)
    cases = (
        ("without compensation", judged[0], bare.without_compensation(), machine),
        ("with the RFM", judged[1], bare, machine),
        ("with the RFM and the effects", found, controller, whole),
    )
    rows = []
    for name, one, law, plant in cases:
        ideal = validate(replace(plant, effects=()), law, stroke=stroke, seed=seed)
        rows.append({"name": name, **_row(one), "gap_m": _gap(one, ideal)})
    met = informed.effect_compensation
    results = {
        "rows": rows,
        "met": [] if met is None else list(named(met.effects)),
        "by_place": [] if met is None else [name for name, one in named(met.effects).items() if _goes_by_place(one)],
        "designed_for": [name for name, one in named(machine.effects).items() if _in_plant(one, machine, whole)],
        "refused": refused,
        "left_out": left_out(machine),
    }
    return Written(informed, deadbeat, whole.plant, found, {"effects": results})


def _in_plant(effect: Effect, machine: Machine, whole: Machine) -> bool:
    """Whether the plant of `whole`, beyond the machine's, has the modes or the delay of the effect."""
    longer = whole.plant.dead_time > machine.plant.dead_time
    modes = effect.modes() if not effect.friction_drives else ()
    return bool(modes and whole.plant.modes != machine.plant.modes) or (longer and effect.input_delay() > 0)


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
