"""`python -m tests.benchmark`: time and error of the simulator beside what one would use instead."""

from __future__ import annotations

import argparse
import platform
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from reports import style
from studies.command import to_text
from studies.manifest import versions
from tests.benchmark import outcome
from tests.benchmark.job import Job, default_job
from tests.benchmark.plain import plain
from tests.benchmark.rows import FULL, QUICK, TWIN, Row, Size, contenders, measure, oracle
from tests.benchmark.twin import NoTwinError, build

ROOT = Path(__file__).parents[2]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measures, prints the table and the targets, and writes benchmark.json and benchmark.svg; 0 whatever the times."""
    options = _parser().parse_args(arguments)
    begin = time.monotonic()

    def progress(text: str) -> None:
        print(f"[{time.monotonic() - begin:6.1f} s] {text}", file=sys.stderr, flush=True)

    job, size = default_job(), QUICK if options.quick else FULL
    options.output.mkdir(parents=True, exist_ok=True)
    rows, skipped = run(job, size, progress)
    judged = outcome.targets(rows)
    results = content(job, size, rows, judged, skipped)
    (options.output / "benchmark.json").write_text(to_text(results), encoding="utf-8")
    style.save(outcome.draw, results, options.output / "benchmark.svg")
    print(outcome.table(rows, job.duration, skipped))
    print()
    print(outcome.verdicts(judged))
    if options.quick:
        print("\nA quick run is too short for its times to count.")
    print(
        "\nTimes are processor time; ratios are medians over rounds, to the simulator at 10 substeps in the same round;"
    )
    print("errors are the largest |x - oracle| of a motion and its reversal, without rounding by the scale.")
    print("written:", options.output / "benchmark.json", options.output / "benchmark.svg")
    return 0


def run(job: Job, size: Size, progress: Callable[[str], None]) -> tuple[tuple[Row, ...], str | None]:
    """The rows, and why there is no C twin among them (None: there is)."""
    twin, skipped = None, None
    try:
        twin = build()
    except NoTwinError as error:
        skipped = str(error)
    with plain(size.piece) as uncompiled:
        return measure(contenders(job, size, twin, uncompiled), oracle(job), size, progress), skipped


def content(
    job: Job, size: Size, rows: Sequence[Row], judged: Sequence[outcome.Target], skipped: str | None
) -> dict[str, Any]:
    """benchmark.json."""
    return {
        "job": {"duration_s": job.duration, "samples": job.target.size, "sample_time_s": job.machine.sample_time},
        "measured": {"fast_s": min(size.duration, job.duration), "slow_s": size.piece, "rounds": size.rounds},
        "rows": [
            {
                "family": row.family,
                "label": row.label,
                "seconds_per_simulated_second": row.per_second,
                "seconds_per_job": row.per_second * job.duration,
                "time_ratio": row.ratio,
                "error_m": row.error,
                "same_job": row.same_job,
                "note": row.note,
                "measured_seconds_per_simulated_second": row.measured,
            }
            for row in rows
        ],
        "targets": [{**vars(target), "reached": target.reached} for target in judged],
        "skipped": {} if skipped is None else {TWIN: skipped},
        "cpu": _cpu(),
        "system": platform.system(),
        "versions": versions(),
    }


def _cpu() -> str | None:
    """The processor's name, where the system says it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return None
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), None)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="tests.benchmark", description=__doc__)
    parser.add_argument(
        "--output",
        type=Path,
        default=ROOT / "reports" / "out" / "benchmark",
        metavar="FOLDER",
        help="where benchmark.json and benchmark.svg go (default: reports/out/benchmark)",
    )
    parser.add_argument("--quick", action="store_true", help="small sizes, for a smoke test")
    return parser


if __name__ == "__main__":
    sys.exit(main())
