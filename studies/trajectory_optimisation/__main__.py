"""`python -m studies.trajectory_optimisation`: x_T* by optimal control, judged on the nonsmooth machine."""

from __future__ import annotations

import argparse
import sys

from studies.command import Study, main, whole

OBJECTIVES = ("sensitivity", "peak_thrust", "energy", "thrust_difference")
COMMON_OBJECTIVES = ("worst_error", "dispersion")


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of this study beyond those of all."""
    parser.add_argument(
        "--settling-time",
        metavar="TIME",
        help='time by which the table, not x_T* alone, is to rest on the target, such as "20 ms"; one that the thrust '
        "does not allow is lengthened to the shortest that it does "
        "(default: the machine file's specification.reference_settling_time; 20 ms for the default machine)",
    )
    parser.add_argument(
        "--stroke",
        metavar="LENGTH",
        help='stroke of a motion, such as "20 um" '
        "(default: the machine file's specification.stroke; 20 um for the default machine)",
    )
    parser.add_argument(
        "--tolerance", metavar="LENGTH", default="0.5 um", help='the finer settling accuracy (default: "0.5 um")'
    )
    parser.add_argument(
        "--thrust-limit",
        metavar="FORCE",
        help='largest thrust that a trajectory may ask for, friction included, such as "140 N" '
        "(default: the rated thrust less 0.7 T_fc, which feedback and tables with more friction may need; "
        "138.5 N for the default machine)",
    )
    parser.add_argument("--slew", metavar="FORCE", help='largest change of the thrust in a sample, such as "60 N"')
    parser.add_argument(
        "--objective",
        choices=OBJECTIVES,
        default="sensitivity",
        help="of the history-aware trajectory: least sensitivity to errors of friction, mass and modes (default), "
        "least peak thrust, least squares of the thrust or of its differences",
    )
    parser.add_argument(
        "--common-objective",
        choices=COMMON_OBJECTIVES,
        default="worst_error",
        help="of the trajectory for all histories: least largest error (default) or least sum of squared errors",
    )
    parser.add_argument(
        "--tables",
        type=whole(1),
        default=None,
        metavar="N",
        help="perturbed tables to judge on (default: 200; quick: 12)",
    )


STUDY = Study(
    name="trajectory_optimisation",
    question="Which x_T* makes every motion settle, whatever the friction remembers?",
    add_options=add_options,
    verb="optimise",
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
