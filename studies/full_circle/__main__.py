"""`python -m studies.full_circle`: ask, name, redesign, run: does the gap close?"""

from studies.interrupt import supervise

if __name__ == "__main__":
    supervise()  # before anything that takes time is imported

import sys

from studies.command import main
from studies.full_circle.options import CircleOptions
from studies.study import Study

STUDY = Study(
    "full_circle",
    "Does the gap close: asked, named, redesigned and run on a withheld machine, or on an axis of one's own?",
    CircleOptions,
    writes=(
        "identified.toml",
        "improved.toml",
        "controller.json",
        "suite.csv",
        "next_experiment.csv",
        "run_current.csv",
        "run_redesign.csv",
    ),
    keeps=("steps", "sealed"),
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
