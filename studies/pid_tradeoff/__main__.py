"""`python -m studies.pid_tradeoff`: certified PIDs along the bound on |S|, and the limits of every PID."""

from studies.interrupt import supervise

if __name__ == "__main__":
    supervise()  # before anything that takes time is imported

import sys

from studies.command import main
from studies.pid_tradeoff.options import TradeoffOptions
from studies.study import Study

STUDY = Study(
    "pid_tradeoff",
    "How much friction suppression does the stability margin allow?",
    TradeoffOptions,
    writes=("controller.json",),
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
