"""`python -m studies.export CONTROLLER.json`: the same controller as code for a drive, with its proof."""

from studies.interrupt import supervise

if __name__ == "__main__":
    supervise()  # before anything that takes time is imported

import sys

from studies.command import main
from studies.export.options import ExportOptions
from studies.study import Study

STUDY = Study(
    "export",
    "Is the controller the same in C, as an FMU, in structured text and in MATLAB?",
    ExportOptions,
    writes=("README.md", "controller.json", "vectors.csv", "c/*", "fmi3/*", "st/*", "matlab/*", "cia402/*"),
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
