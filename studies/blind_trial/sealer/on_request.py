"""A sealed machine that runs what it is asked, within limits, as an axis in a laboratory would.

    python -m studies.blind_trial.sealer.on_request --folder FOLDER

The first line on its input is "SEED CASE": the machine and what is wrong with it are those of that case of a pack of
drawn machines, and follow from the seed, which is therefore in no file and on no command line. FOLDER then holds
nominal.json, what is known of the machine and asked of it, limits.json and, where effects are not to be named,
disabled.json. Each further line is the path of a table of references
(time_s, target_m, reference_m, feedforward_N, as the diagnosis writes its next_experiment.csv), or a line of JSON,
{"references": PATH, "controller": PATH}: the run is then made with the plain PID and the reference's delay of that
controller.json in place of its own, as an engineer would load it into the drive; the machine trips where that asks for
more than the drive has, and its own controller runs again next time. The machine runs it,
from rest at 0 after moves that nobody recorded, and answers with one line of JSON: the record that it wrote and what is
left of its limits, or why it did not run. log.jsonl keeps every answer. The limits are kept here, whatever limits.json
says.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from studies.blind_trial.sealer.machines import cases
from studies.blind_trial.sealer.machines.cases import Bench, Plan
from studies.blind_trial.sealer.machines.motions import Schedule
from studies.blind_trial.sealer.machines.specifying import specification
from studies.blind_trial.sealer.machines.writing import disabled, table

Array = NDArray[np.float64]

COLUMNS: Final = "time_s,target_m,reference_m,feedforward_N"
SECONDS: Final = 90.0  # of machine time
RECORDS: Final = 6
SHORTEST: Final = 100  # samples of a run
FIRST: Final = 1000  # from a case's seed to that of its first run
GAINS: Final = {"kp": "kp_N_per_m", "ki": "ki_N_per_ms", "kd": "kd_Ns_per_m", "tau": "derivative_filter_s"}
LATEST: Final = 1000  # samples by which a reference may wait
MOST: Final = 1e20  # of any gain, SI


@dataclass(frozen=True)
class Limits:
    """What a run may ask for: the largest distance from 0 [m], speed [m/s] and feedforward [N]; and what all runs may
    take together: machine time [s] and records."""

    distance: float
    speed: float
    feedforward: float
    machine_time: float = SECONDS
    records: int = RECORDS

    def to_json(self) -> dict[str, float]:
        """With units."""
        return {
            "distance_m": self.distance,
            "speed_m_per_s": self.speed,
            "feedforward_N": self.feedforward,
            "machine_time_s": self.machine_time,
            "records": self.records,
        }


@dataclass(frozen=True)
class Used:
    """What has been taken of the machine time [s] and the records."""

    machine_time: float = 0.0
    records: int = 0


@dataclass(frozen=True)
class Another:
    """A controller to run with in place of the machine's own: gains of a plain PID (SI), samples that its reference
    waits."""

    gains: Mapping[str, float]
    delay: int


class RefusedError(ValueError):
    """A request that the machine does not run."""


def limits_of(bench: Bench) -> Limits:
    """Those of the experiment with which the machine was found fit to run, and its thrust with what friction needs."""
    axis = bench.axis
    return Limits(
        max(float(np.abs(one.reference).max()) for one in bench.schedules),
        max(float(np.abs(np.diff(one.reference)).max()) for one in bench.schedules) / axis.sample_time,
        cases.RESERVE * axis.rated,
    )


def read(path: Path, sample_time: float) -> Schedule:
    """The references in a table. Raises RefusedError."""
    try:
        with path.open(encoding="utf-8") as file:
            head = file.readline().strip()
            if head != COLUMNS:
                raise RefusedError(f"{path}: begins with {head[:60]!r}; give the columns {COLUMNS}")
            rows = np.loadtxt(file, delimiter=",", ndmin=2)
    except (OSError, UnicodeDecodeError, ValueError) as error:
        if isinstance(error, RefusedError):
            raise
        raise RefusedError(f"{path}: cannot be read as a table of numbers ({error})") from error
    if rows.shape[0] < SHORTEST or rows.shape[1] != 4 or not np.all(np.isfinite(rows)):
        raise RefusedError(f"{path}: must have four finite numbers in each of {SHORTEST} rows at least")
    if np.abs(np.diff(rows[:, 0]) - sample_time).max() > 1e-3 * sample_time:
        raise RefusedError(f"{path}: must have one row every {sample_time:g} s")
    return Schedule(rows[:, 1], rows[:, 2], rows[:, 3], ())


def requested(line: str) -> tuple[Path, Path | None]:
    """The table that a line asks for, and the controller file to run it with. Raises RefusedError."""
    if not line.lstrip().startswith("{"):
        return Path(line.strip()), None
    try:
        content = json.loads(line)
        return Path(content["references"]), Path(content["controller"]) if content.get("controller") else None
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise RefusedError('a request must be a path, or {"references": PATH, "controller": PATH}') from error


def another(path: Path, sample_time: float) -> Another:
    """The controller in a controller.json. Raises RefusedError for any but a plain PID at the machine's sample time."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        pid, delay = content["pid"], int(content["reference_delay_samples"])
        found = {name: float(pid[key]) for name, key in GAINS.items()}
        its_time = float(content["sample_time_s"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise RefusedError(f"{path}: cannot be read as a controller.json with a PID ({error})") from error
    plain = "law" not in content and all(
        pid.get(f"{name}_weight", 1.0) == 1.0 for name in ("proportional", "derivative")
    )
    if not plain:
        raise RefusedError(f"{path}: its feedback must be a plain PID, the only one that this machine can be given")
    if not (abs(its_time - sample_time) <= 1e-6 * sample_time and 0 <= delay <= LATEST):
        raise RefusedError(f"{path}: must run every {sample_time:g} s, its reference 0 to {LATEST} samples late")
    if not all(0.0 <= gain < MOST for gain in found.values()):
        raise RefusedError(f"{path}: a gain is negative, not finite or beyond {MOST:g}")
    return Another({"kind": 0.0, "b": 1.0, "c": 1.0, **found}, delay)


def require(asked: Schedule, limits: Limits, used: Used, sample_time: float) -> None:
    """Raises RefusedError for a run beyond the limits, of which `used` is taken."""
    seconds = asked.target.size * sample_time
    way = np.abs(np.diff(np.concatenate([[0.0], asked.reference])))
    for name, wanted, most, unit in (
        ("records", used.records + 1, limits.records, ""),
        ("machine time", used.machine_time + seconds, limits.machine_time, " s"),
        ("distance", float(np.abs(np.concatenate([asked.reference, asked.target])).max()), limits.distance, " m"),
        ("speed", float(way.max()) / sample_time, limits.speed, " m/s"),
        ("feedforward", float(np.abs(asked.feedforward).max()), limits.feedforward, " N"),
    ):
        if wanted > most * (1 + 1e-6):
            raise RefusedError(f"{name}: {wanted:.4g}{unit} is beyond the limit of {most:.4g}{unit}")


def serve(found: Plan, folder: Path, requests: Iterable[str], tell: Callable[[str], None]) -> Used:
    """Runs what is asked, one request a line, and tells one line of JSON each; what was taken in the end."""
    limits, used, ts = limits_of(found.bench), Used(), found.bench.axis.sample_time
    nominal = found.bench.axis.nominal("sealed machine") | {"specification": specification(found)}
    (folder / "nominal.json").write_text(json.dumps(nominal, indent=1) + "\n", encoding="utf-8")
    disabled(folder, found)
    (folder / "limits.json").write_text(json.dumps(limits.to_json(), indent=1) + "\n", encoding="utf-8")
    with (folder / "log.jsonl").open("x", encoding="utf-8") as log:
        for line in requests:
            answer: dict[str, Any] = {"asked": line.strip()}
            try:
                path, controller = requested(line)
                asked, other = read(path, ts), None if controller is None else another(controller, ts)
                require(asked, limits, used, ts)
                used = Used(used.machine_time + asked.target.size * ts, used.records + 1)
                answer["record"] = _ran(found, folder, asked, used.records, other)
            except RefusedError as error:
                answer["refused"] = str(error)
            except ArithmeticError as error:
                answer["tripped"] = f"{error}; the machine time is spent"
            answer["left"] = {
                "machine_time_s": limits.machine_time - used.machine_time,
                "records": limits.records - used.records,
            }
            log.write(json.dumps(answer) + "\n")
            log.flush()
            tell(json.dumps(answer))
    return used


def _ran(found: Plan, folder: Path, asked: Schedule, number: int, other: Another | None) -> str:
    """The record of a run that the machine can do, as the path of its table."""
    path = folder / f"record-{number}.csv"
    seed = found.seed + FIRST + number
    log = found.run(asked, seed) if other is None else found.run(asked, seed, other.gains, other.delay)
    path.write_text(table(found.bench.axis.sample_time, asked, log), encoding="utf-8")
    return str(path)


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs a sealed machine; exit status 0, or 2 with one line for a folder or a first line that can't be used."""
    parser = argparse.ArgumentParser(
        prog="studies.blind_trial.sealer.on_request", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "--folder", type=Path, required=True, metavar="FOLDER", help="new or empty; the records go there"
    )
    folder = parser.parse_args(arguments).folder
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        print(f"error: --folder {folder}: is not an empty folder; a machine starts once only", file=sys.stderr)
        return 2
    numbers = sys.stdin.readline().split()
    if len(numbers) != 2 or not all(one.isdecimal() for one in numbers):
        print('error: the first line must be "SEED CASE", two whole numbers from 0 on', file=sys.stderr)
        return 2
    folder.mkdir(parents=True, exist_ok=True)
    found = cases.plan(int(numbers[0]), int(numbers[1]), "sealed")
    serve(found, folder, iter(sys.stdin.readline, ""), lambda text: print(text, flush=True))
    return 0


if __name__ == "__main__":
    sys.exit(main())
