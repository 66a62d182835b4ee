"""A trial of policies at equal budget: which is right after how much machine time, on sealed machines in processes.

Each (case, policy) is a sealed machine in a process of its own (blind_trial's sealer, told its seed on its input) and a
diagnosis in another one, asker.py, which can open neither seed nor sealer; this module hands the lines between them and
scores by the trial's own rules. Every policy begins with the same record, has the same limits, time, records and rules
to stop; they differ in what they run next.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from diagnosis.experiments import policy
from diagnosis.experiments.policy import Choose
from models.effects.catalogue import every
from studies.blind_trial.answering import program as program_hash
from studies.blind_trial.figures_of_merit import Rate
from studies.blind_trial.guard import SEALER_FOLDER
from studies.blind_trial.scoring import WITHOUT_EFFECT, Label, Score, label_of, score
from studies.folder import write_at_once
from studies.gap_diagnosis.course import confirmed
from studies.gap_diagnosis.options import MOST_SAMPLES
from studies.machine_process import program

ROOT: Final = Path(__file__).parents[2]
SEALED: Final = (sys.executable, "-m", "studies.blind_trial.sealer.on_request")
ASKER: Final = (sys.executable, "-m", "studies.full_circle.asker")
THREADS: Final = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "LOKY_MAX_CPU_COUNT")
POLICIES: Final[Mapping[str, Callable[[int], Choose]]] = {
    "active": lambda _seed: policy.active,
    "fixed suite": lambda _seed: policy.in_turn,
    "random": policy.at_random,
    "D-optimal": lambda _seed: policy.d_optimal,
}
"""By name, the policy for a seed."""


@dataclass(frozen=True)
class Terms:
    """On which terms every policy works: machine time [s], records, samples of all records together, the probability of
    a false name over all looks [1], the seed of its own, and a folder for thresholds."""

    seconds: float = 60.0
    records: int = 6
    samples: int = MOST_SAMPLES
    chance: float = policy.CHANCE
    seed: int = 0
    cache: Path = Path("reports/out/.null")


@dataclass(frozen=True)
class Result:
    """One policy on one case, scored. looks: machine time so far [s], the outcome and the names that were sure, look by
    look; seconds of machine time, cpu_seconds of the diagnosis; refused: requests that were beyond the limits."""

    case: int
    policy: str
    kind: str
    severity: str
    effects: tuple[str, ...]
    counts: bool
    right: bool
    false_name: bool
    stop: str
    named: tuple[str, ...]
    seconds: float
    looks: tuple[tuple[float, str, tuple[str, ...]], ...]
    refused: int
    cpu_seconds: float
    error: str = ""


def answered(seed: int, case: int, name: str, terms: Terms) -> dict[str, Any]:
    """What a policy found on a sealed machine: the course, the verdict, or an error; times in [s]."""
    plan = _plan(seed, case)
    task = {
        **{key: one for key, one in asdict(terms).items() if key != "cache"},
        "cache": str(terms.cache.resolve()),
        "forbidden": [str(SEALER_FOLDER)],
        "policy": name,
        "disabled": [part.name for part in plan.parts] if plan.kind == "disabled" else [],
    }
    terms.cache.mkdir(parents=True, exist_ok=True)  # a process may not read a folder that is newer than itself
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        with program(SEALED, work, f"{seed} {case}") as machine, _asker(work) as asker:
            lines = _between(asker, machine, {**task, "work": str(work)})
            answer: dict[str, Any] = json.loads(lines)
        beyond = _beyond(work / "machine" / "log.jsonl")
    return {**answer, "beyond": beyond, "body": json.dumps(plan.body())}


def _beyond(log: Path) -> int:
    """How many requests the machine refused, as it logged them itself; none where it was never asked."""
    lines = log.read_text(encoding="utf-8").splitlines() if log.is_file() else []
    return sum("refused" in json.loads(line) for line in lines)


def _plan(seed: int, case: int) -> Any:
    from studies.blind_trial.sealer.machines import cases  # the key of this trial, which the asker never has

    return cases.plan(seed, case, str(case))


def _asker(work: Path) -> subprocess.Popen[str]:
    threads = dict.fromkeys(THREADS, "1")
    with (work / "asker.txt").open("wb") as errors:
        return subprocess.Popen(
            ASKER,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            encoding="utf-8",
            cwd=ROOT,
            env={**os.environ, **threads},
        )


def _between(asker: subprocess.Popen[str], machine: subprocess.Popen[str], task: Mapping[str, Any]) -> str:
    """Hands lines from one to the other until the asker has an answer; that, as JSON."""
    assert asker.stdin is not None
    assert asker.stdout is not None
    assert machine.stdin is not None
    assert machine.stdout is not None
    line = json.dumps(task) + "\n"
    while True:
        try:
            asker.stdin.write(line)
            asker.stdin.flush()
            asked = asker.stdout.readline()
            if asked.startswith("{"):
                return asked
            machine.stdin.write(asked)
            machine.stdin.flush()
            line = machine.stdout.readline()
        except BrokenPipeError:
            line = ""
        if not asked or not line:
            asker.kill()
            return json.dumps({"error": "the asking process ended" if not asked else "the machine's process ended"})


def scored(case: int, name: str, answer: Mapping[str, Any]) -> Result:
    """A policy's answer by the trial's rules: names count where they are sure; times in [s]."""
    label: Label = label_of(str(case), answer["body"], list(every()))
    if "error" in answer:
        verdict, course = {"outcome": "failed", "effects": [], "equivalent": []}, _no_course()
    else:
        course = answer["course"]
        verdict = confirmed(answer["verdict"], course) if course["looks"] else answer["verdict"]
    rule: Score = score(label, {"verdict": verdict, "which": [], "how_far": None, "seconds": 0.0})
    return Result(
        case,
        name,
        label.kind,
        label.severity,
        label.names,
        rule.counts,
        rule.right,
        rule.false_positive,
        course["outcome"],
        tuple(course["effects"]),
        course["seconds"],
        tuple(_looks(course)),
        int(answer.get("beyond", 0)) + len(answer.get("refused", ())),
        float(answer.get("cpu_seconds", 0.0)),
        str(answer.get("error", "")),
    )


def _no_course() -> dict[str, Any]:
    return {"outcome": "failed", "effects": [], "seconds": 0.0, "looks": [], "needed": 1.0}


def _looks(course: Mapping[str, Any]) -> Iterator[tuple[float, str, tuple[str, ...]]]:
    seconds = 0.0
    for look in course["looks"]:
        seconds += look["seconds"]
        if look["after"] is not None:
            sure = {name for name, log in look["log10_e_values"].items() if 10.0**log >= course["needed"]}
            there = 10.0 ** look["log10_e_value"] >= course["needed"]
            names = tuple(name for name in look["after"]["names"] if there and name in sure)
            yield seconds, look["after"]["outcome"], names


def run(
    seed: int,
    cases: Sequence[int],
    names: Sequence[str],
    file: Path,
    terms: Terms = Terms(),
    progress: Callable[[float, str], None] = lambda _share, _text: None,
    jobs: int = 1,
) -> tuple[Result, ...]:
    """Every policy on every case of a seed; answers are kept in `file` after each, and none is computed again by the
    same program on the same terms. jobs: processes beside one another. Times in [s]."""
    from joblib import Parallel, delayed

    mark = f"{seed} {terms.seconds:g} {terms.records} {terms.samples} {terms.chance:g} {terms.seed} {program_hash()}"
    kept = _kept(file, mark)
    tasks = [(case, name) for case in cases for name in names]
    left = [task for task in tasks if _key(*task) not in kept]
    stream = Parallel(n_jobs=jobs, return_as="generator_unordered")(
        delayed(_keyed)(seed, case, name, terms) for case, name in left
    )
    for key, answer in stream:
        kept[key] = answer
        write_at_once(file, json.dumps({"of": mark, "answers": kept}) + "\n")
        stop = answer.get("error") or answer["course"]["outcome"]
        progress(sum(_key(*one) in kept for one in tasks) / len(tasks), f"{key}: {stop}")
    return tuple(scored(case, name, kept[_key(case, name)]) for case, name in tasks)


def _key(case: int, name: str) -> str:
    return f"{case} {name}"


def _keyed(seed: int, case: int, name: str, terms: Terms) -> tuple[str, dict[str, Any]]:
    return _key(case, name), answered(seed, case, name, terms)


def _kept(file: Path, mark: str) -> dict[str, Any]:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    answers: dict[str, Any] = content.get("answers", {}) if content.get("of") == mark else {}
    return answers


def rates(results: Sequence[Result]) -> dict[str, dict[str, Rate]]:
    """By policy: right names of single effects by severity and of all; false names where nothing is wrong or parameters
    only; abstentions on outsiders; requests beyond limits [1]."""
    found: dict[str, dict[str, Rate]] = {}
    for name in dict.fromkeys(one.policy for one in results):
        own = [one for one in results if one.policy == name]
        singles = [one for one in own if one.kind == "single" and one.counts]
        innocent = [one for one in own if one.kind in WITHOUT_EFFECT]
        outside = [one for one in own if one.kind in {"outsider", "disabled"}]
        found[name] = {
            "right name": _rate(singles, lambda one: one.right),
            **{
                f"right name, {severity}": _rate(
                    [one for one in own if one.kind == "single" and one.severity == severity], lambda one: one.right
                )
                for severity in ("low", "middle", "high")
            },
            "false name": _rate(innocent, lambda one: one.false_name or bool(one.error)),
            "no name for an outsider": _rate(outside, lambda one: one.right),
            "beyond the limits": _rate(own, lambda one: one.refused > 0),
        }
    return found


def _rate(results: Sequence[Result], hit: Callable[[Result], bool]) -> Rate:
    flags = [hit(one) for one in results]
    return Rate(sum(flags), len(flags))


def right_over_time(results: Sequence[Result], times: Sequence[float]) -> dict[str, list[Rate]]:
    """By policy, how many single effects were rightly and surely named after so much machine time [s]."""
    found: dict[str, list[Rate]] = {}
    for name in dict.fromkeys(one.policy for one in results):
        singles = [one for one in results if one.policy == name and one.kind == "single"]
        found[name] = [_rate(singles, lambda one, at=at: _right_at(one, at)) for at in times]  # type: ignore[misc]
    return found


def _right_at(one: Result, seconds: float) -> bool:
    before = [names for at, _, names in one.looks if at <= seconds]
    return bool(before) and set(before[-1]) == set(one.effects)
