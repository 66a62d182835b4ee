"""Examines the draws that show the pattern: at a finer step, without compensation, over time, in the experiments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from models.machine import Machine, Published
from studies.paper_gap.decide import decide
from studies.paper_gap.experiments import measure, menu
from studies.paper_gap.explore import Draw, Table, simulated
from studies.paper_gap.pattern import Outcome, Pattern, outcome_of, positive_errors
from studies.paper_gap.verdicts import NEVER, tuned, verdict

Array = NDArray[np.float64]
Explored = Mapping[str, Mapping[str, Sequence[Draw]]]
Chosen = Mapping[str, Sequence[Draw]]

FINE: Final = 40  # Substeps in a sample for the repeated simulation of draws that show the pattern.
TUNED: Final = 3  # Sizes of each candidate that are examined.
LEAST: Final = 4  # The least number of candidates examined; if fewer show the pattern, the nearest others are added.
SECONDS: Final = 0.1  # of each motion that is shown
DRAWN: Final = 5  # candidates whose responses are shown


def choose(explored: Explored, order: Sequence[str]) -> Chosen:
    """The candidates to examine, with their sizes: those that show the pattern, in this order."""
    found = {name: tuned(explored[name], TUNED) for name in order if verdict(explored[name]) != NEVER}
    others = [tuned(explored[name], 1) for name in order if name not in found]
    for nearest in sorted(others, key=lambda draws: draws[0].distance)[: max(LEAST - len(found), 0)]:
        found[nearest[0].case.name] = nearest
    return found


def again(tables: Sequence[Table], chosen: Chosen, pattern: Pattern, pool: Executor | None) -> list[dict[str, Any]]:
    """Every chosen size at FINE substeps, and without compensation, as results.json holds it."""
    draws = [one for its in chosen.values() for one in its]
    mapped = (pool.map if pool else map)(_again, ((tables[one.table], one) for one in draws))
    return [
        {
            "name": one.case.name,
            "way": one.case.way,
            "table": one.table,
            "values": dict(zip((item.name for item in one.case.candidate().ranges), one.values, strict=True)),
            "units": {item.name: item.unit for item in one.case.candidate().ranges},
            "shows": one.shows,
            "seen": one.outcome.to_json(),
            "finer": {**fine.to_json(), "shows": pattern.distance(fine) == 0.0},
            "without_compensation": without.to_json(),
        }
        for one, (fine, without) in zip(draws, mapped, strict=True)
    ]


def kept(again: Sequence[Mapping[str, Any]], published: Published, share: float) -> dict[str, Any]:
    """The candidates of which some size shows the pattern and leaves the figures without compensation as published.

    Within a share [1] of each: the reversal's settling time, and 3 sigma.
    """
    names = []
    for row in again:
        without = row["without_compensation"]
        off = max(
            abs(without["reversal_settling_s"] / published.reversal_settling_time - 1),
            abs(without["dispersion_m"] / published.dispersion_without - 1),
        )
        if row["shows"] and off <= share and row["name"] not in names:
            names.append(row["name"])
    return {"share": share, "names": names}


def _again(given: tuple[Table, Draw]) -> tuple[Outcome, Outcome]:
    (machine, controller), one = given
    fine = simulated((machine, controller), one.case, one.point, FINE)
    without = simulated((machine, controller.without_compensation()), one.case, one.point)
    return outcome_of(fine), outcome_of(without)


def responses(tables: Sequence[Table], bare: Sequence[Array], chosen: Chosen) -> list[dict[str, Any]]:
    """Errors [m] over time of the positive motions: the first table by itself, then a size of each of some candidates,
    beside the same table without it.
    """
    machine, _ = tables[0]
    n = round(SECONDS / machine.sample_time)
    first = {"name": "", "way": "", "table": 0, "error_m": bare[0][:, :n], "without_m": bare[0][:, :n]}
    drawn = [first]
    for its in list(chosen.values())[:DRAWN]:
        one = its[0]
        error = positive_errors(simulated(tables[one.table], one.case, one.point))
        drawn.append(
            {
                "name": one.case.name,
                "way": one.case.way,
                "table": one.table,
                "error_m": error[:, :n],
                "without_m": bare[one.table][:, :n],
            }
        )
    return [{**one, "time_s": np.arange(n) * machine.sample_time} for one in drawn]


def decided(machine: Machine, tables: Sequence[Table], chosen: Chosen, pool: Executor | None) -> dict[str, Any]:
    """The experiments' power to discriminate between the chosen candidates."""
    draws = [one for its in chosen.values() for one in its]
    mapped = iter((pool.map if pool else map)(_measured, ((tables[one.table], one) for one in draws)))
    return decide(menu(machine), {name: [next(mapped) for _ in its] for name, its in chosen.items()})


def _measured(given: tuple[Table, Draw]) -> list[list[float]]:
    table, one = given
    return [measure(experiment, table, one) for experiment in menu(table[0])]
