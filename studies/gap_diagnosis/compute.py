"""The diagnosis of records: verdict, where, which, how far; what they cannot distinguish; the improved machine; the
next experiment."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.judging.known_range import with_covered
from diagnosis.baseline import driving_record, refit_and_null
from diagnosis.diagnose import Diagnosis
from diagnosis.diagnose import to_json as verdict_of
from diagnosis.evidence import Evidence, examined
from diagnosis.experiments.active import Settings
from diagnosis.experiments.schedules import SUITE_SAMPLES, suite, to_csv
from diagnosis.handover.gate import leaves_more
from diagnosis.handover.overrun import OVERRUN, as_reported, overrun
from diagnosis.handover.transfer import on_record
from diagnosis.improved import improved_machine, unchanged, without_effects
from diagnosis.model.roughness import variance_by_record
from diagnosis.records.at_rest import swing_at_rest
from diagnosis.records.motions import PIECE_LOOP_TIMES, Piece
from diagnosis.records.units import loop_time
from diagnosis.refit import whiteness
from diagnosis.where.controller import replayed
from diagnosis.where.serialise import pictures
from models.effects.base import parameters
from models.effects.catalogue import every
from models.machine import Machine
from models.machine_file import to_toml
from models.records.checks import AT_LIMIT, kept_to
from models.records.files import Loaded
from models.records.record import Record
from models.records.tables.sizes import RecordError
from studies.beforehand import require_designable, require_stable
from studies.effort import MAX_MEMORY_BYTES, diagnosing, foresee, more_samples
from studies.gap_diagnosis import by_hand, moved_most, own_records
from studies.gap_diagnosis.answer import front, sentences
from studies.gap_diagnosis.common_factor import common_factor
from studies.gap_diagnosis.course import confirmed, copies, course
from studies.gap_diagnosis.options import DiagnosisOptions
from studies.gap_diagnosis.records import disabled, held_out, loaded
from studies.gap_diagnosis.settling import settling_told
from studies.gap_diagnosis.shifts import shifts
from studies.gap_diagnosis.stated_effects import stated_effects
from studies.options import BadInputError
from studies.sticking import found_in
from studies.sticking import rows as sticking_rows
from studies.study import Answer, Check, Progress

CACHE: Final = Path("reports/out/.null")  # keeps the thresholds of a machine and a schedule from run to run
OF_NO_AXIS: Final = (
    "Gaps and their noise floor are told from simulations of that loop, so that they are not the axis's, and values "
    "may have moved to make up for it"
)
CLOSED: Final = 0.9  # share of the gap that the effect in simulated records has to close


@dataclass(frozen=True)
class Given:
    """What is diagnosed: the machine, the records with what the report says about each and, of simulated ones, the
    effect that is in them."""

    machine: Machine
    records: tuple[Record, ...]
    shown: tuple[Mapping[str, Any], ...]
    truth: Mapping[str, Any] | None


def compute(machine: Machine, options: DiagnosisOptions, progress: Progress) -> Answer:
    """Answers the study's question. Raises BadInputError for records or options that can't be used."""
    if options.draft_effect is not None:
        raise BadInputError("--draft-effect: is for the command line; call draft.draft from Python")
    if options.continue_ is not None:
        raise BadInputError("--continue: is for the command line; give all records from Python")
    if options.machine_process is not None:
        raise BadInputError("--machine-process: is for the command line; call diagnosis.experiments.active from Python")
    require_stable(machine)  # as thresholds are those of simulated tables, whose loop is closed by the machine's PID
    if not options.record:
        require_designable(machine)
        samples = round(own_records.duration(quick=options.quick) / machine.sample_time)
        _foresee(machine, samples, 1, options, progress)
    unused = disabled(options.disable, machine)
    given = _given(machine, options, progress)
    by_hand.require_growing(options.looked, len(given.records))
    apart, _ = held_out(machine, options, progress), course(options.looks)  # what can't be read is said before the work
    if options.record:
        counts = [record.position.size for record in given.records]
        before = sum(sum(counts[:count]) for count in options.looked)
        _foresee(machine, sum(counts), len(given.records), options, progress, before=before)

    return answered(given, apart, unused, options, progress)[1]


def answered(
    given: Given,
    apart: Sequence[Loaded],
    unused: Sequence[str],
    options: DiagnosisOptions,
    progress: Callable[[float, str], None],
) -> tuple[Diagnosis, Answer]:
    """The diagnosis of what is given, and the study's answer to it; apart: records that nothing is fitted to; unused:
    effects that are not considered."""

    def say(share: float, text: str) -> None:
        progress(0.05 + 0.8 * share, text)

    looks, settings = course(options.looks), Settings(seed=options.seed, disabled=tuple(unused), cache=CACHE)
    try:
        tell = partial(say, 0.0)
        before = by_hand.before(given.machine, given.records, options.looked, settings, looks, tell)
        begun = refit_and_null(given.machine, given.records, progress=say, cache=CACHE)
    except RecordError as error:
        raise BadInputError(_with_its_name(str(error), given.shown)) from error
    found, beside = examined(begun, seed=options.seed, disabled=unused, progress=say)
    verdict = {**verdict_of(found)["verdict"], **beside.to_json()["verdict"]}
    if before is not None:
        looks = by_hand.course_of(before, begun, verdict, given.shown)
    verdict = confirmed(verdict, looks)
    if verdict.get("confirmed") is False and not verdict["effects"]:
        found = without_effects(found)
    left = _elsewhere(found, apart)
    if left is not None and left["refused"] is not None:
        found = unchanged(found)
    source = "gap_diagnosis of " + ", ".join(str(one["name"]) for one in given.shown)
    better = improved_machine(found, source)
    if options.record and better != given.machine:
        better = with_covered(better, given.records, source)
    adopted = [effect.name for effect in better.effects]
    told: dict[str, Any] = {"verdict": verdict, "asked": looks, "stated_effects": stated_effects(given.machine, better)}
    told["adopted"], told["common_factor"] = adopted, common_factor(given.machine, better)
    told |= _sticking(given.machine, given.records)
    told["at_random"] = bool(found.how_far.handover.adopted.judged.candidate.random_forces)
    rated = given.machine.drive.rated_thrust
    taken = {one.name: one.at_rating(rated) for one in found.final.candidate.added_effects}
    told["at_rating"] = [{"effect": name, "part": part, "rated_N": rated} for name, part in taken.items() if part]
    results = _results(found, beside, given, left, options, told)
    handover = found.how_far.handover
    files = [handover.files[0]] + [handover.adopted] * (handover.adopted.name != handover.files[0].name)
    results["settling"] = settling_told(files, found.baseline.records, found.baseline.driving, options.seed)
    written: dict[str, Any] = {"improved.toml": to_toml(better)}
    if options.looks is not None:
        written |= copies(options.record, options.looks)
    if not options.record:
        written["suite.csv"] = to_csv(suite(given.machine, SUITE_SAMPLES), given.machine.sample_time)
    if beside.proposal is not None:
        written["next_experiment.csv"] = to_csv(beside.proposal.schedule, given.machine.sample_time)
    summary = [
        (part.replace("_", " "), text)
        for part, text in results["answer"].items()
        if part in {"where", "which", "how_far"}
    ]
    summary += sticking_rows(results)
    if asked := results["verdict"]["next_experiment"]:
        needs = results["next"]["needs"] if results["next"] else ""
        summary.append(("next", f"{asked} {needs[:1].upper()}{needs[1:]}." if needs else asked))
    return found, Answer(results, tuple(_checks(found, given)), written, summary)


def _sticking(machine: Machine, records: Sequence[Record]) -> dict[str, Any]:
    """What `found_in` says of a machine and these records, with what it means for a diagnosis behind the cause."""
    shown = found_in(machine, records=records)
    return {name: {**found, "cause": f"{found['cause']}. {OF_NO_AXIS}"} for name, found in shown.items()}


def _with_its_name(why: str, shown: Sequence[Mapping[str, Any]]) -> str:
    """A reason that begins with the number of a record, with its file's name instead."""
    number = re.match(r"record (\d+): ", why)
    return why if number is None else f"{shown[int(number[1]) - 1]['name']}: {why[number.end() :]}"


def _foresee(
    machine: Machine, samples: int, records: int, options: DiagnosisOptions, progress: Progress, *, before: int = 0
) -> None:
    """The time and the memory of a diagnosis of so many samples, and of looks at so many before it; of records given,
    their reader bounds them."""
    taken, held = diagnosing(machine, samples, records)
    taken += diagnosing(machine, before, 1)[0]
    most = math.inf if options.record else MAX_MEMORY_BYTES
    foresee({f"{samples:,} samples": taken / min(os.cpu_count() or 1, 2)}, held, options, progress, most)


def _given(machine: Machine, options: DiagnosisOptions, progress: Progress) -> Given:
    if options.record:
        progress(0.01, "reading " + ", ".join(path.name for path in options.record))
        found = loaded(machine, options, progress)
        return given_of(machine, found)
    progress(0.01, "simulating a table with an effect that its model lacks")
    made = own_records.made(machine, options.seed, quick=options.quick)
    names = ("simulated suite",) if len(made.records) == 1 else ("simulated sequence", "simulated suite")
    shown = tuple(
        _shown(name, f"none, seed {options.seed}", record, machine)
        for name, record in zip(names, made.records, strict=True)
    )
    size = {
        item.name: {"value": getattr(made.effect, item.name), "unit": item.unit, "role": item.role}
        for item in parameters(type(made.effect))
    }
    return Given(made.machine, made.records, shown, {"effect": made.effect.name, "parameters": size})


def given_of(machine: Machine, found: Sequence[Loaded]) -> Given:
    """What is diagnosed where records were read from files."""
    records = tuple(one.content for one in found if isinstance(one.content, Record))
    shown = tuple(_shown(one.name, one.sha256, one.content, machine, one.findings) for one in found)
    return Given(machine, records, shown, None)


def _shown(name: str, sha256: str, record: Any, machine: Machine, findings: Sequence[str] = ()) -> dict[str, Any]:
    rated, kept = machine.drive.rated_thrust, kept_to(record.command[:: record.every])
    return {
        "name": Path(name).name,
        "sha256": sha256,
        "samples": record.position.size,
        "sample_time_s": record.sample_time,
        "at_rating": float(np.mean(np.abs(record.command) >= AT_LIMIT * rated)),
        "kept_below_rating_N": kept if kept is not None and kept < AT_LIMIT * rated else None,
        "swings": str(swing_at_rest(record, machine) or ""),
        "findings": list(findings),
    }


def _elsewhere(found: Diagnosis, apart: Sequence[Loaded]) -> dict[str, Any] | None:
    """What each machine file leaves of the records that nothing was fitted to."""
    if not apart:
        return None
    records = [one.content for one in apart if isinstance(one.content, Record)]
    handover, machine = found.how_far.handover, found.baseline.machine
    driving = [
        driving_record(machine, record, replayed(machine, record, found.baseline.criteria)) for record in records
    ]
    gaps = {
        file.name: [on_record(file.machine, *pair) for pair in zip(records, driving, strict=True)]
        for file in handover.files
    }
    rows = {name: [gap.to_json() for gap in left] for name, left in gaps.items()}
    files = [{"file": name, **{key: [one[key] for one in left] for key in left[0]}} for name, left in rows.items()]
    worse = leaves_more(gaps[handover.adopted.name], gaps[handover.files[0].name])
    refused = handover.adopted.name if worse else None
    return {"records": [Path(one.name).name for one in apart], "files": files, "refused": refused}


def _friction_elements(found: Diagnosis) -> dict[str, int] | None:
    """How many elements the file has, and with how many its friction was fitted; None where these are the same."""
    given, used = (len(one.friction.limit) for one in (found.baseline.delivered, found.baseline.machine))
    return {"file": given, "fitted": used} if used > given else None


def _results(
    found: Diagnosis,
    beside: Evidence,
    given: Given,
    elsewhere: Mapping[str, Any] | None,
    options: DiagnosisOptions,
    told: Mapping[str, Any],
) -> dict[str, Any]:
    """The agreed keys, and what the report needs besides; told: the verdict, and the looks that it was asked for."""
    more, plain = beside.to_json(), verdict_of(found)
    plain["how_far"]["hold_out"] = elsewhere
    results = {
        **plain,
        **told,
        "where": more["where"],
        "confusability": more["confusability"],
        "quick": options.quick,
        "truth": given.truth,
        "records": _with_motions(given.shown, found.baseline.pieces),
        "motion_part_s": PIECE_LOOP_TIMES * loop_time(found.baseline.machine),
        "shifts": shifts(found),
        "moved_most": moved_most.rows(found, plain["how_far"]),
        "friction_elements": _friction_elements(found),
        "criteria": [
            {"name": name, "value": value, "unit": unit, "meaning": meaning, "chosen": chosen}
            for name, value, unit, meaning, chosen in found.baseline.criteria.listed()
        ],
        "white_force_N": _white_force(found),
        "chi_square_per_sample": {
            "re_fitted": variance_by_record(found.baseline.nominal).tolist(),
            "with_effects": variance_by_record(found.final).tolist(),
        },
        "overrun": [
            asdict(as_reported(one, given.machine)) for one in overrun(given.machine, improved_machine(found), OVERRUN)
        ],
        "not_looked_for": _not_looked_for(given.machine),
        "catalogue": {name: _entry(name) for name in given.machine.kinds},
        "pictures": pictures(
            beside.where, found.baseline.nominal.candidate, found.baseline.records, found.baseline.pieces
        ),
        "next": _next(beside, given.machine, [record.position.size for record in given.records], options.most_samples),
    }
    return {**results, "answer": sentences(results), "front": front(results)}


def _with_motions(shown: Sequence[Mapping[str, Any]], pieces: Sequence[Piece]) -> list[dict[str, Any]]:
    counts = [sum(piece.record == i and not piece.kind.rests for piece in pieces) for i in range(len(shown))]
    return [{**one, "motions": count} for one, count in zip(shown, counts, strict=True)]


def _entry(name: str) -> dict[str, Any]:
    kind = every()[name]
    doc = (kind.__doc__ or "").strip().splitlines()[0]
    return {"family": kind.family, "equation": kind.equation, "meaning": doc, "shown_in": kind.shown_in()}


def _not_looked_for(machine: Machine) -> list[str]:
    """The effects that this machine may have, and that were not tried since its file states none of their sizes."""
    may = (
        not kind.beside and (not kind.common_on or machine.axis in kind.common_on) and kind.placed(machine.plant) != ()
        for kind in every().values()
    )
    return [name for name, yes in zip(every(), may, strict=True) if yes and name not in machine.kinds]


def _white_force(found: Diagnosis) -> dict[str, Any]:
    """Of a drive as smooth as its model, of the roughest record, and of each [N]; the values that the re-fit would
    move under the first of them where nothing is wrong, by how many of their tolerances [1]; of how many samples each
    record's log has one; whether what is left under them may be noise; and where nothing is named, the white force of
    each record [N] that leaves no more than that.
    """
    candidate, baseline = found.final.candidate, found.baseline
    usual = candidate.usual_white_force
    by_record = [usual * candidate.roughness_of(i) for i in range(len(baseline.records))]
    biased = [{"name": name, "tolerances": size} for name, size in baseline.biased.items()]
    even = whiteness(found.final, baseline.records)
    return {
        "usual": usual,
        "taken": candidate.white_force,
        "by_record": by_record,
        "interpolated": baseline.interpolated,
        "log_has_one_of": [record.every for record in baseline.records],
        "biased": biased,
        "may_be_noise": bool(np.all(even >= baseline.criteria.whiteness_of_a_drive)),
        "alone": None if found.noise is None else found.noise.tolist(),
    }


def _next(beside: Evidence, machine: Machine, samples: Sequence[int], most: int) -> dict[str, Any] | None:
    """The proposed references, thinned for a figure, and what their record needs beside those of so many samples."""
    if beside.proposal is None:
        return None
    given = beside.proposal.schedule.given
    step = max(given.position.size // 2000, 1)
    needs = more_samples(machine, given.position.size, sum(samples), len(samples), most)
    return {
        "name": beside.proposal.schedule.name,
        "duration_s": given.position.size * machine.sample_time,
        "needs": f"with its record, {needs}" if needs else "",
        "time_s": [machine.sample_time * i for i in range(0, given.position.size, step)],
        "reference_m": given.position[::step].tolist(),
        "feedforward_N": (given.feedforward + given.compensation)[::step].tolist(),
    }


def _checks(found: Diagnosis, given: Given) -> list[Check]:
    """For simulated records: that the effect in them is named and closes the gap. For others the truth is unknown."""
    if given.truth is None:
        return []
    name = given.truth["effect"]
    place = found.effects.index(name) + 1 if name in found.effects else len(given.machine.kinds)
    title = name.replace("_", " ")
    return [
        Check(f"place of {title} among the effects named", float(place), "1", 1.0, "the simulated table has it"),
        Check(f"share of the gap that {title} closes", found.how_far.closure, "1", CLOSED, "on held-out motions", ">="),
    ]
