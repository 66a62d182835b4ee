"""What the settling times of the tables hang on: the nominal table, and a size of every candidate that is examined."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from typing import Any, Final

from design.validation import validate
from models.controller import Controller
from models.machine import Machine
from studies.options import Options
from studies.paper_gap.candidates import Table
from studies.paper_gap.pattern import PERIODS
from studies.paper_gap.shown import Chosen
from studies.scattered import FEW_RUNS, rows_of, scattered
from studies.wording import effect

QUICK_CANDIDATES: Final = 1  # in a quick run


def hanging(tables: Sequence[Table], chosen: Chosen, options: Options, pool: Executor | None) -> dict[str, Any]:
    """Single runs, margins and scatter over runs with a dither, SI.

    Of the first table without and with its compensation, and with the first size of every candidate chosen, on the
    table of that size.
    """
    machine, controller = tables[0]
    cases = [
        ("without compensation", machine, controller.without_compensation()),
        ("with compensation", machine, controller),
    ]
    for its in list(chosen.values())[: QUICK_CANDIDATES if options.quick else None]:
        one = its[0]
        candidate = one.case.candidate()
        changed, law = candidate.put(tables[one.table], candidate.values(one.point[:-1]))
        cases.append((f"{effect(one.case.name)}, table {one.table + 1}", changed, law))
    given = [(changed, law, options) for _, changed, law in cases]
    found = list((pool.map if pool else map)(_scattered, given))
    return {"rows": rows_of(list(zip((name for name, *_ in cases), found, strict=True))), "runs": found[0]}


def _scattered(given: tuple[Machine, Controller, Options]) -> dict[str, Any]:
    machine, controller, options = given
    return scattered(machine, controller, validate(machine, controller, periods=PERIODS), options, most=FEW_RUNS)
