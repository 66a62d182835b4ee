"""A program that stands in for an axis: the nominal table, simulated, with an effect or without; and faulty programs.

    python -m tests.studies.stand_in_axis WAY --folder FOLDER

WAY: "clean"; the name of an effect of the catalogue; or what is wrong with the program, one of FAULTS.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from models.controller import References
from models.machine import load
from models.records.files import read
from models.simulation.simulator import simulate

FAULTS: Final = (
    "refuses",
    "trips",
    "no JSON",
    "ends",
    "ends at once",
    "no limits",
    "no way",
    "no record",
    "stray byte",
)
LIMITS: Final = {
    "distance_m": 0.05,
    "speed_m_per_s": 0.3,
    "feedforward_N": 100.0,
    "machine_time_s": 40.0,
    "records": 6,
}
TRIPPED: Final = "the drive's error 0x2310"


def run(way: str, table: Path, folder: Path, number: int) -> str:
    """The record of references, as a file's name in the folder."""
    columns, machine = read(table), load()
    kinds = machine.kinds
    effects = (kinds[way].typical(machine.priors),) if way in kinds else ()
    position, force = columns["reference_m"], columns["feedforward_N"]
    made = simulate(
        replace(machine, effects=effects, scale=machine.scale.noisy()),
        machine.feedback_only(),
        columns["target_m"],
        given=References(position, force, np.zeros(force.size)),
        seed=number,
    ).record
    rows = np.column_stack([*columns.values(), made.command, made.position])
    header = ",".join([*columns, "command_N", "position_m"])
    np.savetxt(folder / f"run{number}.csv", rows, delimiter=",", header=header, comments="", fmt="%.12g")
    return f"run{number}.csv"


def answer(way: str, line: str, folder: Path, left: dict[str, Any]) -> str:
    """What is put out for a line; `left` is what is left of the limits."""
    if way == "refuses":
        return json.dumps({"refused": "the door\nis open", "left": left})
    if way == "no JSON":
        return "done"
    left["records"] -= 1
    left["machine_time_s"] -= read(Path(line.strip()))["time_s"].size * load().sample_time
    if way == "trips":
        return json.dumps({"tripped": TRIPPED, "left": left})
    if way == "no record":
        (folder / "empty.csv").write_text("", encoding="utf-8")
        return json.dumps({"record": "empty.csv", "left": left})
    name = run(way, Path(line.strip()), folder, LIMITS["records"] - left["records"])
    return json.dumps({"record": name, "left": left})


def main() -> int:
    """Runs the program."""
    parser = argparse.ArgumentParser()
    parser.add_argument("way")
    parser.add_argument("--folder", type=Path)
    given = parser.parse_args()
    left = {name: LIMITS[name] for name in ("machine_time_s", "records")}
    if given.way == "ends at once":
        print("no axis here", file=sys.stderr)
        return 2
    limits = {"no limits": {"speed_m_per_s": "fast"}, "no way": {**LIMITS, "distance_m": 0}}.get(given.way, LIMITS)
    (given.folder / "limits.json").write_text(json.dumps(limits), encoding="utf-8")
    for line in sys.stdin:
        if given.way == "ends":
            return 0
        if given.way == "stray byte":
            sys.stdout.buffer.write(b"\xb5m\n")
            sys.stdout.flush()
        print(answer(given.way, line, given.folder, left), flush=True)
    (given.folder / "ended.txt").write_text("with its input", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
