"""`python -m studies.deadbeat_design`: from a machine file to a validated feedforward and its report."""

from __future__ import annotations

import argparse
import sys

from studies.command import Study, main

OBJECTIVES = ("thrust_difference", "thrust", "peak_thrust", "mode_robustness")


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of this study beyond those of all."""
    parser.add_argument(
        "--settling-time",
        metavar="TIME",
        help='time by which x_T* rests on the target, such as "20 ms" '
        "(default: the machine file's specification.reference_settling_time; 20 ms for the default machine)",
    )
    parser.add_argument(
        "--stroke",
        metavar="LENGTH",
        help='stroke of a motion, such as "20 um" '
        "(default: the machine file's specification.stroke; 20 um for the default machine)",
    )
    parser.add_argument(
        "--objective",
        choices=OBJECTIVES,
        default="thrust_difference",
        help="what the feedforward's freedom is spent on: least squares of the thrust's differences (default) or of "
        "the thrust, least peak thrust, or least vibration left when a mode's frequency is off by up to 5 %%",
    )
    parser.add_argument(
        "--thrust-limit",
        metavar="FORCE",
        help='largest |u_ff|, such as "120 N" '
        "(default: the rated thrust less T_fc, which friction may need; 133.5 N for the default machine)",
    )
    parser.add_argument(
        "--overshoot", metavar="RATIO", help='largest overshoot of x_T* over the stroke, such as "0.05"'
    )
    parser.add_argument("--monotone", action="store_true", help="x_T* must not move backwards")


STUDY = Study(
    name="deadbeat_design",
    question="Which N_ff(z), D_ff(z) for this machine, and do they hold on the nonsmooth one?",
    add_options=add_options,
    verb="design",
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
