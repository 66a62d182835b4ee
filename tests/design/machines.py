"""Machines that are another one in other units, on which a design has to come out as the same one."""

from __future__ import annotations

from dataclasses import replace

from models.controller import PID
from models.machine import Machine
from models.plant import Mode


def quicker(machine: Machine, times: float) -> Machine:
    """The machine with all of its plant's and its controller's times so many times as short [1]."""
    plant, control = machine.plant, machine.control
    modes = tuple(replace(mode, frequency=mode.frequency * times) for mode in plant.modes)
    pid = replace(control.pid, derivative_filter=control.pid.derivative_filter / times)
    return replace(
        machine,
        plant=replace(plant, modes=modes, dead_time=plant.dead_time / times),
        control=replace(control, sample_time=control.sample_time / times, pid=pid),
    )


def far_side(machine: Machine, gain: float = -0.98) -> Machine:
    """The table with its scale on the far side of a belt: one mode at 38 Hz, of `gain` times the rigid body's [1], and
    a PID slow enough for it to be stable while the friction slips."""
    rigid = machine.plant.modes[machine.plant.rigid]
    belt = replace(machine, plant=replace(machine.plant, modes=(rigid, Mode(gain * rigid.gain, 38.0, 0.1))))
    pid = PID(kp=140.0, ki=44.0, kd=112.0, derivative_filter=machine.control.pid.derivative_filter)
    return replace(belt, published=None, control=replace(machine.control, pid=pid))
