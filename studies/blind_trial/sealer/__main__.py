"""`python -m studies.blind_trial.sealer --cases N --seed S --output PACK --key KEYFILE`: a program of its own.

The same numbers give the same pack, key and second measurements, so that each can be made when it is wanted: the key
need not exist before the answers do.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path


def main(arguments: Sequence[str] | None = None) -> int:
    """Seals a pack; exit status 0, or 2 with one line for options that can't be used."""
    parser = argparse.ArgumentParser(prog="studies.blind_trial.sealer", description=__doc__)
    parser.add_argument("--cases", type=int, required=True, metavar="N", help="how many, from 1 on")
    parser.add_argument(
        "--seed",
        type=int,
        required=True,
        metavar="S",
        help="of everything, from 0 on: whoever knows it can draw the labels too",
    )
    parser.add_argument("--output", type=Path, metavar="PACK", help="folder for the pack")
    parser.add_argument("--key", type=Path, metavar="FILE", help="labels and nonces, outside the pack")
    parser.add_argument(
        "--again", type=Path, metavar="FOLDER", help="second measurements of some cases, for the scorer"
    )
    parser.add_argument("--jobs", type=int, default=-1, metavar="N", help="processes (default: all cores)")
    parser.add_argument(
        "--machines", choices=["table", "random"], default="table", help="all cases on one table, or on drawn machines"
    )
    options = parser.parse_args(arguments)
    if options.cases < 1 or options.seed < 0:
        print("error: --cases is from 1 on and --seed from 0 on; give such numbers", file=sys.stderr)
        return 2
    if options.output and options.key and options.key.resolve().is_relative_to(options.output.resolve()):
        print(f"error: --key {options.key} lies in the pack; put it where the answerer does not look", file=sys.stderr)
        return 2
    from studies.blind_trial.sealer.pack import Places, seal

    def tell(done: int, case: str) -> None:
        print(f"{done} of {options.cases} {case}", file=sys.stderr, flush=True)

    places = Places(options.output, options.key, options.again)
    seal(options.cases, options.seed, places, options.jobs, tell, options.machines)
    return 0


if __name__ == "__main__":
    sys.exit(main())
