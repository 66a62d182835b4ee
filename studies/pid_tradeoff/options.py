"""Options of pid_tradeoff besides those common to all studies."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from studies.options import Options, choice, path, quantity

if TYPE_CHECKING:
    from design.pid.goal import Objective


@dataclass(frozen=True, kw_only=True)
class TradeoffOptions(Options):
    """The bounds on every loop, and the family of plants they must hold for."""

    objective: Objective = choice(
        "objective of the front: largest integral gain (default), least peak of |PS| up to 1 / (2 pi settling "
        "time), or least error from the settling time on after a step of friction",
        ("integral", "band", "step"),
    )
    ms: float = quantity(
        "1",
        "RATIO",
        "bound on |S| of the controller that is written (default: 2)",
        default=2.0,
        text="2",
        above=1,
    )
    mt: float | None = quantity(
        "1", "RATIO", "bound on |T| (default: that on |S|, but at least 1.4, for every point)", above=1
    )
    noise: float | None = quantity(
        "N/m",
        "STIFFNESS",
        'bound on |CS|, thrust per noise of the scale, such as "30000 N/mm" (default: what the present PID has)',
    )
    mode_error: float | None = quantity(
        "1",
        "RATIO",
        "relative error of the modes' frequencies, either way (default: 0.03, or three deviations that the machine "
        "file states, where they are more)",
        at_least=0,
        below=0.5,
    )
    mass_error: float | None = quantity(
        "1",
        "RATIO",
        "relative error of the mass, either way (default: 0.1, or three deviations that the machine file states, where "
        "they are more)",
        at_least=0,
        below=0.5,
    )
    ensemble: Path | None = path(
        "FILE",
        "ensemble file whose machines join the family of the tuning (default: none; the default machine's "
        "PIDs are then judged on models/machines/linear_motor_table_ensemble.toml afterwards)",
        reviewable=True,
    )
