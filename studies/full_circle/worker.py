"""The process in which a withheld machine is worked on; it can open neither the truth nor the program of the machine.

Reads a line of JSON on stdin: {"forbidden", "nominal", "limits", "seed", "quick", "folder"}. Then it asks for runs,
each a line {"run": {"bench", "table", "controller"}} answered by one on stdin, and ends with {"done": ANSWERS}.
"""

from __future__ import annotations

import json
import sys
import traceback
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from studies.blind_trial.guard import forbid


def work(task: Mapping[str, Any], out: Any) -> dict[str, Any]:
    """The answers to a task."""
    from studies.command import plain
    from studies.full_circle.withheld import Limits, asking, circle
    from studies.study import machine_of

    machine = machine_of(Path(task["nominal"]))

    def run(asked: Mapping[str, Any]) -> Mapping[str, Any]:
        print(json.dumps({"run": asked}), file=out, flush=True)
        answer: dict[str, Any] = json.loads(sys.stdin.readline())
        return answer

    ask = asking(Path(task["folder"]), machine.sample_time, run)
    found = circle(machine, Limits(**task["limits"]), ask, task["seed"], quick=task["quick"])
    answers: dict[str, Any] = plain(found)
    return answers


def main() -> None:
    """Forbids what is sealed to this process, then works on its one machine."""
    task = json.loads(sys.stdin.readline())
    refused = forbid(task["forbidden"])
    out, sys.stdout = sys.stdout, sys.stderr  # nothing else may mix with the protocol
    try:
        found = work(task, out)
    except Exception as error:
        traceback.print_exc()
        found = {"failed": f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"}
    if refused:
        found = {"failed": f"refused: {refused[0]}", "refused": refused}
    print(json.dumps({"done": found}), file=out, flush=True)


if __name__ == "__main__":
    main()
