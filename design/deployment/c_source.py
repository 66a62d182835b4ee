"""The law as C99 in double or single precision, with the vectors that it replays."""

from __future__ import annotations

import math
from typing import Final

from design.deployment.templating import filled, hexadecimal
from design.deployment.vectors import MISSING, Vectors
from models.deployment.coefficients import Coefficients
from models.deployment.learning_steps import MAX_STROKE_MISS, learning_numbers

PROGRAMS: Final = ("closed_loop", "session", "day")  # that close the loop with the plant


def law_sources(known: Coefficients, origin: str) -> dict[str, str]:
    """The sources of the law by file name; coefficients in SI units. origin: of the law, for a comment."""
    taught = learning_numbers(known.learning, known.stroke, len(known.position))
    given = {
        "k": known,
        "origin": origin,
        "keep": known.pid.pole(known.sample_time),
        "early": taught.early.tolist(),
        "sooner": taught.sooner.tolist(),
        "same": MAX_STROKE_MISS,
    }
    return {f"axis_law.{end}": filled(f"axis_law.{end}.j2", hexadecimal, **given) for end in ("h", "c")}


def selftest_sources(known: Coefficients, vectors: Vectors) -> dict[str, str]:
    """The sources of the self-test by file name; coefficients in SI units."""
    rows = [[number if math.isfinite(number) else MISSING for number in row] for row in vectors.rows()]
    return {
        "axis_vectors.h": filled("axis_vectors.h.j2", hexadecimal, k=known, rows=rows),
        "axis_selftest.c": filled("axis_selftest.c.j2", hexadecimal),
        "axis_replay.c": filled("axis_replay.c.j2", hexadecimal),
    }


def loop_sources(known: Coefficients) -> dict[str, str]:
    """The programs that close the loop with the plant's sources, by file name; coefficients in SI units."""
    return {f"axis_{name}.c": filled(f"axis_{name}.c.j2", hexadecimal, k=known) for name in PROGRAMS}
