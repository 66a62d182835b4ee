"""`python -m studies.response_variation`: the paper's figures and numbers from the model, and the set that fits."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from studies.command import Study, main, whole


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of this study beyond those of all."""
    parser.add_argument(
        "--ensemble",
        type=Path,
        metavar="FILE",
        help="the tables of the set (default: models/machines/linear_motor_table_ensemble.toml; "
        "only the machine itself where --machine is given)",
    )
    parser.add_argument(
        "--search",
        action="store_true",
        help="find the set anew, seeded by --seed, in a minute or two; "
        "ensemble.toml and most_central.toml are written beside the results",
    )
    parser.add_argument(
        "--members",
        type=whole(2, 160),
        default=60,
        metavar="N",
        help="tables that --search keeps, 2 to 160 (default: 60)",
    )


STUDY = Study(
    name="response_variation",
    question="Does the model show what the paper shows, and which tables could the paper's be?",
    add_options=add_options,
    verb="vary",
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
