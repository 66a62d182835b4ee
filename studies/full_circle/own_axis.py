"""The circle on an axis of one's own: from a folder of records the machine, a design, and what to run next.

Each step is kept with the hash of what it was made from (steps.py), so that a record that is added costs only the steps
that it changes.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.deadbeat import DesignError
from design.judging.known_range import with_covered
from design.redesign.choice import UNITS, worse
from design.redesign.outcome import Outcome, judged_target, outcome
from design.redesign.stated import machines_as_stated
from diagnosis.experiments.schedules import suite, to_csv
from diagnosis.handover.posterior import machines_allowed
from models.identification.pipeline import identify
from models.machine import Machine, MachineError, from_table
from models.machine_file import to_toml
from models.quantity import show
from models.records.record import Record
from models.records.tables.sizes import RecordError
from studies.beforehand import require_designable
from studies.effort import DIAGNOSED, DIAGNOSING, foresee, seconds_a_sample
from studies.full_circle import asked, redesigning
from studies.full_circle.folder_of_records import Given, hashes, loaded
from studies.full_circle.options import CircleOptions
from studies.full_circle.steps import Steps, program
from studies.gap_diagnosis.compute import answered, given_of
from studies.gap_diagnosis.options import DiagnosisOptions
from studies.gap_diagnosis.records import disabled, loaded_of
from studies.identify_machine.shown import results_of
from studies.options import BadInputError
from studies.study import Answer, Check, Progress

RUNS: Final = 40  # machines that could be this one, on which each design is tried
FEW: Final = 10  # of them in a quick run
OPEN: Final = ("ambiguous", "none_of_these")  # outcomes of a diagnosis that ask for another experiment
FILES: Final = {"current": "run_current.csv", "redesign": "run_redesign.csv"}


@dataclass(frozen=True)
class Circle:
    """What all steps of one run know."""

    machine: Machine
    options: CircleOptions
    given: tuple[Given, ...]
    steps: Steps
    progress: Progress

    def of(self, *roles: str) -> tuple[Given, ...]:
        """The records with one of these roles."""
        return tuple(one for one in self.given if one.role in roles)

    def made_from(self, *roles: str) -> dict[str, Any]:
        """What a step that sees these records is made from."""
        shown = ("column", "mapping", "recipe", "trust_records", "disable", "seed", "quick")
        chosen = {name: getattr(self.options, name) for name in shown}
        if self.options.mapping is not None:
            chosen["mapping"] = self.options.mapping.read_text(encoding="utf-8")
        return {"machine": to_toml(self.machine), "records": hashes(self.given, *roles), "options": chosen}


def compute(machine: Machine, options: CircleOptions, progress: Progress) -> Answer:
    """The chain over the folder of --records. Raises BadInputError for what can't be used in it."""
    require_designable(machine)
    disabled(options.disable, machine)
    output = options.output or Path("reports/out/full_circle")
    steps = Steps(output / "steps", program())
    tables = asked.kept(output / "steps" / "asked")
    circle = Circle(machine, options, loaded(machine, options, tables, progress), steps, progress)
    identified, known = _identified(circle)
    found, better = _diagnosed(circle, identified)
    redesign = _redesigned(circle, better, found)
    verified = _verified(circle, redesign)
    files, runs = _next(circle, found, redesign, verified)
    if known is not None:
        files["identified.toml"] = known["machine"]
    results = {
        "mode": "records",
        "quick": options.quick,
        "records": [_shown(one) for one in circle.given],
        "identified": known and {name: known[name] for name in ("estimates", "said")},
        "diagnosis": found and {name: found[name] for name in ("answer", "verdict", "how_far", "probabilities")},
        "redesign": redesign and redesign["shown"],
        "pictures": redesign and _pictures(circle, redesign),
        "verified": verified,
        "next": runs,
    }
    return Answer(results, tuple(_checks(results)), files, _summary(results))


def _shown(one: Given) -> dict[str, Any]:
    content, table = one.loaded.content, one.table
    return {
        "name": one.path.name,
        "sha256": one.loaded.sha256,
        "kind": one.kind,
        "role": one.role,
        "table": None if table is None else table.key,
        "samples": content.position.size if isinstance(content, Record) else content.frequency.size,
        "sample_time_s": content.sample_time if isinstance(content, Record) else None,
        "findings": list(one.loaded.findings),
    }


def _identified(circle: Circle) -> tuple[Machine, dict[str, Any] | None]:
    """The machine with what identification records show, and that step; as it was given where there are none."""
    given, machine = circle.of("identify"), circle.machine
    if not given:
        return machine, None
    circle.progress(0.03, f"identifying from {len(given)} records")

    def work() -> dict[str, Any]:
        try:
            found = identify(machine, [one.loaded for one in given], kinds=[one.kind for one in given])
        except RecordError as error:
            raise BadInputError(f"{error}; or move it out of --records") from error
        motions = [one.loaded.content for one in given if isinstance(one.loaded.content, Record)]
        source = "full_circle of " + ", ".join(one.path.name for one in given)
        rows = results_of(found, None)["estimates"]
        return {
            "machine": to_toml(with_covered(found.machine, motions, source)),
            "estimates": rows,
            "said": list(found.remarks),
        }

    kept, again = circle.steps.done("identify", circle.made_from("identify"), work)
    _tell(circle, 0.1, "identify", again=again)
    return _machine(kept["machine"]), kept


def _diagnosed(circle: Circle, identified: Machine) -> tuple[dict[str, Any] | None, Machine]:
    """What the diagnosis found, and the improved machine; None and the identified one without records for it."""
    given = circle.of("diagnose")
    if not given:
        return None, identified
    paths = tuple(one.path for one in given)
    options = _as_diagnosis(circle.options, tuple(one.path for one in circle.given))
    used = {**circle.made_from("diagnose"), "machine": to_toml(identified)}

    def work() -> dict[str, Any]:
        records = loaded_of(identified, options, paths, circle.progress)
        samples = sum(one.loaded.content.position.size for one in given if isinstance(one.loaded.content, Record))
        taken = samples * DIAGNOSING * seconds_a_sample(identified)
        foresee({f"a diagnosis of {samples:.3g} samples": taken}, samples * DIAGNOSED, options, circle.progress)
        within = lambda share, text: circle.progress(0.1 + 0.6 * share, text)  # noqa: E731
        found, answer = answered(given_of(identified, records), (), options.disable, options, within)
        count = FEW if circle.options.quick else RUNS
        draws = [to_toml(one) for one in machines_allowed(found, count, circle.options.seed)]
        names = ("answer", "verdict", "how_far", "next")
        return {
            **{name: answer.results[name] for name in names},
            "probabilities": {row["effect"]: row["probability"] for row in answer.results["which"]},
            "improved": answer.files["improved.toml"],
            "next_experiment": answer.files.get("next_experiment.csv"),
            "could_be": draws,
        }

    kept, again = circle.steps.done("diagnose", used, work)
    _tell(circle, 0.7, "diagnose", again=again)
    return kept, _machine(kept["improved"])


def _as_diagnosis(options: CircleOptions, paths: tuple[Path, ...]) -> DiagnosisOptions:
    """The options of a diagnosis of all these records, which the columns are mapped for."""
    names = ("machine", "column", "mapping", "recipe", "trust_records", "disable", "seed", "quick", "time_limit")
    return DiagnosisOptions(record=paths, **{name: getattr(options, name) for name in names})


def _redesigned(circle: Circle, better: Machine, found: Mapping[str, Any] | None) -> dict[str, Any]:
    """The redesign: what of it is shown, its controller files, and its tables."""
    drawn = found["could_be"] if found else []
    used = {"before": to_toml(circle.machine), "better": to_toml(better), "could_be": drawn}
    used |= {"seed": circle.options.seed, "quick": circle.options.quick}

    def work() -> dict[str, Any]:
        could_be = _loadable(drawn) or machines_as_stated(better, FEW if circle.options.quick else RUNS)
        within = lambda share, text: circle.progress(0.7 + 0.15 * share, text)  # noqa: E731
        try:
            made = redesigning.redesigned(circle.machine, better, could_be, circle.options.seed, within)
        except DesignError as error:
            raise BadInputError(f"--machine: {error}") from error
        old, new = made.old, made.chosen.design
        same = new.controller.feedback == old.controller.feedback
        target, ts = judged_target(circle.machine), circle.machine.sample_time
        tables = {
            "current": redesigning.table(target, redesigning.references_of(circle.machine, old, own_loop=True), ts),
            "redesign": redesigning.table(target, redesigning.references_of(circle.machine, new, own_loop=same), ts),
        }
        expected = {
            name: redesigning.errors_over_time(redesigning.simulated_record(better, one, circle.options.seed), better)
            for name, one in (("current", old), ("redesign", new))
        }
        return {
            "shown": {**redesigning.to_json(made), "same_feedback": same},
            "controllers": {
                "current": redesigning.controller_file(circle.machine, old),
                "redesign": redesigning.controller_file(better, new),
            },
            "tables": tables,
            "expected": expected,
        }

    kept, again = circle.steps.done("redesign", used, work)
    _tell(circle, 0.85, "redesign", again=again)
    return dict(kept)


def _verified(circle: Circle, redesign: Mapping[str, Any]) -> dict[str, Any]:
    """What the records show of the design in place and of the redesign, and which of the two is to be kept.

    state: "kept" where there was no better one, "asked" where its record is missing, "holds" or "rolled back".
    """
    kept, machine = redesign["shown"]["kept"], circle.machine
    key = asked.asked("redesign", redesign["tables"]["redesign"]).key
    rows, before, after = [], None, None
    for one in circle.given:
        found = _outcome(one, machine)
        if found is None:
            continue
        now = one.table is not None and one.table.kind == "redesign"
        rows.append({"record": one.path.name, "design": _design(one, key), **_plain(found)})
        if not now and (before is None or one.role == "current"):
            before = found
        if now and one.table is not None and one.table.key == key:
            after = found
    lost = worse(before, after, machine) if before is not None and after is not None and not kept else ()
    state = "kept" if kept else "asked" if after is None or before is None else "rolled back" if lost else "holds"
    return {
        "rows": rows,
        "before": redesigning.outcome_to_json(before),
        "after": redesigning.outcome_to_json(None if kept else after),
        "worse": list(lost),
        "state": state,
        "inside": None if kept or after is None else _inside(after, redesign["shown"], machine),
    }


def _plain(found: Outcome) -> dict[str, Any]:
    return dict(redesigning.outcome_to_json(found) or {})


def _design(one: Given, key: str) -> str:
    """Which design made a record, for a reader."""
    if one.table is None or one.table.kind == "current":
        return "in place"
    return "the redesign" if one.table.key == key else "an earlier redesign"


def _outcome(one: Given, machine: Machine) -> Outcome | None:
    """What the motions over the specified stroke achieved in a record; None where it has none."""
    content = one.run if one.run is not None else one.loaded.content
    if not isinstance(content, Record) or (one.run is None and one.role != "diagnose"):
        return None
    return outcome(content, machine)


def _inside(after: Outcome, shown: Mapping[str, Any], machine: Machine) -> dict[str, bool]:
    """Whether the redesign achieved what was expected of it, to a sample."""
    (row,) = (row for row in shown["designs"] if row["taken"])
    slack = {"settling": machine.sample_time, "dispersion": 0.0}
    return {
        name: bool(row[name]["low"] - slack[name] <= getattr(after, name) <= row[name]["high"] + slack[name])
        for name in UNITS
    }


def _pictures(circle: Circle, redesign: Mapping[str, Any]) -> dict[str, Any]:
    """Errors of the judged motions: measured where there is a record, and as expected."""
    key = asked.asked("redesign", redesign["tables"]["redesign"]).key
    measured: dict[str, Any] = {"current": None, "redesign": None}
    for one in circle.given:
        content = one.run if one.run is not None else one.loaded.content
        if _outcome(one, circle.machine) is None or not isinstance(content, Record):
            continue
        now = one.table is not None and one.table.kind == "redesign"
        if not now and (measured["current"] is None or one.role == "current"):
            measured["current"] = redesigning.errors_over_time(content, circle.machine)
        if now and one.table is not None and one.table.key == key:
            measured["redesign"] = redesigning.errors_over_time(content, circle.machine)
    return {"measured": measured, "expected": redesign["expected"]}


def _next(
    circle: Circle,
    found: Mapping[str, Any] | None,
    redesign: Mapping[str, Any],
    verified: Mapping[str, Any],
) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The files to be written, and what to run next: each file with the reason and how long it takes [s]."""
    machine, runs = circle.machine, list[dict[str, Any]]()
    rolled = verified["state"] == "rolled back" or redesign["shown"]["kept"]
    files: dict[str, Any] = {"controller.json": redesign["controllers"]["current" if rolled else "redesign"]}
    if found is not None:
        files["improved.toml"] = found["improved"]
    if found is None:
        files["suite.csv"] = to_csv(suite(machine), machine.sample_time)
        runs.append(
            _run("suite.csv", files, machine, "no record is there to be diagnosed; this one excites nearly all")
        )
    elif found["next_experiment"] and found["verdict"]["outcome"] in OPEN:
        files["next_experiment.csv"] = found["next_experiment"]
        runs.append(_run("next_experiment.csv", files, machine, str(found["verdict"]["next_experiment"])))
    folder = circle.steps.folder / "asked"
    why = {
        "current": "what the design in place achieves is not in the records; the redesign is compared with it",
        "redesign": "the proof of the redesign"
        + ("" if redesign["shown"]["same_feedback"] else ", with the PID of controller.json in the drive")
        + "; where it is worse, the design in place comes back",
    }
    missing = {
        "current": verified["before"] is None,
        "redesign": verified["state"] == "asked" and verified["after"] is None,
    }
    for kind, name in FILES.items():
        if missing[kind]:
            files[name] = redesign["tables"][kind]
            asked.keep(folder, kind, redesign["tables"][kind])
            runs.append(_run(name, files, machine, why[kind]))
    return files, runs


def _run(name: str, files: Mapping[str, Any], machine: Machine, why: str) -> dict[str, Any]:
    """One entry of what to run next, with the way [m] and the largest force [N] that it takes."""
    rows = np.loadtxt(files[name].splitlines()[1:], delimiter=",", ndmin=2)
    return {
        "file": name,
        "why": why,
        "seconds": rows.shape[0] * machine.sample_time,
        "from_m": float(rows[:, 2].min()),
        "to_m": float(rows[:, 2].max()),
        "force_N": float(np.abs(rows[:, 3]).max()),
    }


def _machine(text: str) -> Machine:
    return from_table(tomllib.loads(text), Path("improved.toml"))


def _loadable(texts: Sequence[str]) -> list[Machine]:
    """The machines in these files; a draw that no file may hold is left out."""
    found = []
    for text in texts:
        try:
            found.append(_machine(text))
        except MachineError:
            continue
    return found


def _tell(circle: Circle, share: float, step: str, *, again: bool) -> None:
    circle.progress(share, f"{step}: {'nothing it is made from has changed, reused' if again else 'done'}")


def _checks(results: Mapping[str, Any]) -> list[Check]:
    """That the redesign, once it was run, is not worse than the design in place."""
    verified = results["verified"]
    if verified["state"] not in {"holds", "rolled back"}:
        return []
    name = "in how much the redesign is worse than the design in place, of settling and 3 sigma"
    return [Check(name, float(len(verified["worse"])), "1", 0.0, "the records of both")]


def _summary(results: Mapping[str, Any]) -> list[tuple[str, str]]:
    rows, shown = list[tuple[str, str]](), results["redesign"]
    counts = {role: sum(one["role"] == role for one in results["records"]) for role in ("identify", "diagnose")}
    rows.append(("records", f"{counts['identify']} to identify from, {counts['diagnose']} to diagnose"))
    if results["diagnosis"] is not None:
        rows += [(part, results["diagnosis"]["answer"][part]) for part in ("outcome", "which")]
    rows.append(("design to run", shown["chosen"]))
    for row in shown["designs"]:
        settles, spread = row["settling"], row["dispersion"]
        rows.append(
            (
                f"  expected of the {row['name']}",
                f"settles in {show(settles['low'], 's', 3)} to {show(settles['high'], 's', 3)}, 3 sigma "
                f"{show(spread['low'], 'm', 2)} to {show(spread['high'], 'm', 2)}",
            )
        )
    for row in results["verified"]["rows"]:
        told = f"settles in {show(row['settling_s'], 's', 3)}, 3 sigma {show(row['dispersion_m'], 'm', 2)}"
        rows.append((f"  measured in {row['record']} ({row['design']})", told))
    rows.append(("verification", results["verified"]["state"]))
    rows += [("not met", text) for text in shown["unmet"]]
    rows += [("run next", f"{one['file']} ({show(one['seconds'], 's', 3)}): {one['why']}") for one in results["next"]]
    return rows if results["next"] else [*rows, ("run next", "nothing: the circle is closed")]
