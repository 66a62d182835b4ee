"""`python -m studies.pid_tradeoff`: the PIDs at the edge of stability, certified, and what no PID can pass."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from studies.command import Study, main


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of this study beyond those of all."""
    parser.add_argument(
        "--objective",
        choices=("integral", "band", "step"),
        default="integral",
        help="what the front is best in: largest integral gain (default), least peak of |PS| up to 1 / (2 pi settling "
        "time), or least error from the settling time on after a step of friction",
    )
    parser.add_argument(
        "--ms", default="2", metavar="RATIO", help="bound on |S| of the controller that is written (default: 2)"
    )
    parser.add_argument(
        "--mt", metavar="RATIO", help="bound on |T| (default: that on |S|, but at least 1.4, for every point)"
    )
    parser.add_argument(
        "--noise",
        metavar="STIFFNESS",
        help='bound on |CS|, thrust per noise of the scale, such as "30000 N/mm" (default: what the present PID has)',
    )
    parser.add_argument(
        "--mode-error", default="0.03", metavar="RATIO", help="modes' frequencies off to both sides by (default: 0.03)"
    )
    parser.add_argument("--mass-error", default="0.1", metavar="RATIO", help="mass off to both sides by (default: 0.1)")
    parser.add_argument(
        "--ensemble",
        type=Path,
        metavar="FILE",
        help="ensemble file whose machines join the family of the tuning (default: none; the default machine's "
        "PIDs are then judged on models/machines/linear_motor_table_ensemble.toml afterwards)",
    )


STUDY = Study(
    name="pid_tradeoff",
    question="How much friction suppression does stability leave?",
    add_options=add_options,
    verb="trade_off",
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
