"""Compares all schemes on the central table and on the same perturbed tables: performance and yield."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.controller import assemble, feedback_alone
from design.deadbeat import Deadbeat
from design.trajectory import schemes
from design.trajectory.compensator import compensate
from design.trajectory.history_aware import Trajectory
from design.trajectory.learning import LearnedTable, learned_tables
from design.trajectory.robust import RobustTrajectory
from design.trajectory.schemes import Scheme, Wanted, history_aware, profile_of
from design.validation import assess, sequence
from models.controller import Controller, References
from models.machine import Machine
from models.quantity import keeps_to
from models.simulation.simulator import simulate
from models.variation import drawn
from studies.perturbed import RANGE
from studies.scattered import QUANTILE, scattered
from studies.study import Progress
from studies.trajectory_optimisation.options import TrajectoryOptions
from studies.trajectory_optimisation.outcomes import Aim, Outcome, judge

Array = NDArray[np.float64]

MOST_RUNS: Final = 20  # with a dither on the central table, of each scheme,
FEW_RUNS: Final = 4  # and in a quick run
FRESH: Final = 104729  # Added to the seed, for held-out tables on which no design was chosen.


@dataclass(frozen=True)
class Contestant:
    """A scheme by its key and name: its controller, what it is given, and whether it learns on each table."""

    key: str
    name: str
    controller: Controller
    given: References | None = None
    learning: Scheme | None = None


def compare(
    machine: Machine,
    wanted: Wanted,
    aim: Aim,
    options: TrajectoryOptions,
    schemes: Sequence[Contestant],
    progress: Progress,
) -> dict[str, Any]:
    """Every scheme on the central table, on the same perturbed ones, and on as many that are drawn anew."""
    count = options.tables or (8 if options.quick else 200)
    many, fresh = (drawn(machine, RANGE, count, options.seed + more) for more in (0, FRESH))
    rows, again, shown, missed = [], [], {}, []
    for i, one in enumerate(schemes):
        progress(0.6 + 0.03 * i, f"judging {one.name}")
        every, learned = outcomes(machine, one, many, aim, options.seed)
        rows.append(
            {
                **row_of(one, every[0], every[1:], machine, wanted),
                "settling": _hangs(machine, one, learned, aim, options),
            }
        )
        shown[one.key] = _shown(every[0], every[1:])
        if one.key == "learning":
            forces = [each.learned.friction.coulomb_force for each in learned[1:]]
            missed = [force / table.friction.coulomb_force - 1 for force, table in zip(forces, many, strict=True)]
        anew, _ = outcomes(machine, one, fresh, aim, options.seed + FRESH)
        again.append(row_of(one, anew[0], anew[1:], machine, wanted))
    return {
        "tables": count,
        "rows": rows,
        "settling": [{"case": row["name"], "motion": "slowest", **row["settling"]["slowest"]} for row in rows],
        "fresh": {"seed": options.seed + FRESH, "tables": count, "rows": again},
        "shown": shown,
        "shown_time_s": np.arange(len(every[0].position[0])) * machine.sample_time,
        "learned_force_error": float(np.sqrt(np.mean(np.square(missed)))),
    }


def _hangs(
    machine: Machine, one: Contestant, learned: Sequence[LearnedTable], aim: Aim, options: TrajectoryOptions
) -> dict[str, Any]:
    """What the settling times on the central table hang on, and their scatter over runs with a dither."""
    law, given, start = one.controller, one.given, None
    if learned:
        law, given, start = learned[0].controller, learned[0].given, learned[0].elements
    target, seed = sequence(machine, aim.stroke), options.seed
    response = simulate(machine, law, target, seed=seed, initial_friction=start, given=given)
    found, most = assess(machine, response, stroke=aim.stroke), FEW_RUNS if options.quick else MOST_RUNS
    return scattered(machine, law, found, options, given=given, start=start, stroke=aim.stroke, most=most)


def contestants(
    machine: Machine, wanted: Wanted, made: tuple[Deadbeat, Trajectory, Trajectory, RobustTrajectory]
) -> list[Contestant]:
    """All schemes, as designed for `machine`; the learning is the same for both that learn."""
    deadbeat, peak, chosen, common = made
    law = assemble(machine, deadbeat)
    aware, target = history_aware(machine, profile_of(machine, chosen)), sequence(machine, wanted.stroke)
    least = compensate(profile_of(machine, peak), machine.friction, target)
    rfm = law.friction_compensation
    name = f"Deadbeat and RFM, N = {len(rfm.limit) if rfm else 0}"
    return [
        Contestant("deadbeat", "Deadbeat alone", law.without_compensation()),
        Contestant("paper", name, law),
        Contestant("paper_learning", f"{name}, learning", law, learning=schemes.paper(law)),
        Contestant("common", "One for all", schemes.robust_controller(machine, common)),
        Contestant("peak", "History-aware, least peak", feedback_alone(machine), least),
        Contestant(
            "aware",
            "History-aware, chosen",
            feedback_alone(machine),
            aware.references(machine.friction, target),
        ),
        Contestant("learning", "History-aware, learning", feedback_alone(machine), learning=aware),
    ]


def outcomes(
    machine: Machine, one: Contestant, tables: Sequence[Machine], aim: Aim, seed: int
) -> tuple[list[Outcome], list[LearnedTable]]:
    """The outcomes of `one` on `machine` and then on each table; what it has learned there, if it learns."""
    every = [machine, *tables]
    if one.learning is None:
        return judge(every, one.controller, aim, one.given, seed), []
    return judge_learning(every, machine, one.learning, aim, seed)


def judge_learning(
    tables: Sequence[Machine],
    nominal: Machine,
    scheme: Scheme,
    aim: Aim,
    seed: int,
    starts: Sequence[Array] | None = None,
) -> tuple[list[Outcome], list[LearnedTable]]:
    """The outcome on each table after it has learned, and what; starts: its elements (N,) [m] before, default 0."""
    taught = learned_tables(tables, nominal, scheme, aim.stroke, seed, starts)
    laws, given, elements = zip(*((each.controller, each.given, each.elements) for each in taught), strict=True)
    return judge(tables, laws, aim, given, seed, elements), taught


def row_of(
    one: Contestant, central: Outcome, every: Sequence[Outcome], machine: Machine, wanted: Wanted
) -> dict[str, Any]:
    """A scheme's outcomes; over the tables the quantile, and the shares that hold."""

    def quantile(attribute: str) -> float:
        return float(np.quantile([getattr(outcome, attribute) for outcome in every], QUANTILE, method="higher"))

    def share(attribute: str, limit: float) -> float:
        return float(np.mean([keeps_to(getattr(outcome, attribute), limit) for outcome in every]))

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
        "key": one.key,
        "name": one.name,
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
    half, shown = len(central.position) // 2, central.position.shape[1]
    largest = np.array([np.max(np.abs(outcome.error[:, :shown]), axis=0) for outcome in every])
    return {
        "position_m": central.position[:half],
        "command_N": central.command[:half],
        "error_m": np.quantile(largest, QUANTILE, axis=0),
        "dispersions_m": sorted(outcome.dispersion_specified for outcome in every),
    }
