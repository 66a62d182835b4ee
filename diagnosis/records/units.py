"""What the sizes of a diagnosis are counted in: a machine's own quantities, so that no setting fits one machine only.

A setting that stood in newtons, metres or seconds would be another one on a machine of another size. Here forces are
counted in the friction or in the white force that the scale's noise makes of it, lengths in what the contacts yield
before they slip, in the travel or in the scale's noise, times in samples or in the time of the control loop. The same
machine in other units of mass, length and time then gets the same answer.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from models.effects.priors import Units
from models.machine import Machine
from models.records.record import Record

WHITE_SHARE: Final = 0.89
"""Of the force that the scale's noise makes of the stiffest friction: the white process noise [1]. It stands for the
error of the friction, which is evaluated at a smoothed position; chosen so that complete models of simulated tables
leave white innovations."""
WITHOUT_FRICTION: Final = 0.02
"""The same, of the force that the noise makes of the loop's stiffness: the least there is [1]."""
WALK: Final = 0.05  # usual white forces a sample, by which the unknown force walks in the last step of a re-fit at most
WALK_IN_A_LOOP: Final = 0.14  # the same in a loop time: a random walk goes with the square root of time
WALK_OF_FRICTION: Final = 1.3e-3
"""The walk of the unknown force in a loop time, of the friction [1] at most. On a scale that is coarse for the contacts
the usual white force is large, but what it stands for does not walk: beside a force that walked by 0.0045 of the
friction a ripple and a drift were not seen on one machine of the trial. The paper's table has 0.0007, EMPS 0.00125."""
READABLE: Final = 1.3e-5  # of the contacts' length: noise of a reading that is said to have none
SOFT: Final = 1e-3  # of the loop's stiffness: contacts that are softer do not hold an axis, and
SLIGHT: Final = 1e-2  # of the rated thrust: friction that is less is not what its forces are like
OF_THRUST: Final = 0.1  # of the rated thrust: what stands for the friction of an axis that has next to none
SHORTEST_TRAVEL: Final = 1280.0  # contacts' lengths: what happens along the way does not happen within less


def contact_length(machine: Machine) -> float:
    """By how much the friction's contacts yield before they slip [m]: friction over stiffness. Of a machine whose
    friction does not hold it, its tolerance."""
    if not holds(machine):
        return machine.specification.tolerance
    return friction_force(machine) / sum(machine.friction.stiffness)


def holds(machine: Machine) -> bool:
    """Whether friction holds the axis where it stands: on an air bearing, whose cable chain is all the friction that
    it has, the loop does."""
    stiffness, force = sum(machine.friction.stiffness), friction_force(machine)
    by_loop = machine.plant.mass / loop_time(machine) ** 2
    return stiffness > 0 and force > 0 and (stiffness > SOFT * by_loop or force > SLIGHT * machine.drive.rated_thrust)


def usual_force(machine: Machine) -> float:
    """What an axis' forces are counted in [N]: the friction that holds it; without, a part of the rated thrust."""
    return friction_force(machine) if holds(machine) else OF_THRUST * machine.drive.rated_thrust


def loop_time(machine: Machine) -> float:
    """1 over the frequency [rad/s] to which the feedback controls the rigid body: where |kp + i w kd| = m w^2."""
    mass, pid = machine.plant.mass, machine.control.pid
    damped, stiff = (pid.kd / mass) ** 2, (pid.kp / mass) ** 2
    squared = (damped + math.sqrt(damped**2 + 4 * stiff)) / 2
    return 1 / math.sqrt(squared) if squared > 0 else machine.specification.settling_time


def noise(machine: Machine) -> float:
    """Deviation [m] of the reading: the scale's noise and its rounding."""
    return max(machine.scale.noisy().reading_deviation, READABLE * contact_length(machine))


def white_force(machine: Machine) -> float:
    """The white force [N] that a machine's model leaves where nothing is missing."""
    reading = noise(machine)
    by_contacts = min(sum(machine.friction.stiffness) * reading, friction_force(machine))
    by_loop = machine.plant.mass / loop_time(machine) ** 2 * reading
    return max(WHITE_SHARE * by_contacts, WITHOUT_FRICTION * by_loop)


def slow_walk(machine: Machine) -> float:
    """The walk [usual white forces a sample] of the unknown force beside which effects are sought: so slow that it
    leaves them what changes along the travel or the record, however finely a machine is sampled and however coarse
    its scale is."""
    in_a_loop = WALK_IN_A_LOOP
    if holds(machine):
        in_a_loop = min(in_a_loop, WALK_OF_FRICTION * friction_force(machine) / white_force(machine))
    return min(WALK, in_a_loop * math.sqrt(machine.sample_time / loop_time(machine)))


def units(machine: Machine, records: Sequence[Record] = ()) -> Units:
    """The quantities that the usual sizes of effects are counted in; the travel is what the records show."""
    contact = contact_length(machine)
    travels = [np.ptp(one.reference) or np.ptp(one.position) for one in records]
    return Units(
        force=usual_force(machine),
        thrust=machine.drive.rated_thrust,
        mass=1 / machine.plant.modes[machine.plant.rigid].gain,
        contact=contact,
        travel=max(float(max(travels, default=0.0)), SHORTEST_TRAVEL * contact),
        reading=noise(machine),
        loop=loop_time(machine),
        sample=machine.sample_time,
    )


def with_units(machine: Machine, records: Sequence[Record]) -> Machine:
    """The machine with the usual sizes of effects as they are in it and along these records' ways [SI]."""
    return replace(machine, priors=replace(machine.priors, units=units(machine, records)))


def friction_force(machine: Machine) -> float:
    """The friction [N] where every contact slips."""
    return float(np.dot(machine.friction.stiffness, machine.friction.limit))
