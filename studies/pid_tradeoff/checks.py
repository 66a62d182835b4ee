"""Checks of the front: its certificates by means independent of the tuning, and necessary conditions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from design.family import Member
from design.loop import controller_response, frequency_response, grid, sensitivities, sensitivity, stays_below
from design.pid.front import Point
from design.validation import Validation
from models.machine import Machine
from studies.study import Check
from studies.wording import cited

CERTAIN: Final = 1e-6  # Relative distance of the certificate's level above the peak found.


def made(
    members: Sequence[Member],
    points: Sequence[Point],
    results: dict[str, Any],
    compensated: Validation,
    machine: Machine,
) -> tuple[Check, ...]:
    """The study's checks; one of them is missed if no PID meets the requested bound on |S|."""
    radius = max(loop.spectral_radius for point in points for loop in point.loops)
    excess = max(point.ms / (point.bound or math.inf) for point in points)
    published = max(row["largest_error"] for row in results["published"])
    settled = max(one.settling_time for one in compensated.positive)
    checks: tuple[Check, ...] = (
        Check("largest eigenvalue of all loops of the front", radius, "1", 1 - 1e-9, "stability"),
        Check("largest peak of the sensitivity over its bound", excess, "1", 1 + 2e-4, "certificate"),
        Check(
            "the same on a ten times finer grid, over the peak", _finer(members, points), "1", 1 + 1e-6, "certificate"
        ),
        Check(
            "loops whose peaks are not proved at all frequencies", _uncertain(members, points), "1", 0, "Hamiltonian"
        ),
        Check("imbalance of Bode's integral", results["limits"]["imbalance"], "1", 0.01, "Bode"),
        Check("error to published optima", published, "1", 0.01, "Åström et al."),
        Check(
            "settling of the chosen PID with compensation",
            settled,
            "s",
            machine.specification.settling_time,
            cited(machine, "specification.settling_time"),
        ),
    )
    asked, kept = results["wanted"]["ms"], results["chosen"]["bound"]
    if kept > asked:
        checks += (Check("least bound on the sensitivity with a PID", kept, "1", asked, "--ms"),)
    return checks


def _finer(members: Sequence[Member], points: Sequence[Point]) -> float:
    """Ratio of the largest |S| on a ten times finer grid to the peak found."""
    worst = 0.0
    for point in points:
        for member, loop in zip(members, point.loops, strict=True):
            omega = grid(member.plant, point.feedback, 2000)
            c = controller_response(point.feedback, float(member.plant.dt), omega)
            s = np.abs(sensitivities(frequency_response(member.plant, omega), c)["S"])
            worst = max(worst, float(np.max(s)) / loop.ms.value)
    return worst


def _uncertain(members: Sequence[Member], points: Sequence[Point]) -> int:
    """Number of loops whose |S| or |T| is not certified to stay below the peaks found at all frequencies."""
    missed = 0
    for point in points:
        for member, loop in zip(members, point.loops, strict=True):
            for name, peak in (("S", loop.ms), ("T", loop.mt)):
                system = sensitivity(member.plant, point.feedback, name)  # type: ignore[arg-type]
                missed += not stays_below(system, peak.value * (1 + CERTAIN))
    return missed
