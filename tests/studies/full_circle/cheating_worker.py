"""Works on a withheld machine by cheating: looks at what is sealed, asks for too much, and goes on as if nothing were.

Its answer tells what came of each cheat, and the task that it was given.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from studies.blind_trial.guard import SEALER_FOLDER, forbid
from studies.full_circle import worker
from studies.full_circle.trial import OPENED


def came_of(cheat: Callable[[], Any]) -> str:
    """What a cheat led to: the kind of error, or its result as text."""
    try:
        return json.dumps(cheat())
    except Exception as error:
        return type(error).__name__


def main() -> None:
    """As worker.py, but for what it does."""
    task = json.loads(sys.stdin.readline())
    attempts = forbid(task["forbidden"])
    folder = Path(task["folder"])

    def by_a_link() -> str:
        (folder / "link").symlink_to(SEALER_FOLDER)
        return (folder / "link" / "physics.py").read_text(encoding="utf-8")

    def ask(bench: str) -> Any:
        rows = [f"{k * 1.6e-3:.9g},0,{k},0" for k in range(200)]  # 200 m away
        (folder / "far.csv").write_text("time_s,target_m,reference_m,feedforward_N\n" + "\n".join(rows), "utf-8")
        asked = {"bench": bench, "table": str(folder / "far.csv"), "controller": None}
        print(json.dumps({"run": asked}), flush=True)
        return json.loads(sys.stdin.readline())

    truth = Path(f"{folder}{OPENED}") / "truth.json"
    step = folder.parent / "steps" / f"{folder.name}{OPENED}.json"
    cheats: dict[str, Callable[[], Any]] = {
        "opens the sealer": lambda: (SEALER_FOLDER / "physics.py").read_text(encoding="utf-8"),
        "opens it by a link": by_a_link,
        "imports the sealer": lambda: __import__("studies.blind_trial.sealer.machines.cases"),
        "opens the truth of an earlier run": lambda: truth.read_text(encoding="utf-8"),
        "opens its step": lambda: step.read_text(encoding="utf-8"),
        "asks for too much": lambda: ask("main"),
        "asks for a bench elsewhere": lambda: ask("../elsewhere"),
    }
    said = {way: came_of(cheat) for way, cheat in cheats.items()}
    done = {**worker.answer_of({"course": None}, attempts), "said": said, "task": task}
    print(json.dumps({"done": done}), flush=True)


if __name__ == "__main__":
    main()
