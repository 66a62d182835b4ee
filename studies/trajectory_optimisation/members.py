"""Every scheme on the tables that are consistent with the paper and differ in its unpublished parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from design.controller import assemble, feedback_alone
from design.deadbeat import synthesise
from design.trajectory import schemes
from design.trajectory.schemes import Wanted, history_aware, profile_of
from design.validation import sequence
from models.ensemble import load_ensemble
from models.machine import Machine, load
from studies.study import Progress
from studies.trajectory_optimisation.comparison import Contestant, outcomes, row_of
from studies.trajectory_optimisation.options import TrajectoryOptions
from studies.trajectory_optimisation.outcomes import Aim, judge

QUICK_MEMBERS: Final = 5  # members of a quick run


def on_members(
    machine: Machine,
    wanted: Wanted,
    aim: Aim,
    options: TrajectoryOptions,
    schemes: Sequence[Contestant],
    count: int,
    progress: Progress,
) -> dict[str, Any] | None:
    """The schemes on the ensemble's tables, designed for `machine` and then for each table; None without an ensemble.

    The ensemble belongs to the default machine. count: samples of the central table's motions.
    """
    if machine != load():
        return None
    members = load_ensemble()[: QUICK_MEMBERS if options.quick else None]
    rows = []
    for one in schemes:
        every, _ = outcomes(machine, one, members, aim, options.seed)
        rows.append(row_of(one, every[0], every[1:], machine, wanted))
    progress(0.88, "designs for each of the tables that behave as the paper says")
    own, rests = _own(members, wanted, aim, count, options.seed)
    masses = [one.plant.mass for one in members]
    return {
        "tables": len(members),
        "mass_kg": [min(masses), max(masses)],
        "rows": rows,
        "own": own,
        "own_rest_s": [min(rests), max(rests)],
        "own_in_time": float(np.mean([rest <= wanted.settling_time + machine.sample_time / 2 for rest in rests])),
    }


def _own(
    members: Sequence[Machine], wanted: Wanted, aim: Aim, count: int, seed: int
) -> tuple[list[dict[str, Any]], list[float]]:
    """Deadbeat and RFM, and a history-aware scheme designed for each table, and when [s] the latter's motions rest.

    A table too heavy for `count` samples within the thrust gets the fewest more that do.
    """
    laws, given, rests = [], [], []
    for one in members:
        settling = one.specification.reference_settling_time
        laws.append(assemble(one, synthesise(one.plant, one.sample_time, settling, wanted.stroke)))
        samples, tried = schemes.quickest(one, wanted, count, least=count)
        scheme = history_aware(one, profile_of(one, tried[samples]))
        given.append(scheme.references(one.friction, sequence(one, wanted.stroke)))
        rests.append(schemes.rest_time(one, samples))
    rows = []
    for key, name, controllers, its in (
        ("paper", "Deadbeat and RFM", laws, None),
        ("peak", "History-aware, least peak", [feedback_alone(one) for one in members], given),
    ):
        every = judge(members, controllers, aim, its, seed)
        row = row_of(Contestant(key, name, controllers[0]), every[0], every, members[0], wanted)
        rows.append({part: row[part] for part in row if part != "central"})  # None of these tables is the central one.
    return rows, rests
