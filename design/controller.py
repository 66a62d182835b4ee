"""The 2DoF controller of a machine, put together from its designs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from design.deadbeat import Constraints, Deadbeat, Objective, synthesise
from design.effect_compensation import designed_with_effects
from design.element_count import choose
from design.friction_compensation import simplify
from models.controller import Controller
from models.machine import Machine
from models.plant import Plant, delay_split
from models.quantity import show


def reference_delay_samples(machine: Machine) -> int:
    """Samples by which the PID's reference waits, z^-d: the whole ones of the dead time, L = d T_s + rest.

    x_T* is made with P_l(z) = z^-d N(z) / D(z), so it has the rest of L in it and is the table's position d samples
    later. The paper's z^-2 (III.A) is this rule for 1 ms <= L < 1.5 ms. What a machine file says of z^-d holds for the
    controller in place, which made its records; rounding L instead would let x_T* come a whole sample too late.
    """
    return delay_split(machine.plant.dead_time, machine.sample_time)[0]


def lead(plant: Plant, sample_time: float) -> float:
    """How far ahead of x_T* [samples] the middle of the interval is in which a sample's thrust acts: the interval takes
    T_s, and begins L, less the samples that the reference waits, behind the sample of x_T*."""
    return 0.5 + delay_split(plant.dead_time, sample_time)[1] / sample_time


def advanced(n_ff: Sequence[float], lead: float) -> tuple[float, ...]:
    """N_ff [m/m] of x_T* `lead` samples [-] ahead, straight between samples, as far as the target is known by then.

    What x_T* would do before the step of its target begins at the step: N_ff starts slowly, so that it is next to
    nothing.
    """
    response = np.cumsum(n_ff)
    at = np.arange(response.size)
    ahead = np.interp(at + lead, np.append(at, [at.size, at.size + lead]), np.append(response, [1.0, 1.0]))
    return tuple(np.diff(ahead, prepend=0.0).tolist())


def feedback_alone(machine: Machine) -> Controller:
    """The machine's feedback by itself, for references that are given; it waits for the dead time as
    `reference_delay_samples` says."""
    return machine.feedback_only(reference_delay_samples(machine))


def assemble(machine: Machine, deadbeat: Deadbeat, plant: Plant | None = None) -> Controller:
    """The controller of Fig. 13: this feedforward and its dead-time compensation, the machine's feedback, and its RFM.

    Where the machine file leaves the number of the RFM's elements open ("auto"), it is the one that `choose` finds for
    this feedforward; who needs the controllers of many designs states the number first. plant: that the deadbeat is
    designed for, where that is not the machine's own. Raises ValueError for a deadbeat of another sample time.

    >>> controller = pos.assemble(machine, deadbeat)
    >>> controller.reference_delay  # samples
    2
    """
    bare, count = assemble_bare(machine, deadbeat, plant), machine.control.compensator_elements
    if count == "auto":
        count = choose(machine, bare, stroke=deadbeat.stroke).count
    return replace(bare, friction_compensation=simplify(machine.friction, count))


def assemble_bare(machine: Machine, deadbeat: Deadbeat, plant: Plant | None = None) -> Controller:
    """The controller of `assemble` without its friction compensation.

    The path that a compensator's elements are to follow is x_T* ahead by the `lead`. The paper leads them along x_T*
    itself, so that it meets the friction so much too late.

    A feedback of another structure than a PID keeps its loop, but takes its reference as it takes the position, because
    the feedforward needs one that puts out nothing while the position is on x_T*. Raises ValueError for a deadbeat of
    another sample time.
    """
    if deadbeat.sample_time != machine.sample_time:
        raise ValueError(
            f"the deadbeat is designed for samples of {show(deadbeat.sample_time, 's')}, and the machine's controller "
            f"runs every {show(machine.sample_time, 's')}; design it for this machine"
        )
    control, known = machine.control, machine if plant is None else replace(machine, plant=plant)
    law = control.law and control.law.of_error()
    filters = deadbeat.n_ff, deadbeat.d_ff
    path = advanced(deadbeat.n_ff, lead(known.plant, known.sample_time))
    return Controller(known.sample_time, control.pid, reference_delay_samples(known), *filters, law=law, path_ff=path)


def usable_thrust(machine: Machine) -> float:
    """What of the rated thrust a feedforward may use [N]: the rest is friction's share, T_fc, and the offset's."""
    return machine.drive.rated_thrust - machine.friction.coulomb_force - abs(machine.drive.offset)


def design_deadbeat(
    machine: Machine,
    *,
    settling_time: float | None = None,
    stroke: float | None = None,
    objective: Objective = "thrust_difference",
    constraints: Constraints | None = None,
) -> Deadbeat:
    """The deadbeat feedforward of a machine: `synthesise` for its plant and sample time.

    settling_time [s], stroke [m]: by default those of the machine's specification. constraints: by default the thrust
    that `usable_thrust` leaves. Raises DesignError, with the shortest settling time that can be met, where there is no
    such feedforward.

    >>> deadbeat = pos.design_deadbeat(machine, settling_time=20e-3, stroke=20e-6)
    >>> float(deadbeat.position[-1])  # at rest on the target
    2e-05
    >>> pos.design_deadbeat(machine, settling_time=2e-3)
    Traceback (most recent call last):
    design.deadbeat.DesignError: ...
    """
    wanted = machine.specification
    return synthesise(
        machine.plant,
        machine.sample_time,
        wanted.reference_settling_time if settling_time is None else settling_time,
        wanted.stroke if stroke is None else stroke,
        objective,
        Constraints(thrust=usable_thrust(machine)) if constraints is None else constraints,
    )


def default_feedforward(machine: Machine) -> tuple[Deadbeat, Plant]:
    """The deadbeat that the machine's specification asks for, and the plant that it is for: with the modes and delays
    of the machine's effects. Raises DesignError where there is none."""
    whole, deadbeat, _ = designed_with_effects(machine, design_deadbeat)
    return deadbeat, whole.plant


def default_controller(machine: Machine) -> Controller:
    """The controller that the machine's specification asks for: its default deadbeat, assembled.

    Raises DesignError where there is none.
    """
    return assemble(machine, *default_feedforward(machine))


def paper_controller(machine: Machine) -> Controller:
    """`default_controller` as the paper has it: the elements of its RFM follow x_T* itself. Raises DesignError where
    there is none."""
    return replace(default_controller(machine), path_ff=None)


def bare_controller(machine: Machine) -> Controller:
    """`default_controller` without its friction compensation. Raises DesignError where there is none."""
    return assemble_bare(machine, *default_feedforward(machine))
