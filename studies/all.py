"""`python -m studies.all`: every report, and a page that links them with the state of all checks."""

from __future__ import annotations

from studies.interrupt import supervise

if __name__ == "__main__":
    supervise()  # before anything that takes time is imported

import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from studies.catalogue import every
from studies.command import BAD_INPUT, CHECK_MISSED, DONE, guarded, main
from studies.folder import require_writable
from studies.interrupt import INTERRUPTED, finish_first, heed_interruptions
from studies.options import BadInputError, Parser
from studies.study import Study

if TYPE_CHECKING:
    from reports.index import Entry


def run(arguments: Sequence[str] | None = None) -> int:
    """Runs every study and returns the worst exit status; the index is written whatever the studies say."""
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
    parser.add_argument(
        "--overwrite", action="store_true", help="replace files in the studies' folders that no earlier run wrote"
    )
    options = parser.parse_args(arguments)
    require_writable(options.output)
    index = options.output / "index.html"
    if not options.overwrite and os.path.lexists(index) and not _is_index(index):
        raise BadInputError(
            f"--output {options.output}: index.html in it is not of an earlier run; give another folder, "
            "or --overwrite to replace it"
        )
    from reports.index import write_index

    flags = [f"--{name}" for name in ("quick", "overwrite") if getattr(options, name)]
    entries, worst = [], DONE
    for name, study in every().items():
        print(f"== {name}", flush=True)
        output = options.output / name
        status = main(study, ["--output", str(output), "--seed", options.seed, *flags])
        if status == INTERRUPTED:
            return INTERRUPTED
        heed_interruptions()  # which the study did not any more while it put its results in place
        entries.append(_entry(study, output, status))
        worst = max(worst, status)
    finish_first()
    write_index(entries, index, "Quick runs: coarser than the full reports." if options.quick else "")
    print("written:", index)
    return worst


def _is_index(file: Path) -> bool:
    """Whether a file is an index that this wrote."""
    if file.is_symlink() or not file.is_file():
        return False
    with file.open(encoding="utf-8", errors="replace") as stream:
        return "<title>Reports</title>" in stream.read(4096)


def _entry(study: Study, output: Path, status: int) -> Entry:
    """What the index says of a study that ended with `status`; one without results does not stop the others."""
    from reports.index import Entry

    if status not in {DONE, CHECK_MISSED}:
        what = "bad input" if status == BAD_INPUT else "a fault"
        return Entry(study.name, study.question, failure=f"{what} (exit status {status}); see what its run printed")
    checks = json.loads((output / "results.json").read_text(encoding="utf-8"))["checks"]
    failed = tuple(check["name"] for check in checks if not check["holds"])
    return Entry(study.name, study.question, len(checks) - len(failed), failed)


if __name__ == "__main__":
    sys.exit(run())
