"""`python -m studies.gap_diagnosis RECORD...`: where a machine deviates from its model, and why."""

from studies.interrupt import supervise

if __name__ == "__main__":
    supervise()  # before anything that takes time is imported

import sys
from collections.abc import Sequence
from pathlib import Path

from studies.command import guarded, parser_of, run
from studies.gap_diagnosis.options import DiagnosisOptions
from studies.study import Study

STUDY = Study(
    "gap_diagnosis",
    "Where does the real machine deviate from its model, which effect causes it, how much of the gap does it close?",
    DiagnosisOptions,
    writes=("improved.toml", "suite.csv", "next_experiment.csv"),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit status; writes the draft of an effect where one is asked for."""
    return guarded(lambda: _run(arguments))


def _run(arguments: Sequence[str] | None) -> int:
    given = parser_of(STUDY).parse_args(arguments)
    file, given.draft_effect = given.draft_effect, None  # which the study itself does not write
    if file is None:
        return run(STUDY, given)
    from studies.gap_diagnosis.draft import require_draftable, written

    require_draftable(file, overwrite=given.overwrite)
    status = run(STUDY, given)
    print(written(file, Path(given.output or Path("reports/out") / STUDY.name)))
    return status


if __name__ == "__main__":
    sys.exit(main())
