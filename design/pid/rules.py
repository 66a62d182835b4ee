"""Rules of thumb for a PID on a machine whose rigid body counts: starts for the tuning, and points to compare with."""

from __future__ import annotations

from typing import Final

from models.controller import PID
from models.machine import Machine
from models.plant import Plant

SLOW_START: Final = 25e-3  # s. The closed-loop time constant of the rule that a tuning starts from: slow, so stable.
FAST_START: Final = 6e-3  # s. That of a rule nearer to the edge of stability, whose gains are of a tuned PID's size.


def simc(plant: Plant, sample_time: float, closed_loop: float, derivative_filter: float) -> PID:
    """Skogestad's rule for k'' exp(-theta s) / s^2 with closed-loop time constant `closed_loop` tau_c [s]; times [s].

    K_c = 1 / (4 k'' (tau_c + theta)^2), tau_I = tau_D = 4 (tau_c + theta) in series form (J. Process Control 13, 2003,
    table 1); theta = L + T_s / 2 for the hold.
    """
    slow = closed_loop + plant.dead_time + sample_time / 2
    gain = 1 / (4 * plant.rigid_gain * slow**2)
    return PID(2 * gain, gain / (4 * slow), gain * 4 * slow, derivative_filter)


def lambda_rule(plant: Plant, closed_loop: float, derivative_filter: float) -> PID:
    """Three poles of the rigid body's loop at -1 / lambda, dead time left out; lambda = `closed_loop`; times [s]."""
    gain = 1 / plant.rigid_gain
    return PID(3 * gain / closed_loop**2, gain / closed_loop**3, 3 * gain / closed_loop, derivative_filter)


def slow_rule(machine: Machine) -> PID:
    """SIMC's PID [SI] that a tuning starts from: slow, so that its loops are stable."""
    return simc(machine.plant, machine.sample_time, SLOW_START, machine.control.pid.derivative_filter)


def fast_rule(machine: Machine) -> PID:
    """SIMC's PID [SI] at about the edge of stability."""
    return simc(machine.plant, machine.sample_time, FAST_START, machine.control.pid.derivative_filter)


def magnitude(machine: Machine) -> PID:
    """A PID whose gains [SI] are of the right size: the present one, or the fast rule's where it lacks a part."""
    pid = machine.control.pid
    return pid if min(pid.kp, pid.ki, pid.kd) > 0 else fast_rule(machine)
