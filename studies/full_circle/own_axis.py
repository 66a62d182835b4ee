"""The circle on an axis of one's own: from a folder of records the machine, a design, and what to run next.

Each step is kept with the hash of what it was made from (steps.py), so that a record that is added costs only the steps
that it changes.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.deadbeat import DesignError
from design.judging.known_range import with_covered
from design.redesign.outcome import judged_target
from design.redesign.stated import machines_as_stated
from design.redesign.unmet import NARROWED
from diagnosis.experiments.schedules import SUITE_SAMPLES, suite, to_csv
from diagnosis.handover.posterior import machines_allowed, unexplained_force
from models.identification.pipeline import identify
from models.machine import Machine, MachineError, from_table
from models.machine_file import to_toml
from models.quantity import keeps_to, show, span
from models.records.record import Record
from models.records.tables.sizes import RecordError
from studies.beforehand import require_designable
from studies.effort import LOG_LENGTH_RATIO, diagnosing, foresee, more_samples
from studies.full_circle import asked, looked, redesigning, verification
from studies.full_circle.folder_of_records import Given, hashes, loaded
from studies.full_circle.options import CircleOptions
from studies.full_circle.steps import Steps, program
from studies.full_circle.verification import Tried, slowest, tried
from studies.gap_diagnosis.compute import answered, given_of
from studies.gap_diagnosis.options import DiagnosisOptions
from studies.gap_diagnosis.records import disabled, loaded_of
from studies.identify_machine.shown import results_of, warnings_of
from studies.options import BadInputError
from studies.sticking import found_in
from studies.sticking import rows as sticking_rows
from studies.study import Answer, Progress

RUNS: Final = 40  # machines that could be this one, on which each design is tried
QUICK_RUNS: Final = 10  # of them in a quick run
TOLD_OF_DIAGNOSIS: Final = ("answer", "front", "verdict", "how_far")  # of a diagnosis
OPEN: Final = ("ambiguous", "none_of_these")  # outcomes of a diagnosis that ask for another experiment
STILL_OPEN: Final = "the experiment that was asked for left open what is wrong; this one excites nearly all"
SAME_MODEL: Final = "the other designs are judged with the same model"
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
    judged = tried(machine, circle.given, redesign["tables"])
    verified = verification.verified(machine, judged, redesign["shown"])
    if verified["state"] == "rolled back":
        redesign |= {"shown": redesigning.restored(redesign["shown"])}
    files, runs = _next(circle, found, redesign, verified)
    if known is not None:
        files["identified.toml"] = known["machine"]
    results = {
        "mode": "records",
        "quick": options.quick,
        "records": [_shown(one) for one in circle.given],
        "identified": known and {name: known[name] for name in ("estimates", "warnings", "said")},
        "diagnosis": found and {name: found[name] for name in (*TOLD_OF_DIAGNOSIS, "probabilities")},
        "redesign": redesign["shown"],
        "pictures": _pictures(circle, redesign, judged),
        "verified": verified,
        "next": runs,
        **found_in(better),
    }
    checks = verification.checks(verified, machine.specification.settling_time)
    return Answer(results, tuple(checks), files, _summary(results))


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
        rows = results_of(found)["estimates"]
        return {
            "machine": to_toml(with_covered(found.machine, motions, source)),
            "estimates": rows,
            "warnings": [list(one) for one in warnings_of(found)],
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
    by_hash = {one.loaded.sha256: one.path for one in given}
    hashes, counts = looked.order(circle.steps.folder, tuple(by_hash))
    paths = tuple(by_hash[one] for one in hashes)
    options = replace(_as_diagnosis(circle.options, tuple(one.path for one in circle.given)), looked=counts)
    used = {**circle.made_from("diagnose"), "machine": to_toml(identified), "looked": [hashes[:n] for n in counts]}

    def work() -> dict[str, Any]:
        records = loaded_of(identified, options, paths, circle.progress)
        sizes = [one.content.position.size for one in records if isinstance(one.content, Record)]
        samples = sum(sizes)
        taken, memory = diagnosing(identified, samples, len(given))
        taken += diagnosing(identified, sum(sum(sizes[:count]) for count in counts), 1)[0]
        work_ahead = {f"a diagnosis of {samples:,} samples": taken}
        foresee(work_ahead, memory, options, circle.progress, math.inf)  # their reader bounds the samples
        within = lambda share, text: circle.progress(0.1 + 0.6 * share, text)  # noqa: E731
        found, answer = answered(given_of(identified, records), (), options.disable, options, within)
        count = QUICK_RUNS if circle.options.quick else RUNS
        draws = [to_toml(one) for one in machines_allowed(found, count, circle.options.seed)]
        return {
            **{name: answer.results[name] for name in (*TOLD_OF_DIAGNOSIS, "next")},
            "probabilities": {row["effect"]: row["probability"] for row in answer.results["which"]},
            "improved": answer.files["improved.toml"],
            "next_experiment": answer.files.get("next_experiment.csv"),
            "could_be": draws,
            "left_N": [one.tolist() for one in unexplained_force(found)],
        }

    kept, again = circle.steps.done("diagnose", used, work)
    looked.keep(circle.steps.folder, hashes)
    _tell(circle, 0.7, "diagnose", again=again)
    return kept, _machine(kept["improved"])


def _as_diagnosis(options: CircleOptions, paths: tuple[Path, ...]) -> DiagnosisOptions:
    """The options of a diagnosis of all these records, which the columns are mapped for."""
    reading = ("machine", "column", "mapping", "recipe", "trust_records", "most_samples")
    names = (*reading, "disable", "seed", "quick", "time_limit")
    return DiagnosisOptions(record=paths, **{name: getattr(options, name) for name in names})


def _redesigned(circle: Circle, better: Machine, found: Mapping[str, Any] | None) -> dict[str, Any]:
    """The redesign: what of it is shown, its controller files, and its tables."""
    drawn, left = (found["could_be"], found["left_N"]) if found else ([], [])
    used = {"before": to_toml(circle.machine), "better": to_toml(better), "could_be": drawn, "left_N": left}
    used |= {"seed": circle.options.seed, "quick": circle.options.quick}

    def work() -> dict[str, Any]:
        could_be = _loadable(drawn) or machines_as_stated(
            better, QUICK_RUNS if circle.options.quick else RUNS, circle.options.seed
        )
        within = lambda share, text: circle.progress(0.7 + 0.15 * share, text)  # noqa: E731
        try:
            forces = [np.array(one) for one in left]
            made = redesigning.redesigned(circle.machine, better, could_be, circle.options.seed, within, left=forces)
        except DesignError as error:
            raise BadInputError(f"--machine: {error}") from error
        old, new = made.old, made.chosen.design
        same = new.controller.feedback == old.controller.feedback
        target, ts = judged_target(circle.machine), circle.machine.sample_time
        tables = {
            "current": redesigning.current_table(circle.machine),
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


def _pictures(circle: Circle, redesign: Mapping[str, Any], found: Sequence[Tried]) -> dict[str, Any]:
    """Errors of the judged motions: measured where there is a record, in the one with the slowest motion, and as
    expected."""
    runs = {design: slowest(found, design) for design in FILES}
    measured = {design: one and redesigning.errors_over_time(one.run, circle.machine) for design, one in runs.items()}
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
    experiment = _experiment(circle, found, redesign["shown"], verified)
    folder = circle.steps.folder / "asked"
    if experiment is not None:
        name, files[name], why = experiment
        asked.keep(folder, Path(name).stem, files[name])
        runs.append(_run(name, files, machine, with_remark(why, _more_samples(circle, files[name]))))
    why_run = {
        "current": "what the design in place achieves is not in the records; the redesign is compared with it",
        "redesign": "the proof of the redesign"
        + ("" if redesign["shown"]["same_feedback"] else ", with the PID of controller.json in the drive")
        + "; if it turns out worse, the design in place is restored",
    }
    missing = {
        "current": verified["before"] is None and not verified["met"],
        "redesign": verified["state"] == "asked",
    }
    for kind, name in FILES.items():
        if missing[kind]:
            files[name] = redesign["tables"][kind]
            asked.keep(folder, kind, redesign["tables"][kind])
            runs.append(_run(name, files, machine, why_run[kind]))
    return files, runs


def _experiment(
    circle: Circle, found: Mapping[str, Any] | None, shown: Mapping[str, Any], verified: Mapping[str, Any]
) -> tuple[str, str, str] | None:
    """The experiment to run next: its file, its table and the reason; None where none is needed or known."""
    if found is None:
        return "suite.csv", _suite(circle), "no record is there to be diagnosed; this one excites nearly all"
    unsure = found["verdict"]["outcome"] in OPEN or found["verdict"].get("unconfirmed")
    is_open = bool(found["next_experiment"] and unsure)
    asked_for = found["next_experiment"] and not _was_run(circle, found["next_experiment"])
    if is_open and asked_for:
        return "next_experiment.csv", found["next_experiment"], str(found["verdict"]["next_experiment"])
    why = STILL_OPEN if is_open else _why_further(shown, verified)
    if not why:
        return None
    if asked_for:
        return "next_experiment.csv", found["next_experiment"], why
    usual = to_csv(suite(circle.machine, SUITE_SAMPLES), circle.machine.sample_time)
    had = any(one.table is not None and one.table.kind == "suite" for one in circle.given)
    return None if had or _was_run(circle, usual) else ("suite.csv", _suite(circle), why)


def _suite(circle: Circle) -> str:
    """The table of the suite, as long as the samples of the records beside it allow, but half of the usual ones."""
    room = int((circle.options.most_samples - _held(circle)) / LOG_LENGTH_RATIO)
    most = min(max(room, SUITE_SAMPLES // 2), SUITE_SAMPLES)
    return to_csv(suite(circle.machine, most), circle.machine.sample_time)


def _held(circle: Circle) -> int:
    """How many samples the records have together that are diagnosed."""
    records = [one.loaded.content for one in circle.of("diagnose")]
    return sum(one.position.size for one in records if isinstance(one, Record))


def _why_further(shown: Mapping[str, Any], verified: Mapping[str, Any]) -> str:
    """Why a further record would bring the design nearer to the specification; empty where it would not."""
    if verified["met"]:
        return ""
    if any(NARROWED in text for text in shown["unmet"]):
        return "the design is not sure to meet the specification; this record narrows the parameters that decide it"
    (taken,) = (row for row in shown["designs"] if row["taken"])
    stays = shown["designs"][0] if verified["state"] == "rolled back" else taken
    if verified["met"] is False and keeps_to(stays["settling"]["high"], shown["specified"]["settling_s"]):
        return "the specification is missed, though the model expects it to be met; this record tells what it lacks"
    return ""


def _was_run(circle: Circle, text: str) -> bool:
    """Whether a record of this table is in the folder."""
    table = (asked.asked("suite", text),)
    records = [one.loaded.content for one in circle.of("diagnose")]
    return any(isinstance(one, Record) and asked.ran(one, table) is not None for one in records)


def _more_samples(circle: Circle, text: str) -> str:
    """What to give along with the record of a table, where it makes them more samples than a diagnosis takes."""
    records, most = len(circle.of("diagnose")), circle.options.most_samples
    needs = more_samples(circle.machine, text.count("\n") - 1, _held(circle), records, most)
    return f"with its record, {needs}" if needs else ""


def with_remark(why: str, remark: str) -> str:
    """A reason, which may be a sentence, and a remark on it, which may be empty."""
    return f"{why.removesuffix('.')}; {remark}" if remark else why


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


def _summary(results: Mapping[str, Any]) -> list[tuple[str, str]]:
    rows, shown, verified = list[tuple[str, str]](), results["redesign"], results["verified"]
    counts = {role: sum(one["role"] == role for one in results["records"]) for role in ("identify", "diagnose")}
    rows.append(("records", f"{counts['identify']} to identify from, {counts['diagnose']} to diagnose"))
    if results["identified"] is not None:
        rows += [(f"WARNING, {name}", said) for name, said in results["identified"]["warnings"]]
    if results["diagnosis"] is not None:
        rows += [(part, results["diagnosis"]["answer"][part]) for part in ("outcome", "which")]
    rows.append(("design to run", shown["chosen"]))
    for row in shown["designs"]:
        settling, spread = row["settling"], row["dispersion"]
        told = verification.expected_to_settle(settling["low"], settling["high"], verified["interval_s"])
        told = f"{told}, 3 sigma {span(*(show(spread[end], 'm', 2) for end in ('low', 'high')))}"
        rows.append((f"  expected of the {row['name']}", told))
    if shown["left"] is not None:
        rows.append(("  with a force in these runs", left_told(shown["left"])))
    for row in verified["rows"]:
        told = f"{verification.settles(row)}, 3 sigma {show(row['dispersion_m'], 'm', 2)}"
        rows.append((f"  measured in {row['record']} ({row['design']})", told))
    if verified["contradicts"]:
        rows.append(("WARNING, the design in place", "; ".join([*verified["contradicts"], SAME_MODEL])))
    rows += sticking_rows(results)
    rows.append(("verification", verification.sentence(verified, shown["specified"]["settling_s"])))
    expected = "expected before that record" if verified["met"] else "not met"
    rows += [("note on the design" if text in shown["notes"] else expected, text) for text in shown["unmet"]]
    rows += [("run next", f"{one['file']} ({show(one['seconds'], 's', 3)}): {one['why']}") for one in results["next"]]
    if not results["next"]:
        rows.append(("run next", f"nothing: {verification.closing(verified, shown['unmet'])}"))
    return rows


def left_told(left: Mapping[str, Any]) -> str:
    """How large the force is that no model explains, and what it does, in words."""
    return (
        f"{show(left['force_N'], 'N', 2)} (rms) that no model explains, as it was in the records that were diagnosed; "
        f"it alone moves the axis by {show(left['moves_m'], 'm', 2)} (rms) under the design in place"
    )
