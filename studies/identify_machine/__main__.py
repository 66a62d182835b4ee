"""`python -m studies.identify_machine RECORD...`: from measured records to a machine file with uncertainties."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from studies.command import Study, main

KINDS = ("auto", "response", "excitation", "hysteresis", "motion", "dynamics")


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of this study beyond those of all."""
    parser.add_argument(
        "record",
        nargs="*",
        type=Path,
        metavar="RECORD",
        help=".csv, .csv.gz, .mat or .parquet; what each shows is recognised. Without any, records of simulated tables "
        "are identified, so that the stated uncertainties can be judged (round trip)",
    )
    parser.add_argument(
        "--kinds",
        metavar="KIND,...",
        help=f"what the records are, in their order, instead of being recognised: {', '.join(KINDS)}",
    )
    parser.add_argument(
        "--column",
        action="append",
        default=[],
        metavar="SIGNAL=ENTRY",
        help='how the files call a signal, such as "position=qm [mm]" or "command=vir [V] * 35.2 N/V"; may be repeated '
        "(default: the machine file's [record], else time_s, command_N, position_m, ...)",
    )
    parser.add_argument(
        "--pass-band",
        metavar="FREQUENCY",
        help='of the low-pass for friction, such as "40 Hz" (default: 20 Hz for hysteresis, else 40 Hz)',
    )
    parser.add_argument(
        "--tables",
        type=int,
        default=50,
        metavar="N",
        help="simulated tables of the round trip, at least 1 (default: 50; 3 with --quick)",
    )


STUDY = Study(
    name="identify_machine",
    question="Which machine is this, as its frequency response, hysteresis and motion records show it, and how surely?",
    add_options=add_options,
    verb="identify",
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
