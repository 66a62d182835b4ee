"""The verdict on each candidate from the draws of all cases: whether, how and at which sizes it shows the pattern."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from studies.paper_gap.explore import ALONE, BESIDE, BEYOND, Case, Draw

WAYS = (ALONE, BESIDE, BEYOND)  # the mildest assumption first
NEVER = "never"


def by_name(explored: Iterable[Sequence[Draw]]) -> Mapping[str, Mapping[str, Sequence[Draw]]]:
    """The draws by candidate and way."""
    found: dict[str, dict[str, Sequence[Draw]]] = {}
    for draws in explored:
        case = draws[0].case
        found.setdefault(case.name, {})[case.way] = draws
    return found


def verdict(ways: Mapping[str, Sequence[Draw]]) -> str:
    """The mildest way in which some draw shows the pattern, or NEVER."""
    return next((way for way in WAYS if any(one.shows for one in ways.get(way, ()))), NEVER)


def loose(ways: Mapping[str, Sequence[Draw]]) -> bool:
    """Whether some draw by itself, within its range, has the pattern's 3 sigma and a reversal in time."""
    return any(one.disperses for one in ways[ALONE])


def rows(explored: Mapping[str, Mapping[str, Sequence[Draw]]], tables: int) -> list[dict[str, Any]]:
    """One row per candidate; first those that show the pattern under the mildest assumption and come nearest."""
    made = [_row(name, ways, tables) for name, ways in explored.items()]
    order = (*WAYS, NEVER)
    return sorted(made, key=lambda row: (order.index(row["verdict"]), row["ways"][ALONE]["closest_m"]))


def _row(name: str, ways: Mapping[str, Sequence[Draw]], tables: int) -> dict[str, Any]:
    case = Case(name)
    one = case.candidate()
    size, found = one.ranges[one.size], verdict(ways)
    return {
        "name": name,
        "kind": one.kind,
        "family": one.family,
        "equation": one.equation,
        "size": {
            "name": size.name,
            "unit": size.unit,
            "low": size.low,
            "high": size.high,
            "either_sign": size.signed,
        },
        "verdict": found,
        "loose": loose(ways),
        "ways": {way: _way(draws, tables) for way, draws in ways.items()},
        "times_prior": _least_size(ways[BEYOND]) / size.high if found == BEYOND else None,
    }


def _way(draws: Sequence[Draw], tables: int) -> dict[str, Any]:
    """A case's least distance and, of the draws that show the pattern, their share, tables, and signed sizes.

    share: of the draws over the priors alone; results of the local search count for everything else.
    """
    blind = [one for one in draws if not one.found]
    shown = [one for one in draws if one.shows]
    best = closest(draws)[0]
    sizes = [one.values[one.case.candidate().size] for one in shown]
    return {
        "closest_m": best.distance,
        "closest": {**best.outcome.to_json(), "table": best.table, "values": best.values},
        "draws": len(draws),
        "share": float(np.mean([one.shows for one in blind])),
        "loose_share": float(np.mean([one.disperses for one in blind])),
        "shown": len(shown),
        "share_of_tables": len({one.table for one in shown}) / tables,
        "sizes": [min(sizes), max(sizes)] if sizes else None,
    }


def _least_size(draws: Sequence[Draw]) -> float:
    return min(abs(one.values[one.case.candidate().size]) for one in draws if one.shows)


def closest(draws: Sequence[Draw]) -> list[Draw]:
    """Nearest to the pattern first; of those that show it, the one with the smallest size."""
    return sorted(draws, key=lambda one: (one.distance, abs(one.values[one.case.candidate().size])))


def tuned(ways: Mapping[str, Sequence[Draw]], count: int) -> list[Draw]:
    """Up to `count` draws of the mildest way that shows the pattern, spread over their sizes, without those at the ends
    of the range.

    Where no way does, those that have its 3 sigma and a reversal in time; where there are none, the nearest draw within
    the prior.
    """
    way = verdict(ways)
    if way != NEVER:
        shown = [one for one in closest(ways[way]) if one.shows]
    elif loose(ways):
        shown = [one for one in ways[ALONE] if one.disperses]
    else:
        return closest([*ways[ALONE], *ways.get(BESIDE, ())])[:1]
    shown.sort(key=lambda one: abs(one.values[one.case.candidate().size]))
    picked = np.unique(np.linspace(0, len(shown) - 1, count + 2)[1:-1].round().astype(int))
    return [shown[i] for i in picked]
