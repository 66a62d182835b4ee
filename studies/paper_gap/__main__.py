"""`python -m studies.paper_gap`: possible causes of the 2.4 um and the late inching motions on the paper's table."""

from studies.interrupt import supervise

if __name__ == "__main__":
    supervise()  # before anything that takes time is imported

import sys

from studies.command import main
from studies.paper_gap.options import PaperOptions
from studies.study import Study

STUDY = Study(
    "paper_gap",
    "Is the dispersion left on the paper's table due to the compensator's design, a wrong parameter or an effect?",
    PaperOptions,
    writes=("next_experiment.csv", "second_experiment.csv"),
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
