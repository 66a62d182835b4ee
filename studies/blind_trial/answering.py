"""Answers every case of a pack, over the cores or a cluster; each answer is saved at once and never computed again."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from studies.blind_trial.asking import ask, end_with
from studies.blind_trial.cluster import Cluster, connect
from studies.blind_trial.guard import SEALER_FOLDER
from studies.blind_trial.packs import Case, Pack
from studies.command import plain
from studies.folder import write_at_once
from studies.options import BadInputError

ROOT: Final = Path(__file__).parents[2]
DIAGNOSIS: Final = "diagnosis.diagnose"
SOURCES: Final = ("models", "diagnosis")


@dataclass(frozen=True)
class Conditions:
    """How cases are answered.

    forbidden: files that no answering process may open; diagnosis: the module that diagnoses; baselines: whether the
    simpler methods answer too; evidence: whether the answer says where the gap lies and which experiment to run next;
    cache: a folder for what cases of one schedule share; program: an identifier of this program (empty: the hash of the
    sources of models and diagnosis).
    """

    seed: int = 0
    forbidden: tuple[Path, ...] = ()
    diagnosis: str = DIAGNOSIS
    baselines: bool = False
    evidence: bool = True
    cache: Path | None = None
    program: str = ""


def answer_case(case: Case, conditions: Conditions) -> dict[str, Any]:
    """One answer, from a process that can open neither the key nor the sealer's code."""
    if conditions.cache is not None:
        conditions.cache.mkdir(parents=True, exist_ok=True)  # a process may not read a folder that is newer than itself
    task = {
        "records": [str(file.resolve()) for file in case.records],
        "nominal": str(case.nominal.resolve()),
        "disabled": list(case.disabled),
        "seed": conditions.seed,
        "diagnosis": conditions.diagnosis,
        "baselines": conditions.baselines,
        "evidence": conditions.evidence,
        "cache": None if conditions.cache is None else str(conditions.cache.resolve()),
    }
    return ask(task, tuple(str(file.resolve()) for file in (*conditions.forbidden, SEALER_FOLDER)))


def fingerprint(case: Case, conditions: Conditions) -> str:
    """SHA-256 over what an answer follows from: the case, the seed, and the program that diagnoses."""
    made = [case.fingerprint(), str(conditions.seed), conditions.diagnosis]
    made += [str(conditions.baselines), str(conditions.evidence)]
    made.append(conditions.program or program())
    return hashlib.sha256(" ".join(made).encode()).hexdigest()


def program() -> str:
    """SHA-256 over the sources of models and diagnosis."""
    digest = hashlib.sha256()
    for file in sorted(
        one for folder in SOURCES for one in (ROOT / folder).rglob("*") if one.suffix in (".py", ".toml")
    ):
        digest.update(file.relative_to(ROOT).as_posix().encode())
        digest.update(file.read_bytes())
    return digest.hexdigest()


def answer_all(
    pack: Pack,
    file: Path,
    conditions: Conditions,
    progress: Callable[[float, str], None],
    cluster: Cluster | None = None,
    jobs: int = -1,
    *,
    in_turn: bool = False,
) -> dict[str, Any]:
    """The answers to all cases, saved in `file` after each; answers that it already holds, to the same records by the
    same program, are reused. cluster: a Dask cluster that sees the same folders. jobs: processes. in_turn: a case is
    begun when the one before is answered, so that the first one's thresholds are in the cache for those that follow.
    """
    from joblib import Parallel, delayed

    marks = {case.name: fingerprint(case, conditions) for case in pack.cases}
    answers = _kept(file, marks)
    left = [case for case in pack.cases if case.name not in answers]
    if len(left) < len(pack.cases):
        progress(len(answers) / len(pack.cases), f"{len(answers)} cases answered before are kept")
    with _workers(cluster):
        ahead = 1 if in_turn else "2 * n_jobs"  # how many cases are handed out before one is answered
        stream = Parallel(n_jobs=jobs, return_as="generator_unordered", pre_dispatch=ahead)(
            delayed(_named_answer)(case, conditions) for case in left
        )
        for name, found in stream:
            answers[name] = {**found, "of": marks[name]}
            write_answers(file, answers)
            progress(len(answers) / len(pack.cases), f"{name}: {(found.get('verdict') or {}).get('outcome')}")
    return {name: answers[name] for name in sorted(answers)}


def all_answered(pack: Pack, file: Path, conditions: Conditions) -> bool:
    """Whether `file` holds answers to all cases, so that none is left to be answered."""
    return len(_kept(file, {case.name: fingerprint(case, conditions) for case in pack.cases})) == len(pack.cases)


def _kept(file: Path, marks: Mapping[str, str]) -> dict[str, Any]:
    """The answers in a file that are to these fingerprints by name of case."""
    return {name: one for name, one in read_answers(file).items() if name in marks and one.get("of") == marks[name]}


def _named_answer(case: Case, conditions: Conditions) -> tuple[str, dict[str, Any]]:
    return case.name, answer_case(case, conditions)


@contextmanager
def _workers(cluster: Cluster | None) -> Iterator[None]:
    """Processes of this machine, or the workers of a Dask cluster. Raises BadInputError where there is none."""
    from joblib import parallel_config

    if cluster is None:
        with parallel_config(backend="loky", initializer=end_with, initargs=(os.getpid(),), idle_worker_timeout=20):
            yield
        return
    client = connect(cluster)
    try:
        with parallel_config(backend="dask"):
            yield
    finally:
        client.close()


def read_answers(file: Path) -> dict[str, Any]:
    """The answers saved so far; none if the file is missing or is not valid."""
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return {name: one for name, one in content.items() if isinstance(one, dict)} if isinstance(content, dict) else {}


def require_answers(file: Path, *, overwrite: bool) -> None:
    """Raises BadInputError for a file that would be replaced and does not hold answers of an earlier run."""
    if overwrite or not os.path.lexists(file):
        return
    answers = read_answers(file) if file.is_file() and not file.is_symlink() else {}
    if not answers or not all(isinstance(one.get("of"), str) for one in answers.values()):
        raise BadInputError(
            f"--output {file.parent}: {file.name} in it does not hold the answers of a trial; "
            "give another folder, or --overwrite to replace it"
        )


def write_answers(file: Path, answers: Mapping[str, Any]) -> None:
    """Writes the answers atomically: whenever this is killed, the file holds either the old ones or the new."""
    text = json.dumps(plain({key: answers[key] for key in sorted(answers)}), indent=1, sort_keys=True) + "\n"
    write_at_once(file, text)
