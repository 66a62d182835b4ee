"""`python -m studies.gap_diagnosis RECORD...`: where a machine leaves its model, which effect, how far the gap."""

import sys

from studies.command import main
from studies.gap_diagnosis.options import DiagnosisOptions
from studies.study import Study

STUDY = Study(
    "gap_diagnosis",
    "Where does the real machine leave the model, which effect causes it, how far does the gap shrink?",
    DiagnosisOptions,
    writes=("improved.toml", "suite.csv", "next_experiment.csv"),
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
