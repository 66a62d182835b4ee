"""The learning scheme on tables that are off in everything at once, and in one thing at a time; what learning takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.trajectory.compensator import EVALUATIONS
from design.trajectory.learning import looked_at, motions_to_learn, path_to_learn
from design.trajectory.schemes import Scheme, Wanted
from design.validation import BATCH, sequence
from design.wiping import carried_on, wipe, wipe_path, wipe_to_json
from models.friction import reached_states
from models.machine import Machine
from models.quantity import keeps_to
from models.variation import drawn
from studies.binomial import CONFIDENCE, interval
from studies.perturbed import DAMPING, DEAD_TIME, MODE_GAIN, OFFSET_FRICTION_SHARE, Perturbed, perturbations
from studies.scattered import QUANTILE
from studies.starts import cost_of_starts
from studies.study import Progress
from studies.trajectory_optimisation.comparison import judge_learning
from studies.trajectory_optimisation.options import TrajectoryOptions
from studies.trajectory_optimisation.outcomes import Aim, Outcome

Array = NDArray[np.float64]

SEED: Final = 7919  # added to the study's seed, for tables of their own
ALONE: Final = 100  # tables that are off in one thing alone
STARTS: Final = 100  # starts of which the cost is simulated
OPERATIONS: Final = 4  # of an element at a point: a sum, two comparisons, a product


def everything(
    machine: Machine, wanted: Wanted, aim: Aim, options: TrajectoryOptions, scheme: Scheme, progress: Progress
) -> dict[str, Any]:
    """The yields of the learning scheme by what is perturbed, what learning takes, and what a wrong start costs."""
    cases = perturbations(machine)
    rows = []
    for i, (name, one) in enumerate(cases.items()):
        last = i == len(cases) - 1
        count = tables_of(options) if last else 0 if options.quick else min(ALONE, tables_of(options))
        if count:
            progress(0.9 + 0.05 * i / len(cases), f"judging the learning on {count} tables: {name}")
            rows.append({"perturbed": name, **_row(machine, wanted, aim, scheme, one, count, options.seed + SEED)})
    return {
        "ranges": {
            "mode_gain": MODE_GAIN,
            "damping": DAMPING,
            "dead_time": DEAD_TIME,
            "offset_N": OFFSET_FRICTION_SHARE * machine.friction.coulomb_force,
            "noise_m": machine.scale.noisy().noise,
        },
        "confidence": CONFIDENCE,
        "rows": rows,
        "effort": _effort(machine, scheme, wanted.stroke),
        "wipe": wipe_to_json(wipe(machine)),
        "starts": _starts(machine, scheme, wanted, 8 if options.quick else STARTS, options.seed),
    }


def tables_of(options: TrajectoryOptions) -> int:
    """How many tables are off in everything."""
    return options.tables or (6 if options.quick else 1000)


def _row(
    machine: Machine, wanted: Wanted, aim: Aim, scheme: Scheme, one: Perturbed, count: int, seed: int
) -> dict[str, Any]:
    """The yields and the 95 % quantiles over `count` tables."""
    tables = [
        replace(table, scale=table.scale.noisy()) if one.noise else table
        for table in _tables(machine, one, count, seed)
    ]
    found: list[Outcome] = []
    missed = []
    for begin in range(0, count, BATCH):  # a batch has one course of the scale's noise
        part = tables[begin : begin + BATCH]
        starts = [reached_states(table.friction, 1, seed + begin + i)[0] for i, table in enumerate(part)]
        every, taught = judge_learning(part, machine, scheme, aim, seed + begin, starts if one.start else None)
        found += [replace(outcome, error=_NONE, position=_NONE, command=_NONE) for outcome in every]
        missed += [
            (
                each.learned.friction.coulomb_force / table.friction.coulomb_force - 1,
                each.learned.offset - table.drive.offset,
                (1 + each.errors[0]) * machine.plant.mass / table.plant.mass - 1,
                machine.plant.dead_time + each.errors[1] - table.plant.dead_time,
            )
            for each, table in zip(taught, part, strict=True)
        ]
    return _told(found, np.array(missed), machine, wanted)


_NONE: Final = np.zeros((0, 0))


def _tables(machine: Machine, one: Perturbed, count: int, seed: int) -> list[Machine]:
    """The tables, those of like dead time beside each other, as they are simulated side by side."""
    return sorted(drawn(machine, one.within, count, seed), key=lambda table: table.plant.dead_time)


def _told(found: Sequence[Outcome], missed: Array, machine: Machine, wanted: Wanted) -> dict[str, Any]:
    count, in_time = len(found), machine.specification.settling_time
    fine = sum(keeps_to(one.settling_fine, wanted.settling_time) for one in found)
    coarse = sum(keeps_to(one.settling, in_time) for one in found)
    within = sum(keeps_to(one.peak_thrust, machine.drive.rated_thrust) for one in found)
    spread = float(np.quantile([one.dispersion_specified for one in found], QUANTILE, method="higher"))
    slow = float(np.quantile([one.settling_fine for one in found], QUANTILE, method="higher"))
    rms = np.sqrt(np.mean(missed**2, axis=0))
    return {
        "tables": count,
        "fine_aim": {"hits": fine, "share": fine / count, "low": interval(fine, count)[0]},
        "specified": {"hits": coarse, "share": coarse / count, "low": interval(coarse, count)[0]},
        "thrust": {"hits": within, "share": within / count, "low": interval(within, count)[0]},
        "dispersion_m": spread,
        "settling_fine_s": slow,
        "peak_thrust_N": max(one.peak_thrust for one in found),
        "missed": dict(zip(("force", "offset_N", "mass", "dead_time_s"), rms.tolist(), strict=True)),
    }


def _effort(machine: Machine, scheme: Scheme, stroke: float) -> dict[str, Any]:
    """What learning takes of time, memory and arithmetic on a drive, which stores the path's turning points alone."""
    path = path_to_learn(machine, scheme, stroke)
    steps = np.diff(path)
    moving = np.sign(steps[steps != 0])
    points = int(np.count_nonzero(np.diff(moving))) + 1 + motions_to_learn(machine)
    elements, look = len(scheme.known.limit), looked_at(machine)
    numbers = points + 2 * (2 + 2 * machine.specification.motions) + 4 * look + 3 * elements
    return {
        "motions": motions_to_learn(machine),
        "time_s": path.size * machine.sample_time,
        "turning_points": points,
        "numbers_stored": numbers,
        "operations": EVALUATIONS * points * elements * OPERATIONS + 4 * look,
    }


def _starts(machine: Machine, scheme: Scheme, wanted: Wanted, count: int, seed: int) -> dict[str, Any]:
    """Settling to the fine tolerance from unknown starts, without and with the wipe, where all else is known."""
    fine = replace(machine, specification=replace(machine.specification, tolerance=wanted.tolerance))
    target = sequence(machine, wanted.stroke, 1)
    given, path = scheme.references(scheme.known, target), scheme.path(target)
    wiped = carried_on(scheme.known, wipe_path(fine), path, given)
    return cost_of_starts(fine, scheme.controller, scheme.known, given, wiped, target, count, seed)
