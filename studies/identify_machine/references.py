"""Writes what to run on an axis so that it can be identified and diagnosed, as records without command and position."""

from __future__ import annotations

from typing import Final

import numpy as np

from diagnosis.experiments.references import NAMES, axis_references
from diagnosis.experiments.schedules import Schedule, to_csv
from models.machine import Machine, to_json
from models.quantity import show
from studies.command import DONE, to_text
from studies.folder import Place, atomic_folder, require_free
from studies.identify_machine.options import IdentificationOptions
from studies.manifest import FORMAT, hashes, versions
from studies.study import machine_for

WRITER: Final = "identify_machine --write-references"


def write(options: IdentificationOptions) -> int:
    """Writes the references for the options' machine as records (CSV, SI) and returns the exit status.

    Raises BadInputError for a machine file that can't be used and where other people's files are in the way.
    """
    assert options.write_references is not None
    place = Place(options.write_references, WRITER, (*NAMES, "manifest.json"), overwrite=options.overwrite)
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
    print(
        "check that these travels and forces are safe on your axis; record command and position beside the references"
    )
    print("written:", *(str(place.folder / name) for name in (*NAMES, "manifest.json")))
    return DONE


def _extent(planned: Schedule, machine: Machine) -> str:
    """How long, how far and with which force a schedule runs, for a reader."""
    force = float(np.max(np.abs(planned.given.feedforward)))
    time, path = planned.target.size * machine.sample_time, planned.given.position
    ends = " to ".join(show(float(end) + 0.0, machine.unit("m")) for end in (np.min(path), np.max(path)))
    return f"{show(time, 's')}, from {ends}, u_ff up to {show(force, machine.unit('N'))}"
