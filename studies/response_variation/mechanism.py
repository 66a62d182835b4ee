"""Why reversal and inching differ, as numbers: the slope that each motion meets, and an exchange of their histories."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from design.validation import Validation
from models.controller import Controller
from models.machine import Machine
from models.records.record import feeding_sequence
from models.records.settling import settling_time
from models.simulation.simulator import simulate


def mechanism(machine: Machine, controller: Controller, without: Validation) -> dict[str, Any]:
    """Slopes [N/m], steady friction [N] and settling times [s] with exchanged initial friction, without compensation.

    For the exchange a single motion is simulated from rest, once with the elements as they stand before the reversal
    and once as before the last inching motion; nothing else changes.
    """
    positive, slopes = without.positive, slopes_met(without)
    ends = [without.response.friction[one.motion.stop - 1] for one in positive]
    own_reversal, own_inching = _settling(machine, controller, 0), _settling(machine, controller, len(positive) - 1)
    reversal = without.reversal.settling_time
    inching = positive[-1].settling_time
    return {
        "slopes_N_per_m": slopes,
        "slope_reversal_N_per_m": slopes[0],
        "slope_inching_N_per_m": float(np.mean(slopes[1:])),
        "slope_first_inching_N_per_m": slopes[1],
        "slope_last_inching_N_per_m": slopes[-1],
        "steady_friction_N": ends,
        "reversal_settling_s": reversal,
        "inching_settling_s": inching,
        "reversal_with_inching_history_s": own_inching,
        "inching_with_reversal_history_s": own_reversal,
        "delay_share": delay_share(reversal, own_inching, inching),
    }


def delay_share(reversal: float, exchanged: float, inching: float) -> float:
    """The share [1] of the reversal's delay over inching that exchanged histories take away; times [s], inf: never."""
    if reversal <= inching:
        return 0.0
    if math.isinf(reversal):
        return float(math.isfinite(exchanged))
    return float((reversal - exchanged) / (reversal - inching))


def slopes_met(without: Validation) -> list[float]:
    """The slope [N/m] that each positive motion meets: the friction gained over its stroke."""
    friction = without.response.friction
    return [
        float(friction[motion.stop - 1] - friction[motion.start]) / (motion.target - motion.origin)
        for motion in (one.motion for one in without.positive)
    ]


def _settling(machine: Machine, controller: Controller, index: int) -> float:
    """Settling time [s] of a motion from rest, with the friction elements as before positive motion `index`."""
    wanted, bare = machine.specification, controller.without_compensation()
    period = feeding_sequence(wanted.stroke, wanted.motions, wanted.interval, machine.sample_time)
    samples = round(wanted.interval / machine.sample_time)
    before = np.concatenate([np.tile(period, 2), period[: index * samples]])
    history = simulate(machine, bare, before).elements
    response = simulate(machine, bare, np.full(samples, wanted.stroke), initial_friction=history)
    return settling_time(response.position - wanted.stroke, wanted.tolerance, machine.sample_time)
