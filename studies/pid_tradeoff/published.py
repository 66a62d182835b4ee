"""Tunings to compare with: a published optimum that the program has to find again as T_s goes to zero."""

from __future__ import annotations

from typing import Any, Final

import control

from design.family import Member
from design.pid import pose, tune
from design.pid_goal import Goal
from design.pid_problem import Bounds
from models.controller import PID

SAMPLE_TIME: Final = 0.0025  # s, against time constants of 1 s
SOURCE: Final = "Åström, Panagopoulos and Hägglund (1998), Automatica 34(5), 585–601, PI for 1/(s+1)³"
# Bound on |S|, proportional gain and integral time [s] as the paper prints them.
PUBLISHED: Final = ((1.4, 0.633, 1.95), (2.0, 1.22, 1.78))


def compare() -> list[dict[str, Any]]:
    """The published PI of largest integral gain beside the one found here, for 1 / (s + 1)^3 and two bounds on |S|."""
    plant = control.sample_system(
        control.ss([[-1, 1, 0], [0, -1, 1], [0, 0, -1]], [[0], [0], [1]], [[1, 0, 0]], 0), SAMPLE_TIME
    )
    scale = PID(1.0, 0.5, 0.0, 0.0)
    problem = pose([Member("cube", plant)], Goal(), scale, derivative=False, derivative_filter=0.0, lowest=1e-5)
    rows = []
    for ms, kp, integral_time in PUBLISHED:
        found = tune(problem, Bounds(ms), [("slow", PID(0.2, 0.1, 0.0, 0.0))], tolerance=1e-5).pid
        here = found.kp / found.ki
        rows.append(
            {
                "ms": ms,
                "kp_published": kp,
                "kp_here": found.kp,
                "integral_time_published_s": integral_time,
                "integral_time_here_s": here,
                "largest_error": max(abs(found.kp / kp - 1), abs(here / integral_time - 1)),
            }
        )
    return rows
