"""Lines of a periodic excitation on which another signal stands: a ripple that the axis rolls over as often in each
period. X / U is there what feedback answers to that signal, and not the plant; neither the periods nor the lines
between show it. One such line hides every mode from the search, which no line of a plant does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.identification.modal.local_rational import DEGREE, MIN_DENOMINATOR_RATIO, PASSES
from models.identification.modal.order import MISFIT_VARIANCE_RATIO, Chosen
from models.identification.modal.problem import Lines, Problem
from models.identification.modal.transfer import Array, Complex

STANDING: Final = 30.0  # times the usual error of what neighbours foretell, from which on a line may be foreign,
TRIED_LINES: Final = 3  # so many at a time
MAX_FOREIGN_LINES: Final = 3  # lines that are left out
NEIGHBOURS: Final = 4  # neighbours on each side, from which a line is foretold

Mask = NDArray[np.bool_]


def left_out(problem: Problem, found: Chosen, search: Callable[[Problem], Chosen]) -> tuple[Chosen, Mask]:
    """What is found once the foreign lines of one response are left out, and which lines (n,) were used.

    Only where what is found is far from the stated errors; a line is foreign if without it this is
    MISFIT_VARIANCE_RATIO times less.
    """
    used = np.ones(problem.lines[0].f.size, bool)
    for _ in range(MAX_FOREIGN_LINES):
        one = problem.lines[0].kept(used)
        if not problem.known or found.best.cost <= MISFIT_VARIANCE_RATIO * 2 * one.f.size:
            break
        places = np.flatnonzero(used)
        suspects = _suspects(one)
        if not suspects:
            break
        tried = [(int(places[i]), search(_without(problem, used, int(places[i])))) for i in suspects]
        line, better = min(tried, key=lambda pair: pair[1].best.cost)
        if better.best.cost > found.best.cost / MISFIT_VARIANCE_RATIO:
            break
        used[line], found = False, better
    return found, used


def _without(problem: Problem, used: Mask, line: int) -> Problem:
    kept = used.copy()
    kept[line] = False
    return replace(problem, lines=(problem.lines[0].kept(kept),))


def _suspects(lines: Lines) -> list[int]:
    """The lines that stand out from what their neighbours foretell, which near one mode are a rational function."""
    shape = lines.p * (2j * np.pi * lines.f) ** 2
    away: Array = np.asarray([_foretold(lines.f, shape, i) for i in range(lines.f.size)]) / (2 * np.pi * lines.f) ** 2
    away = away * lines.weight
    worst = np.argsort(-away, kind="stable")[:TRIED_LINES]
    return [int(i) for i in worst if away[i] > STANDING * np.median(away)]


def _foretold(f: Array, shape: Complex, line: int) -> float:
    """By how much one line of w^2 P (n,) [1/kg] is not B / A, of degree DEGREE in log f, of those around it [1/kg]."""
    near = np.clip(line - NEIGHBOURS, 0, f.size - 2 * NEIGHBOURS - 1) + np.arange(2 * NEIGHBOURS + 1)
    near = near[near != line]
    place = np.log(f[near] / f[line])
    powers = (place / np.max(np.abs(place)))[:, None] ** np.arange(DEGREE + 1)
    weight, found = np.ones(near.size), np.zeros(2 * DEGREE + 1, complex)
    for _ in range(PASSES):
        columns = np.hstack([powers, -shape[near, None] * powers[:, 1:]]) * weight[:, None]
        found, *_ = np.linalg.lstsq(columns, shape[near] * weight)
        weight = 1 / np.maximum(np.abs(1 + powers[:, 1:] @ found[DEGREE + 1 :]), MIN_DENOMINATOR_RATIO)
    return float(np.abs(shape[line] - found[0]))
