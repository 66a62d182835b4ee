"""`python -m studies.gap_diagnosis RECORD...`: where a machine leaves its model, which effect, how far the gap."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from studies.command import Study, main


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of this study beyond those of all."""
    parser.add_argument(
        "record",
        nargs="*",
        type=Path,
        metavar="RECORD",
        help=".csv, .csv.gz, .mat or .parquet of one machine, one or several. Without any, records of a simulated "
        "table are diagnosed that has an effect the model lacks, so that the answer can be judged",
    )
    parser.add_argument(
        "--disable",
        action="append",
        default=[],
        metavar="NAME",
        help="an effect of the catalogue that is not to be used, such as cogging; may be repeated",
    )
    parser.add_argument(
        "--column",
        action="append",
        default=[],
        metavar="SIGNAL=ENTRY",
        help='how the files call a signal, such as "position=qm [mm]" or "command=vir [V] * 35.2 N/V"; may be repeated '
        "(default: the machine file's [record], else time_s, command_N, position_m, ...)",
    )


STUDY = Study(
    name="gap_diagnosis",
    question="Where does the real machine leave the model, which effect causes it, how far does the gap shrink?",
    add_options=add_options,
    verb="diagnose",
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
