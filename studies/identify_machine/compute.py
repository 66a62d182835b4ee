"""From records to a machine file: each record is recognised, identified, and put into the machine; plain results."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from models.identification.force_fit import SURE
from models.identification.response import FrequencyResponse, period
from models.machine import Machine, parameters
from models.machine_file import to_toml
from models.quantity import show
from models.records.checks import RecordError
from models.records.files import Loaded, load
from models.records.record import Record, cut
from studies.identify_machine import own_records, round_trip
from studies.identify_machine.found import Found
from studies.identify_machine.options import KINDS, IdentificationOptions
from studies.identify_machine.steps import STEPS
from studies.options import BadInputError
from studies.record_columns import columns_of
from studies.study import Answer, Check, Progress

Array = NDArray[np.float64]

SLOW: Final = 0.05  # of the command's scatter: a record whose inertial force is below shows friction alone
STRAIGHT: Final = 0.01  # of the way: by so much a reference of one speed may depart from a straight line
QUICK_TABLES: Final = 3


def compute(machine: Machine, options: IdentificationOptions, progress: Progress) -> Answer:
    """Answers the study's question. Raises BadInputError for records or options that can't be used."""
    given = _loaded(machine, options, progress) if options.record else _own(machine, options.seed)
    found = Found(machine=_bare(machine), pass_band=options.pass_band)
    for i, (kind, record) in enumerate(sorted(given, key=lambda item: KINDS.index(item[0]))):
        progress(0.05 + 0.4 * i / len(given), f"identifying from {record.name} ({kind})")
        try:
            found = STEPS[kind](found, record)
        except ValueError as error:
            raise BadInputError(f"{record.name}: {error}") from error
    checks = [*found.checks]
    results: dict[str, Any] = {
        "quick": options.quick,
        "own_records": not options.record,
        "records": [_record(kind, record) for kind, record in given],
        **found.results,
        "parameters": [_parameter(p) for p in parameters(found.machine) if p.provenance.kind == "identified"],
        "said": list(found.said),
        "sure": SURE,
    }
    if not options.record:
        tables = min(options.tables, QUICK_TABLES) if options.quick else options.tables
        results["round_trip"] = round_trip.judged(
            machine, tables, options.seed, lambda share, text: progress(0.45 + 0.4 * share, text)
        )
        checks += _round_trip_checks(results["round_trip"], quick=options.quick)
        checks += _curve_checks(machine, found)
    summary = [(p["name"], f"{_shown(p['number'], p['unit'])} ± {_shown(p['std'], p['unit'], 2)}")
               for p in found.results.get("estimates", [])]  # fmt: skip
    return Answer(results, tuple(checks), {"identified.toml": to_toml(found.machine)}, summary)


def _shown(number: float, unit: str, digits: int = 5) -> str:
    return show(number, unit, digits)


def _bare(machine: Machine) -> Machine:
    """What stays nominal; what an experiment on another machine showed is left out."""
    return replace(machine, name=f"{machine.name}, identified", published=None)


def _loaded(machine: Machine, options: IdentificationOptions, progress: Progress) -> list[tuple[str, Loaded]]:
    columns = columns_of(machine, options.column)
    kinds = options.kinds.split(",") if options.kinds else ["auto"] * len(options.record)
    if len(kinds) != len(options.record) or not set(kinds) <= set(KINDS):
        raise BadInputError(f"--kinds {options.kinds}: give one of {', '.join(KINDS)} for each of the records")
    control = machine.control
    found = []
    for kind, path in zip(kinds, options.record, strict=True):
        progress(0.02, f"reading {path}")
        try:
            loaded = load(
                path,
                columns,
                pid=control.pid,
                reference_delay=control.reference_delay,
                sample_time=machine.sample_time,
                mass=machine.plant.mass,
                limit=machine.drive.rated_thrust,
            )
        except RecordError as error:
            raise BadInputError(str(error)) from error
        found.append((recognised(machine, loaded) if kind == "auto" else kind, loaded))
    return found


def recognised(machine: Machine, loaded: Loaded) -> str:
    """Which of KINDS a file is [SI]: see the report's section on records."""
    if isinstance(loaded.content, FrequencyResponse):
        return "response"
    record = loaded.content
    steps = np.count_nonzero(np.diff(record.target))
    if 0 < steps < record.target.size / 20:
        return "motion"
    if np.ptp(record.feedforward) > 0 and (_straight(record) or period(record.feedforward) is not None):
        return "excitation"
    width = max(round(0.05 / record.sample_time), 3)
    smooth = np.convolve(record.position, np.hanning(width + 2)[1:-1] / np.sum(np.hanning(width + 2)), "valid")
    inertia = np.diff(smooth, 2) / record.sample_time**2 / machine.plant.rigid_gain
    return "hysteresis" if np.std(inertia) < SLOW * np.std(record.command) else "dynamics"


def _straight(record: Record) -> bool:
    """Whether the reference stands still or moves at one speed, so that the feedforward is no motion's."""
    line = np.linspace(record.reference[0], record.reference[-1], record.reference.size)
    away = float(np.max(np.abs(record.reference - line)))
    return away <= STRAIGHT * max(float(np.ptp(record.reference)), float(np.ptp(record.position)))


def _own(machine: Machine, seed: int) -> list[tuple[str, Loaded]]:
    """Three records of the machine itself, simulated; `sha256` is then the seed that makes them."""
    table = own_records.noisy(machine)
    records = (
        ("excitation", own_records.excitation(table, seed)),
        ("hysteresis", own_records.hysteresis(table, seed)),
        ("motion", own_records.motions(table, seed)),
    )
    return [(kind, Loaded(f"simulated {kind}", f"none, seed {seed}", record, (), ())) for kind, record in records]


def _record(kind: str, loaded: Loaded) -> dict[str, Any]:
    content = loaded.content
    shown: dict[str, Any] = {
        "name": Path(loaded.name).name,
        "kind": kind,
        "sha256": loaded.sha256,
        "findings": list(loaded.findings),
    }
    if isinstance(content, Record):
        size = content.position.size
        return {**shown, "samples": size, "sample_time_s": content.sample_time, "motions": len(cut(content))}
    return {**shown, "samples": content.frequency.size, "sample_time_s": None, "motions": 0}


def _parameter(parameter: Any) -> dict[str, Any]:
    provenance = parameter.provenance
    shown = {"name": parameter.name, "meaning": parameter.meaning, "unit": parameter.unit, "number": parameter.number}
    record, _, std = provenance.detail.rpartition(", std ")
    listed = re.match(r"\[.*\]|\S+", std) if record else None
    return {
        **shown,
        "source": provenance.kind,
        "detail": provenance.detail,
        "record": record.removeprefix("record ").partition(" sha256 ")[0],
        "std": None if listed is None else json.loads(listed.group()),
    }


def _round_trip_checks(judged: dict[str, Any], *, quick: bool) -> list[Check]:
    source = f"{judged['intervals']} intervals of {judged['tables']} simulated tables"
    if quick:
        source += ", a smoke test: too few to judge a coverage"
    low = Check("share of true values within their 95 % intervals", judged["coverage"], "1", 0.9, source, ">=")
    high = Check("the same share, from above", judged["coverage"], "1", 1.0 if quick else 0.99, source)
    share = judged["wrong_number"] / judged["tables"]
    wrong = Check("tables with a wrong number of modes or elements", share, "1", 0.1,
                  "of two records of each")  # fmt: skip
    return [low, high, wrong]


def _curve_checks(machine: Machine, found: Found) -> list[Check]:
    """The machine's own elements, more than data tell apart, against the curve identified."""
    from models.friction import branch

    curve = found.results["hysteresis"]["curve"]
    distance = np.array(curve["distance_m"])
    off = np.max(np.abs(np.array(curve["climbed_N"]) - branch(machine.friction, distance)))
    name = "largest error of the friction curve, as a share of its climb"
    return [Check(name, float(off) / (2 * machine.friction.coulomb_force), "1", 0.02, "the simulated table's elements")]
