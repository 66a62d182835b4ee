"""`python -m studies.new_machine FILE --mass ...`: a commented machine file to begin with, from ten answers."""

from __future__ import annotations

from studies.interrupt import supervise

if __name__ == "__main__":
    supervise()  # before anything that takes time is imported

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

from studies.command import DONE, guarded
from studies.folder import write_at_once
from studies.new_machine.answers import ANSWERS, OPTIONAL
from studies.options import BadInputError, Parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit status: 0 written, 2 bad input."""
    return guarded(lambda: _run(arguments))


def _run(arguments: Sequence[str] | None) -> int:
    given = vars(_parser().parse_args(arguments))
    file, overwrite = given.pop("file"), given.pop("overwrite")
    lacking = [one for one in ANSWERS if given[one.name] is None]
    if lacking:
        wanted = " ".join(f'{one.option} "{one.example}"' for one in lacking)
        raise BadInputError(f"{len(lacking)} answers are missing; add, with your values: {wanted}")
    _require_free(file, overwrite=overwrite)
    from studies.new_machine.starter import starter

    text = starter({name: answer for name, answer in given.items() if answer is not None}, file.stem)
    write_at_once(file, text)
    print(f"written: {file}")
    print(f"next, to know the axis: python -m studies.identify_machine --machine {file} --write-references references")
    print(f"or, a first design on these values: python -m studies.deadbeat_design --machine {file}")
    return DONE


def _require_free(file: Path, *, overwrite: bool) -> None:
    """Raises BadInputError where the file can't be written, or holds what somebody has written."""
    if file.suffix != ".toml":
        raise BadInputError(f"{file}: a machine file's name ends in .toml; give such a name")
    if os.path.lexists(file) and not (overwrite and file.is_file()):
        raise BadInputError(f"{file}: exists; give another name, or --overwrite to replace it")
    existing = next(place for place in file.absolute().parents if place.exists())
    if not existing.is_dir() or not os.access(existing, os.W_OK | os.X_OK):
        raise BadInputError(f"{file}: {existing} can't be written to; give another folder")


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="studies.new_machine",
        usage="python -m studies.new_machine FILE [options]",
        description=__doc__.partition(": ")[2] if __doc__ else None,
        epilog="All answers but the optional ones are needed. A rotary axis is answered in its units: kg m^2, N m, rad "
        "or deg, rpm. Exit status: 0 written; 2 bad input.",
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="the machine file to write, such as my_axis.toml")
    for one in (*ANSWERS, *OPTIONAL):
        text = f'{one.meaning}, such as "{one.example}"' + (" (optional)" if one in OPTIONAL else "")
        parser.add_argument(one.option, dest=one.name, metavar=one.metavar, help=text)
    parser.add_argument("--overwrite", action="store_true", help="replace FILE where it exists")
    return parser


if __name__ == "__main__":
    sys.exit(main())
