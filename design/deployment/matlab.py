"""The law as a MATLAB function with its coefficients, and a check against the vectors."""

from __future__ import annotations

from design.deployment.templating import filled
from design.deployment.vectors import Vectors
from models.deployment.coefficients import Coefficients


def matlab_files(known: Coefficients, title: str) -> dict[str, str]:
    """The functions by file name; coefficients in SI units. title: what designed it."""
    return {
        "axis_law.m": filled("axis_law.m.j2", repr, k=known, title=title),
        "axis_check.m": filled("axis_check.m.j2", repr),
    }


def vectors_csv(vectors: Vectors) -> str:
    """The vectors as CSV for any program: see the head for what is asked and in which unit [m], [N]."""
    head = (
        "asked (0 step; 1 reset; 2 wipe; 3 plan; 4 learn; 5 init),target_m (reset: position_m),"
        "position_m (reset: thrust_N),thrust_N,status"
    )
    return "\n".join([head, *(",".join(map(repr, row)) for row in vectors.rows())]) + "\n"
