"""What a design needs of a machine, asked before any work: a stable loop, thrust to spare, a scale that sees enough."""

from __future__ import annotations

from typing import Final

import numpy as np

from design.deadbeat import DesignError
from design.family import largest_pole, linear
from design.pid.rules import slow_rule
from models.machine import Machine
from models.quantity import show
from models.simulation.simulator import simulate, substeps_needed

GROWTH_SAMPLES: Final = 200  # samples of a short simulation: what doubles in each of them would be beyond all numbers
UNSTABLE: Final = 1e-6  # A pole so far beyond the unit circle is not one on it that round-off has moved.


def require_designable(machine: Machine) -> None:
    """Raises DesignError, a sentence, for a machine on which no feedforward could be judged.

    An unstable loop comes first, as nothing else that could be said of it means anything.

    >>> from models.machine import load
    >>> require_designable(load())
    """
    require_stable(machine)
    _require_simulable(machine)
    drive, scale, wanted = machine.drive, machine.scale, machine.specification
    friction = machine.friction.coulomb_force
    if abs(drive.offset) + friction >= drive.rated_thrust:
        taken = f"friction takes {show(friction, 'N')}"
        if drive.offset != 0:
            taken = f"drive.offset takes {show(abs(drive.offset), 'N')} and {taken}"
        raise DesignError(
            f"{taken}, all of the rated {show(drive.rated_thrust, 'N')}; give a stronger drive.rated_thrust or "
            f"{'a smaller drive.offset' if abs(drive.offset) > friction else 'less friction'}"
        )
    for name, size in (("scale.resolution", scale.resolution), ("scale.noise", scale.noise)):
        if size > wanted.tolerance:
            raise DesignError(
                f"{name}: {show(size, 'm')} is above specification.tolerance, {show(wanted.tolerance, 'm')}, so that "
                "the scale cannot tell whether a motion has settled; give a finer scale or a wider tolerance"
            )
    if wanted.tolerance >= wanted.stroke:
        raise DesignError(
            f"specification.tolerance: +-{show(wanted.tolerance, 'm')} is not below specification.stroke, "
            f"{show(wanted.stroke, 'm')}, so a table that never moves would count as settled; give a longer stroke or "
            "less tolerance"
        )


def require_pid(machine: Machine) -> None:
    """Raises DesignError where anything but a plain PID runs, which a design around a PID would leave out."""
    control = machine.control
    if control.law is not None:
        raise DesignError(
            f"{control.in_words} runs on this machine, and this study designs around a plain PID alone; state the PID "
            "to design for in [control.pid], without set-point weights, cascade, filters and anti_windup "
            "(deadbeat_design and pid_tradeoff take any feedback)"
        )


def _require_simulable(machine: Machine) -> None:
    """Raises DesignError where forces grow so fast with the speed that the simulation's step does not follow them."""
    try:
        substeps_needed(machine)
    except ValueError as error:
        raise DesignError(str(error)) from None
    if not machine.effects:
        return
    with np.errstate(all="ignore"):
        response = simulate(machine, machine.feedback_only(), np.full(GROWTH_SAMPLES, machine.specification.stroke))
    if not np.all(np.isfinite(response.position)):
        raise DesignError(
            f"effects: their forces make a mass of {show(machine.plant.mass, 'kg')} run away within "
            f"{show(GROWTH_SAMPLES * machine.sample_time, 's')} of simulation; correct coefficients that "
            "multiply a speed"
        )


def require_stable(machine: Machine) -> None:
    """Raises DesignError if the feedback in place makes an unstable loop with the machine while its friction slips."""
    if not machine.control.pid.kp > 0:
        raise DesignError(
            f"control.pid.kp is 0, so that nothing pulls the table to its target; give gains{_others(machine)}"
        )
    pole = largest_pole(machine, machine.control.feedback)
    stated = "control.pid" if machine.control.cascade is None else "control.cascade"
    if pole > 1 + UNSTABLE:
        lag = linear(machine).lag
        behind = f" and a lag of {show(lag, 's')}" if lag > 0 else ""
        raise DesignError(
            f"the loop is unstable: with {stated} on a mass of {show(machine.plant.mass, 'kg')} and a dead time of "
            f"{show(machine.plant.dead_time, 's')}{behind} its largest pole has the magnitude {pole:.5g}; "
            f"correct the gains, the mass or the dead time{_others(machine)}"
        )


def _others(machine: Machine) -> str:
    """Gains with which the loop is stable, where a rule of thumb knows some; empty otherwise."""
    pid = slow_rule(machine)
    if largest_pole(machine, pid) > 1 + UNSTABLE:
        return ""
    gains = ((pid.kp, "N/m"), (pid.ki, "N/(m s)"), (pid.kd, "N s/m"), (pid.derivative_filter, "s"))
    kp, ki, kd, keep = (show(*gain, 3) for gain in gains)
    return (
        f"; a rule of thumb has kp {kp}, ki {ki}, kd {kd}, derivative_filter {keep}, from which pid_tradeoff can tune"
    )
