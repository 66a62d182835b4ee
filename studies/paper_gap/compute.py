"""Possible causes of the paper's dispersion: every candidate in tables whose controllers do not know it."""

from __future__ import annotations

import math
import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.controller import paper_controller
from design.deadbeat import DesignError
from design.validation import sequence, validate_many
from diagnosis.experiments.schedules import to_csv
from models.ensemble import DEFAULT as ENSEMBLE
from models.ensemble import load_ensemble
from models.machine import Machine, MachineError
from models.quantity import keeps_to, show
from studies.beforehand import require_designable, require_members
from studies.compensator import with_elements
from studies.effort import SIMULATED, foresee, period, seconds_a_sample
from studies.options import BadInputError
from studies.paper_gap import shown
from studies.paper_gap.candidates import BESIDE_FRICTION, BOUND, FRICTION, MASS_BOUND, PARAMETERS, Table, every
from studies.paper_gap.candidates import EFFECTS as OF_EFFECTS
from studies.paper_gap.compensators import named, of_name, slope_error, with_compensator
from studies.paper_gap.exchange import exchanged
from studies.paper_gap.experiments import menu
from studies.paper_gap.explore import (
    ALONE,
    BESIDE,
    BEYOND,
    BEYOND_PRIOR_RATIO,
    SEARCH_STEPS,
    Case,
    Draw,
    Effort,
    explore_all,
)
from studies.paper_gap.hanging import hanging
from studies.paper_gap.likelihood import evidence
from studies.paper_gap.options import PaperOptions
from studies.paper_gap.pattern import (
    COARSE_SUBSTEPS,
    CONVERGED,
    MAX_DISTANCE_STEPS,
    PERIODS,
    Outcome,
    Pattern,
    by_scale,
    outcome_of,
    positive_errors,
)
from studies.paper_gap.verdicts import NEVER, by_name, rows
from studies.response_variation.tables import logarithms
from studies.study import Answer, Check, Progress
from studies.wording import effect

Array = NDArray[np.float64]
Tell = Callable[[float, str], None]

TABLE_COUNT: Final = 60
QUICK_TABLES: Final = 3
EFFECT: Final = 1.6  # A simulation with an effect takes so many times as long as one without.
STAYS: Final = 0.8  # The least share of draws that show the pattern at a finer step too: some lie at its edge.
MIN_DISCRIMINATED_SHARE: Final = 0.9  # The least share of pairs of candidates that the experiments should discriminate.


def compute(machine: Machine, options: PaperOptions, progress: Progress) -> Answer:
    """Answers the study's question. Raises BadInputError for a machine of which no outcomes are published."""
    pattern = _pattern(machine, options)
    require_designable(machine)
    counted = with_elements(machine, options, progress)
    machine = counted.machine
    tables = _tables(machine, options)
    effort = _effort(len(tables), quick=options.quick)
    _foresee(machine, effort, options, progress)
    bare = [_without(table, pattern) for table in tables]
    with _pool(options) as pool:
        designs = _designs(tables, pattern, quick=options.quick)
        explored = by_name(_explored(tables, pattern, effort, options, pool, progress))
        told = rows(explored, len(tables))
        chosen = shown.choose(explored, [row["name"] for row in told])
        progress(0.82, "what shows the pattern at a finer step, and without compensation")
        again = shown.again(tables, chosen, pattern, pool)
        progress(0.84, "what the settling times hang on")
        settling = hanging(tables, chosen, options, pool)
        progress(0.86, "simulating the experiments that could decide")
        decided = shown.decided(machine, tables, chosen, pool)
        progress(0.95, "exchanging the compensator")
        told_apart = exchanged(tables, _consistent(chosen), pattern.dispersion, pool)
    share = pattern.margin / pattern.dispersion
    results = {
        "quick": options.quick,
        "pattern": {
            **vars(pattern),
            "settling_time": machine.specification.settling_time,
            **_arithmetic(pattern, machine.specification.motions),
        },
        "tables": len(tables),
        "effort": {
            **vars(effort),
            "simulations": effort.simulations,
            "periods": PERIODS,
            "seconds": sequence(machine, periods=PERIODS).size * machine.sample_time,
            "most": BEYOND_PRIOR_RATIO,
            "fine": shown.FINE_SUBSTEPS / CONVERGED,
            "near_steps": MAX_DISTANCE_STEPS,
            "substeps": [COARSE_SUBSTEPS, CONVERGED, shown.FINE_SUBSTEPS],
        },
        "priors": {"friction": FRICTION, "beside": BESIDE_FRICTION, "bound": BOUND, "mass_bound": MASS_BOUND},
        "evidence": evidence(explored, share, options.seed),
        "designs": designs,
        "exchange": told_apart,
        "nominal": [row for row, _ in bare],
        "candidates": told,
        "points": {name: _points(ways[ALONE]) for name, ways in explored.items()},
        "responses": shown.responses(tables, [error for _, error in bare], chosen),
        "again": again,
        "kept": shown.kept(again, share),
        "settling": settling,
        "decided": decided,
        **counted.results,
    }
    summary = [*_summary(results), *counted.summary]
    return Answer(results, _checks(results), _references(machine, decided), summary)


def _foresee(machine: Machine, effort: Effort, options: PaperOptions, progress: Progress) -> None:
    """The time of all candidates alone and beside a wrong friction, with half a motion of rest before the sequence."""
    cases, cores = 1.5 * len(every()), 1 if options.quick else min(os.cpu_count() or 1, 2)
    samples = (PERIODS + 1) * period(machine)
    taken = cases * effort.simulations * samples * EFFECT * seconds_a_sample(machine) / cores
    foresee({"the candidates": taken}, samples * SIMULATED, options, progress)


def _references(machine: Machine, decided: Mapping[str, Any]) -> dict[str, str]:
    """The two experiments as records of references for the machine's nominal design."""
    controller, experiments = paper_controller(machine), menu(machine)
    files = {"second_experiment.csv": decided["second"], "next_experiment.csv": decided["first"]}
    return {
        name: to_csv(experiments[at].plan(machine, controller).schedule, machine.sample_time)
        for name, at in files.items()
        if name == "next_experiment.csv" or at != decided["first"]
    }


def _pattern(machine: Machine, options: PaperOptions) -> Pattern:
    if machine.published is None:
        raise BadInputError(
            "--machine: no [published] outcomes to explain; add reversal_settling_time, dispersion_without and "
            "dispersion_with to the machine file"
        )
    margin, wanted = options.margin, machine.published.dispersion_with
    if not 0 < margin < wanted:
        raise BadInputError(f"--margin: {show(margin, 'm')} must be between 0 and the published {show(wanted, 'm')}")
    return Pattern(machine.specification.tolerance, machine.scale.resolution, wanted, margin)


def _tables(machine: Machine, options: PaperOptions) -> list[Table]:
    """The tables with their controllers, designed without any effect."""
    try:
        alone = options.machine is not None and options.ensemble is None
        members: Sequence[Machine] = (machine,) if alone else load_ensemble(options.ensemble or ENSEMBLE)
    except MachineError as error:
        raise BadInputError(f"--ensemble {error}") from error
    chosen = spread(members, machine, options.tables or (QUICK_TABLES if options.quick else TABLE_COUNT))
    require_members(() if alone else chosen)
    try:
        return [(one, paper_controller(one)) for one in chosen]
    except DesignError as error:
        raise BadInputError(f"--machine, --ensemble: {error}") from error


def spread(members: Sequence[Machine], machine: Machine, count: int) -> list[Machine]:
    """Up to `count` of the members that lie far from each other: the one nearest to `machine`, then the farthest ones.

    Distances are those of the logarithms of the unpublished parameters, each in units of its deviation over all.
    """
    if count >= len(members):
        return list(members)
    points = logarithms([*members, machine])
    deviation = np.std(points, axis=0)
    points /= np.where(deviation > 0, deviation, 1.0)
    apart = np.linalg.norm(points[:-1, None] - points[None], axis=2)  # (members, members and the machine)
    picked = [int(np.argmin(apart[:, -1]))]
    while len(picked) < count:
        picked.append(int(np.argmax(np.min(apart[:, picked], axis=1))))
    return [members[i] for i in picked]


def _effort(tables: int, *, quick: bool) -> Effort:
    return (
        Effort(max(tables, QUICK_TABLES), 1, 1, 0)
        if quick
        else Effort(4 * max(tables, QUICK_TABLES), 6, 3, len(SEARCH_STEPS))
    )


def _of_search(effort: Effort) -> Effort:
    """Beside a wrong friction and beyond its range a candidate is only searched for: a quarter of the draws."""
    return replace(effort, draws=max(effort.draws // 4, QUICK_TABLES))


def _consistent(chosen: shown.Chosen) -> list[Draw]:
    """The sizes that have the dispersion by themselves: beside a wrong friction, two causes would be exchanged."""
    return [one for its in chosen.values() for one in its if one.disperses and one.case.way != BESIDE]


def _designs(tables: Sequence[Table], pattern: Pattern, *, quick: bool) -> list[dict[str, Any]]:
    """Every design of the compensator that has a name, on every table."""
    some = tables[:1] if quick else tables
    machines = [machine for machine, _ in some]
    found = []
    for i, one in enumerate(named(machines[0])):
        rfms = [of_name(machine, named(machine)[i]) for machine in machines]
        laws = [with_compensator(controller, rfm) for (_, controller), rfm in zip(some, rfms, strict=True)]
        substeps = COARSE_SUBSTEPS if quick else CONVERGED
        validations = validate_many(machines, laws, periods=PERIODS, reading="scale", substeps=substeps)
        outcomes = [outcome_of(validation) for validation in validations]
        errors = [slope_error(machine, rfm) for machine, rfm in zip(machines, rfms, strict=True)]
        found.append({"name": one.name, **_over_tables(outcomes, pattern), "slopes_off": float(np.median(errors))})
    return found


def _over_tables(outcomes: Sequence[Outcome], pattern: Pattern) -> dict[str, Any]:
    """3 sigma [m] over the tables: least, median, largest; and on how many of them what is as in the paper."""
    return {
        "dispersions_m": np.quantile([one.dispersion for one in outcomes], [0.0, 0.5, 1.0]),
        "tables": len(outcomes),
        "reversal_in_time": sum(keeps_to(one.reversal_error, pattern.tolerance) for one in outcomes),
        "inching_in_time": sum(keeps_to(one.inching_error, pattern.tolerance) for one in outcomes),
        "loose": sum(pattern.loose_distance(one) == 0.0 for one in outcomes),
        "pattern": sum(pattern.distance(one) == 0.0 for one in outcomes),
    }


@contextmanager
def _pool(options: PaperOptions) -> Iterator[Executor | None]:
    """Processes for a full run; a quick one finishes before they would have started."""
    if options.quick:
        yield None
        return
    with ProcessPoolExecutor(min(os.cpu_count() or 1, 2), multiprocessing.get_context("spawn")) as pool:
        yield pool


def _without(table: Table, pattern: Pattern) -> tuple[dict[str, Any], Array]:
    """The outcome of a table by itself, and its errors (motions, n) [m]."""
    machine, controller = table
    validation = by_scale(machine, controller)
    outcome, error = outcome_of(validation), positive_errors(validation)
    return {**outcome.to_json(), "distance_m": pattern.distance(outcome), "name": machine.name}, error


def _explored(
    tables: Sequence[Table],
    pattern: Pattern,
    effort: Effort,
    options: PaperOptions,
    pool: Executor | None,
    progress: Progress,
) -> list[list[Draw]]:
    """Every candidate alone; effects and designs beside a wrong friction; effects beyond their prior where they take
    that alone.
    """

    def tell(begin: float, end: float) -> Tell:
        return lambda share, text: progress(begin + share * (end - begin), text)

    names = every()
    beside = [Case(name, BESIDE) for name, one in names.items() if one.kind != PARAMETERS]
    effects = [name for name, one in names.items() if one.kind == OF_EFFECTS]
    mild = [Case(name) for name in names]
    found = explore_all(tables, mild, pattern, effort, options.seed, pool, tell(0.05, 0.45))
    alone, search = by_name(found), _of_search(effort)
    found += explore_all(tables, beside, pattern, search, options.seed, pool, tell(0.45, 0.65))
    more = [Case(name, BEYOND) for name in effects if not any(one.shows for one in alone[name][ALONE])]
    return found + explore_all(tables, more, pattern, search, options.seed, pool, tell(0.65, 0.82))


def _arithmetic(pattern: Pattern, motions: int) -> dict[str, float]:
    """The errors that three sigma of so many motions [m] allows.

    from_mean: the largest deviation of one of them from their mean, the others being equal. common: what the mean has
    to be, then, for an inching motion to miss. alike: the error of inching motions that err alike after a reversal that
    does not.
    """
    farthest = (pattern.dispersion + pattern.margin) / 3 * math.sqrt(motions - 1)
    return {
        "from_mean": farthest,
        "common": max(pattern.tolerance + pattern.step - farthest, 0.0),
        "alike": pattern.dispersion / 3 * motions / math.sqrt(motions - 1),
    }


def _points(draws: Sequence[Draw]) -> dict[str, Any]:
    """The draws of a candidate alone, for a figure."""
    return {
        "inching_error_m": [one.outcome.inching_error for one in draws],
        "dispersion_m": [one.outcome.dispersion for one in draws],
        "reversal_error_m": [one.outcome.reversal_error for one in draws],
    }


def _checks(results: Mapping[str, Any]) -> tuple[Check, ...]:
    exchange = results["exchange"]
    bare = sum(row["distance_m"] == 0.0 for row in results["nominal"])
    again = [row["finer"]["shows"] for row in results["again"] if row["shows"]]
    decided = results["decided"]
    told = decided["told_by_first"] + decided["added_by_second"]
    return (
        Check("tables that show the pattern without anything added", bare, "1", 0, "what there is to explain"),
        Check(
            f"share of what shows the pattern that does at {shown.FINE_SUBSTEPS} substeps a sample, too",
            float(np.mean(again)) if again else 1.0,
            "1",
            STAYS,
            "the simulation's step",
            ">=",
        ),
        Check(
            "pairs of candidates that two experiments tell apart",
            told / decided["pairs"] if decided["pairs"] else 1.0,
            "1",
            MIN_DISCRIMINATED_SHARE,
            "aim of this study",
            ">=",
        ),
        Check(
            "causes that exchanging the compensator tells apart",
            exchange["right"] / exchange["of"] if exchange["of"] else 1.0,
            "1",
            MIN_DISCRIMINATED_SHARE,
            "aim of this study",
            ">=",
        ),
    )


def _odds(found: Mapping[str, Any]) -> list[tuple[str, str]]:
    """One line per kind: the shares of its draws that agree with the paper by either reading."""
    return [
        (
            {"compensator": "the compensator's design", "parameters": "wrong parameters"}.get(kind, "missing effects"),
            f"3 sigma as published in {one['loose_fits']['share']:.2%} of the draws, the pattern in "
            f"{one['pattern_fits']['share']:.2%}",
        )
        for kind, one in found["kinds"].items()
    ]


def _summary(results: Mapping[str, Any]) -> list[tuple[str, str]]:
    """One line per verdict, and the experiments."""
    told, decided = results["candidates"], results["decided"]
    words = {
        ALONE: "show the pattern alone",
        BESIDE: "show it beside a wrong friction",
        BEYOND: "show it beyond their prior",
        NEVER: "do not show it",
    }
    lines = [
        (text, ", ".join(effect(row["name"]) for row in told if row["verdict"] == way) or "none")
        for way, text in words.items()
    ]
    first, second = (decided["experiments"][decided[place]] for place in ("first", "second"))
    lines = [*_odds(results["evidence"]), *lines]
    most = f"{first['name']} ({decided['told_by_first']} of {decided['pairs']} pairs)"
    lines.append(("most discriminating experiment", most))
    if decided["added_by_second"]:
        lines.append(("and after it", f"{second['name']} ({decided['added_by_second']} more)"))
    return lines
