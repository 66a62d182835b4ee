"""Rules of thumb for a PID on a machine whose rigid body counts: starts for the tuning, and points to compare with.

Their time constants are multiples of the quickest one that this machine's own dead time and modes allow.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from design.family import linear, with_effects
from design.loop import assess
from models.controller import PID
from models.machine import Machine
from models.plant import Plant

PEAK: Final = 2.0  # of |S| [1], beyond which a rule of thumb's loop counts as too quick
RUNGS: Final = np.sqrt(2.0) ** np.arange(24)  # of theta: the time constants that are tried, from the quickest on
# Times the quickest: near to the edge of stability, so that the gains are of a tuned PID's size.
FAST_RULE_TIME_RATIO: Final = 2.3
SLOW_RULE_TIME_RATIO: Final = 9.5  # times the quickest: so slow that the loop is surely stable


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


def quickest_time(machine: Machine) -> float:
    """The least closed-loop time constant [s] on the ladder with which SIMC's loop keeps |S| within its peak; the last
    rung if there is none."""
    ts, keep = machine.sample_time, machine.control.pid.derivative_filter
    plant, known = with_effects(machine), linear(machine).late
    times = (known.dead_time + ts / 2) * RUNGS
    loops = ((float(time), assess(plant, simc(known, ts, time, keep))) for time in times)
    return next((time for time, loop in loops if loop.stable and loop.ms.value <= PEAK), float(times[-1]))


def slow_rule(machine: Machine) -> PID:
    """SIMC's PID [SI] that a tuning starts from: slow, so that its loops are stable."""
    return _of(machine, SLOW_RULE_TIME_RATIO)


def fast_rule(machine: Machine) -> PID:
    """SIMC's PID [SI] with gains of a tuned one's size."""
    return _of(machine, FAST_RULE_TIME_RATIO)


def _of(machine: Machine, times: float) -> PID:
    """SIMC's PID [SI] with so many times the quickest time constant [1]."""
    return simc(
        linear(machine).late,
        machine.sample_time,
        times * quickest_time(machine),
        machine.control.pid.derivative_filter,
    )


def magnitude(machine: Machine) -> PID:
    """A PID whose gains [SI] are of the right size: the present one, or the fast rule's where it lacks a part."""
    pid = machine.control.pid
    return pid if min(pid.kp, pid.ki, pid.kd) > 0 else fast_rule(machine)
