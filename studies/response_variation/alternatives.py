"""What follows from the paper under other conventions than those chosen here: outcomes of the tables, and other sets.

conventions.toml holds tables that behave as the paper says under each of the other conventions: points of the search,
found as the head of the file says.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.controller import default_controller
from design.deadbeat import DesignError
from design.validation import validate_many
from models.controller import Controller
from models.machine import Machine
from studies.response_variation.conventions import FEEDFORWARDS, Convention, bare
from studies.response_variation.search import RANGES, TOLERANCE, SearchError, distance, search, table
from studies.response_variation.tables import COORDINATES, coordinates, spread

Array = NDArray[np.float64]

CONVENTIONS_FILE: Final = Path(__file__).parent / "conventions.toml"
OTHER_TABLE_COUNT: Final = 40  # of each other convention
SEARCH_MEMBERS: Final = 80  # by their search from step to step

RANGED: Final = ("mass", "kp", "ki", "kd")
CHOSEN_DIVISOR: Final = tuple(Convention(objective, monotone) for objective, monotone in FEEDFORWARDS)
SEARCHED: Final = (*CHOSEN_DIVISOR[1:], Convention(one_less=True))
QUICK_TABLES_EACH: Final = 2  # tables of each that a quick run simulates


def alternatives(
    machine: Machine, members: Sequence[Machine], shown: Sequence[Machine], text: str | None, *, quick: bool
) -> dict[str, Any]:
    """The tables of the set under other conventions, the sets of these, and the range of each parameter over all.

    members: of the set; shown: those of them that are simulated; text: of conventions.toml, None for the kept one,
    which is of the paper's table.
    """
    content = CONVENTIONS_FILE.read_text(encoding="utf-8") if text is None else text
    found = [_of_set(machine, convention, points, quick=quick) for convention, points in kept(content)]
    feedforwards = {one.words: _feedforward(machine, shown, one) for one in CHOSEN_DIVISOR}
    ranges = [coordinates(one) for one in members], [one["coordinates"] for one in found]
    together = np.vstack([np.array(ranges[0]), *ranges[1]])
    return {
        "tolerance": TOLERANCE,
        "feedforwards": [one for one in feedforwards.values() if one is not None],
        "impossible": [words for words, one in feedforwards.items() if one is None],
        "divisor_ratio": _ratio(machine),
        "sets": [{key: item for key, item in one.items() if key != "coordinates"} for one in found],
        "parameters": [
            {"name": one.name, "meaning": one.meaning, "unit": one.unit, **spread(together[:, i], one)}
            for i, one in enumerate(COORDINATES)
        ],
        "largest_difference": max((one["largest_difference"] for one in found), default=0.0),
    }


def kept(text: str) -> list[tuple[Convention, Array]]:
    """The conventions of a file, each with the points (tables, parameters) of its search, natural logarithms."""
    content = tomllib.loads(text)
    return [
        (
            Convention(one["objective"], one["monotone"], one["one_less"]),
            np.log(np.array(one["tables"], float)).reshape(-1, len(RANGES)),
        )
        for one in content.get("convention", [])
    ]


def searched(machine: Machine, seed: int, *, workers: int, tell: Callable[[float, str], None]) -> str:
    """The text of conventions.toml by new searches; a convention by which no table is the paper's has none."""
    blocks = []
    for i, convention in enumerate(SEARCHED):

        def part(share: float, text: str, i: int = i) -> None:
            tell((i + share) / len(SEARCHED), text)

        try:
            members = search(
                machine, OTHER_TABLE_COUNT, seed, workers=workers, tell=part, convention=convention, held=SEARCH_MEMBERS
            )
        except SearchError:  # no table is the paper's by this convention
            members = ()
        blocks.append(to_text(convention, [member.theta for member in members]))
    head = (
        "# Tables that behave as the paper says under other conventions than those of this project, found by\n"
        f"# python -m studies.response_variation --conventions --seed {seed}\n"
        "# A table is the search's parameters in their order, in SI units (studies/response_variation/search.py).\n"
    )
    return head + "".join(blocks)


def to_text(convention: Convention, points: Sequence[Array]) -> str:
    """A convention with the points of its tables, as they stand in conventions.toml."""
    numbers = {
        name: str(item).lower() if isinstance(item, bool) else f'"{item}"' for name, item in asdict(convention).items()
    }
    lines = [f"{name} = {item}" for name, item in numbers.items()]
    rows = ["    [" + ", ".join(f"{number:.6g}" for number in np.exp(point)) + "]," for point in points]
    return "\n[[convention]]\n" + "\n".join([*lines, "tables = [", *rows, "]"]) + "\n"


def _of_set(machine: Machine, convention: Convention, points: Array, *, quick: bool) -> dict[str, Any]:
    """A kept set: the words of its convention, its tables' parameters, and how far they are from the paper [1]."""
    tables = [table(machine, point) for point in points]
    some = tables[:QUICK_TABLES_EACH] if quick else tables
    validations = validate_many(some, [bare(one, convention) for one in some])
    off = [distance(one, without, convention) for one, without in zip(some, validations, strict=True)]
    points_of = np.array([coordinates(one) for one in tables]).reshape(-1, len(COORDINATES))
    names = {one.name: i for i, one in enumerate(COORDINATES)}
    return {
        **_said(convention),
        "tables": len(tables),
        "coordinates": points_of,
        "ranges": {
            name: np.quantile(points_of[:, names[name]], [0.05, 0.5, 0.95]) if tables else None for name in RANGED
        },
        "largest_difference": TOLERANCE * max(off, default=0.0),
    }


def _said(convention: Convention) -> dict[str, Any]:
    return {**asdict(convention), "words": convention.words}


def _feedforward(machine: Machine, shown: Sequence[Machine], convention: Convention) -> dict[str, Any] | None:
    """A deadbeat on the machine: how far x_T* goes back in all and beyond [m], its thrust [N], and the outcomes.

    And how many of the shown tables still behave as the paper says, with either divisor. None where the machine has no
    such deadbeat.
    """
    try:
        law = bare(machine, convention)
    except DesignError:
        return None
    with_rfm = _compensated(law, machine)
    without, compensated = validate_many([machine, machine], [law, with_rfm])
    stroke = machine.specification.stroke
    path, thrust = stroke * np.cumsum(law.n_ff), stroke * np.cumsum(law.d_ff)
    over = _over(shown, convention)
    return {
        **_said(convention),
        "back_m": float(np.sum(np.maximum(-np.diff(path, prepend=0.0), 0.0))),
        "beyond_m": max(float(np.max(path)) - stroke, 0.0),
        "peak_N": float(np.max(np.abs(thrust))),
        "reversal_settling_s": without.reversal.settling_time,
        "dispersion_m": without.worst_dispersion,
        "with_m": compensated.worst_dispersion,
        "tables": len(shown),
        **over,
    }


def _compensated(law: Controller, machine: Machine) -> Controller:
    """The controller with the machine's usual RFM."""
    return replace(law, friction_compensation=default_controller(machine).friction_compensation)


def _ratio(machine: Machine) -> float:
    """3 sigma by the other divisor over that by the chosen one [1]."""
    motions = machine.specification.motions
    return math.sqrt(motions / (motions - 1))


def _over(shown: Sequence[Machine], convention: Convention) -> dict[str, Any]:
    """How many of the shown tables still fit the paper, by either divisor; 3 sigma with compensation over them [m]."""
    machines, laws = [], []
    for one in shown:
        try:
            laws.append(bare(one, convention))
        except DesignError:
            continue  # no such deadbeat within the thrust
        machines.append(one)
    without = validate_many(machines, laws)
    compensated = validate_many(machines, [_compensated(law, one) for law, one in zip(laws, machines, strict=True)])
    fits = {
        key: sum(
            distance(one, seen, Convention(convention.objective, convention.monotone, one_less)) <= 1
            for one, seen in zip(machines, without, strict=True)
        )
        for key, one_less in (("fit", False), ("fit_one_less", True))
    }
    left = [one.worst_dispersion for one in compensated]
    return {**fits, "with_quantiles_m": np.quantile(left, [0.0, 0.5, 1.0]) if left else None}
