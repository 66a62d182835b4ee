"""`python -m studies.blind_trial`: a blind test: sealed cases are diagnosed without their key, then scored."""

from studies.interrupt import supervise

if __name__ == "__main__":
    supervise()  # before anything that takes time is imported

import sys

from studies.blind_trial.options import TrialOptions
from studies.command import main
from studies.study import Study

STUDY = Study(
    "blind_trial",
    "How often is the diagnosis right when the effect is withheld?",
    TrialOptions,
    writes=("answers.json",),
    keeps=("answers.json", "sealed"),
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
