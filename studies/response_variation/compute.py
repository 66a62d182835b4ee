"""The paper's evidence, from the model: its figures as data, its mechanism as numbers, and the range of the set."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.controller import default_controller
from design.deadbeat import DesignError
from design.validation import BATCH, PERIODS, validate_many
from models.ensemble import DEFAULT as ENSEMBLE
from models.ensemble import load_ensemble, to_text
from models.machine import Machine, MachineError
from models.quantity import keeps_to, show
from studies.beforehand import require_designable, require_members, require_pid
from studies.compensator import with_elements
from studies.effort import SIMULATED, foresee, period, seconds_a_sample
from studies.options import BadInputError
from studies.response_variation.alternatives import alternatives, searched
from studies.response_variation.amplitude import by_amplitude
from studies.response_variation.choice import error_against_count
from studies.response_variation.conventions import FEEDFORWARDS
from studies.response_variation.curves import hysteresis, plants, reference, responses
from studies.response_variation.mechanism import mechanism
from studies.response_variation.observer import estimated
from studies.response_variation.options import VariationOptions
from studies.response_variation.published import Shown, outcomes, rows, taken_over
from studies.response_variation.search import LARGEST_MS, TOLERANCE, SearchError, exact_sensitivity, search
from studies.response_variation.small_effects import small_effects
from studies.response_variation.tables import COORDINATES, coordinates, most_central, spread, texts
from studies.scattered import rows_of, scattered
from studies.study import Answer, Check, Progress

Array = NDArray[np.float64]

LEAST_ELEMENTS: Final = 3  # of friction: two whose forces have a trend in Region 1, and one for Region 2
MIN_TABLES: Final = 50  # tables that the set should have
SEARCHED: Final = 2000  # tables that a search simulates, about
EXCHANGE: Final = 7  # periods in the exchange of a table's histories
QUICK_TABLES: Final = 6  # of them that a quick run simulates
QUICK_OTHER_TABLES: Final = 2  # of these under other conventions
SECONDS: Final = {
    "search": 50.0,
    "simulate": 2.0,
    "exchange": 1.0,
    "choice": 18.0,
    "conventions": 20.0,
    "report": 4.0,
}
NEW_SEARCHES_S: Final = 450.0  # of them for new searches under the other conventions


def compute(machine: Machine, options: VariationOptions, progress: Progress) -> Answer:
    """Answers the study's question. Raises BadInputError for a machine of which no outcomes are published."""
    if machine.published is None:
        raise BadInputError(
            "--machine: no [published] outcomes to compare with; add reversal_settling_time, dispersion_without and "
            "dispersion_with to the machine file"
        )
    require_pid(machine)
    if len(machine.plant.modes) != 3:
        raise BadInputError(
            "--machine: the machine must have a rigid body and two vibration modes, as the paper's table"
        )
    require_designable(machine)
    _require_regions(machine)
    _foresee(machine, options, progress)
    counted = with_elements(machine, options, progress)
    machine = counted.machine
    tell = _Steps(options, progress)
    tell("search", 0.0, "collecting the tables")
    members = _searched(machine, options, tell) if options.search else _kept(machine, options)
    shown = members[:QUICK_TABLES] if options.quick and not options.search else members
    tell("simulate", 0.0, f"simulating {_count(len(shown) + 1, 'table')} over the sequence")
    central, tables = _simulated([machine])[0], _simulated(shown)
    tell("exchange", 0.0, "exchanging the friction's history between reversal and inching")
    exchange = mechanism(central.machine, central.controller, central.without)
    over_set = [mechanism(one.machine, one.controller, one.without) for one in tables]
    choice = error_against_count(
        machine, options.seed, quick=options.quick, tell=lambda share, text: tell("choice", share, text)
    )
    tell("conventions", 0.0, "varying what the paper leaves open")
    open_choices, files = _open_choices(machine, members, shown, options, tell)
    tell("report", 0.0, "collecting the results")
    results = {
        "quick": options.quick,
        "alone": _alone(options),
        "members": len(members),
        "simulated": len(tables),
        "bode": plants(machine, shown),
        "hysteresis": hysteresis(central, tables),
        "reference": reference(machine),
        "without": responses(central.without, [one.without for one in tables]),
        "with": responses(central.with_rfm, [one.with_rfm for one in tables]),
        "mechanism": {
            "central": exchange,
            "set": _quantiles(over_set),
            "set_share_growing": float(np.mean([np.all(np.diff(one["steady_friction_N"]) > 0) for one in over_set])),
        },
        "choice": choice,
        "set": _set(central, tables, members),
        "settling": _settling(central, options),
        "droop": by_amplitude(machine),
        "observer": estimated(central.without),
        "small": small_effects(machine, central.controller),
        "paper": rows(central, tables),
        "taken": taken_over(machine),
        "gap": _gap(central, tables),
        "conventions": open_choices,
        **counted.results,
    }
    files |= _files(tables, options) if options.search else {}
    return Answer(results, _checks(central, tables, results), files, counted.summary)


def _foresee(machine: Machine, options: VariationOptions, progress: Progress) -> None:
    """The time of a search, of two validations of each table and of its exchange of histories."""
    sample, samples = seconds_a_sample(machine), period(machine)
    tables = options.members if options.search else 1 if _alone(options) else len(_kept(machine, options))
    cases = 2 * PERIODS * (1 + len(FEEDFORWARDS)) + EXCHANGE
    seconds = {"the tables": (tables + 1) * cases * samples * sample}
    if options.conventions:
        seconds["the searches under other conventions"] = SEARCHED * len(FEEDFORWARDS) * PERIODS * samples * sample
    if options.search:
        seconds["the search"] = SEARCHED * PERIODS * samples * sample
    foresee(seconds, 2 * tables * samples * SIMULATED + BATCH * PERIODS * samples * SIMULATED, options, progress)


def _require_regions(machine: Machine) -> None:
    """Raises BadInputError for a friction whose curve has not the two regions that the paper's has."""
    elements, slope = len(machine.friction.limit), machine.presliding.stiffness_2
    if elements < LEAST_ELEMENTS or not slope > 0:
        what = f"{_count(elements, 'element')}, a slope of {show(slope, 'N/m')} in Region 2"
        raise BadInputError(
            f"--machine: friction has {what}, while the paper's hysteresis curve rises in two regions; give at least "
            f"{LEAST_ELEMENTS} elements, the last of which slips beyond specification.stroke"
        )


class _Steps:
    """Progress by steps: each has a share of the run as long as SECONDS says it takes, two cores assumed."""

    def __init__(self, options: VariationOptions, progress: Progress) -> None:
        lasts = dict(SECONDS)
        if not options.search:
            lasts["search"] = 0.1
        if options.conventions:
            lasts["conventions"] += NEW_SEARCHES_S
        if options.quick:
            lasts["choice"] /= 4
            lasts["conventions"] /= 4
        if options.no_report:
            lasts["report"] = 0.1
        whole = 0.5 + sum(lasts.values())  # the half second is for the imports
        ends = [0.5 / whole, *((0.5 + sum(list(lasts.values())[: i + 1])) / whole for i in range(len(lasts)))]
        self._parts = {name: (ends[i], ends[i + 1]) for i, name in enumerate(lasts)}
        self._progress = progress

    def __call__(self, step: str, share: float, text: str) -> None:
        """`share` (0 .. 1) of `step` is done; `text` is what comes next."""
        begin, end = self._parts[step]
        self._progress(begin + share * (end - begin), text)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _alone(options: VariationOptions) -> bool:
    """Whether a single machine is studied: a user's own, without a set of tables."""
    return options.machine is not None and options.ensemble is None and not options.search


def _searched(machine: Machine, options: VariationOptions, tell: _Steps) -> tuple[Machine, ...]:
    """The tables of a new search."""
    try:
        found = search(
            machine,
            options.members,
            options.seed,
            workers=min(os.cpu_count() or 1, 2),
            tell=lambda share, text: tell("search", share, text),
        )
    except SearchError as error:
        raise BadInputError(f"--search: {error}") from error
    return tuple(member.machine for member in found)


def _open_choices(
    machine: Machine, members: Sequence[Machine], shown: Sequence[Machine], options: VariationOptions, tell: _Steps
) -> tuple[dict[str, Any] | None, dict[str, str]]:
    """What follows under other conventions, and the file of new searches; nothing for a single machine."""
    if _alone(options):
        return None, {}
    files: dict[str, str] = {}
    kept = None if options.machine is None else ""  # the kept sets are of the default machine
    if options.conventions:
        files["conventions.toml"] = searched(
            machine,
            options.seed,
            workers=min(os.cpu_count() or 1, 2),
            tell=lambda share, text: tell("conventions", 0.9 * share, text),
        )
    some = shown[:QUICK_OTHER_TABLES] if options.quick else shown
    return alternatives(machine, members, some, files.get("conventions.toml", kept), quick=options.quick), files


def _files(tables: Sequence[Shown], options: VariationOptions) -> dict[str, str]:
    """The tables of a new search, and the most central one of them, as ensemble files."""
    comment = (
        "Tables that behave as the paper says, for what it leaves out: found by\n"
        f"python -m studies.response_variation --search --members {options.members} --seed {options.seed}"
    )
    central = tables[_most_central(tables)].machine
    base, source = "linear_motor_table.toml", "assumed: one of the tables that behave as the paper says"
    source += " (studies.response_variation)"
    return {
        "ensemble.toml": to_text(base, source, comment, [texts(one.machine) for one in tables]),
        "most_central.toml": to_text(base, source, "The most central of these tables.", [texts(central)]),
    }


def _most_central(tables: Sequence[Shown]) -> int:
    achieved = [outcomes(one.without) for one in tables]
    return most_central(
        [one.machine for one in tables], [[one["reversal_settling_s"], one["dispersion_m"]] for one in achieved]
    )


def _kept(machine: Machine, options: VariationOptions) -> tuple[Machine, ...]:
    """The tables of an ensemble file; without one, only the user's machine itself."""
    if _alone(options):
        return (machine,)
    path: Path = options.ensemble or ENSEMBLE
    try:
        members = load_ensemble(path)
    except MachineError as error:
        raise BadInputError(f"--ensemble {error}") from error
    require_members(members)
    return members


def _simulated(machines: Sequence[Machine]) -> list[Shown]:
    try:
        controllers = [default_controller(machine) for machine in machines]
    except DesignError as error:
        raise BadInputError(f"--machine, --ensemble: {error}") from error
    without = validate_many(machines, [controller.without_compensation() for controller in controllers])
    compensated = validate_many(machines, controllers)
    return [Shown(*all_four) for all_four in zip(machines, controllers, without, compensated, strict=True)]


def _settling(central: Shown, options: VariationOptions) -> dict[str, Any]:
    """What the settling times without and with compensation hang on, and their scatter over runs with a dither."""
    machine, controller = central.machine, central.controller
    bare = scattered(machine, controller.without_compensation(), central.without, options)
    compensated = scattered(machine, controller, central.with_rfm, options)
    rows = rows_of((("without compensation", bare), ("with compensation", compensated)))
    return {"without": bare, "with": compensated, "rows": rows}


def _quantiles(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Least, median and largest of every scalar over the set."""
    names = [name for name, item in rows[0].items() if np.ndim(item) == 0]
    return {
        name: dict(zip(("low", "median", "high"), _three([row[name] for row in rows]), strict=True)) for name in names
    }


def _three(values: Sequence[float]) -> Array:
    """Least, median and largest; among motions that never settle the median is one of the values."""
    return np.quantile(values, [0, 0.5, 1], method="linear" if np.all(np.isfinite(values)) else "lower")


def _set(central: Shown, tables: Sequence[Shown], members: Sequence[Machine]) -> dict[str, Any]:
    """The range of each unpublished parameter over the set, and its share of the range searched."""
    points = np.array([coordinates(one) for one in members])
    medoid = tables[_most_central(tables)].machine if len(tables) == len(members) else None
    return {
        "parameters": [
            {
                "name": one.name,
                "meaning": one.meaning,
                "unit": one.unit,
                "low": one.low,
                "high": one.high,
                "values": points[:, i],
                "central": coordinates(central.machine)[i],
                **spread(points[:, i], one),
            }
            for i, one in enumerate(COORDINATES)
        ],
        "tolerance": TOLERANCE,
        "largest_Ms_allowed": LARGEST_MS,
        "machine_is_most_central": medoid and bool(np.all(coordinates(central.machine) == coordinates(medoid))),
        "outcomes": {
            name: [outcomes(getattr(one, case))[name] for one in tables]
            for case, name in (("without", "reversal_settling_s"), ("without", "dispersion_m"))
        },
        "largest_Ms": [exact_sensitivity(one) for one in members],
    }


def _gap(central: Shown, tables: Sequence[Shown]) -> dict[str, Any]:
    """The dispersion with compensation in the model, over the set, beside that of the real table."""
    published = central.machine.published
    assert published is not None
    in_time = central.machine.specification.settling_time
    left = [outcomes(one.with_rfm) for one in tables]
    sigma = np.array([one["dispersion_m"] for one in left])
    inching = np.array([one["inching_settling_s"] for one in left])
    return {
        "central": outcomes(central.with_rfm),
        "dispersion_quantiles_m": np.quantile(sigma, [0, 0.25, 0.5, 0.75, 1]),
        "dispersions_m": sigma,
        "share_below_published": float(np.mean(sigma < published.dispersion_with)),
        "share_inching_in_time": float(np.mean([keeps_to(one, in_time) for one in inching])),
        "share_reversal_in_time": float(np.mean([keeps_to(one["reversal_settling_s"], in_time) for one in left])),
        "unexplained_m": float(np.sqrt(max(published.dispersion_with**2 - float(np.median(sigma)) ** 2, 0.0))),
    }


def _checks(central: Shown, tables: Sequence[Shown], results: dict[str, Any]) -> tuple[Check, ...]:
    published = central.machine.published
    assert published is not None
    checks = [
        Check(f"{row['name']}: difference to the paper", abs(row["difference"]), "1", TOLERANCE, row["section"])
        for row in results["paper"]
        if row["outcome"]
    ]
    in_time, gap = central.machine.specification.settling_time, results["gap"]["central"]
    exchange = results["mechanism"]["central"]
    compensated = "settling of the reversal, with compensation"
    return (
        *checks,
        *([] if results["alone"] else _checks_of_set(central, tables, results)),
        Check(
            "share of the reversal's delay due to the friction's history", exchange["delay_share"], "1", 0.9, "IV", ">="
        ),
        Check(compensated, gap["reversal_settling_s"], "s", in_time, "V.B"),
        Check(
            "3 sigma with compensation: difference to the paper",
            abs(gap["dispersion_m"] / published.dispersion_with - 1),
            "1",
            TOLERANCE,
            "V.B",
        ),
    )


def _checks_of_set(central: Shown, tables: Sequence[Shown], results: dict[str, Any]) -> tuple[Check, ...]:
    published = central.machine.published
    assert published is not None
    worst = max(
        max(
            abs(outcomes(one.without)["reversal_settling_s"] / published.reversal_settling_time - 1),
            abs(outcomes(one.without)["dispersion_m"] / published.dispersion_without - 1),
        )
        for one in tables
    )
    peak = max(one.peak_thrust for shown in tables for one in (shown.without, shown.with_rfm))
    sensitivity = max(results["set"]["largest_Ms"])
    rated = central.machine.drive.rated_thrust
    return (
        Check("members of the set", results["members"], "1", MIN_TABLES, "as many as show what is left open", ">="),
        Check("largest difference of a member to the paper", worst, "1", TOLERANCE, "III.B, V.B"),
        *(
            [
                Check(
                    "largest difference to the paper of a table under another convention",
                    results["conventions"]["largest_difference"],
                    "1",
                    TOLERANCE,
                    "III.B, V.B",
                )
            ]
            if results["conventions"]["sets"]
            else []
        ),
        Check("largest Ms of a member", sensitivity, "1", LARGEST_MS, "what a practitioner accepts"),
        Check("largest thrust of a member", peak, "N", rated, "II.A"),
    )
