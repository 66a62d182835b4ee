"""`python -m studies.trajectory_optimisation`: x_T* by optimal control, validated on the nonsmooth machine."""

from studies.interrupt import supervise

if __name__ == "__main__":
    supervise()  # before anything that takes time is imported

import sys

from studies.command import main
from studies.study import Study
from studies.trajectory_optimisation.options import TrajectoryOptions

STUDY = Study(
    "trajectory_optimisation",
    "Which x_T* makes every motion settle, from any state that earlier motions leave in the friction?",
    TrajectoryOptions,
    writes=("controller.json",),
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
