"""`python -m studies.review FOLDER [OTHER]`: is a report reproducible, and what differs between two?"""

from __future__ import annotations

from studies.interrupt import remove_if_interrupted, supervise

if __name__ == "__main__":
    supervise()  # before anything that takes time is imported

import argparse
import math
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from studies.command import CHECK_MISSED, DONE, guarded, to_text
from studies.folder import Place, atomic_folder, require_free
from studies.manifest import FORMAT, hashes, versions
from studies.options import BadInputError, Parser
from studies.review.bounded import Limits
from studies.review.copying import FILE_SIZE, FILES, WHOLE_SIZE, visible
from studies.study import Progress

USUAL = Limits()


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit status: 0 follows, 1 does not, 2 bad input."""
    return guarded(lambda: _run(arguments))


def _run(arguments: Sequence[str] | None) -> int:
    options = _parser().parse_args(arguments)
    if not 0 <= options.tolerance < 1:
        raise BadInputError(f"--tolerance {options.tolerance:g}: must be from 0 on and below 1")
    if not (math.isfinite(options.time_limit) and options.time_limit > 0):
        raise BadInputError(f"--time-limit {options.time_limit:g}: must be a number of seconds above 0")
    limits = Limits(options.time_limit)
    if options.other:
        place = Place(options.output, "review", overwrite=options.overwrite)
        return _compare(options.folder, options.other, place, limits)
    for file in options.input:
        if not file.is_file():
            raise BadInputError(f"--input {file}: is not a file; give one that the run read")
    return _follows(options.folder, options.tolerance, options.input, limits)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="studies.review",
        usage="python -m studies.review FOLDER [OTHER] [options]",
        description="Is this report still reproducible from its inputs? With OTHER: what differs between the two? "
        "The folder may be a stranger's: only plain files in it are read (at most "
        f"{FILES}, {FILE_SIZE >> 20} MB each, {WHOLE_SIZE >> 20} MB in all), and the study is run again only by "
        "options that reach nothing outside, in a process of its own without a network, with at most "
        f"{USUAL.seconds / 60:g} minutes, {USUAL.memory >> 30} GB of memory and files of {USUAL.file >> 20} MB. What "
        "it will run is said first.",
        epilog="Exit status: 0 it follows, or no check turned; 1 it does not, or one did; 2 bad input.",
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="a folder that a study wrote")
    parser.add_argument("other", type=Path, nargs="?", metavar="OTHER", help="a second one, of the same study")
    parser.add_argument(
        "--tolerance",
        type=float,
        default=1e-9,
        metavar="RATIO",
        help="relative difference up to which numbers count as equal (default: 1e-9)",
    )
    parser.add_argument(
        "--input",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="a file outside the folder that the run read, such as a record; may be repeated. No other is read",
    )
    parser.add_argument(
        "--time-limit",
        type=float,
        default=USUAL.seconds,
        metavar="SECONDS",
        help=f"time after which the second run is stopped (default: {USUAL.seconds:g})",
    )
    parser.add_argument(
        "--output",
        type=Path,
        default=Path("reports/out/review"),
        metavar="FOLDER",
        help="where the comparison goes (default: reports/out/review)",
    )
    parser.add_argument(
        "--overwrite", action="store_true", help="replace files in --output that no earlier comparison wrote"
    )
    return parser


def _follows(folder: Path, tolerance: float, given: Sequence[Path], limits: Limits) -> int:
    from studies.review.follows import review

    found = review(folder, tolerance, Progress(), given, limits)
    for one in found.edited:
        print(f"edited    {one}")
    for one in found.changed:
        print(f"changed   {one}")
    print(f"run again {found.verdict}" + (f" within {tolerance:g}" if found.verdict == "equal" else ""))
    for name in found.unequal:
        print(f"          other bytes: {visible(name)}")
    if found.first is not None:
        print(f"          {visible(found.first, 300)}")
    if found.reason:
        print(f"          {found.reason}")
    print(f"{folder} {'follows' if found.follows else 'DOES NOT FOLLOW'} from its inputs")
    return DONE if found.follows else CHECK_MISSED


def _compare(before: Path, after: Path, place: Place, limits: Limits) -> int:
    from studies.review.follows import compared

    require_free(place)
    with tempfile.TemporaryDirectory() as name, atomic_folder(place) as folder:
        remove_if_interrupted(Path(name))
        made, content = compared(before, after, Path(name), Progress(), limits)
        shutil.copytree(made, folder, dirs_exist_ok=True)
        inputs = {"before": before.name, "after": after.name}
        record = {"format": FORMAT, "study": "review", "options": {}, "inputs": inputs, "versions": versions()}
        (folder / "manifest.json").write_text(to_text({**record, "outputs": hashes(folder)}), encoding="utf-8")
    turned = [row["name"] for row in content["checks"] if row["turned"]]
    print(f"parameters that differ: {len(content['machine'])}")
    for name in turned:
        print(f"turned    {visible(name)}")
    print("written:", *(place.folder / name for name in ("report.html", "report.pdf", "results.json")))
    return CHECK_MISSED if turned else DONE


if __name__ == "__main__":
    sys.exit(main())
