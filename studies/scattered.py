"""Settling times as reports state them: the single run, what it hangs on, and how it scatters over many runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.judging.scatter import PERIODS, Scatter, dither_of, margin_of, scatter
from design.validation import Validation
from models.controller import Controller, References
from models.machine import Machine
from models.records.settling import Margin
from studies.effort import period
from studies.options import Options

Array = NDArray[np.float64]

RUNS: Final = 40  # with a dither and a past of their own each,
FEW_RUNS: Final = 10  # in a quick run, with effects or a law, which run one by one, and where the motions take long:
RUN_SAMPLES: Final = 2_000_000  # samples that all of them have together, about
LEAST_RUNS: Final = 4
QUANTILE: Final = 0.95  # that reports state of runs, of starts and of tables


def high_end(runs: int) -> str:
    """What the QUANTILE of so many runs is, as the head of a column: of few runs the longest one is."""
    last = math.ceil(QUANTILE * (runs - 1)) == runs - 1
    return f"longest of {runs}" if last else f"{100 * QUANTILE:g} %"


def runs_of(machine: Machine, options: Options, most: int = RUNS) -> int:
    """How many runs tell the scatter of this machine's outcomes in reasonable time."""
    few = options.quick or machine.effects or machine.control.law is not None
    affordable = int(RUN_SAMPLES // (PERIODS * period(machine)))
    return max(min(affordable, FEW_RUNS if few else most), LEAST_RUNS)


def scattered(
    machine: Machine,
    controller: Controller,
    validation: Validation,
    options: Options,
    *,
    given: References | None = None,
    start: Array | None = None,
    stroke: float | None = None,
    most: int = RUNS,
) -> dict[str, Any]:
    """The outcome of `validation`, its margins, and its scatter over runs, for results.json; stroke [m].

    given, start: as of `scatter`, over as many periods as the validation. most: runs at most.
    """
    periods = validation.periods if given is not None else max(PERIODS, validation.periods - 1)
    count = runs_of(machine, options, most)
    if periods > PERIODS:
        count = max(count * PERIODS // periods, LEAST_RUNS)
    found = scatter(machine, controller, count, options.seed, stroke=stroke, periods=periods, given=given, start=start)
    return {
        "runs": count,
        "dither_m": dither_of(machine),
        "virgin": given is not None,
        "reversal": _settling(validation, found.reversal, reversal=True),
        "slowest": _settling(validation, found.slowest, reversal=False),
        "dispersion": {"single_m": validation.worst_dispersion, **_over(found.dispersion, "m")},
        "margin": _over_margins(found),
    }


def margin_to_json(margin: Margin) -> dict[str, float]:
    """A margin [m], [s] as results.json holds it."""
    return {
        "less_m": margin.less,
        "earlier_s": margin.earlier,
        "more_m": margin.more,
        "later_s": margin.later,
        "nearest_m": margin.nearest,
        "otherwise_s": margin.otherwise,
    }


def _settling(validation: Validation, times: Array, *, reversal: bool) -> dict[str, Any]:
    motion = validation.reversal if reversal else validation.slowest
    margin = margin_to_json(margin_of(validation, reversal=reversal))
    return {"single_s": motion.settling_time, **margin, **_over(times, "s")}


def _over(values: Array, unit: str) -> dict[str, float]:
    """Median, 95 % quantile and largest of the runs (runs,); among motions that never settle each is one of them."""
    return {
        f"median_{unit}": float(np.quantile(values, 0.5, method="higher")),
        f"quantile_{unit}": float(np.quantile(values, QUANTILE, method="higher")),
        f"largest_{unit}": float(np.max(values)),
    }


def _over_margins(found: Scatter) -> dict[str, float]:
    """Median and least of the slowest motions' margins [m]."""
    return {"median_m": float(np.median(found.margins)), "least_m": float(np.min(found.margins))}


def rows_of(cases: Sequence[tuple[str, dict[str, Any]]]) -> list[dict[str, Any]]:
    """A row for the settling times of each case, the reversal's and the slowest motion's; one where they are equal."""
    rows = []
    for name, case in cases:
        which = {"reversal": case["reversal"], "slowest motion": case["slowest"]}
        if which["reversal"] == which["slowest motion"]:
            which = {"all motions": case["slowest"]}
        rows += [{"case": name, "motion": motion, **one} for motion, one in which.items()]
    return rows
