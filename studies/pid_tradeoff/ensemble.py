"""Performance of PIDs on all machines consistent with the same facts (an ensemble), and one PID tuned for them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from design.family import Member, family
from design.loop import assess
from design.pid.goal import Goal
from design.pid.problem import Bounds, TuningError, mt_bound
from design.pid.rules import magnitude, slow_rule
from design.pid.tuning import pose, tune
from design.validation import validate_many
from models.controller import PID, Controller, Feedback
from models.machine import Machine, with_pid

OWN: Final = "own"  # The PID of a member's own file.


def on_every_member(
    others: Sequence[Machine], controller: Controller, feedbacks: Mapping[str, Feedback], ms: float, deadline: float
) -> dict[str, Any]:
    """Largest |S| [1] over a member's four plants, as known, and the reversal's settling [s], by feedback and member.

    controller: gives the feedforward of all motions, without friction compensation. ms: bound on |S| that is counted;
    deadline [s]: the specified settling time.
    """
    named: list[tuple[str, list[Feedback]]] = [(name, [one] * len(others)) for name, one in feedbacks.items()]
    named.append((OWN, [other.control.feedback for other in others]))
    rows = {name: _behaviour(others, controller, each) for name, each in named}
    own = rows[OWN]["settling_s"]
    return {
        "members": [other.name for other in others],
        "mass_kg": [other.plant.mass for other in others],
        "ms_bound": ms,
        "rows": [{"name": name, **row, **_counts(row, own, ms, deadline)} for name, row in rows.items()],
    }


def held(machine: Machine, others: Sequence[Machine], errors: tuple[float, float], limits: Bounds) -> Any:
    """(PID or None, outcome): the PID of largest integral gain that meets the bounds on every member.

    errors [1]: of the modes' frequencies and the mass of `machine` itself, as in `family`.
    """
    members = family(machine, *errors, others)
    bounds = replace(limits, mt=mt_bound(limits.ms, limits.mt))
    try:
        found = tune(pose(members, Goal(), magnitude(machine)), bounds, [("slow rule", slow_rule(machine))])
    except TuningError as error:
        return None, str(error)
    return found.pid, found.attempts[0].outcome


def _behaviour(others: Sequence[Machine], controller: Controller, feedbacks: Sequence[Feedback]) -> dict[str, Any]:
    peaks = []
    for other, feedback in zip(others, feedbacks, strict=True):
        loops = [assess(member.plant, feedback) for member in _plants(other)]
        peaks.append(max(loop.ms.value if loop.stable else math.inf for loop in loops))
    plain = controller.without_compensation()
    machines = [
        with_pid(other, one, "this study") if isinstance(one, PID) else other
        for other, one in zip(others, feedbacks, strict=True)
    ]
    validations = validate_many(machines, [plain.with_feedback(one) for one in feedbacks], periods=4)
    settling = [one.reversal.settling_time for one in validations]
    return {"ms": peaks, "settling_s": settling}


def _plants(machine: Machine) -> tuple[Member, ...]:
    return family(machine, 0.0, 0.0)


def _counts(row: Mapping[str, Any], own: Sequence[float], ms: float, deadline: float) -> dict[str, Any]:
    peaks, settling = np.array(row["ms"]), np.array(row["settling_s"])
    return {
        "stable": int(np.sum(np.isfinite(peaks))),
        "within": int(np.sum(peaks <= ms * (1 + 2e-4))),
        "faster": int(np.sum(settling < np.array(own))),
        "in_time": int(np.sum(settling <= deadline)),
        "ms_range": [float(np.min(peaks)), float(np.median(peaks)), float(np.max(peaks))],
        "settling_range_s": [float(np.min(settling)), float(np.median(settling)), float(np.max(settling))],
    }
