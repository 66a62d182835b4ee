"""`python -m studies.response_variation`: the paper's figures and numbers from the model, and the set that fits."""

from studies.interrupt import supervise

if __name__ == "__main__":
    supervise()  # before anything that takes time is imported

import sys

from studies.command import main
from studies.response_variation.options import VariationOptions
from studies.study import Study

STUDY = Study(
    "response_variation",
    "Does the model reproduce the paper's response variation, and which tables are consistent with it?",
    VariationOptions,
    writes=("ensemble.toml", "most_central.toml", "conventions.toml"),
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
