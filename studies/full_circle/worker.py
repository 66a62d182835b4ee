"""The process in which a withheld machine is worked on; it can open neither the truth nor the program of the machine.

Reads a line of JSON on stdin: {"forbidden", "nominal", "limits", "terms", "disabled", "seed", "folder", "cache"}. Then
it asks for runs, each a line {"run": {"bench", "table", "controller"}} answered by one on stdin, and ends with
{"done": ANSWERS}.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from studies.blind_trial.guard import forbid


def work(task: Mapping[str, Any], out: Any) -> dict[str, Any]:
    """The answers to a task."""
    from diagnosis.experiments.active import Settings
    from studies.command import plain
    from studies.full_circle.withheld import Limits, Terms, asking, circle
    from studies.study import machine_of

    machine = machine_of(Path(task["nominal"]))

    def run(asked: Mapping[str, Any]) -> Mapping[str, Any]:
        print(json.dumps({"run": asked}), file=out, flush=True)
        answer: dict[str, Any] = json.loads(sys.stdin.readline())
        return answer

    ask = asking(Path(task["folder"]), machine.sample_time, run)
    settings = Settings(seed=task["seed"], disabled=tuple(task["disabled"]), cache=Path(task["cache"]))
    found = circle(machine, Limits(**task["limits"]), ask, settings, Terms(**task["terms"]))
    answers: dict[str, Any] = plain(found)
    return answers


def end_with(parent: int) -> None:
    """Ends this process once the one that started it has ended: it would look at its records to the end otherwise."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def main() -> None:
    """Forbids what is sealed to this process, then works on its one machine."""
    end_with(os.getppid())
    task = json.loads(sys.stdin.readline())
    refused = forbid(task["forbidden"])
    out, sys.stdout = sys.stdout, sys.stderr  # nothing else may mix with the protocol
    try:
        found = work(task, out)
    except Exception as error:
        traceback.print_exc()
        found = {"failed": f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"}
    print(json.dumps({"done": answer_of(found, refused)}), file=out, flush=True)


def answer_of(found: dict[str, Any], refused: list[str]) -> dict[str, Any]:
    """The answers, which count only if nothing sealed was tried to be opened."""
    return {"failed": f"refused: {refused[0]}"} if refused else found


if __name__ == "__main__":
    main()
