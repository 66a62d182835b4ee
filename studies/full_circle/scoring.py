"""What of the gap was recovered, and how well settling was predicted: over machines."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
import scipy

from models.quantity import keeps_to
from studies.blind_trial.figures_of_merit import rate_of

QUANTITIES: Final = {"settling": "settling_s", "dispersion": "dispersion_m"}
WAYS: Final = {
    "after": "redesign, verified",
    "refit": "re-fit only",
    "pid": "another PID only",
    "learning": "ten rounds of learning",
}
RELATIVE: Final = 0.05  # of what there was before: a gap with less to be gained does not count as one

Case = Mapping[str, Any]


def recovered(case: Case, way: str, name: str) -> float | None:
    """(before - after) / (before - with the truth) [1] of "settling" or "dispersion"; None where there is nothing to be
    gained beyond noise and RELATIVE of what there was, and of settling that there never was before, as its share would
    be larger the longer the motions were watched."""
    key = QUANTITIES[name]
    before, best = case["before"], case["truth"]
    after = case["after"] if way == "after" else case["beside"].get(way)
    if before is None or best is None or after is None or (name == "settling" and before["never"]):
        return None
    gap = before[key] - best[key]
    least = max(2 * case["noise"][key], RELATIVE * before[key])
    return float((before[key] - after[key]) / gap) if gap > least else None


def shares(cases: Sequence[Case]) -> dict[str, dict[str, Any]]:
    """By way and quantity: the shares of all machines, their median and its interval."""
    found: dict[str, dict[str, Any]] = {}
    for way in WAYS:
        found[way] = {}
        for name in QUANTITIES:
            values = [one for case in cases if (one := recovered(case, way, name)) is not None]
            found[way][name] = {"values": values, "count": len(values), **_median(values)}
    return found


def _median(values: Sequence[float]) -> dict[str, float | None]:
    """The median and its interval between order statistics, in which the true one is with 95 % at least, whatever the
    distribution (H. David, H. Nagaraja, Order Statistics, 2003, section 7.1); none of so few that there is none."""
    if not values:
        return {"median": None, "low": None, "high": None}
    ordered, rank = sorted(values), int(scipy.stats.binom.ppf(0.025, len(values), 0.5))  # of the last one outside
    ends = (ordered[rank - 1], ordered[-rank]) if rank > 0 else (None, None)
    return {"median": float(np.median(values)), "low": ends[0], "high": ends[1]}


def rates(cases: Sequence[Case]) -> dict[str, Any]:
    """Rates with their exact intervals: machines that settle in the end, of those where motions never did and with the
    truth do; redesigns that were worse when run or could not be run to their end; within the prediction's interval;
    reasons told. A design that is rolled back leaves its machine as it was, so that none ends worse than before."""
    judged = [one for one in cases if one["before"] is not None]
    stuck = [one for one in judged if one["before"]["never"] and one["truth"] is not None and not one["truth"]["never"]]
    given = [one for one in judged if not one["redesign"]["kept"]]
    tried = [one for one in judged if one["tried"] is not None]
    return {
        "settles_in_the_end": rate_of([not one["after"]["never"] for one in stuck]).plain(),
        "worse_when_run": rate_of([bool(one["rolled_back"]) for one in given]).plain(),
        "inside_settling": rate_of([inside(one, "settling") for one in tried]).plain(),
        "inside_dispersion": rate_of([inside(one, "dispersion") for one in tried]).plain(),
        "said_why": rate_of([said_why(one) for one in judged if not met(one)]).plain(),
    }


def inside(case: Case, name: str) -> bool:
    """Whether what the redesign achieved was in the interval in which it was expected, to a sample."""
    row = next(one for one in case["redesign"]["designs"] if one["taken"])
    slack = case["noise"]["settling_s"] if name == "settling" else 0.0
    value = case["tried"][QUANTITIES[name]]
    return bool(row[name]["low"] - slack <= value <= row[name]["high"] + slack)


def said_why(case: Case) -> bool:
    """Whether it is said that the design that runs in the end settles late, and why; other remarks do not count."""
    designs = case["redesign"]["designs"]
    row = designs[0] if case["rolled_back"] else next(one for one in designs if one["taken"])
    return bool(row["late"])


def met(case: Case) -> bool:
    """Whether the machine ends within its specified settling time."""
    return keeps_to(case["after"]["settling_s"], case["redesign"]["specified"]["settling_s"])
