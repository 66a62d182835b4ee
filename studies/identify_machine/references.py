"""Writes what to run on an axis so that it can be identified and diagnosed, as records without command and position."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from diagnosis.experiments.references import FILE_NAMES, axis_references
from diagnosis.experiments.schedules import Schedule, to_csv
from models.machine import Machine, to_json
from models.quantity import show
from studies.command import DONE, to_text
from studies.effort import LOG_LENGTH_RATIO, more_samples
from studies.folder import Place, atomic_folder, require_free
from studies.gap_diagnosis.options import MOST_SAMPLES
from studies.identify_machine.options import IdentificationOptions
from studies.manifest import FORMAT, hashes, versions
from studies.study import machine_for

WRITER: Final = "identify_machine --write-references"


def write(options: IdentificationOptions) -> int:
    """Writes the references for the options' machine as records (CSV, SI) and returns the exit status.

    Raises BadInputError for a machine file that can't be used and where other people's files are in the way.
    """
    assert options.write_references is not None
    place = Place(options.write_references, WRITER, (*FILE_NAMES, "manifest.json"), overwrite=options.overwrite)
    require_free(place)
    machine, _ = machine_for(options)
    planned = axis_references(machine)
    with atomic_folder(place) as folder:
        for name, one in planned.items():
            (folder / name).write_text(to_csv(one, machine.sample_time), encoding="utf-8")
        inputs = {"machine": to_json(machine)}
        record = {"format": FORMAT, "study": WRITER, "options": {}, "inputs": inputs, "versions": versions()}
        (folder / "manifest.json").write_text(to_text({**record, "outputs": hashes(folder)}), encoding="utf-8")
    for name, one in planned.items():
        print(f"{name:<16}{_extent(one, machine)}")
    print(_room(tuple(planned.values()), machine))
    rows = [planned[name].target.size for name in ("strokes.csv", "suite.csv")]
    if more := more_samples(machine, rows[0], math.ceil(LOG_LENGTH_RATIO * rows[1]), 1, MOST_SAMPLES):
        print(f"for a diagnosis of the records of strokes.csv and suite.csv, {more}")
    print(
        "check that these travels and forces are safe on your axis; record command and position beside the references"
    )
    print("written:", *(str(place.folder / name) for name in (*FILE_NAMES, "manifest.json")))
    return DONE


def _room(planned: Sequence[Schedule], machine: Machine) -> str:
    """Where the axis has to stand for them, and what a stated spring takes on the way, for a reader."""
    paths = [one.given.position - one.given.position[0] for one in planned]
    low, high = min(float(np.min(path)) for path in paths), max(float(np.max(path)) for path in paths)
    ends = " and ".join(show(end + 0.0, machine.unit("m")) for end in (low, high))
    said = f"each begins where the axis stands then, as 0, and together they reach {ends}: start each where it has room"
    pull = sum(effect.spring_to_ground() for effect in machine.effects) * max(-low, high)
    return f"{said}; the stated spring takes up to {show(pull, machine.unit('N'))} beside u_ff" if pull > 0 else said


def _extent(planned: Schedule, machine: Machine) -> str:
    """How long, how far and with which force a schedule runs, for a reader."""
    force = float(np.max(np.abs(planned.given.feedforward)))
    time, path = planned.target.size * machine.sample_time, planned.given.position
    ends = " to ".join(show(float(end) + 0.0, machine.unit("m")) for end in (np.min(path), np.max(path)))
    return f"{show(time, 's')}, from {ends}, u_ff up to {show(force, machine.unit('N'))}"
