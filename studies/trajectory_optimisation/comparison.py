"""Every scheme on the central table and on the same perturbed ones: what it achieves, and on how many tables."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from design.common import CommonTrajectory
from design.deadbeat import Deadbeat
from design.friction_compensation import simplify
from design.history import compensate
from design.trajectory import Trajectory
from models.controller import Controller
from models.machine import Machine
from studies.command import Progress
from studies.trajectory_optimisation import designs
from studies.trajectory_optimisation.designs import Wanted, bare, motion_of
from studies.trajectory_optimisation.judge import Aim, Outcome, judge, perturbed, sequence

QUANTILE: Final = 0.95


def compare(
    machine: Machine,
    wanted: Wanted,
    aim: Aim,
    options: argparse.Namespace,
    made: tuple[Deadbeat, Trajectory, Trajectory, CommonTrajectory],
    progress: Progress,
) -> dict[str, Any]:
    """Every scheme on the central table and on the same perturbed ones."""
    deadbeat, peak, chosen, common = made
    count = options.tables or (12 if options.quick else 200)
    many = perturbed(machine, count, options.seed)
    control = machine.control
    rfm = simplify(machine.friction, control.compensator_elements)
    plain = Controller(machine.sample_time, control.pid, control.reference_delay, deadbeat.n_ff, deadbeat.d_ff)
    paper = Controller(machine.sample_time, control.pid, control.reference_delay, deadbeat.n_ff, deadbeat.d_ff, rfm)
    target = sequence(machine, wanted.stroke)
    schemes: list[tuple[str, str, Controller, Any]] = [
        ("deadbeat", "Deadbeat alone", plain, None),
        ("paper", f"Deadbeat and RFM, N = {control.compensator_elements}", paper, None),
        ("common", "One for all", designs.common_controller(machine, common), None),
        ("peak", "History-aware, least peak", bare(machine), motion_of(machine, peak)),
        ("aware", "History-aware, chosen", bare(machine), motion_of(machine, chosen)),
    ]
    rows, shown = [], {}
    for i, (key, name, controller, motion) in enumerate(schemes):
        progress(0.6 + 0.05 * i, f"judging {name}")
        given = None if motion is None else compensate(motion, machine.friction, target)
        central, every = (judge(tables, controller, aim, given, options.seed) for tables in ([machine], many))
        rows.append(_row(key, name, central[0], every, machine, wanted))
        shown[key] = _shown(central[0], every)
    progress(0.86, "judging History-aware, learning")
    motion = motion_of(machine, chosen)
    frictions, taught = designs.learned([machine, *many], machine, motion, wanted.stroke, options.seed)
    every = judge([machine, *many], bare(machine), aim, taught, options.seed)
    rows.append(_row("learning", "History-aware, learning", every[0], every[1:], machine, wanted))
    shown["learning"] = _shown(every[0], every[1:])
    missed = [f.coulomb_force / t.friction.coulomb_force - 1 for f, t in zip(frictions[1:], many, strict=True)]
    return {
        "tables": count,
        "rows": rows,
        "shown": shown,
        "shown_time_s": np.arange(len(every[0].position[0])) * machine.sample_time,
        "learned_force_error": float(np.sqrt(np.mean(np.square(missed)))),
    }


def _row(
    key: str, name: str, central: Outcome, every: Sequence[Outcome], machine: Machine, wanted: Wanted
) -> dict[str, Any]:
    """A scheme's outcomes; over the tables the quantile, and the shares that hold."""

    def quantile(attribute: str) -> float:
        return float(np.quantile([getattr(one, attribute) for one in every], QUANTILE, method="higher"))

    def share(attribute: str, limit: float) -> float:
        return float(np.mean([getattr(one, attribute) <= limit * (1 + 1e-9) for one in every]))

    in_time = machine.specification.settling_time
    names = {
        "settling_s": "settling",
        "settling_fine_s": "settling_fine",
        "dispersion_aim_m": "dispersion_aim",
        "dispersion_m": "dispersion_specified",
        "peak_thrust_N": "peak_thrust",
        "vibration_m": "vibration",
    }
    return {
        "key": key,
        "name": name,
        "central": {to: getattr(central, attribute) for to, attribute in names.items()},
        "ensemble": {to: quantile(attribute) for to, attribute in names.items()},
        "yield": {
            "specified": share("settling", in_time),
            "fine_aim": share("settling_fine", wanted.settling_time),
            "fine_specified": share("settling_fine", in_time),
            "thrust": share("peak_thrust", machine.drive.rated_thrust),
        },
    }


def _shown(central: Outcome, every: Sequence[Outcome]) -> dict[str, Any]:
    """For the figures: motions up on the central table, and the spread of the largest error over the tables in time."""
    half = len(central.position) // 2
    largest = np.array([np.max(np.abs(one.error), axis=0) for one in every])
    return {
        "position_m": central.position[:half],
        "command_N": central.command[:half],
        "error_m": np.quantile(largest, QUANTILE, axis=0),
        "dispersions_m": sorted(one.dispersion_specified for one in every),
    }
