"""Options of trajectory_optimisation besides those common to all studies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from studies.options import Options, choice, quantity, whole

if TYPE_CHECKING:
    from design.trajectory.history_aware import Objective


@dataclass(frozen=True, kw_only=True)
class TrajectoryOptions(Options):
    """Requirements on the motions, and the objectives of the optimisation."""

    settling_time: float | None = quantity(
        "s",
        "TIME",
        'time by which the table, not x_T* alone, is to rest on the target, such as "20 ms"; if the thrust '
        "does not allow it, the shortest feasible time is used "
        "(default: the machine file's specification.reference_settling_time; 20 ms for the default machine)",
        above=0,
    )
    stroke: float | None = quantity(
        "m",
        "LENGTH",
        'stroke of a motion, such as "20 um" '
        "(default: the machine file's specification.stroke; 20 um for the default machine)",
        above=0,
    )
    tolerance: float | None = quantity(
        "m",
        "LENGTH",
        'the finer settling accuracy, such as "0.5 um" (default: a quarter of the machine file\'s '
        "specification.tolerance; 0.5 um for the default machine)",
        above=0,
    )
    thrust_limit: float | None = quantity(
        "N",
        "FORCE",
        'largest thrust that a trajectory may ask for, friction included, such as "140 N" '
        "(default: the rated thrust less 0.7 T_fc, which feedback and tables with more friction may need; "
        "138.5 N for the default machine)",
    )
    slew: float | None = quantity("N", "FORCE", 'largest change of the thrust in a sample, such as "60 N"', above=0)
    objective: Objective = choice(
        "of the history-aware trajectory: least sensitivity to errors of friction, mass and modes (default), "
        "least peak thrust, least squares of the thrust or of its differences",
        ("sensitivity", "peak_thrust", "energy", "thrust_difference"),
    )
    common_objective: str = choice(
        "of the trajectory for all histories: least largest error (default) or least sum of squared errors",
        ("worst_error", "dispersion"),
    )
    tables: int | None = whole(
        "N", "perturbed tables to judge on (default: 200, and 1000 that are off in everything; quick: 8 and 6)", 1
    )
