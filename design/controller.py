"""The 2DoF controller of a machine, put together from its designs."""

from __future__ import annotations

from design.deadbeat import Constraints, Deadbeat, synthesise
from design.friction_compensation import simplify
from models.controller import Controller
from models.machine import Machine


def assemble(machine: Machine, deadbeat: Deadbeat) -> Controller:
    """The controller of Fig. 13: this feedforward, the machine's PID and dead-time compensation, and its RFM."""
    control = machine.control
    rfm = simplify(machine.friction, control.compensator_elements)
    return Controller(machine.sample_time, control.pid, control.reference_delay, deadbeat.n_ff, deadbeat.d_ff, rfm)


def usable_thrust(machine: Machine) -> float:
    """What of the rated thrust a feedforward may use [N]: the rest is friction's share, T_fc."""
    return machine.drive.rated_thrust - machine.friction.coulomb_force


def default_controller(machine: Machine) -> Controller:
    """The controller that the machine's specification asks for: `synthesise`'s default deadbeat within usable_thrust.

    Raises DesignError where there is none.
    """
    wanted = machine.specification
    limit = Constraints(thrust=usable_thrust(machine))
    deadbeat = synthesise(
        machine.plant, machine.sample_time, wanted.reference_settling_time, wanted.stroke, constraints=limit
    )
    return assemble(machine, deadbeat)
