"""`python -m studies.all`: every report, and a page that links them with the state of all checks."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from studies.catalogue import every
from studies.command import BAD_INPUT, CHECK_MISSED, DONE, BadInputError, Parser, guarded, main, require_writable


def run(arguments: Sequence[str] | None = None) -> int:
    """Runs every study and returns the worst exit status; the index is written whatever the checks say."""
    return guarded(lambda: _run(arguments))


def _run(arguments: Sequence[str] | None) -> int:
    parser = Parser(prog="studies.all", description="Builds every report on the default machine, and an index of them.")
    parser.add_argument(
        "--output",
        type=Path,
        default=Path("reports/out"),
        metavar="FOLDER",
        help="one folder a study and index.html go here (default: reports/out)",
    )
    parser.add_argument("--quick", action="store_true", help="quick runs of all; the page says so")
    parser.add_argument("--seed", default="0", metavar="N", help="of all that is random (default: 0)")
    options = parser.parse_args(arguments)
    require_writable(options.output)
    from reports.index import Entry, write_index

    entries, missed = [], False
    for name, study in every().items():
        print(f"== {name}", flush=True)
        output = options.output / name
        quick = ["--quick"] if options.quick else []
        status = main(study, ["--output", str(output), "--seed", options.seed, *quick])
        if status == BAD_INPUT:
            raise BadInputError(f"{name} could not run; see its line above")
        missed |= status == CHECK_MISSED
        checks = json.loads((output / "results.json").read_text(encoding="utf-8"))["checks"]
        failed = tuple(check["name"] for check in checks if not check["holds"])
        entries.append(Entry(name, study.question, len(checks) - len(failed), failed))
    write_index(
        entries, options.output / "index.html", "Quick runs: coarser than the full reports." if options.quick else ""
    )
    print("written:", options.output / "index.html")
    return CHECK_MISSED if missed else DONE


if __name__ == "__main__":
    sys.exit(run())
