"""What the paper shows, in the model: its figures as data, its mechanism as numbers, and the band of the whole set."""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.controller import default_controller
from design.deadbeat import DesignError
from models.ensemble import DEFAULT as ENSEMBLE
from models.ensemble import load_ensemble, to_text
from models.friction import branch, follow
from models.machine import Machine, MachineError
from models.plant import bode
from models.record import feeding_sequence
from studies.command import Answer, BadInputError, Check, Progress
from studies.response_variation.choice import error_against_count
from studies.response_variation.mechanism import mechanism
from studies.response_variation.published import Shown, outcomes, rows
from studies.response_variation.search import LARGEST_MS, TOLERANCE, largest_sensitivity, most_central, search
from studies.response_variation.tables import COORDINATES, coordinates, spread, texts
from studies.validation import Validation, validate_many

Array = NDArray[np.float64]

SHOWN: Final = 0.1  # s of each motion that is shown


def vary(machine: Machine, options: argparse.Namespace, progress: Progress) -> Answer:
    """Answers the study's question. Raises BadInputError for a machine of which no outcomes are published."""
    if machine.published is None:
        raise BadInputError(
            "--machine: no [published] outcomes to compare with; add reversal_settling_time, dispersion_without and "
            "dispersion_with to the machine file"
        )
    if len(machine.plant.modes) != 3:
        raise BadInputError("--machine: the paper's table has a rigid body and two vibration modes; this one has not")
    progress(0.02, "collecting the tables")
    files: dict[str, Any] = {}
    members = _searched(machine, options, progress, files) if options.search else _kept(machine, options)
    if options.quick:
        members = members[:6]
    progress(0.3, f"simulating {len(members) + 1} tables over the sequence")
    central, tables = _simulated([machine])[0], _simulated(members)
    progress(0.5, "exchanging the friction's history between reversal and inching")
    exchange = mechanism(central.machine, central.controller, central.without)
    over_set = [mechanism(one.machine, one.controller, one.without) for one in tables]
    progress(0.65, "error against the number of elements")
    choice = error_against_count(machine.friction, options.seed, quick=options.quick)
    progress(0.8, "collecting the results")
    results = {
        "quick": options.quick,
        "members": len(tables),
        "bode": _bode([machine, *members]),
        "hysteresis": _hysteresis(central),
        "reference": _reference(machine),
        "without": _band(central.without, [one.without for one in tables]),
        "with": _band(central.with_rfm, [one.with_rfm for one in tables]),
        "mechanism": {"central": exchange, "set": _quantiles(over_set)},
        "choice": choice,
        "set": _set(central, tables),
        "paper": rows(central, tables),
        "gap": _gap(central, tables),
    }
    return Answer(results, _checks(central, tables, results), files)


def _searched(
    machine: Machine, options: argparse.Namespace, progress: Progress, files: dict[str, Any]
) -> tuple[Machine, ...]:
    """The tables of a new search; they and the most central one are written beside the results."""
    found = search(
        machine,
        options.members,
        options.seed,
        workers=min(os.cpu_count() or 1, 2),
        tell=lambda share, text: progress(0.02 + 0.28 * share, text),
    )
    comment = (
        "Tables that behave as the paper says, for what it leaves out: found by\n"
        f"python -m studies.response_variation --search --members {options.members} --seed {options.seed}"
    )
    source = "assumed: one of the tables that behave as the paper says (studies.response_variation)"
    files["ensemble.toml"] = to_text(
        "linear_motor_table.toml", source, comment, [texts(member.machine) for member in found]
    )
    files["most_central.toml"] = to_text(
        "linear_motor_table.toml",
        source,
        "The most central of these tables.",
        [texts(found[most_central(found)].machine)],
    )
    return tuple(member.machine for member in found)


def _kept(machine: Machine, options: argparse.Namespace) -> tuple[Machine, ...]:
    """The tables of an ensemble file; for an own machine without one, only the machine itself."""
    if options.ensemble is None and options.machine is not None:
        return (machine,)
    path: Path = options.ensemble or ENSEMBLE
    try:
        return load_ensemble(path)
    except MachineError as error:
        raise BadInputError(f"--ensemble {error}") from error


def _simulated(machines: Sequence[Machine]) -> list[Shown]:
    try:
        controllers = [default_controller(machine) for machine in machines]
    except DesignError as error:
        raise BadInputError(f"--machine, --ensemble: {error}") from error
    without = validate_many(machines, [controller.without_compensation() for controller in controllers])
    compensated = validate_many(machines, controllers)
    return [Shown(*all_four) for all_four in zip(machines, controllers, without, compensated, strict=True)]


def _bode(machines: Sequence[Machine]) -> dict[str, Any]:
    """Fig. 2: the first machine's curves, and the band of all; K_e as published."""
    first = machines[0]
    frequency = np.geomspace(1.0, 200.0, 500)
    slopes = {"P_l": 0.0, "P_e1": first.presliding.stiffness_1, "P_e2": first.presliding.stiffness_2}
    curves: dict[str, Any] = {"frequency_Hz": frequency}
    for name, slope in slopes.items():
        both = [bode(one.plant, 2 * math.pi * frequency, slope) for one in machines]
        magnitudes = np.array([magnitude for magnitude, _ in both])
        curves[name] = {
            "magnitude_m_per_N": magnitudes[0],
            "low_m_per_N": np.min(magnitudes, axis=0),
            "high_m_per_N": np.max(magnitudes, axis=0),
            "phase_deg": np.degrees(both[0][1]),
            "stiffness_N_per_m": slope,
        }
    return curves


def _hysteresis(shown: Shown) -> dict[str, Any]:
    """Figs. 3a, 3b and 4: loops of the machine's friction and of its RFM, the branch behind a reversal, inner loops."""
    friction, rfm = shown.machine.friction, shown.controller.friction_compensation
    assert rfm is not None

    def along(corners: Sequence[float]) -> dict[str, Any]:
        x = np.concatenate([np.linspace(a, b, 120) for a, b in pairwise(corners)]) * 1e-6
        before = np.concatenate([[0.0], np.full(1, -1e-3), x])  # full slip in the negative direction comes first
        return {"position_m": x, "machine_N": follow(friction, before)[0][2:], "rfm_N": follow(rfm, before)[0][2:]}

    distance = np.linspace(0, 200e-6, 400)
    return {
        "overview": along([-150, 150, -150]),
        "inner": along([-150, 150, -150, -40, -100, 20, -30, 80, 40, 60, -150]),
        "branch": {"distance_m": distance, "machine_N": branch(friction, distance), "rfm_N": branch(rfm, distance)},
        "elements": len(friction.limit),
        "rfm_elements": len(rfm.limit),
    }


def _reference(machine: Machine) -> dict[str, Any]:
    wanted = machine.specification
    target = feeding_sequence(wanted.stroke, wanted.motions, wanted.interval, machine.sample_time)
    samples = round(wanted.interval / machine.sample_time)
    return {
        "time_s": np.arange(target[::samples].size + 1) * wanted.interval,
        "target_m": np.append(0.0, target[::samples]),
    }


def _band(central: Validation, others: Sequence[Validation]) -> dict[str, Any]:
    """The positive motions of the central table, and the range of all tables at each time."""
    ts = central.response.record.sample_time
    n = round(SHOWN / ts)
    motions = []
    for one in central.positive():
        part = slice(one.motion.start, one.motion.start + n)
        motions.append(
            {
                "origin_m": one.motion.origin,
                "target_m": one.motion.target,
                "reversal": one.motion.reversal,
                "settling_s": one.settling_time,
                "travelled_m": central.response.position[part] - one.motion.origin,
                "reference_m": central.response.record.reference[part] - one.motion.origin,
                "friction_N": central.response.friction[part],
            }
        )
    dispersions = [one.dispersion[:n] for one in others]
    band: dict[str, Any] = {"time_s": np.arange(n) * ts, "motions": motions, "dispersion_m": central.dispersion[:n]}
    band["dispersion_low_m"], band["dispersion_high_m"] = np.min(dispersions, axis=0), np.max(dispersions, axis=0)
    for kind in (True, False):
        travelled = [
            validation.response.position[one.motion.start : one.motion.start + n] - one.motion.origin
            for validation in others
            for one in validation.positive()
            if one.motion.reversal is kind
        ]
        name = "reversal" if kind else "inching"
        band[f"{name}_low_m"], band[f"{name}_high_m"] = np.min(travelled, axis=0), np.max(travelled, axis=0)
    return band


def _quantiles(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Least, median and largest of every scalar over the set."""
    names = [name for name, item in rows[0].items() if np.ndim(item) == 0]
    return {
        name: dict(zip(("low", "median", "high"), np.quantile([row[name] for row in rows], [0, 0.5, 1]), strict=True))
        for name in names
    }


def _set(central: Shown, tables: Sequence[Shown]) -> dict[str, Any]:
    """Where the tables lie in each unpublished parameter, and how much of the range searched that is."""
    points = np.array([coordinates(one.machine) for one in tables])
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
        "outcomes": {
            name: [outcomes(getattr(one, case))[name] for one in tables]
            for case, name in (("without", "reversal_settling_s"), ("without", "dispersion_m"))
        },
        "largest_Ms": [largest_sensitivity(one.machine) for one in tables],
    }


def _gap(central: Shown, tables: Sequence[Shown]) -> dict[str, Any]:
    """What compensation leaves in the model, over the set, beside what it left on the real table."""
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
        "share_inching_in_time": float(np.mean(inching <= in_time)),
        "share_reversal_in_time": float(np.mean(np.array([one["reversal_settling_s"] for one in left]) <= in_time)),
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
    worst = max(
        max(
            abs(outcomes(one.without)["reversal_settling_s"] / published.reversal_settling_time - 1),
            abs(outcomes(one.without)["dispersion_m"] / published.dispersion_without - 1),
        )
        for one in tables
    )
    rated = central.machine.drive.rated_thrust
    peak = max(one.peak_thrust for shown in tables for one in (*shown.without.achieved, *shown.with_rfm.achieved))
    exchange = results["mechanism"]["central"]
    gap = results["gap"]
    return (
        *checks,
        Check("members of the set", len(tables), "1", 6 if results["quick"] else 50, "issue: at least 50 tables", ">="),
        Check("largest difference of a member to the paper", worst, "1", TOLERANCE, "III.B, V.B"),
        Check(
            "largest Ms of a member", max(results["set"]["largest_Ms"]), "1", LARGEST_MS, "what a practitioner accepts"
        ),
        Check("largest thrust of a member", peak, "N", rated, "II.A"),
        Check(
            "share of the reversal's delay due to the friction's history", exchange["delay_share"], "1", 0.9, "IV", ">="
        ),
        Check("3 sigma with compensation", gap["central"]["dispersion_m"], "m", published.dispersion_with, "V.B"),
    )
