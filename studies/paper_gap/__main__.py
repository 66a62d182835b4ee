"""`python -m studies.paper_gap`: what could have left 2.4 um and inching motions that miss on the paper's table."""

import sys

from studies.command import main
from studies.paper_gap.options import PaperOptions
from studies.study import Study

STUDY = Study(
    "paper_gap",
    "Which effects leave what compensation left on the paper's table, and which experiment would tell?",
    PaperOptions,
    writes=("next_experiment.csv", "second_experiment.csv"),
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
