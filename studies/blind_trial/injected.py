"""--inject: known laws are put into measured records, which are answered in isolation and scored.

The records, their nominal references and the uninjected records' own pack are closed to what answers. The answer to an
uninjected record is made after the answers to the injected ones are committed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from joblib import cpu_count

from models.effects.base import parameters
from models.identification.recognise import read
from models.machine import Machine
from models.machine_file import to_toml
from models.records.checks import check_sample_time, derivative_of_error, quantisation
from models.records.record import Record
from models.records.tables.sizes import RecordError
from studies.beforehand import require_stable
from studies.blind_trial.answering import Conditions, answer_all, read_answers, require_answers
from studies.blind_trial.cluster import cluster_of
from studies.blind_trial.committing import commit, require_committed
from studies.blind_trial.guard import leaks, shared_code
from studies.blind_trial.injected_scoring import Verdict, closure_of, rates, score
from studies.blind_trial.injection.distance import beside_speed, noise_of
from studies.blind_trial.injection.inverse import (
    FEEDFORWARD_ROUTE,
    REFERENCE_ROUTE,
    Channel,
    NoInverseError,
    channel,
    inject,
)
from studies.blind_trial.injection.motion import Course, course
from studies.blind_trial.injection.planning import (
    Drawn,
    Known,
    Plan,
    commitments,
    draw,
    plans,
    ranges_of,
    secrets,
    size_of_design,
)
from studies.blind_trial.injection.writing import write_pack
from studies.blind_trial.options import TrialOptions
from studies.blind_trial.packs import bodies_of, read_key, read_pack
from studies.blind_trial.scoring import OUTCOMES, KeyFileError
from studies.effort import DIAGNOSED, DIAGNOSING, foresee, seconds_a_sample
from studies.folder import write_at_once
from studies.options import BadInputError
from studies.record_columns import mapped
from studies.study import Answer, Check, Progress

ROOT: Final = Path(__file__).parents[2]
INJECTION_FOLDER: Final = Path(__file__).with_name("injection")
NOT_SHARED: Final = ("models/effects", "diagnosis")
QUICK_CASES: Final = 2
SEALING: Final = 0.05  # share of the time for what is written before the answers
ANSWERED: Final = 0.95  # share of the time after which the uninjected records are left
SOURCE: Final = "what the injection is to reach"


@dataclass(frozen=True)
class Given:
    """A measured record as it ran; what its PID's derivative was taken of; the way from its reference to the command
    (None: there is no stable inverse, so a force goes through the feedforward)."""

    path: Path
    record: Record
    derivative: str
    way: Channel | None

    @property
    def route(self) -> str:
        """The signal that a force goes through."""
        return FEEDFORWARD_ROUTE if self.way is None else REFERENCE_ROUTE


def compute_injected(
    machine: Machine, options: TrialOptions, progress: Progress, diagnosis: str, cache: Path
) -> Answer:
    """Injects, has the records answered, scores the answers. Raises BadInputError."""
    _require_alone(options)
    require_stable(machine)
    output = options.output or Path("reports/out/blind_trial")
    file, sealed = output / "answers.json", output / "sealed" / "injected"
    committed, key = sealed / "answers_committed.json", sealed / "key.json"
    uninjected_file = sealed / "answers_uninjected.json"
    require_answers(file, overwrite=options.overwrite)
    for one in (file, uninjected_file):
        require_committed(committed, read_answers(one), one)
    given = [_given(machine, options, path) for path in options.inject]
    known = known_of(machine, given)
    whole = size_of_design(known)
    cases = min(options.cases or (QUICK_CASES if options.quick else whole), whole)
    _foresee(machine, given, cases, options, progress)
    chosen = plans(known, options.seed, cases)
    secret = _seal(machine, given, known, chosen, options.seed, sealed, progress)
    pack = read_pack(sealed / "pack")
    conditions = Conditions(
        options.seed,
        (*(one.path for one in given), sealed / "uninjected", uninjected_file, key, INJECTION_FOLDER),
        diagnosis,
        evidence=False,
        cache=cache,
    )
    cluster = cluster_of(options)
    key.unlink(missing_ok=True)
    answers = answer_all(
        pack, file, conditions, lambda share, text: progress(SEALING + (ANSWERED - SEALING) * share, text), cluster
    )
    commit(committed, answers)
    write_pack(sealed / "uninjected", to_toml(machine), _uninjected(machine, given), {}, _mark(machine, given))
    before = answer_all(
        read_pack(sealed / "uninjected"),
        uninjected_file,
        replace(conditions, forbidden=()),
        lambda share, text: progress(ANSWERED + (0.98 - ANSWERED) * share, f"uninjected, {text}"),
        cluster,
    )
    commit(committed, before)
    write_at_once(key, json.dumps(secret, indent=1) + "\n")
    try:
        bodies = {case: json.loads(body) for case, body in bodies_of(read_key(key), pack).items()}
    except KeyFileError as error:
        raise BadInputError(f"--output {output}: {error}; delete {sealed} to inject again") from error
    names = [f"case-{i + 1}" for i in range(len(given))]
    scores = [score(case, body, answers[case], before[names[body["record"]]]) for case, body in bodies.items()]
    results = _results(options, given, known, whole, bodies, answers, [before[name] for name in names], scores)
    results["guards"] = {
        "commitments": len(bodies),
        "leaks": [
            leak
            for case in pack.cases
            for leak in leaks(case.records[0].parent, sorted({body["name"][0] for body in bodies.values()}))
        ],
        "shared_code": shared_code(
            INJECTION_FOLDER, [ROOT / one for one in NOT_SHARED], ("models.effects", "diagnosis")
        ),
        "refused": sorted(case for case, one in answers.items() if one.get("refused")),
    }
    return Answer(results, tuple(_checks(results)), {"answers.json": answers}, tuple(_summary(results)))


def _require_alone(options: TrialOptions) -> None:
    """Raises BadInputError for options of another kind of trial."""
    for name in ("pack", "key", "controller"):
        if getattr(options, name) is not None:
            raise BadInputError(f"--{name}: is not for --inject, which seals cases of its own; leave one of them out")


def _given(machine: Machine, options: TrialOptions, path: Path) -> Given:
    """A record into which a force can be put. Raises BadInputError."""
    columns = mapped(machine, options, options.inject).columns(path)
    try:
        one = read(machine, path, columns, trusted=options.trust_records)
        if not isinstance(one.content, Record):
            raise RecordError("is a frequency response; give records over time")
        check_sample_time(one.content, machine.sample_time)
    except RecordError as error:
        said = str(error)
        raise BadInputError(said if said.startswith(str(path)) else f"{path}: {said}") from error
    record = one.content
    if not {"reference", "target"} & set(one.given):
        raise BadInputError(
            f"--inject {path}: has no reference, so what the controller would have been given is unknown; "
            'map it, as in --column "reference=NAME [mm]"'
        )
    if np.ptp(record.reference) == 0:
        raise BadInputError(f"--inject {path}: its reference stands still; give a record of motions")
    law = machine.control.law
    top = float(np.max(np.abs(record.command)))
    if top >= machine.drive.rated_thrust * (1 - 1e-9):
        raise BadInputError(
            f"--inject {path}: its command of {top:.4g} N is at the rating, {machine.drive.rated_thrust:.4g} N, where "
            "a feedback is not linear; give a record that stays below, or correct drive.rated_thrust"
        )
    try:
        way = channel(machine, columns.derivative if law is None else "error")
    except NoInverseError as error:
        if "feedforward" not in one.given:
            raise BadInputError(
                f"--inject {path}: {error}, so that no reference makes a given force, and the record has no "
                'feedforward to put it into; map it, as in --column "feedforward=NAME [N]"'
            ) from error
        way = None
    return Given(path, replace(record, target=record.reference), columns.derivative if law is None else "error", way)


def known_of(machine: Machine, given: Sequence[Given]) -> Known:
    """The records' motions and roughness, and what the machine file says of sizes."""
    paths = tuple(_course(machine, one.record) for one in given)
    rows = [
        (name, item.name, item.typical if item.low <= 0 else item.low, item.high)
        for name, kind in machine.kinds.items()
        for item in parameters(kind, machine.priors)
    ]
    friction, tolerance = machine.friction, machine.tolerance
    level = float(np.dot(friction.stiffness, friction.limit))
    noises = tuple(noise_of(path, one.record.sample_time) for path, one in zip(paths, given, strict=True))
    return Known(
        paths,
        noises,
        tuple(map(beside_speed, paths, noises)),
        ranges_of(rows),
        tuple(machine.kinds),
        tuple(effect.name for effect in machine.effects),
        {"payload_mass": tolerance.mass * machine.plant.mass, "friction_level": tolerance.friction_level * level},
        machine.drive.rated_thrust,
    )


def _course(machine: Machine, record: Record) -> Course:
    grain = max(quantisation(record.position), machine.scale.resolution, machine.scale.noise)
    return course(
        record.position,
        record.command,
        record.sample_time,
        grain=grain,
        longest_limit=max(machine.friction.limit, default=0.0),
        ahead=machine.plant.dead_time + record.sample_time / 2,
    )


def injected(machine: Machine, given: Given, force: Any) -> Record:
    """The record with a force (n,) [N] against the axis, as the diagnosis reads it."""
    delay = machine.control.reference_delay
    made = inject(given.record, force, given.way, delay)
    return derivative_of_error(made, machine.control.pid, delay) if given.derivative == "position" else made


def _uninjected(machine: Machine, given: Sequence[Given]) -> Iterator[tuple[str, Record]]:
    for i, one in enumerate(given):
        yield f"case-{i + 1}", injected(machine, one, np.zeros(one.record.position.size))


def _mark(machine: Machine, given: Sequence[Given], *more: object) -> str:
    """A hash of what a pack is made from."""
    digest = hashlib.sha256(to_toml(machine).encode())
    for one in given:
        digest.update(one.path.read_bytes())
    for file in sorted(INJECTION_FOLDER.glob("*.py")):
        digest.update(file.read_bytes())
    digest.update(repr(more).encode())
    return digest.hexdigest()


def _seal(
    machine: Machine,
    given: Sequence[Given],
    known: Known,
    chosen: Sequence[Plan],
    seed: int,
    sealed: Path,
    progress: Progress,
) -> Mapping[str, Mapping[str, str]]:
    """Writes the pack of the injected records; the labels, which are in no file. Every case is drawn again from the
    seed where a run goes on."""
    progress(0.0, f"injecting into {len(given)} record{'s' if len(given) > 1 else ''}, {len(chosen)} cases")
    drawn: dict[str, Drawn] = {plan.case: draw(plan, known) for plan in chosen}
    secret = secrets({case: one.body for case, one in drawn.items()}, seed)

    def made() -> Iterator[tuple[str, Record]]:
        for i, plan in enumerate(chosen):
            yield plan.case, injected(machine, given[plan.record], drawn[plan.case].force)
            progress(SEALING * (i + 1) / len(chosen), f"injected {plan.case}")

    mark = _mark(machine, given, seed, len(chosen))
    write_pack(sealed / "pack", to_toml(machine), made(), commitments(secret), mark)
    return secret


def _foresee(machine: Machine, given: Sequence[Given], cases: int, options: TrialOptions, progress: Progress) -> None:
    longest = max(one.record.position.size for one in given)
    taken = (cases + len(given)) * longest * DIAGNOSING * seconds_a_sample(machine) / cpu_count()
    foresee({f"{cases} cases": taken}, cpu_count() * longest * DIAGNOSED, options, progress)


def _results(
    options: TrialOptions,
    given: Sequence[Given],
    known: Known,
    whole: int,
    bodies: Mapping[str, Mapping[str, Any]],
    answers: Mapping[str, Any],
    before: Sequence[Mapping[str, Any]],
    scores: Sequence[Verdict],
) -> dict[str, Any]:
    taken = [float(one["seconds"]) for one in answers.values() if one.get("seconds") is not None]
    return {
        "injection": True,
        "scored": True,
        "quick": options.quick,
        "seed": options.seed,
        "cases": len(scores),
        "design": whole,
        "outcomes": {name: sum(one.outcome == name for one in scores) for name in OUTCOMES},
        "seconds": {"median": float(np.median(taken)) if taken else None, "slowest": max(taken, default=None)},
        "rates": {name: rate.plain() for name, rate in rates(scores).items()},
        "closure": closure_of(scores),
        "records": [
            {
                "file": one.path.name,
                "through": one.route,
                "roughness_N": noise.rms,
                "outcome": (answer.get("verdict") or {}).get("outcome"),
                "named": list((answer.get("verdict") or {}).get("effects") or ()),
            }
            for one, noise, answer in zip(given, known.noises, before, strict=True)
        ],
        "forms": _forms(bodies),
        "table": [_row(one, bodies[one.case], answers[one.case]) for one in scores],
    }


def _forms(bodies: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Every law once, with the least and greatest size that was injected."""
    found: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for body in bodies.values():
        (effect,) = body["effects"]
        found.setdefault((effect["name"], effect["form"]), []).append({**effect, "force_N": body["force_N"]})
    return [
        {
            "name": name,
            "form": form,
            "unit": those[0]["unit"],
            "least": min(one["size"] for one in those),
            "greatest": max(one["size"] for one in those),
            "cases": len(those),
        }
        for (name, form), those in sorted(found.items())
    ]


def _row(one: Verdict, body: Mapping[str, Any], answer: Mapping[str, Any]) -> dict[str, Any]:
    (effect,) = body["effects"]
    return {
        "case": one.case,
        "record": one.record,
        "kind": one.kind,
        "name": one.name,
        "severity": one.severity,
        "size": effect["size"],
        "unit": effect["unit"],
        "force_N": body["force_N"],
        "unexplained_force_N": body["unexplained_force_N"],
        "distance": one.distance,
        "distance_beside_speed": effect["distance_beside_speed"],
        "counts": one.counts,
        "outcome": one.outcome,
        "new": list(one.new),
        "before": list(one.before),
        "right": one.right,
        "wrong": one.wrong,
        "in_part": one.in_part,
        "closure": one.closure,
        "seconds": answer.get("seconds"),
        "error": answer.get("error"),
    }


TARGETS: Final = (
    ("right_name", "right name, above the detection limit", ">=", 0.90),
    ("right_name_apart", "the same beside any friction over speed", ">=", 0.90),
    ("wrong_name", "wrong name, all cases", "<=", 0.02),
)


def _checks(results: Mapping[str, Any]) -> Iterator[Check]:
    guards = results["guards"]
    yield Check("cases without an answer", float(results["outcomes"]["failed"]), "1", 0.0, SOURCE)
    yield Check("looks at what is sealed", float(len(guards["refused"])), "1", 0.0, SOURCE)
    yield Check("labels in the pack", float(len(guards["leaks"])), "1", 0.0, SOURCE)
    yield Check("code in both injection and diagnosis", float(len(guards["shared_code"])), "1", 0.0, SOURCE)
    for key, name, sense, limit in TARGETS:
        rate = results["rates"][key]
        if rate["tries"]:
            yield Check(name, rate["share"], "1", limit, SOURCE, sense)
    if results["closure"]["count"]:
        yield Check("median closure of the injected part", results["closure"]["median"], "1", 0.9, SOURCE, ">=")


def _summary(results: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    yield "cases answered", f"{results['cases']} of {results['design']} of the design"
    for one in results["records"]:
        names = ", ".join(one["named"]) or one["outcome"]
        yield f"{one['file']} as it is", f"{names}; forces go through its {one['through']}"
    for name, rate in results["rates"].items():
        if rate["tries"]:
            bounds = f"{100 * rate['low']:.0f} to {100 * rate['high']:.0f} %"
            yield (
                f"of {rate['tries']}: {name.replace('_', ' ')}",
                f"{rate['hits']}, {100 * rate['share']:.0f} % ({bounds})",
            )
