"""The plants that one controller has to hold: the machine's, in every state of its friction, and what it could be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

from design.loop import dominant_pole
from models.controller import Feedback
from models.machine import Machine
from models.plant import Mode, Plant, sampled
from models.variation import Variation, known, varied_plant

if TYPE_CHECKING:
    import control

MODE_ERROR: Final = 0.03  # relative, of the modes' frequencies,
MASS_ERROR: Final = 0.1  # and of the mass, that a family covers where the machine file does not know them worse
DEVIATIONS: Final = 3.0  # that it covers of a value that the file states one for,
LARGEST_ERROR: Final = 0.49  # up to here


@dataclass(frozen=True)
class Member:
    """One sampled plant of a family; `nominal` if it is the machine as it is known, at one of the friction's slopes."""

    name: str
    plant: control.StateSpace
    nominal: bool = True


def family(
    machine: Machine, mode_error: float = MODE_ERROR, mass_error: float = MASS_ERROR, others: Sequence[Machine] = ()
) -> tuple[Member, ...]:
    """P_l, P_e1, P_e2 and the steepest slope sum K_i, each also with all modes' frequencies and the mass off.

    mode_error, mass_error [1]: relative, to both sides; the mass is the rigid body's, as a payload changes it. others:
    further machines that could be this one (an ensemble); of each the four plants as they are. All with what the
    machine's effects add, as far as that is linear.
    """
    variants = {"": machine.plant}
    for sign in (-1, 1):
        if mode_error > 0:
            variants[f", modes {100 * sign * mode_error:+g} %"] = varied_plant(
                machine.plant, Variation(frequency=sign * mode_error)
            )
        if mass_error > 0:
            variants[f", mass {100 * sign * mass_error:+g} %"] = varied_plant(
                machine.plant, Variation(payload=sign * mass_error)
            )
    members = [
        Member(name + variant, with_effects(machine, plant, slope), not variant)
        for variant, plant in variants.items()
        for name, slope in slopes(machine).items()
    ]
    members += [
        Member(f"{name} of {other.name}", with_effects(other, other.plant, slope), False)
        for other in others
        for name, slope in slopes(other).items()
    ]
    return tuple(members)


def usual_errors(machine: Machine) -> tuple[float, float]:
    """The relative errors [1] of the modes' frequencies and of the mass that a family covers unless asked otherwise:
    usual ones, or what the file says that it knows less well. A loop is not to hold on a narrower family than usual
    because an identification is sure of itself."""
    stated = {one.name: max(one.relative) for one in known(machine) if one.origin == "value"}
    modes = [stated.get(f"plant.modes.{i + 1}.frequency", 0.0) for i in machine.plant.flexible]
    gain = stated.get(f"plant.modes.{machine.plant.rigid + 1}.gain", 0.0)
    mass = math.hypot(gain, stated.get("plant.thrust_constant", 0.0))  # a loop's gain is their product
    covered = (max(MODE_ERROR, DEVIATIONS * max(modes, default=0.0)), max(MASS_ERROR, DEVIATIONS * mass))
    return min(covered[0], LARGEST_ERROR), min(covered[1], LARGEST_ERROR)


def slopes(machine: Machine) -> dict[str, float]:
    """The friction's slopes K_e [N/m] at which a loop has to hold, by the name of their plant."""
    facts = machine.presliding
    steepest = sum(machine.friction.stiffness)
    return {"P_l": 0.0, "P_e1": facts.stiffness_1, "P_e2": facts.stiffness_2, "steepest": steepest}


@dataclass(frozen=True)
class Linear:
    """What a machine's effects add to its plant that is linear: the modes are in `plant`, and delays that are no lag.

    lag [s]: of the thrust behind its command; drag [N s/m]; spring to ground [N/m]; by_friction: modes that the
    friction drives and the thrust does not.
    """

    plant: Plant
    lag: float
    drag: float
    spring: float
    by_friction: tuple[Mode, ...] = ()

    @property
    def late(self) -> Plant:
        """The plant with the lag as further dead time, for rules that know no other."""
        return replace(self.plant, dead_time=self.plant.dead_time + self.lag)


def linear(machine: Machine, plant: Plant | None = None) -> Linear:
    """The linear part of a machine's effects around a plant, by default its own."""
    effects, around = machine.effects, plant or machine.plant
    lag = sum(effect.lag() for effect in effects)
    late = sum(effect.input_delay() for effect in effects) - lag
    modes = sum((effect.modes() for effect in effects if not effect.friction_drives), around.modes)
    return Linear(
        replace(around, modes=modes, dead_time=around.dead_time + late),
        lag,
        sum(effect.viscous_drag() for effect in effects),
        sum(effect.spring_to_ground() for effect in effects),
        sum((effect.modes() for effect in effects if effect.friction_drives), ()),
    )


def with_effects(
    machine: Machine, plant: Plant | None = None, slope: float = 0.0, *, parts: int = 1
) -> control.StateSpace:
    """The plant, by default the machine's, at a slope of the friction [N/m], with the linear part of the effects; so
    many times as fast sampled as the controller."""
    known = linear(machine, plant)
    return sampled(
        known.plant,
        machine.sample_time / parts,
        slope + known.spring,
        damping=known.drag,
        lag=known.lag,
        by_friction=known.by_friction,
    )


def largest_pole(machine: Machine, feedback: Feedback) -> float:
    """Largest magnitude [1] of the eigenvalues of the loop on the rolling axis: above 1 it is unstable."""
    known = linear(machine)
    held = (known.spring, known.drag, known.lag, known.by_friction)
    return abs(dominant_pole(known.plant, feedback, machine.sample_time, *held))
