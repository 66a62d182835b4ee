"""`python -m studies.paper_gap`: what could have left 2.4 um and inching motions that miss on the paper's table."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from studies.command import Study, main, whole


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of this study beyond those of all."""
    parser.add_argument(
        "--tables",
        type=whole(1),
        metavar="N",
        help="tables of the set, spread ones, that the effects are put into; the time grows with it "
        "(default: 12; quick: 3; all there are: 60)",
    )
    parser.add_argument(
        "--margin",
        default="0.24 um",
        metavar="LENGTH",
        help='how far 3 sigma may be from the published one and still show the pattern (default: "0.24 um")',
    )
    parser.add_argument(
        "--ensemble",
        type=Path,
        metavar="FILE",
        help="the tables of the set (default: models/machines/linear_motor_table_ensemble.toml; "
        "only the machine itself where --machine is given)",
    )


STUDY = Study(
    name="paper_gap",
    question="Which effects leave what compensation left on the paper's table, and which experiment would tell?",
    add_options=add_options,
    verb="explain",
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
