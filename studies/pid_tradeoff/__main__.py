"""`python -m studies.pid_tradeoff`: the PIDs at the edge of stability, certified, and what no PID can pass."""

import sys

from studies.command import main
from studies.pid_tradeoff.options import TradeoffOptions
from studies.study import Study

STUDY = Study(
    "pid_tradeoff", "How much friction suppression does stability leave?", TradeoffOptions, writes=("controller.json",)
)

if __name__ == "__main__":
    sys.exit(main(STUDY))
