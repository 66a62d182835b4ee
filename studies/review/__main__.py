"""`python -m studies.review FOLDER [OTHER]`: is a report reproducible, and what differs between two?"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from studies.command import CHECK_MISSED, DONE, guarded, to_text
from studies.folder import Place, atomic_folder, require_free
from studies.manifest import FORMAT, hashes, versions
from studies.options import Parser
from studies.study import Progress


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit status: 0 follows, 1 does not, 2 bad input."""
    return guarded(lambda: _run(arguments))


def _run(arguments: Sequence[str] | None) -> int:
    parser = Parser(
        prog="studies.review",
        usage="python -m studies.review FOLDER [OTHER] [options]",
        description="Is this report still reproducible from its inputs? With OTHER: what differs between the two?",
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
        "--output",
        type=Path,
        default=Path("reports/out/review"),
        metavar="FOLDER",
        help="where the comparison goes (default: reports/out/review)",
    )
    parser.add_argument(
        "--overwrite", action="store_true", help="replace files in --output that no earlier comparison wrote"
    )
    options = parser.parse_args(arguments)
    return (
        _compare(options.folder, options.other, Place(options.output, "review", overwrite=options.overwrite))
        if options.other
        else _follows(options.folder, options.tolerance)
    )


def _follows(folder: Path, tolerance: float) -> int:
    from studies.review.follows import review

    found = review(folder, tolerance, Progress())
    for one in found.edited:
        print(f"edited    {one}")
    for one in found.changed:
        print(f"changed   {one}")
    print(f"run again {found.verdict}" + (f" within {tolerance:g}" if found.verdict == "equal" else ""))
    for name in found.unequal:
        print(f"          other bytes: {name}")
    if found.first is not None:
        print(f"          {found.first}")
    print(f"{folder} {'follows' if found.follows else 'DOES NOT FOLLOW'} from its inputs")
    return DONE if found.follows else CHECK_MISSED


def _compare(before: Path, after: Path, place: Place) -> int:
    from reports.report import render
    from studies.options import BadInputError
    from studies.review.compare import compare, read, tell

    require_free(place)
    one, other = read(before), read(after)
    if one["study"] != other["study"]:
        raise BadInputError(f"{before} is of {one['study']}, {after} of {other['study']}; give two of one study")
    progress = Progress()
    progress(0.1, "comparing")
    content = compare(one, other)
    report = tell(content)
    content["figures"] = [figure.name for figure in report.figures]
    with atomic_folder(place) as folder:
        shown = {key: item for key, item in content.items() if key not in {"before", "after"}}
        (folder / "results.json").write_text(to_text(shown), encoding="utf-8")
        render(report, content, folder, progress=lambda text: progress(0.5, text))
        inputs = {"before": before.name, "after": after.name}
        record = {"format": FORMAT, "study": "review", "options": {}, "inputs": inputs, "versions": versions()}
        (folder / "manifest.json").write_text(to_text({**record, "outputs": hashes(folder)}), encoding="utf-8")
    turned = [row["name"] for row in content["checks"] if row["turned"]]
    print(f"parameters that differ: {len(content['machine'])}")
    for name in turned:
        print(f"turned    {name}")
    print("written:", *(place.folder / name for name in ("report.html", "report.pdf", "results.json")))
    return CHECK_MISSED if turned else DONE


if __name__ == "__main__":
    sys.exit(main())
