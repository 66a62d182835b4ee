"""Machines that are another one in other units, on which a design has to come out as the same one."""

from __future__ import annotations

from dataclasses import replace

from models.machine import Machine


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
