"""`python -m studies.blind_trial`: sealed cases answered and scored, so that nobody fools himself."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from studies.command import Study, main


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of this study beyond those of all."""
    parser.add_argument(
        "--cases",
        type=int,
        metavar="N",
        help="how many to seal and answer, from 1 on (default: 60; 4 with --quick). The "
        "time of 300 or more is checked, too, on two cores, where nothing of an earlier run is in --output",
    )
    parser.add_argument(
        "--pack",
        type=Path,
        metavar="FOLDER",
        help="answer these sealed cases instead: case-*/*.csv.gz, nominal.json, commitments.json. answers.json in "
        "--output grows with each, and a run that was interrupted goes on there",
    )
    parser.add_argument("--key", type=Path, metavar="FILE", help="open the labels of --pack with it, and score")
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help='of a Dask cluster whose workers see the same folders: "tcp://host:8786" (default: all cores here)',
    )


def nominal(options: argparse.Namespace) -> Path | None:
    """The nominal machine of the pack; None for a folder that is none, which is said later."""
    file: Path = (options.pack or Path(__file__).with_name("sealer")) / "nominal.json"
    return file if file.is_file() else None


STUDY = Study(
    name="blind_trial",
    question="How often is the diagnosis right when the effect is withheld?",
    add_options=add_options,
    machine_file=nominal,
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
