"""`python -m studies.identify_machine RECORD...`: from measured records to a machine file with uncertainties."""

from studies.interrupt import supervise

if __name__ == "__main__":
    supervise()  # before anything that takes time is imported

import sys

from studies.command import main
from studies.identify_machine.options import IdentificationOptions
from studies.study import Study

STUDY = Study(
    "identify_machine",
    "Which machine is this, according to its frequency response, hysteresis and motion records?",
    IdentificationOptions,
    writes=("identified.toml",),
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
