"""From records to a machine file: recognises each record, identifies from it, updates the machine."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.judging.known_range import with_covered
from diagnosis.records.at_rest import swing_at_rest
from models.friction import branch
from models.identification import motion
from models.identification.force.fit import SIGNIFICANT_STDS
from models.identification.pipeline import identify
from models.identification.recognise import read, recognised, replayable
from models.machine import Machine, Parameter, parameters
from models.machine_file import to_toml
from models.quantity import show
from models.records.files import Loaded
from models.records.kinds import KINDS
from models.records.record import Record, cut
from models.records.tables.sizes import RecordError
from studies.beforehand import require_controller
from studies.effort import IDENTIFIED, IDENTIFYING, foresee, seconds_a_sample
from studies.identify_machine import controllers, own_records, round_trip, size_of_force
from studies.identify_machine.options import IdentificationOptions
from studies.identify_machine.shown import checks_of, results_of, warnings_of
from studies.options import BadInputError
from studies.record_columns import mapped
from studies.sticking import found_in
from studies.sticking import rows as sticking_rows
from studies.study import Answer, Check, Progress

QUICK_TABLES: Final = 3


def compute(machine: Machine, options: IdentificationOptions, progress: Progress) -> Answer:
    """Answers the study's question. Raises BadInputError for records or options that can't be used."""
    if options.write_references is not None:
        raise BadInputError("--write-references: is for the command line; call references.write from Python")
    if not options.record:
        require_controller(machine)
        _foresee(machine, options, progress)
    given = _loaded(machine, options, progress) if options.record else _own(machine, options.seed)
    kinds, records = zip(*given, strict=True)
    swinging = _swinging(machine, given)
    try:
        found = identify(
            machine,
            records,
            kinds=kinds,
            pass_band=options.pass_band,
            modes=options.modes,
            rolled=options.rolling,
            tell=lambda share, text: progress(0.05 + 0.4 * share, text),
        )
    except RecordError as error:
        first = "".join(f"{name}: {said}. Besides, " for name, said in swinging[:1])
        raise BadInputError(f"{first}{error}") from error
    shown = results_of(found)
    sizes = size_of_force.doubts(machine, found.machine, given) if options.record else []
    others, checks = controllers.judged(machine, given if options.record else ())
    others = [*swinging, *others]
    checks = [*checks_of(found, shown), *checks]
    results: dict[str, Any] = {
        "quick": options.quick,
        "own_records": not options.record,
        "records": [_record(kind, record) for kind, record in given],
        **shown,
        "parameters": [_parameter(p) for p in parameters(found.machine) if p.provenance.kind == "identified"],
        "said": [
            *(f"{what.capitalize()}: {one}." for what, one in sizes),
            *(f"{name}: {one}" for name, one in others),
            *found.remarks,
        ],
        "sure": SIGNIFICANT_STDS,
        **found_in(found.machine, records=[one for _, one in _motions(given)] if options.record else ()),
    }
    if not options.record:
        tables = min(options.tables, QUICK_TABLES) if options.quick else options.tables
        try:
            results["round_trip"] = round_trip.judged(
                machine, tables, options.seed, lambda share, text: progress(0.45 + 0.4 * share, text)
            )
        except ValueError as error:
            raise BadInputError(
                f"--machine: the simulated records of a machine near this one cannot be identified ({error}); give "
                "records of the machine itself"
            ) from error
        checks += _round_trip_checks(results["round_trip"], quick=options.quick)
        checks += _curve_checks(machine, shown["hysteresis"]["curve"])
    units = [machine.unit(row["unit"]) for row in shown["estimates"]]
    several = len(found.steps) > 1
    summary = [
        (
            f"{row['record']}: {row['name']}" if several else row["name"],
            f"{show(row['number'], unit, 5)} ± {show(row['std'], unit, 2)}{relative_to(row['name'], row['unit'])}",
        )
        for row, unit in zip(shown["estimates"], units, strict=True)
    ]
    warned = [(f"WARNING, {what}", said) for what, said in (*others, *sizes, *warnings_of(found))]
    summary[:0] = [*warned, *sticking_rows(results)]
    return Answer(
        results, tuple(checks), {"identified.toml": to_toml(_with_range(found.machine, given, options))}, summary
    )


def relative_to(name: str, unit: str) -> str:
    """What stands behind an identified value, by its name and unit, that is no quantity of its own; no unit [-]."""
    relative = unit == "1" and (name, unit) in motion.PARAMETER_UNITS
    return " times the other records' or, without one, the machine file's" if relative else ""


def _with_range(machine: Machine, given: Sequence[tuple[str, Loaded]], options: IdentificationOptions) -> Machine:
    """The identified machine with the range of force and speed of its records, where they are an axis's own."""
    motions = [one.content for _, one in given if isinstance(one.content, Record)]
    names = ", ".join(Path(one.name).name for _, one in given)
    return with_covered(machine, motions, f"identify_machine of {names}") if options.record else machine


def _swinging(machine: Machine, given: Sequence[tuple[str, Loaded]]) -> list[tuple[str, str]]:
    """The motion records whose axis swings at rest, by name, and how."""
    found = [(name, swing_at_rest(content, machine)) for name, content in _motions(given)]
    return [(name, f"the axis {swing}") for name, swing in found if swing is not None]


def _motions(given: Sequence[tuple[str, Loaded]]) -> list[tuple[str, Record]]:
    """The motion records by name; others may be excited by what no column holds."""
    return [
        (Path(one.name).name, one.content)
        for kind, one in given
        if kind == "motion" and isinstance(one.content, Record)
    ]


def _loaded(machine: Machine, options: IdentificationOptions, progress: Progress) -> list[tuple[str, Loaded]]:
    mapping = mapped(machine, options, options.record)
    for note in mapping.notes:
        progress(0.02, note)
    kinds = options.kinds.split(",") if options.kinds else ["auto"] * len(options.record)
    if len(kinds) != len(options.record) or not set(kinds) <= {"auto", *KINDS}:
        raise BadInputError(f"--kinds {options.kinds}: give one of auto, {', '.join(KINDS)} for each of the records")
    found = []
    for kind, path in zip(kinds, options.record, strict=True):
        progress(0.02, f"reading {path}")
        columns = mapping.columns(path)
        try:
            loaded = read(machine, path, columns, trusted=options.trust_records)
        except RecordError as error:
            raise BadInputError(str(error)) from error
        progress(0.02, "\n".join([f"read {path}", *loaded.recognised]))
        known = recognised(machine, loaded) if kind == "auto" else kind
        found.append((known, replayable(machine, loaded, known, columns)))
    return found


def _foresee(machine: Machine, options: IdentificationOptions, progress: Progress) -> None:
    """The time of simulated records and of identifying from them, for the machine and for each table."""
    tables = 1 + (min(options.tables, QUICK_TABLES) if options.quick else options.tables)
    samples = own_records.DURATION / machine.sample_time
    taken = tables * samples * IDENTIFYING * seconds_a_sample(machine)
    foresee({"the simulated records": taken}, samples * IDENTIFIED, options, progress)


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


def _parameter(parameter: Parameter) -> dict[str, Any]:
    source = parameter.provenance
    return {
        "name": parameter.name,
        "meaning": parameter.meaning,
        "unit": parameter.unit,
        "number": parameter.number,
        "source": source.kind,
        "detail": source.detail,
        "record": source.record,
        "sha256": source.sha256,
        "std": source.std,
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


def _curve_checks(machine: Machine, curve: Mapping[str, Any]) -> list[Check]:
    """Compares the machine's elements, more than data can resolve, with the identified curve."""
    distance = np.array(curve["distance_m"])
    off = np.max(np.abs(np.array(curve["climbed_N"]) - branch(machine.friction, distance)))
    name = "largest error of the friction curve, as a share of its climb"
    return [Check(name, float(off) / (2 * machine.friction.coulomb_force), "1", 0.02, "the simulated table's elements")]
