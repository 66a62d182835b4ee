"""The range of force and speed that records have shown of a machine, and what a design asks for beyond it.

What was identified or diagnosed from records of small moves holds for small moves: a saturation of the amplifier that
was seen up to 46 N says little about 89 N.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from design.validation import Validation
from models.machine import Machine, Provenance
from models.machines.parts import Covered
from models.records.record import Record

RANGE_MARGIN: Final = 0.05  # A design within so much of the range asks for nothing new.
SPEED_SAMPLES: Final = 10  # samples over which a speed is taken, so that the scale's steps do not make it


@dataclass(frozen=True)
class Excess:
    """What a design needs beyond the records: `what` in `unit`, how much (`needed`) and how much they cover, SI."""

    what: str
    unit: str
    needed: float
    covered: float


def covered_by(records: Sequence[Record], rated_thrust: float) -> Covered | None:
    """The largest force [N] and speed [m/s] in the records; commands count up to the rated thrust [N].

    None without records of motion, or where nothing moves in them.
    """
    force = max((float(np.nanmax(np.abs(one.command))) for one in records), default=0.0)
    speed = max((_speed(one) for one in records), default=0.0)
    return Covered(min(force, rated_thrust), speed) if force > 0 and speed > 0 else None


def with_covered(machine: Machine, records: Sequence[Record], source: str) -> Machine:
    """The machine with the range [N], [m/s] of the records that its values are from; `source` says which they are."""
    covered = covered_by(records, machine.drive.rated_thrust)
    if covered is None:
        return machine
    said = Provenance("identified", source)
    return machine.with_part("covered", covered, {"force": said, "speed": said})


def excess(machine: Machine, force: float, speed: float) -> tuple[Excess, ...]:
    """What of a force [N] and a speed [m/s] that a design needs is beyond the machine's records; empty without them."""
    if machine.covered is None:
        return ()
    asked = (("force", "N", force, machine.covered.force), ("speed", "m/s", speed, machine.covered.speed))
    return tuple(Excess(*one) for one in asked if one[2] > one[3] * (1 + RANGE_MARGIN))


def excess_of(validation: Validation) -> tuple[Excess, ...]:
    """What the motions of a validation need [N], [m/s] beyond the records of its machine."""
    machine = validation.machine
    speed = float(np.max(np.abs(np.diff(validation.response.record.reference)))) / machine.sample_time
    return excess(machine, min(validation.peak_thrust, machine.drive.rated_thrust), speed)


def excess_to_json(design: str, found: Sequence[Excess]) -> list[dict[str, Any]]:
    """Rows for results.json: which design, what it needs and what the records cover (SI)."""
    return [{"design": design, **vars(one)} for one in found]


def _speed(record: Record) -> float:
    """The largest speed [m/s] over SPEED_SAMPLES samples."""
    apart = min(SPEED_SAMPLES, record.position.size - 1)
    if apart < 1:
        return 0.0
    moved = np.abs(record.position[apart:] - record.position[:-apart])
    return float(np.nanmax(moved)) / (apart * record.sample_time)
