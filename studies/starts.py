"""What an unknown state of the friction costs when a controller is started, and what the wipe makes of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.wiping import from_starts
from models.controller import Controller, References
from models.friction import Friction, reached_states
from models.machine import Machine
from studies.scattered import QUANTILE

Array = NDArray[np.float64]


def cost_of_starts(
    machine: Machine,
    controller: Controller,
    compensator: Friction,
    given: References,
    wiped: References,
    target: Array,
    count: int,
    seed: int,
) -> dict[str, Any]:
    """Settling of each motion of a target (n,) [m] over `count` random starts, for results.json; see `from_starts`."""
    starts = reached_states(machine.friction, count, seed)
    found = from_starts(machine, controller, compensator, given, wiped, target, starts, seed)
    return {
        "starts": count,
        "tolerance_m": machine.specification.tolerance,
        "unwiped": _by_motion(found.unwiped),
        "wiped": _by_motion(found.wiped),
        "apart_N": found.apart,
    }


def _by_motion(settling: Array) -> list[Mapping[str, float]]:
    """Median, 95 % quantile and largest settling time [s] of each motion over (starts, motions)."""
    return [
        {
            "median_s": float(np.quantile(one, 0.5, method="higher")),
            "quantile_s": float(np.quantile(one, QUANTILE, method="higher")),
            "largest_s": float(np.max(one)),
        }
        for one in settling.T
    ]
