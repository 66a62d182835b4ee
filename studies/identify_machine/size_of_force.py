"""Whether the commands have the size that the machine file says: a wrong torque constant scales all that is found.

A response gives the mass over the force, and a replay the gains over the force, whatever the command's unit is. Where
the file knows either one beside the records, a wrong factor shows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from models.machine import Machine
from models.quantity import show
from models.records.checks import replay
from models.records.files import Loaded
from models.records.record import Record

KNOWN: Final = ("given", "datasheet", "paper")  # kinds of sources that know a mass beside the records
OTHER: Final = 1.5  # ratio from which on it is another mass, or another gain; payloads within it are usual
MIN_MASS_STDS: Final = 20.0  # deviations by the file's tolerance, which must be exceeded as well
IN_PROPORTION: Final = 0.1  # share of the feedback's changes that a constant factor may leave
CAUSES: Final = "a unit or a force constant of the command that is wrong by this factor"


def doubts(machine: Machine, found: Machine, records: Sequence[tuple[str, Loaded]]) -> list[tuple[str, str]]:
    """What looks as if the command's unit or force constant were wrong: what of, and a sentence with both numbers.

    machine: as its file has it; found: as identified; records: with their kinds [-].
    """
    return [*_of_mass(machine, found), *_of_gain(machine, records)]


def _of_mass(machine: Machine, found: Machine) -> Iterator[tuple[str, str]]:
    name = f"plant.modes.{machine.plant.rigid + 1}.gain"
    stated, source = machine.sources.get(name), found.sources.get(f"plant.modes.{found.plant.rigid + 1}.gain")
    if stated is None or stated.kind not in KNOWN or source is None or source.kind != "identified":
        return
    ratio, most = found.plant.mass / machine.plant.mass, max(OTHER, 1 + MIN_MASS_STDS * machine.tolerances.mass)
    if not 1 / most < ratio < most:
        shown, known = (show(one.plant.mass, machine.unit("kg"), 3) for one in (found, machine))
        yield (
            "mass",
            f"the records show {shown}, {ratio:.3g} times the {known} that the machine file states ({stated.kind}): "
            f"{CAUSES}, or another payload",
        )


def _of_gain(machine: Machine, records: Sequence[tuple[str, Loaded]]) -> Iterator[tuple[str, str]]:
    for _, one in records:
        record = one.content
        if not isinstance(record, Record) or not {"reference", "target"} & set(one.given):
            continue
        if (gain := proportion(machine, record)) is not None and not 1 / OTHER < gain < OTHER:
            yield (
                f"gain of {one.name}",
                f"the logged command is {gain:.3g} times what the stated feedback computes: {CAUSES}, or gains of "
                "[control] that are",
            )


def proportion(machine: Machine, record: Record) -> float | None:
    """How many times the stated feedback's command [1] the logged one is beside the feedforward, by its changes; None
    where they are not in proportion."""
    made = replay(record, machine.control.feedback, machine.control.reference_delay) - record.feedforward
    quarter = record.command.size // 4  # in which the law may still swing in
    shown, logged = np.diff(made)[quarter:], np.diff(record.command - record.feedforward)[quarter:]
    power = float(shown @ shown)
    if not 0 < power < np.inf or not np.any(logged):
        return None
    gain = float(logged @ shown) / power
    left = float(np.std(logged - gain * shown)) / max(float(np.std(logged)), 1e-300)
    return gain if gain > 0 and left < IN_PROPORTION else None
