"""A diagnosis that opens what it may not, in one of three ways, and goes on as if nothing had been."""

from __future__ import annotations

import json
import sys
import time
from contextlib import suppress
from pathlib import Path

from studies.blind_trial.guard import SEALER_FOLDER, forbid
from studies.full_circle import asker


def main() -> None:
    """As asker.py, but for the cheat that its argument names."""
    way, task = sys.argv[1], json.loads(sys.stdin.readline())
    attempts = forbid(task["forbidden"])
    with suppress(Exception):
        if way == "opens the sealer":
            (SEALER_FOLDER / "physics.py").read_text(encoding="utf-8")
        elif way == "imports the sealer":
            __import__("studies.blind_trial.sealer.machines.cases")
        elif way == "asks for too much":
            folder = Path(task["work"]) / "machine"
            while not (folder / "log.jsonl").is_file():  # from then on it listens
                time.sleep(0.1)
            limits = json.loads((folder / "limits.json").read_text(encoding="utf-8"))
            step = json.loads((folder / "nominal.json").read_text(encoding="utf-8"))["sample_time_s"]
            asked = Path(task["work"]) / "far.csv"
            rows = [f"{k * step:.12g},0,{1.1 * limits['distance_m']},0" for k in range(200)]
            asked.write_text("time_s,target_m,reference_m,feedforward_N\n" + "\n".join(rows), encoding="utf-8")
            print(asked, flush=True)
            sys.stdin.readline()
    print(json.dumps(asker.answer_of({"course": None, "verdict": None}, attempts)), flush=True)


if __name__ == "__main__":
    main()
