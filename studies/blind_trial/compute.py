"""The trial: seals a pack or takes a given one, answers every case in isolation, commits to the answers, opens the key,
scores them."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from joblib import cpu_count

from models.machine import Machine
from studies.beforehand import require_stable
from studies.blind_trial import answering, many_machines
from studies.blind_trial import figures_of_merit as merit
from studies.blind_trial.answering import Conditions, all_answered, answer_all, read_answers, require_answers
from studies.blind_trial.cluster import Cluster, cluster_of
from studies.blind_trial.committing import commit, require_committed
from studies.blind_trial.guard import SEALER_FOLDER, leaks, shared_code
from studies.blind_trial.injected import compute_injected
from studies.blind_trial.options import TrialOptions
from studies.blind_trial.packs import Pack, open_key, read_pack
from studies.blind_trial.scoring import OUTCOMES, KeyFileError, Label, Score, groups_of, label_of, score
from studies.blind_trial.sealing import SEALING, Sealed, close, measure_again, reveal, seal
from studies.effort import DIAGNOSED, DIAGNOSING, foresee, seconds_a_sample
from studies.options import BadInputError
from studies.study import Answer, Check, Progress

ROOT: Final = Path(__file__).parents[2]
DIAGNOSIS: Final = answering.DIAGNOSIS
CACHE: Final = Path("reports/out/.null")  # The diagnosis caches thresholds per machine and schedule here.
SECOND_ANSWERS: Final = "answers_again.json"  # beside the key: the answers to second measurements
DEFAULT_CASES: Final = 60
QUICK_CASES: Final = 2
RECORDED: Final = 30.0  # s of records in a case
ANSWERED: Final = 0.93  # The share of a trial's time for its cases; the rest is for second measurements.
FULL: Final = 300  # From this number of cases on, a trial may take at most A_CASE per case on CORES cores.
A_CASE: Final = 12.0  # s
CORES: Final = 2
SOURCE: Final = "what the trial is to reach"
NOT_SHARED: Final = ("models", "design", "diagnosis")
BASELINES: Final = ("refit_only", "aic_forward", "sparse_regression")


@dataclass(frozen=True)
class Trial:
    """What to answer: the pack, its key if one is given, and what was sealed if none is."""

    pack: Pack
    key: Path | None = None
    sealed: Sealed | None = None

    @property
    def scored(self) -> bool:
        """Whether the labels will be known."""
        return self.key is not None or self.sealed is not None


def compute(machine: Machine, options: TrialOptions, progress: Progress) -> Answer:
    """Answers a pack and, with its key, scores the answers. Raises BadInputError.

    The machine is the pack's nominal one, which the answering processes read for themselves.
    """
    if options.inject:
        return compute_injected(machine, options, progress, DIAGNOSIS, CACHE)
    _require_no_columns(options)
    for name in ("machine", "controller"):
        if getattr(options, name) is not None:
            raise BadInputError(f"--{name}: a trial runs on the nominal.json of its pack; leave it out")
    require_stable(machine, "--pack")
    output = options.output or Path("reports/out/blind_trial")
    cluster = cluster_of(options)
    committed, file = output / "sealed" / "answers_committed.json", output / "answers.json"
    require_answers(file, overwrite=options.overwrite)
    for one in (file, committed.with_name(SECOND_ANSWERS)):
        require_committed(committed, read_answers(one), one)
    begun = time.monotonic() if _timed(options, output) else None
    if options.pack is None:
        _foresee(machine, options, progress)
    trial = _trial(options, output, progress)
    conditions = Conditions(
        options.seed if options.pack is None else 0,
        _forbidden(trial, output),
        DIAGNOSIS,
        baselines=trial.scored
        and options.machines == "table"  # They would take as long again on each machine.
        and DIAGNOSIS == answering.DIAGNOSIS,  # They start from the re-fit of the project's own diagnosis.
        cache=CACHE,
    )
    begin = SEALING if options.pack is None else 0.0

    def tell(share: float, text: str) -> None:
        progress(begin + (ANSWERED - begin) * share, text)

    if trial.sealed is not None and not all_answered(trial.pack, file, conditions):
        trial = replace(trial, sealed=close(trial.sealed))
    # Begun together, the few cases of a quick run would each simulate the thresholds that they share.
    answers = answer_all(trial.pack, file, conditions, tell, cluster, in_turn=options.quick)
    commit(committed, answers)
    second = {} if options.quick else _second(trial, committed, conditions, cluster, progress)
    results: dict[str, Any] = {
        "quick": options.quick,
        "scored": trial.scored,
        "own": options.pack is None,
        "seed": options.seed,
        "cases": len(answers),
        "outcomes": {name: sum(_outcome(one) == name for one in answers.values()) for name in OUTCOMES},
        "seconds": _seconds(answers),
    }
    bodies = _opened(trial)
    labels = _labels(bodies, trial.pack)
    results |= _scored(labels, answers, _again(labels, answers, second) if trial.scored else {})
    results["forms"] = _forms(bodies)
    results["machines"] = many_machines.figures(bodies, labels, answers)
    results["guards"] = _guards(trial, labels, answers)
    if not trial.scored:
        results["table"] = [_row(name, one) for name, one in answers.items()]
    if begun is not None:
        results["seconds"]["trial"] = time.monotonic() - begun
    if results["machines"] is None:
        checks = _checks(results, quick=options.quick)
    else:
        checks = [*_sound(results), *many_machines.checks(results, quick=options.quick)]
    return Answer(results, tuple(checks), {"answers.json": answers}, tuple(_summary(results)))


def _require_no_columns(options: TrialOptions) -> None:
    """Raises BadInputError for options on how measured records are read, which only --inject has."""
    for name in ("column", "mapping", "recipe", "trust_records"):
        if getattr(options, name):
            raise BadInputError(
                f"--{name.replace('_', '-')}: is for the measured records of --inject; give it too, or leave it out"
            )


def _foresee(machine: Machine, options: TrialOptions, progress: Progress) -> None:
    """The time of all cases, each with half a minute of records, on the cores of this computer."""
    samples = RECORDED / machine.sample_time
    taken = _cases(options) * samples * DIAGNOSING * seconds_a_sample(machine) / (cpu_count() * ANSWERED)
    foresee({f"{_cases(options)} cases": taken}, samples * DIAGNOSED, options, progress)


def _cases(options: TrialOptions) -> int:
    """How many cases are sealed."""
    return options.cases if options.cases is not None else QUICK_CASES if options.quick else DEFAULT_CASES


def _timed(options: TrialOptions, output: Path) -> bool:
    """Whether the time of this run is that of a whole trial: it seals its own pack, no earlier run has left part of the
    work in its folder, and it has the number of cores that the limit refers to. Thresholds in CACHE may be reused."""
    begins = not any((output / name).exists() for name in ("sealed", "answers.json"))
    own = options.pack is None and options.scheduler is None and not options.quick
    return own and begins and cpu_count() == CORES


def _trial(options: TrialOptions, output: Path, progress: Progress) -> Trial:
    """The pack to answer: the given one, or one sealed now."""
    if options.pack is not None:
        if options.machines != "table":
            raise BadInputError("--machines: a --pack has its own machines; leave one of them out")
        if options.cases is not None:
            raise BadInputError("--cases: a --pack has its own number of cases; leave one of them out")
        if options.key is not None and not options.key.is_file():
            raise BadInputError(f"--key {options.key}: is not a file; give the key of this pack, or leave it out")
        return Trial(read_pack(options.pack), options.key)
    if options.key is not None:
        raise BadInputError("--key: opens a given pack; give --pack too, or leave it out")
    sealed = seal(_cases(options), options.seed, output, progress, options.machines)
    return Trial(read_pack(sealed.pack), sealed=sealed)


def _forbidden(trial: Trial, output: Path) -> tuple[Path, ...]:
    """What no answering process may open, whether it exists or not; the kernel closes what exists."""
    return (*([trial.key] if trial.key else []), output / "sealed" / "key.json")


def _opened(trial: Trial) -> dict[str, str]:
    """The verified bodies of the labels; none without a key. Raises BadInputError."""
    if trial.sealed is not None:
        return reveal(trial.sealed)
    return {} if trial.key is None else open_key(trial.key, trial.pack)


def _labels(bodies: Mapping[str, str], pack: Pack) -> dict[str, Label]:
    """The labels in verified bodies. Raises BadInputError."""
    from studies.blind_trial.baselines import catalogue

    known = catalogue(pack)
    try:
        return {case: label_of(case, body, known) for case, body in bodies.items()}
    except KeyFileError as error:
        raise BadInputError(f"--key: {error}") from error


def _forms(bodies: Mapping[str, str]) -> list[dict[str, Any]]:
    """The functional form of each effect in the sealer, if the bodies state it."""
    found: dict[str, dict[str, Any]] = {}
    for body in bodies.values():
        for one in json.loads(body).get("effects", ()):
            if isinstance(one, dict) and {"name", "form", "size", "unit"} <= set(one):
                found.setdefault(one["name"], {name: one[name] for name in ("name", "form", "size", "unit")})
    return [found[name] for name in sorted(found)]


def _second(
    trial: Trial,
    committed: Path,
    conditions: Conditions,
    cluster: Cluster | None,
    progress: Progress,
) -> dict[str, Any]:
    """The answers to second measurements, which are made once the answers to the first are committed, and before any
    label is known."""

    def tell(share: float, text: str) -> None:
        progress(ANSWERED + (0.98 - ANSWERED) * share, f"second measurement, {text}")

    pack = None if trial.sealed is None else measure_again(trial.sealed)
    if pack is None:
        return {}
    conditions = replace(conditions, baselines=False, evidence=False)
    found = answer_all(pack, committed.with_name(SECOND_ANSWERS), conditions, tell, cluster)
    commit(committed, found)
    return found


def _again(labels: Mapping[str, Label], answers: Mapping[str, Any], second: Mapping[str, Any]) -> dict[str, Any]:
    """Closure on a second measurement, beside the interval stated from the first, where both name the effect."""
    pairs: list[dict[str, Any]] = []
    for case, one in second.items():
        first, then = score(labels[case], answers[case]), score(labels[case], one)
        if first.right and then.right and first.interval is not None and then.closure is not None:
            low, high = first.interval
            pairs.append({"case": case, "low": low, "high": high, "then": then.closure})
    inside = merit.rate_of([pair["low"] <= pair["then"] <= pair["high"] for pair in pairs])
    return {"count": len(pairs), "inside": inside.plain(), "pairs": pairs}


def _outcome(answer: Mapping[str, Any]) -> str:
    outcome = (answer.get("verdict") or {}).get("outcome")
    return str(outcome) if outcome in OUTCOMES else "failed"


def _seconds(answers: Mapping[str, Any]) -> dict[str, float | None]:
    """Wall-clock time of a diagnosis [s], with several running in parallel; the trial's own is added later."""
    taken = [float(one["seconds"]) for one in answers.values() if one.get("seconds") is not None]
    if not taken:
        return {"median": None, "slowest": None, "total": None, "trial": None}
    return {"median": float(np.median(taken)), "slowest": max(taken), "total": sum(taken), "trial": None}


def _scored(labels: Mapping[str, Label], answers: Mapping[str, Any], again: Mapping[str, Any]) -> dict[str, Any]:
    """All results that need the key; empty, with the same keys, without one."""
    scores = [score(label, answers[case]) for case, label in labels.items()]
    return {
        "rates": {name: rate.plain() for name, rate in merit.rates(scores).items()},
        "likeness": merit.likeness(scores).plain(),
        "severity": merit.by_severity(scores),
        "closure": merit.closures(scores),
        "again": again,
        "calibration": {
            "first": merit.calibration(merit.statements(answers, scores, first=True)),
            "all": merit.calibration(merit.statements(answers, scores, first=False)),
        },
        "confusion": merit.confusion(scores),
        "baselines": _baselines(labels, answers),
        "table": [_row(one.label.case, answers[one.label.case], one) for one in scores],
    }


def _baselines(labels: Mapping[str, Label], answers: Mapping[str, Any]) -> dict[str, Any]:
    """The same rates for the other methods; empty if they did not answer."""
    found: dict[str, Any] = {}
    for name in BASELINES:
        beside = {case: (answers[case].get("baselines") or {}).get(name) for case in labels}
        scores = [score(label, one) for case, label in labels.items() if (one := beside[case])]
        if scores:
            found[name] = {kind: rate.plain() for kind, rate in merit.rates(scores).items()}
    return found


def _row(case: str, answer: Mapping[str, Any], one: Score | None = None) -> dict[str, Any]:
    """One case in the table of all cases."""
    far = answer.get("how_far") or {}
    verdict = answer.get("verdict") or {}
    row = {
        "case": case,
        "outcome": _outcome(answer),
        "named": [list(group) for group in groups_of(verdict)],
        "closure": far.get("closure"),
        "interval": far.get("closure_interval"),
        "seconds": answer.get("seconds"),
        "error": answer.get("error"),
    }
    if one is None:
        return row
    sealed = one.label
    return row | {
        "kind": sealed.kind,
        "names": list(sealed.names),
        "severity": sealed.severity,
        "distance": sealed.distance,
        "counts": one.counts,
        "right": one.right,
        "accused": one.false_positive,
        "probability": one.probability,
    }


def _guards(trial: Trial, labels: Mapping[str, Label], answers: Mapping[str, Any]) -> dict[str, Any]:
    """Signs of a compromised trial: labels in the pack, code shared by both programs, attempts to open sealed files."""
    hidden = {name for label in labels.values() for name in label.names}
    return {
        "commitments": len(labels),
        "leaks": leaks(trial.pack.folder, sorted(hidden)),
        "shared_code": shared_code(SEALER_FOLDER, [ROOT / package for package in NOT_SHARED], NOT_SHARED),
        "refused": sorted(case for case, one in answers.items() if one.get("refused")),
    }


TARGETS: Final[tuple[tuple[str, str, str, float], ...]] = (
    ("right_name", "right name, identifiable single effects", ">=", 0.95),
    ("both_named", "both of two effects named", ">=", 0.80),
    ("false_accusation", "false accusation, nothing wrong or parameters only", "<=", 0.02),
    ("abstention", "abstention on effects outside the catalogue", ">=", 0.90),
    ("abstention_disabled", "abstention on effects whose entry is disabled", ">=", 0.90),
)


def _sound(results: Mapping[str, Any]) -> list[Check]:
    """That every case is answered, by who could not know better."""
    guards = results["guards"]
    return [
        Check("cases without an answer", float(results["outcomes"]["failed"]), "1", 0.0, SOURCE),
        Check("looks at what is sealed", float(len(guards["refused"])), "1", 0.0, SOURCE),
        Check("labels in the pack", float(len(guards["leaks"])), "1", 0.0, SOURCE),
        Check("code in both sealer and diagnosis", float(len(guards["shared_code"])), "1", 0.0, SOURCE),
    ]


def _checks(results: Mapping[str, Any], quick: bool) -> list[Check]:
    """Every target of the trial; those without cases are left out."""
    seconds, found = results["seconds"]["median"], _sound(results)
    for key, name, sense, limit in TARGETS:
        rate = results["rates"][key]
        if rate["tries"]:
            found.append(Check(name, rate["share"], "1", limit, SOURCE, sense))
    if results["closure"]["count"]:
        found.append(Check("median closure of right answers", results["closure"]["median"], "1", 0.9, SOURCE, ">="))
    first = results["calibration"]["first"]
    if first["count"] and not quick:
        found.append(Check("calibration error of the probabilities", first["error"], "1", 0.05, SOURCE))
    if seconds is not None and not quick:  # A quick run is compared with a stored one, so it must not contain times.
        found.append(Check("median time of one diagnosis", seconds, "s", 30.0, SOURCE))
    whole = results["seconds"]["trial"]
    if whole is not None and results["cases"] >= FULL:
        found.append(Check("time of the whole trial, on two cores", whole, "s", A_CASE * results["cases"], SOURCE))
    return found


def _summary(results: Mapping[str, Any]) -> Sequence[tuple[str, str]]:
    rows = [("cases answered", f"{results['cases'] - results['outcomes']['failed']} of {results['cases']}")]
    if not results["scored"]:
        rows += [(name, str(count)) for name, count in results["outcomes"].items() if count]
        return rows
    say: Callable[[Mapping[str, Any]], str] = _said
    rows += [(f"of {rate['tries']}: {name.replace('_', ' ')}", say(rate)) for name, rate in results["rates"].items()]
    return rows


def _said(rate: Mapping[str, Any]) -> str:
    if not rate["tries"]:
        return "–"
    return f"{rate['hits']}, {100 * rate['share']:.0f} % ({100 * rate['low']:.0f} to {100 * rate['high']:.0f} %)"
