"""The motion that makes the friction's state known: out and back by more than twice the longest presliding length.

An element of limit X_m slips at the latest after 2 X_m in one direction, wherever it stood before. So after a motion of
more than twice the longest limit every element is at its limit, in the machine and in the compensator alike: the past
is wiped out, whatever it was. The second motion, back to where the first began, is not needed for the state; the
thrust that holds the table after each of the two gives the Coulomb force and the constant force.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.controller import usable_thrust
from design.friction_compensation import with_force
from design.validation import respond
from models.controller import Controller, References, compensator_path
from models.deployment.coefficients import STEEPEST, planned
from models.friction import Friction, follow
from models.machine import Machine
from models.records.record import motions
from models.records.settling import settling_time

Array = NDArray[np.float64]

MARGIN: Final = 1.5  # times 2 X_m, as the presliding lengths of the file may be too short by up to a third
# Of the thrust that friction leaves, and of the rated speed: the wipe only has to be smooth.
USED_LIMIT_SHARE: Final = 0.1
SETTLINGS: Final = 10  # settling times that one stroke takes at least, so that the feedback follows the friction
REST: Final = 5  # settling times that the table rests after each stroke
FASTEST: Final = 15 / 8  # with STEEPEST: largest acceleration T^2 / W, and speed T / W, of the profile below


@dataclass(frozen=True)
class Wipe:
    """Out by `distance` [m] and back, each stroke in `duration` [s] along 10 s^3 - 15 s^4 + 6 s^5, then `rest` [s].

    speed [m/s] and thrust [N]: the largest that it takes, friction not counted.
    """

    distance: float
    duration: float
    rest: float
    speed: float
    thrust: float

    @property
    def time(self) -> float:
        """Time [s] that it takes altogether."""
        return 2 * (self.duration + self.rest)


def wipe(machine: Machine) -> Wipe:
    """The wipe of a machine, from its longest element, mass, rated thrust and speed, and settling time."""
    distance = MARGIN * 2 * max(with_force(machine.friction).limit or machine.friction.limit)
    settling, mass = machine.specification.settling_time, machine.plant.mass
    left = max(usable_thrust(machine), USED_LIMIT_SHARE * machine.drive.rated_thrust)
    times = [SETTLINGS * settling, math.sqrt(STEEPEST * mass * distance / (USED_LIMIT_SHARE * left))]
    times.append(FASTEST * distance / (USED_LIMIT_SHARE * machine.drive.rated_speed))
    duration = math.ceil(max(times) / machine.sample_time) * machine.sample_time
    speed, thrust = FASTEST * distance / duration, STEEPEST * mass * distance / duration**2
    return Wipe(distance, duration, REST * settling, speed, thrust)


def wipe_references(machine: Machine, one: Wipe) -> tuple[References, NDArray[np.int64]]:
    """x_T* [m], u_ff [N] and u_rf = 0 (n,) of a wipe, from rest at 0 and back, and the last sample of each rest (2,).

    The friction is left to the feedback: its state is not known yet.
    """
    ts, mass = machine.sample_time, machine.plant.mass
    count, still = round(one.duration / ts), round(one.rest / ts)
    s = np.arange(1, count + 1) / count
    way = one.distance * s**3 * (10 - 15 * s + 6 * s**2)
    force = mass * one.distance / one.duration**2 * s * (60 - 180 * s + 120 * s**2)
    out, push = np.append(way, np.full(still, one.distance)), np.append(force, np.zeros(still))
    position, thrust = np.append(out, one.distance - out), np.append(push, -push)
    return References(position, thrust, np.zeros(position.size)), np.array([out.size - 1, position.size - 1])


def wipe_path(machine: Machine) -> Array:
    """x_T* (m,) [m] of a machine's wipe, from rest at 0 and back: what its contacts, and the compensator's, have behind
    them in the first motion after it."""
    return wipe_references(machine, wipe(machine))[0].position


def carried_on(friction: Friction, past: Array, path: Array, virgin: References) -> References:
    """`virgin` with the u_rf [N] of elements that were led along `past` (m,) and are now led along `path` (n,) [m].

    virgin: x_T*, u_ff and u_rf where the elements are virgin at the beginning of `path`.

    The feedback's integral holds the friction's force at the start, so u_rf is the change from there on: it is switched
    on without a bump.
    """
    force, _ = follow(friction, np.append(past[-1], path), follow(friction, past)[1])
    before, _ = follow(friction, np.append(0.0, path))
    change = virgin.compensation + (force - before)[1:] - force[0]
    return References(virgin.position, virgin.feedforward, change)


@dataclass(frozen=True)
class FromStarts:
    """Settling times (starts, motions) [s] where the compensator takes the friction to be virgin, and after a wipe.

    apart: the largest difference [N] between the forces of the machine's and the compensator's elements after the wipe.
    """

    unwiped: Array
    wiped: Array
    apart: float


def after_wipe(machine: Machine, controller: Controller, target: Array, virgin: References) -> References:
    """x_T*, u_ff and u_rf (n,) [m], [N] of a controller over a target (n,) [m] after the machine's wipe: of elements
    that were led along it, and of what the effects ask for from there on. virgin: those from the virgin state."""
    past, rfm = wipe_path(machine), controller.friction_compensation
    known = virgin if rfm is None else carried_on(rfm, past, compensator_path(controller, target), virgin)
    if controller.effect_compensation is None:
        return known
    more = np.array(planned(controller, target, past)) - np.array(planned(controller, target))
    return References(known.position, known.feedforward, known.compensation + more)


def from_starts(
    machine: Machine,
    controller: Controller,
    compensator: Friction,
    given: References,
    wiped: References,
    target: Array,
    starts: Array,
    seed: int = 0,
) -> FromStarts:
    """What each of the elements' `starts` (count, N) [m] costs in the motions of a target (n,) [m].

    given, wiped: x_T*, u_ff and u_rf over the target from the virgin state of the compensator's elements, and after the
    machine's wipe. Settled is what stays within the machine's specified tolerance [m]; seed: of the scale's noise.
    """
    machines, tolerance = [machine] * len(starts), machine.specification.tolerance

    def settling(elements: list[Array], references: References) -> Array:
        found = respond(machines, controller, target, given=references, seed=seed, initial_friction=elements)
        return np.array(
            [
                [
                    settling_time(one.position[part.start : part.stop] - part.target, tolerance, machine.sample_time)
                    for part in motions(target)
                ]
                for one in found
            ]
        )

    known, _ = wipe_references(machine, wipe(machine))
    ran = respond(machines, controller, known.position, given=known, seed=seed, initial_friction=list(starts))
    elements, ends = [one.elements for one in ran], follow(compensator, known.position)[0][-1]
    apart = max(abs(float(np.dot(machine.friction.stiffness, one)) - float(ends)) for one in elements)
    return FromStarts(settling(list(starts), given), settling(elements, wiped), apart)


def wipe_to_json(one: Wipe) -> dict[str, Any]:
    """The wipe as controller.json holds it."""
    return {
        "distance_m": one.distance,
        "duration_s": one.duration,
        "rest_s": one.rest,
        "profile": "10 s^3 - 15 s^4 + 6 s^5",
        "peak_speed_m_per_s": one.speed,
        "peak_thrust_N": one.thrust,
    }
