"""`python -m studies.deadbeat_design`: from a machine file to a validated feedforward and its report."""

from studies.interrupt import supervise

if __name__ == "__main__":
    supervise()  # before anything that takes time is imported

import sys

from studies.command import main
from studies.deadbeat_design.options import DeadbeatOptions
from studies.study import Study

STUDY = Study(
    "deadbeat_design",
    "Which N_ff(z), D_ff(z) suit this machine, and do they meet the specification?",
    DeadbeatOptions,
    writes=("controller.json",),
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
