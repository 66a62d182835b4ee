"""Which of a machine's effects a controller can meet ahead, along x_T*, and why it cannot meet the others.

What follows from the path and the thrust alone is replayed along x_T* (models/effect_feedforward.py) and added to u_rf.
A mode is not a force that could be added, and a lag of the thrust could only be undone by thrust that no drive has: the
feedforward is designed for a plant that has the mode, and a dead time that is longer by the lag.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final, TypeVar

from design.deadbeat import DesignError
from design.family import linear
from models.controller import Controller
from models.effect_feedforward import EffectFeedforward
from models.effects.base import Effect, Place
from models.effects.catalogue import named
from models.machine import Machine
from models.plant import Plant, delay_split

Made = TypeVar("Made")

MET: Final = frozenset({Place.THRUST, Place.PATH, Place.LIMIT, Place.FRICTION, Place.FORCE})
REASONS: Final = {
    Place.READING: "the scale shows the table elsewhere, and the feedback goes by the scale: repair or calibrate it",
    Place.CONTROL: "it is in the controller's own law: correct that law",
    Place.COMMAND: "it acts on single commands, the feedback's among them: no thrust along x_T* undoes it",
}
DRIVEN: Final = (
    "the friction drives it and the thrust does not: no thrust along x_T* holds it and leaves the rest alone"
)
CLOCKED: Final = "it follows a time whose beginning the controller does not know"


def left_out(machine: Machine) -> Mapping[str, str]:
    """The machine's effects, by name as in its file, that cannot be met along x_T*, each with the reason."""
    reasons = {name: _reason(effect) for name, effect in named(machine.effects).items()}
    return {name: reason for name, reason in reasons.items() if reason}


def designed_for(machine: Machine) -> Plant:
    """The plant with the modes and delays that the effects add: the one to design the feedforward for."""
    return linear(machine).late


def designed_with_effects(machine: Machine, synthesise: Callable[[Machine], Made]) -> tuple[Machine, Made, str]:
    """The machine with the plant to design the feedforward for, the feedforward, and why that plant lacks the effects'
    modes; empty if it has them. Raises DesignError where there is no feedforward without the modes, either."""
    whole = replace(machine, plant=designed_for(machine))
    try:
        return whole, synthesise(whole), ""
    except DesignError as error:
        if whole.plant.modes == machine.plant.modes:
            raise
        plain = replace(machine, plant=replace(whole.plant, modes=machine.plant.modes))
        return plain, synthesise(plain), str(error)


def with_effects(controller: Controller, machine: Machine) -> Controller:
    """The controller with the machine's effects met by u_rf, where they can be; the same one if none can."""
    met = tuple(
        effect for effect in machine.effects if effect.hooks and not effect.input_delay() and not _reason(effect)
    )
    if not met:
        return controller
    _, fractional_delay = delay_split(designed_for(machine).dead_time, machine.sample_time)
    return replace(controller, effect_compensation=EffectFeedforward(met, fractional_delay))


def _reason(effect: Effect) -> str:
    """Why the effect cannot be met; empty if it can."""
    places = [place for place in effect.hooks if place not in MET]
    if places:
        return REASONS[places[0]]
    if effect.friction_drives:
        return DRIVEN
    return CLOCKED if effect.depends_on_time else ""
