"""The answering process, which diagnoses one case per line of input and can open neither the key nor the sealer's code.

Reads lines of JSON on stdin: first {"forbidden"}, then for each case {"records", "nominal", "disabled", "seed",
"diagnosis", "baselines", "evidence", "cache"}; writes one line of JSON per case to stdout.
"""

from __future__ import annotations

import json
import sys
import time
import traceback
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any

from studies.blind_trial.guard import forbid


def answer(task: dict[str, Any]) -> dict[str, Any]:
    """The diagnosis of a case, under the keys of results.json, with its wall-clock and processor times in seconds: what
    else runs on the computer lengthens the first."""
    from models.records import files as record_file
    from studies.study import machine_of

    diagnosis = import_module(task["diagnosis"])
    machine = machine_of(Path(task["nominal"]))
    records = [record_file.load(Path(file)).content for file in task["records"]]
    given: dict[str, Any] = {"seed": task["seed"], "disabled": tuple(task["disabled"]), "progress": None}
    if task.get("cache") and "cache" in signature(diagnosis.diagnose).parameters:
        given["cache"] = Path(task["cache"])  # thresholds that follow from the machine and the schedule alone
    if "trusted" in signature(diagnosis.diagnose).parameters:
        given["trusted"] = True  # an answer is owed in any case
    begin, worked = time.perf_counter(), time.process_time()
    found = diagnosis.diagnose(machine, records, **given)
    whole = diagnosis.to_json(found)
    if task["diagnosis"] == "diagnosis.diagnose" and task.get("evidence", True):
        whole = _with_evidence(found, whole, task["disabled"])
    taken = {"seconds": time.perf_counter() - begin, "cpu_seconds": time.process_time() - worked}
    answered = {part: whole.get(part) for part in ("verdict", "where", "which", "how_far", "learned")} | taken
    if task.get("baselines"):
        answered["baselines"] = _beside(found, task["disabled"])
    return answered


def _with_evidence(found: Any, whole: dict[str, Any], disabled: list[str]) -> dict[str, Any]:
    """The answer, extended by where the gap lies, what the records cannot show, and which experiment to run next."""
    beside = import_module("diagnosis.evidence").evidence(found, disabled=disabled).to_json()
    return {**whole, "where": beside["where"], "verdict": {**whole["verdict"], **beside["verdict"]}}


def _beside(found: Any, disabled: list[str]) -> dict[str, Any] | None:
    """The answers of simpler methods; None, with the reason on stderr, if they fail: the diagnosis stands without."""
    try:
        answers: dict[str, Any] = import_module("studies.blind_trial.baselines").answers(found, disabled)
    except Exception:
        traceback.print_exc()
        return None
    return answers


def guarded(task: dict[str, Any], refused: list[str]) -> dict[str, Any]:
    """The answer, or the error in its place; an attempt to open sealed files invalidates the answer."""
    try:
        found = answer(task)
    except Exception as error:
        traceback.print_exc()
        found = failed(f"{type(error).__name__}: {' '.join(str(error).split())[:300]}")
    return failed(f"refused: {refused[0]}") | {"refused": refused} if refused else found


def failed(why: str) -> dict[str, Any]:
    """The placeholder for an answer that could not be given."""
    return {
        "verdict": {"outcome": "failed", "effects": [], "equivalent": []},
        "where": None,
        "which": [],
        "how_far": None,
        "seconds": None,
        "error": why,
    }


def main() -> None:
    """Forbids the sealed files to this process, then answers cases until its input ends."""
    refused = forbid(json.loads(sys.stdin.readline())["forbidden"])
    out, sys.stdout = sys.stdout, sys.stderr  # anything the diagnosis prints must not mix with the answers
    from studies.command import plain

    for line in sys.stdin:
        print(json.dumps(plain(guarded(json.loads(line), refused))), file=out, flush=True)


if __name__ == "__main__":
    main()
