"""The records of a diagnosis: read, and refused in one line where they can't be diagnosed."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from diagnosis.model.motions import pieces
from models.machine import Machine
from models.quantity import show
from models.records.checks import RecordError, derivative_of_error, quantisation
from models.records.files import Loaded, load
from models.records.record import Record
from studies.gap_diagnosis.options import DiagnosisOptions
from studies.options import BadInputError
from studies.record_columns import columns_of

SHORTEST: Final = 1000  # samples of all records together
FEWEST: Final = 6  # motions: some have to be left out to judge what was fitted on the others
SAME_TIME: Final = 1e-3  # by which a record's sample time may differ from the machine's
STILL: Final = 5.0  # steps of the scale within which nothing counts as moved
SAME_MASS: Final = 1.3  # ratio of the masses that two records show, above which they are of two machines
ROLLING: Final = 5e-3  # m/s, above which an axis has left the presliding region behind
SHOWN: Final = 0.8  # of a command's variance that inertia has to explain for a mass to be read from it


def loaded(machine: Machine, options: DiagnosisOptions) -> tuple[Loaded, ...]:
    """The records that were given. Raises BadInputError for one that can't be read or diagnosed."""
    columns, control = columns_of(machine, options.column), machine.control
    found = []
    for path in options.record:
        try:
            one = load(
                path,
                columns,
                sample_time=machine.sample_time,
                mass=machine.plant.mass,
                pid=control.pid,
                reference_delay=control.reference_delay,
                limit=machine.drive.rated_thrust,
            )
        except RecordError as error:
            raise BadInputError(str(error)) from error
        if not isinstance(one.content, Record):
            raise BadInputError(
                f"{path}: is a frequency response; a diagnosis needs records over time (identify_machine takes it)"
            )
        _check_time(path, one.content, machine)
        if columns.derivative == "position":
            one = replace(one, content=derivative_of_error(one.content, control.pid, control.reference_delay))
        found.append(one)
    check([one.content for one in found if isinstance(one.content, Record)], options.record)
    return tuple(found)


def disabled(names: Sequence[str], machine: Machine) -> tuple[str, ...]:
    """The effects of --disable. Raises BadInputError for one that is not looked for in this machine."""
    known = list(machine.kinds)
    for name in names:
        if name not in known:
            close = difflib.get_close_matches(name, known, n=1, cutoff=0.5)
            hint = f"did you mean {close[0]}?" if close else f"known: {', '.join(known)}"
            raise BadInputError(f"--disable {name}: is no effect that is looked for; {hint}")
    return tuple(names)


def _check_time(path: Path, record: Record, machine: Machine) -> None:
    if abs(record.sample_time / machine.sample_time - 1) > SAME_TIME:
        raise BadInputError(
            f"{path}: is sampled every {show(record.sample_time, 's')}, and the machine's controller runs every "
            f"{show(machine.sample_time, 's')}; give the machine file of this record, or a record of this machine"
        )


def check(records: Sequence[Record], paths: Sequence[Path]) -> None:
    """Raises BadInputError for records in which nothing moves, which are too short, or not of one machine."""
    samples = sum(record.position.size for record in records)
    if samples < SHORTEST:
        raise BadInputError(
            f"{_named(paths)}: {samples} samples are too short for a diagnosis; give {SHORTEST} or more, with several "
            "motions"
        )
    if not any(_moves(record) for record in records):
        raise BadInputError(
            f"{_named(paths)}: nothing moves; a diagnosis needs motions, such as the references in suite.csv that "
            "this study writes without records"
        )
    count = len(pieces(records))
    if count < FEWEST:
        raise BadInputError(
            f"{_named(paths)}: {count} motion{'s are' if count > 1 else ' is'} too few, some have to be left out to "
            f"judge what the others show; give {FEWEST} or more"
        )
    _check_one_machine(records, paths)


def _named(paths: Sequence[Path]) -> str:
    return ", ".join(str(path) for path in paths)


def _moves(record: Record) -> bool:
    step = quantisation(record.position) or 1e-9
    return bool(np.ptp(record.position) > STILL * step and (np.ptp(record.reference) > 0 or np.ptp(record.command) > 0))


def _check_one_machine(records: Sequence[Record], paths: Sequence[Path]) -> None:
    """That the scale's steps agree, and the masses where the records show them."""
    steps = [(quantisation(record.position), path) for record, path in zip(records, paths, strict=True)]
    known = [(step, path) for step, path in steps if step > 0]
    for step, path in known[1:]:
        if not 0.99 < step / known[0][0] < 1.01:
            raise BadInputError(
                f"{known[0][1]} and {path} are of two machines: their scales have steps of "
                f"{show(known[0][0], 'm')} and {show(step, 'm')}; diagnose each with its own machine file"
            )
    masses = [(mass, path) for record, path in zip(records, paths, strict=True) if (mass := shown_mass(record))]
    for mass, path in masses[1:]:
        if not 1 / SAME_MASS < mass / masses[0][0] < SAME_MASS:
            raise BadInputError(
                f"{masses[0][1]} and {path} are of two machines: their commands move {show(masses[0][0], 'kg', 3)} and "
                f"{show(mass, 'kg', 3)}; diagnose each with its own machine file"
            )


def shown_mass(record: Record) -> float | None:
    """The mass [kg] that inertia shows in a record, by least squares over smoothed signals where the axis rolls; None
    where friction hides it."""
    width = np.hanning(42)[1:-1] / np.sum(np.hanning(42))
    place, force = (np.convolve(signal, width, "valid") for signal in (record.position, record.command))
    speed = np.gradient(place, record.sample_time)
    rolls = np.abs(speed) > max(ROLLING, 0.05 * float(np.max(np.abs(speed))))
    if np.count_nonzero(rolls) < 100:
        return None
    bend = np.gradient(speed, record.sample_time)[rolls]
    columns, force = np.column_stack([bend, np.sign(speed[rolls]), np.ones(bend.size)]), force[rolls]
    weights = np.linalg.lstsq(columns, force, rcond=None)[0]
    inertia, left = float(np.std(weights[0] * bend)), float(np.std(force - columns @ weights))
    return float(weights[0]) if inertia**2 > SHOWN * (inertia**2 + left**2) else None
