"""`python -m studies.identify_machine RECORD...`: from measured records to a machine file with uncertainties."""

from studies.interrupt import supervise

if __name__ == "__main__":
    supervise()  # before anything that takes time is imported

import sys
from collections.abc import Sequence

from studies.command import guarded, parser_of, run
from studies.identify_machine.options import IdentificationOptions
from studies.options import BadInputError
from studies.study import Study

STUDY = Study(
    "identify_machine",
    "Which machine is this, according to its frequency response, hysteresis and motion records?",
    IdentificationOptions,
    writes=("identified.toml",),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command and returns its exit status: that of a study, or of writing the references."""
    return guarded(lambda: _run(arguments))


def _run(arguments: Sequence[str] | None) -> int:
    given = parser_of(STUDY).parse_args(arguments)
    if given.write_references is None:
        return run(STUDY, given)
    if given.record:
        raise BadInputError("--write-references: identifies nothing; leave the records out")
    from studies.identify_machine.references import write

    return write(IdentificationOptions(**vars(given)))


if __name__ == "__main__":
    sys.exit(main())
