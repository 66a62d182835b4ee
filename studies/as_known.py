"""A design on machines that its machine file allows, and how well that file knows each value: as reports tell it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.redesign.stated import machines_as_stated
from design.validation import PERIODS, Validation, respond, sequence
from models.controller import Controller
from models.machine import Machine
from models.quantity import keeps_to, listed, show, span
from models.records.settling import settling_time
from models.variation import Known, known
from studies.options import Options
from studies.scattered import QUANTILE, runs_of

Array = NDArray[np.float64]

ORIGINS: Final = {
    "value": "stated beside the value",
    "tolerance": "the file's [tolerance]",
    "usual": "usual tolerance, as the file states no wider one",
}


def on_allowed_machines(
    machine: Machine, controller: Controller, judged: Validation, options: Options, stroke: float
) -> dict[str, Any]:
    """How a design settles on machines drawn from what the file says of its values, for results.json; stroke [m].

    judged: the design's validation on the machine as it is, whose periods each of them has as well. A run that
    never settles, or runs away, has an infinite settling time [s].
    """
    periods = max(judged.periods, PERIODS)
    count = max(runs_of(machine, options) * PERIODS // periods, 1)
    target = sequence(machine, stroke, periods)
    tables = machines_as_stated(machine, count, options.seed)
    begin = target.size - target.size // periods
    with np.errstate(all="ignore"):  # a loop that runs away is a result
        times = [
            _slowest(response.position[begin:], judged, machine)
            for response in respond(tables, controller, target, seed=options.seed)
        ]
    limit = machine.specification.settling_time
    hits = sum(keeps_to(time, limit) for time in times)
    return {
        "machines": count,
        "in_time": hits,
        "median_s": float(np.quantile(times, 0.5, method="higher")),
        "quantile_s": float(np.quantile(times, QUANTILE, method="higher")),
        "known": [row(one) for one in known(machine)],
    }


def _slowest(position: Array, judged: Validation, machine: Machine) -> float:
    """When [s] the slowest motion of the last period, position (n,) [m], has settled."""
    wanted = machine.specification
    errors = [position[one.motion.start : one.motion.stop] - one.motion.target for one in judged.achieved]
    if not all(np.all(np.isfinite(error)) for error in errors):
        return math.inf
    return max(settling_time(error, wanted.tolerance, machine.sample_time) for error in errors)


def row(one: Known) -> dict[str, Any]:
    """A value's standard deviation as results.json holds it: the least and the largest of its numbers [SI], and over
    their sizes [1], None where a number is 0."""
    share = [min(one.relative), max(one.relative)] if math.isfinite(max(one.relative)) else None
    std = [min(one.deviations), max(one.deviations)]
    return {"name": one.name, "unit": one.unit, "std": std, "share": share, "origin": one.origin}


def spread(told: Mapping[str, Any]) -> str:
    """A value's standard deviation in words: a share of it, or in its unit where the value is 0."""
    share = told.get("share") or (told["std"] if told["unit"] == "1" else None)
    if share is None:
        return span(*(show(one, told["unit"], 2) for one in told["std"]))
    return span(*(f"{100 * one:.2g}" for one in share)) + " %"


def origin(told: Mapping[str, Any]) -> str:
    """Where a value's standard deviation is from, in words."""
    return ORIGINS[told["origin"]]


def filters() -> dict[str, Callable[..., Any]]:
    """The filters of a report that tells such rows, by the names that its template uses."""
    return {"spread": spread, "origin": origin, "drawn_from": drawn_from}


def in_short(found: Mapping[str, Any]) -> str:
    """How many of the allowed machines settle in time, and how many values the file itself states deviations of."""
    return f"{found['in_time']} of {found['machines']} ({drawn_from(found)})"


def summary_row(found: Mapping[str, Any]) -> tuple[str, str]:
    """That as a row of a study's summary, a warning where it is less than half of them: the design is then right for
    one machine, and the axis is as likely as not another one of those that the file allows."""
    name = "machines that the file allows on which all motions settle in time"
    return ("WARNING, " if 2 * found["in_time"] < found["machines"] else "") + name, in_short(found)


def limit_rows(machine: Machine) -> list[tuple[str, str]]:
    """A warning for a summary where a fit left values of the machine at the end of their range; else nothing."""
    names = [name for name, source in machine.sources.items() if source.at_limit]
    if not names:
        return []
    told = f"{listed(names)}: the model lacks something, or the records do not show them, so that the axis may behave "
    told += "otherwise than is said here"
    return [("WARNING, values at the end of the range that a fit had", told)]


def drawn_from(found: Mapping[str, Any]) -> str:
    """By which deviations the allowed machines are drawn, in words."""
    own = sum(one["origin"] == "value" for one in found["known"])
    whole = len(found["known"])
    by = "the usual tolerances" if not own else "the file's own deviations" if own == whole else ""
    return by or f"the file's own deviations for {own} of {whole} values, else tolerances"
