"""The designs that a machine admits: feedforward, friction and effect compensation, and another PID of equal margin.

Each is made by the same rules from whatever machine it is given: from the machine as it was known, as it is known now
or, on a machine that was withheld, as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.controller import assemble, design_deadbeat, usable_thrust
from design.deadbeat import Constraints, Deadbeat, DesignError, shortest_settling_time
from design.effect_compensation import designed_with_effects, left_out, with_effects
from design.family import family, largest_pole
from design.friction_compensation import with_force
from design.loop import assess
from design.pid.goal import Goal
from design.pid.problem import Bounds, TuningError, mt_bound
from design.pid.rules import magnitude, slow_rule
from design.pid.tuning import noise_bound, pose, tune
from models.controller import Controller, References, references
from models.feedback.law import follow
from models.machine import Machine
from models.machines.parts import MOST_COMPENSATED
from models.quantity import show

Array = NDArray[np.float64]

LEAST_MS: Final = 1.5  # a bound on |S| below which no PID with an integral does anything for friction
STABLE: Final = 1.0  # magnitude of a pole from which on a loop is not stable


@dataclass(frozen=True)
class Design:
    """A controller with the stroke [m] and the settling time [s] of its feedforward; notes: what was asked of it and
    could not be met, each with the reason."""

    name: str
    controller: Controller
    stroke: float
    settling_time: float
    notes: tuple[str, ...] = ()


def designed(machine: Machine, name: str, *, effects: bool = True, every_element: bool = True) -> Design:
    """The feedforward and compensation of a machine, around the feedback in place (SI).

    effects: whether those of the machine are met, too. every_element: whether the compensator has all elements of the
    friction, in place of the number that the file states. A settling time that the thrust does not allow
    is replaced by the shortest that it does, which the notes say. Raises DesignError where there is none.
    """
    machine = with_all_elements(machine, every_element=every_element)
    plain = replace(machine, effects=()) if not effects else machine
    whole, (deadbeat, late), refused = designed_with_effects(plain, _deadbeat)
    notes = [f"the modes of its effects are not in the feedforward: {refused}"] if refused else []
    notes += [late] if late else []
    controller = assemble(plain, deadbeat, whole.plant)
    if effects:
        controller = with_effects(controller, machine)
        notes += [f"{effect.replace('_', ' ')} stays: {why}" for effect, why in left_out(machine).items()]
    return Design(name, controller, deadbeat.stroke, deadbeat.settling_time, tuple(notes))


def with_all_elements(machine: Machine, *, every_element: bool = True) -> Machine:
    """The machine whose compensator has all elements of the friction, or at least a stated number of them: for "auto"
    all, too, as another search would find another number for each machine."""
    if machine.control.compensator_elements != "auto" and not every_element:
        return machine
    count = min(max(len(with_force(machine.friction).limit), 1), MOST_COMPENSATED)
    return replace(machine, control=replace(machine.control, compensator_elements=count))


def _deadbeat(machine: Machine) -> tuple[Deadbeat, str]:
    """The feedforward, which rests after whole samples, and why it is slower than was asked for; empty where it is
    not."""
    wanted, ts, limit = machine.specification, machine.sample_time, usable_thrust(machine)
    asked = max(round(wanted.reference_settling_time / ts), 1) * ts
    try:
        return design_deadbeat(machine, settling_time=asked), ""
    except DesignError:
        shortest = shortest_settling_time(machine.plant, ts, wanted.stroke, Constraints(thrust=limit))
        if not asked < shortest < wanted.interval:
            raise
        why = (
            f"the reference rests after {show(shortest, 's')} instead of {show(asked, 's')}: sooner takes more thrust "
            f"than the {show(limit, 'N')} that friction leaves of {show(machine.drive.rated_thrust, 'N')}"
        )
        return design_deadbeat(machine, settling_time=shortest), why


def retuned(design: Design, machine: Machine, before: Machine, others: Sequence[Machine], name: str) -> Design:
    """The design with the PID of most integral gain whose loop has no larger peak of |S| than the one in place had.

    The peak is that of the feedback in place on `before`, the machine that it was tuned for, over the slopes of the
    friction; the new PID keeps to it on `machine` and on each of `others`, machines that could be this one. Where it
    cannot, or another structure than a PID is in place, the feedback stays and the notes say why.
    """
    if before.control.law is not None:
        why = f"the feedback stays as it is: {before.control.in_words} is in place, and only a plain PID is retuned"
        return replace(design, name=name, notes=(*design.notes, why))
    present = before.control.pid
    loops = [assess(member.plant, present) for member in family(before, 0.0, 0.0)]
    ms = max(LEAST_MS, *(loop.ms.value for loop in loops))
    here = family(machine, 0.0, 0.0, others)
    mcs = noise_bound(machine, [assess(member.plant, present) for member in here])
    starts = [("the PID in place", present), ("slow rule", slow_rule(machine))]
    stable = [(start, pid) for start, pid in starts if largest_pole(machine, pid) < STABLE]
    try:
        if not all(loop.stable for loop in loops) or not stable:
            raise TuningError("the loop to start from is not stable")
        found = tune(pose(here, Goal(), magnitude(machine)), Bounds(ms, mt_bound(ms), mcs), stable)
    except ValueError as error:
        reason = error.reason if isinstance(error, TuningError) else str(error)
        why = f"the PID stays as it is: {reason}"
        return replace(design, name=name, notes=(*design.notes, why))
    return replace(design, name=name, controller=design.controller.with_feedback(found.pid))


def retuned_alone(design: Design, machine: Machine, before: Machine, name: str) -> Design:
    """Another PID for the old feedforward; see `retuned`."""
    return retuned(replace(design, notes=()), machine, before, (), name)


def in_place(design: Design, machine: Machine, target: Array) -> References:
    """What to give the loop that runs on the machine, with its own feedback, for it to do what the design does.

    target (n,) [m]. The loop in place lets its reference wait, and may weigh it: what it would put out on x_T* beyond
    the design's feedback, which puts out nothing there, is taken off the feedforward. Only for a design that keeps the
    feedback.
    """
    known, control = references(design.controller, target), machine.control
    late = design.controller.reference_delay - control.reference_delay
    path, feedforward, compensation = known.position, known.feedforward, known.compensation
    if late > 0:  # the table is to be on x_T* later than the loop in place expects it
        path = _later(path, late)
    elif late < 0:
        feedforward, compensation = _later(feedforward, -late), _later(compensation, -late)
    law = control.law
    if law is not None:
        seen = _later(path, control.reference_delay)
        extra = follow(law, seen, seen, np.zeros(seen.size)) - follow(law.of_error(), seen, seen, np.zeros(seen.size))
        feedforward = feedforward - extra
    return References(path, feedforward, compensation)


def _later(signal: Array, count: int) -> Array:
    """The signal (n,) that many samples later, from rest at 0 before."""
    return (
        np.concatenate([np.zeros(min(count, signal.size)), signal[: max(signal.size - count, 0)]]) if count else signal
    )
