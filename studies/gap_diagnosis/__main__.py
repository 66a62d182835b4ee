"""`python -m studies.gap_diagnosis RECORD...`: where a machine deviates from its model, and why."""

from studies.interrupt import supervise

if __name__ == "__main__":
    supervise()  # before anything that takes time is imported

import argparse
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
    writes=("improved.toml", "suite.csv", "next_experiment.csv", "asked/*"),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit status."""
    return guarded(lambda: _run(arguments))


def _run(arguments: Sequence[str] | None) -> int:
    parser = parser_of(STUDY)
    given = parser.parse_args(arguments)
    folder, given.continue_ = given.continue_, None  # which the study itself is not asked
    if given.machine_process is not None:
        return _asking(given, folder)
    if folder is None:
        return _drafted(given)
    from studies.gap_diagnosis import earlier

    before = earlier.read(folder)
    given = earlier.continued(given, before, parser.parse_args([]))
    status = _drafted(given)
    print(earlier.since(before, earlier.results_in(given.output)))
    return status


def _asking(given: argparse.Namespace, folder: Path | None) -> int:
    """Asks the machine for records first, and tells the course of it last."""
    from studies.gap_diagnosis.asking import asked_for
    from studies.gap_diagnosis.course import course, told
    from studies.gap_diagnosis.draft import require_draftable
    from studies.options import BadInputError

    if given.draft_effect is not None:  # before the machine is moved for it
        require_draftable(given.draft_effect, overwrite=given.overwrite)
    if folder is not None:
        raise BadInputError("--machine-process: begins anew; give the earlier records as RECORD instead of --continue")
    if given.looks is not None:
        raise BadInputError("--machine-process: writes its own looks; leave --looks out")
    whole = asked_for(given)
    status = _drafted(whole)
    looks = course(whole.looks)
    assert looks is not None
    print(told(looks))
    return status


def _drafted(given: argparse.Namespace) -> int:
    """Runs the study, and writes the draft of an effect where one is asked for."""
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
