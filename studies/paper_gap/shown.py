"""Examines the draws that show the pattern: at a finer step, without compensation, over time, in the experiments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from models.machine import Machine, Published
from studies.paper_gap.candidates import COMPENSATOR, Table
from studies.paper_gap.decide import decide
from studies.paper_gap.experiments import measure, menu
from studies.paper_gap.explore import Draw, off_published, simulated, without_compensation
from studies.paper_gap.pattern import Outcome, Pattern, outcome_of, positive_errors
from studies.paper_gap.verdicts import NEVER, loose, tuned, verdict

Array = NDArray[np.float64]
Explored = Mapping[str, Mapping[str, Sequence[Draw]]]
Chosen = Mapping[str, Sequence[Draw]]

FINE_SUBSTEPS: Final = 160  # Substeps in a sample for the repeated simulation of draws that show the pattern.
TUNED: Final = 3  # Sizes of each candidate that are examined.
# The least number of candidates examined; if fewer show the pattern, the nearest others are added.
MIN_EXAMINED: Final = 4
SECONDS: Final = 0.1  # of each motion that is shown
DRAWN: Final = 5  # candidates whose responses are shown
CONTAINED_CANDIDATES: Final = {
    "wrong_friction": ("friction_level", "presliding_length"),
    "all_parameters": ("wrong_friction", "friction_level", "presliding_length", "moving_mass", "dead_time"),
}  # of candidates that vary several numbers: where a part shows the pattern, the whole does


def choose(explored: Explored, order: Sequence[str]) -> Chosen:
    """The candidates to examine, with their sizes, in this order: those that show the pattern, and those that have its
    3 sigma with a reversal in time within their ranges.
    """
    found = {
        name: tuned(explored[name], TUNED)
        for name in order
        if verdict(explored[name]) != NEVER or loose(explored[name])
    }
    others = [tuned(explored[name], 1) for name in order if name not in found]
    for nearest in sorted(others, key=lambda draws: draws[0].distance)[: max(MIN_EXAMINED - len(found), 0)]:
        found[nearest[0].case.name] = nearest
    return found


def again(tables: Sequence[Table], chosen: Chosen, pattern: Pattern, pool: Executor | None) -> list[dict[str, Any]]:
    """Every chosen size at FINE_SUBSTEPS substeps, and without compensation, as results.json holds it."""
    draws = [one for its in chosen.values() for one in its]
    mapped = (pool.map if pool else map)(_again, ((tables[one.table], one) for one in draws))
    return [
        {
            "name": one.case.name,
            "way": one.case.way,
            "table": one.table,
            "values": dict(zip((item.name for item in one.case.candidate().ranges), one.values, strict=True)),
            "units": {item.name: item.unit for item in one.case.candidate().ranges},
            "kind": one.case.candidate().kind,
            "shows": one.shows,
            "disperses": one.disperses,
            "slopes_off": one.slopes_off,
            "seen": one.outcome.to_json(),
            "finer": {
                **fine.to_json(),
                "shows": pattern.distance(fine) == 0.0,
                "disperses": pattern.loose_distance(fine) == 0.0,
            },
            "without_compensation": without.to_json(),
            "without_off": off_published(without, _published(tables[one.table])),
        }
        for one, (fine, without) in zip(draws, mapped, strict=True)
    ]


def kept(again: Sequence[Mapping[str, Any]], share: float) -> dict[str, Any]:
    """The candidates of which some size shows the pattern and leaves the figures without compensation as published.

    Within a share [1] of each: the reversal's settling time, and 3 sigma.
    """
    names = []
    for row in again:
        without = row["without_off"]
        if row["shows"] and without <= share and row["name"] not in names:
            names.append(row["name"])
    return {"share": share, "names": names}


def _again(given: tuple[Table, Draw]) -> tuple[Outcome, Outcome]:
    table, one = given
    fine = simulated(table, one.case, one.point, FINE_SUBSTEPS)
    return outcome_of(fine), without_compensation(table, one.case, one.point)


def _published(table: Table) -> Published:
    published = table[0].published
    assert published is not None  # else there would be no pattern
    return published


def responses(tables: Sequence[Table], bare: Sequence[Array], chosen: Chosen) -> list[dict[str, Any]]:
    """Errors [m] over time of the positive motions: the first table by itself, then a size of each of some candidates,
    beside the same table without it.
    """
    machine, _ = tables[0]
    n = min(round(SECONDS / machine.sample_time), bare[0].shape[1])  # at most a motion
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
    """The experiments' power to discriminate between the chosen candidates that show the pattern and act in the table.

    What the compensator is made of is known to whoever runs an experiment with it, so that its design and a friction
    wrongly identified for it make no departure; `exchange` tells these.
    """
    its = {name: [one for one in draws if one.shows] or draws for name, draws in chosen.items() if _acts(draws)}
    showing = {name: draws for name, draws in its.items() if any(one.shows for one in draws)}
    names = _apart(showing if len(showing) > 1 else its)
    draws = [one for name in names for one in its[name]]
    mapped = iter((pool.map if pool else map)(_measured, ((tables[one.table], one) for one in draws)))
    return decide(menu(machine), {name: [next(mapped) for _ in its[name]] for name in names})


def _acts(draws: Sequence[Draw]) -> bool:
    """Whether a candidate changes the table, not its compensator alone."""
    one = draws[0].case
    return one.candidate().kind != COMPENSATOR and not one.name.startswith("identified")


def _apart(chosen: Chosen) -> list[str]:
    """The names without those of which a part is among them."""
    return [name for name in chosen if not any(part in chosen for part in CONTAINED_CANDIDATES.get(name, ()))]


def _measured(given: tuple[Table, Draw]) -> list[list[float]]:
    table, one = given
    return [measure(experiment, table, one) for experiment in menu(table[0])]
