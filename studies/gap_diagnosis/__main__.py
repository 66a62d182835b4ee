"""`python -m studies.gap_diagnosis RECORD...`: where a machine deviates from its model, and why."""

from studies.interrupt import supervise

if __name__ == "__main__":
    supervise()  # before anything that takes time is imported

import sys

from studies.command import main
from studies.gap_diagnosis.options import DiagnosisOptions
from studies.study import Study

STUDY = Study(
    "gap_diagnosis",
    "Where does the real machine deviate from its model, which effect causes it, how much of the gap does it close?",
    DiagnosisOptions,
    writes=("improved.toml", "suite.csv", "next_experiment.csv"),
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
