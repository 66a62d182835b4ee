"""How often the number of modes is right, and whether the stated deviations hold, over random axes."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from design.controller import design_deadbeat
from design.deadbeat import DesignError
from design.feasibility import require_designable
from models.identification import modes
from models.identification.modal.remarks import ResponseStep
from models.identification.pipeline import identify
from models.machine import Machine, MachineError, from_table
from models.machine_file import to_toml
from models.records.files import Loaded
from models.records.record import Record
from tests.coverage.axis import Axis, Log, drawn
from tests.coverage.records import first_file, multisine, sweep

Array = NDArray[np.float64]

MOST = 4  # modes of an axis


@dataclass(frozen=True)
class Result:
    """One axis identified from one record: its number, the modes that it has and that were found, the reduced
    chi-square, the pulls (error over stated deviation) [1] by parameter, if the order is right, and why a later study
    refuses the file that was written, "" if none does."""

    seed: int
    kind: str
    there: int
    found: int
    chi_square: float
    pulls: dict[str, float]
    refusal: str = ""


def record(axis: Axis, log: Log) -> Record:
    """A log as the project has it."""
    return Record(axis.sample_time, log.target, log.target, log.feedforward, log.command, log.position)


def tried(seed: int, kind: str) -> Result:
    """The axis of this seed, with seed modulo five modes, by a "multisine" or a "sweep".

    Raises RecordError, a ValueError, where the record is refused.
    """
    axis = drawn(seed, seed % (MOST + 1))
    log = multisine(axis, seed) if kind == "multisine" else sweep(axis, seed)
    loaded = Loaded(f"{kind}.csv", "none", record(axis, log), (), ())
    identified = identify(first_file(axis), [loaded], kinds=["excitation"])
    gave = identified.steps[0].gave
    assert isinstance(gave, ResponseStep)
    found = len(gave.fit.plant.modes) - 1
    right = found == axis.gain.size
    pulls = _pulls(axis, gave.fit) if right else {}
    return Result(seed, kind, axis.gain.size, found, gave.fit.chi_square, pulls, refused(identified.machine))


def refused(machine: Machine) -> str:
    """Why this machine's file can't be read, or no feedforward be designed for it; "" if it can."""
    try:
        read = from_table(tomllib.loads(to_toml(machine)), Path("identified.toml"))
        require_designable(read)
        design_deadbeat(read)
    except (MachineError, DesignError) as error:
        return str(error)
    return ""


def _pulls(axis: Axis, fit: modes.Fit) -> dict[str, float]:
    """A lag that the record does not show counts as dead time."""
    shown = modes.LAG in fit.estimate.names
    truth = {
        "rigid body gain": 1 / axis.mass,
        "dead time": axis.dead_time + (0.0 if shown else axis.lag),
        modes.LAG: axis.lag,
        modes.DRAG: axis.drag,
    }
    for i in range(axis.gain.size):
        each = (("gain", axis.gain), ("frequency", axis.frequency), ("damping", axis.damping))
        truth |= {f"mode {i + 2} {part}": float(values[i]) for part, values in each}
    e = fit.estimate
    return {name: (e.value(name) - truth[name]) / e.deviation(name) for name in e.names}


def by_parameter(results: list[Result]) -> dict[str, Array]:
    """All pulls (n,) [1] by parameter, those of all modes together."""
    found: dict[str, list[float]] = {}
    for one in results:
        for name, pull in one.pulls.items():
            group = f"mode {name.split()[-1]}" if name.startswith("mode") else name
            found.setdefault(group, []).append(pull)
    return {name: np.array(pulls) for name, pulls in found.items()}
