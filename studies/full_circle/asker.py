"""The process that diagnoses a sealed machine by asking it; it can open neither the sealer's code nor the case's seed.

The first line on its input is JSON: {"forbidden", "work", "policy", "seed", "seconds", "records", "samples", "chance",
"disabled", "cache"}. Each line that it puts out is the path of references, which whoever started it hands to the
machine, whose answer is the next line of its input; the last one is JSON, what it found.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from pathlib import Path
from typing import Any

from studies.blind_trial.guard import forbid


def found(task: dict[str, Any], channel: Any) -> dict[str, Any]:
    """The course of the looks, the verdict, and the processor time [s] that they took."""
    from dataclasses import replace

    from diagnosis.experiments import active
    from studies.full_circle.policies import POLICIES
    from studies.gap_diagnosis.asking import budget_of
    from studies.machine_process import MachineProcess, Ran
    from studies.study import machine_of

    process = MachineProcess(channel, "the sealed machine", Path(task["work"]))
    assert process.nominal is not None
    machine = machine_of(process.nominal)
    refused: list[str] = []

    def run(references: Any) -> Any:
        result = process.run(references, machine.sample_time)
        if isinstance(result, Ran):
            return result.record
        refused.append(result.why)
        return result.why

    begun = time.process_time()
    asked = active.ask(
        machine,
        run,
        replace(
            budget_of(process, machine, task["seconds"], task["samples"]),
            records=task["records"],
            chance=task["chance"],
        ),
        active.Settings(seed=task["seed"], disabled=tuple(task["disabled"]), cache=Path(task["cache"])),
        choose=POLICIES[task["policy"]](task["seed"]),
    )
    course = active.to_json(asked)
    verdict: dict[str, Any] = {"outcome": "none_of_these", "effects": [], "equivalent": []}
    if asked.last is not None:
        now = asked.last.found
        verdict = {"outcome": now.outcome, "effects": now.names, "equivalent": now.alike}
    return {"course": course, "verdict": verdict, "refused": refused, "cpu_seconds": time.process_time() - begun}


def end_with(parent: int) -> None:
    """Ends this process once the one that started it has ended: it would look at its records to the end otherwise."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def main() -> None:
    """Forbids what is sealed to this process, then diagnoses one machine."""
    end_with(os.getppid())
    task = json.loads(sys.stdin.readline())
    attempts = forbid(task.pop("forbidden"))
    out, sys.stdout = sys.stdout, sys.stderr  # anything that is printed must not mix with what is asked
    from studies.command import plain
    from studies.machine_process import Channel

    try:
        answer = found(task, Channel(out, sys.stdin, lambda: False))
    except Exception as error:  # one machine must not end a trial; what it was is told in place of an answer
        import traceback

        traceback.print_exc()
        answer = {"error": f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"}
    print(json.dumps(plain(answer_of(answer, attempts))), file=out, flush=True)


def answer_of(answer: dict[str, Any], attempts: list[str]) -> dict[str, Any]:
    """The answer, which counts only if nothing sealed was tried to be opened."""
    return {"error": f"refused: {attempts[0]}"} if attempts else answer


if __name__ == "__main__":
    main()
