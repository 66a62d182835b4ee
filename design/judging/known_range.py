"""The range of force and speed that records have shown of a machine, and what a design asks for beyond it.

What was identified or diagnosed from records of small moves holds for small moves: a saturation of the amplifier that
was seen up to 46 N says little about 89 N.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.validation import Validation
from models.machine import Machine, Provenance
from models.machines.parts import Covered
from models.records.record import Record

Array = NDArray[np.float64]

RANGE_MARGIN: Final = 0.05  # A design within so much of the range asks for nothing new.
# Of the reference's settling time, over which a speed is taken, so that neither the scale's steps nor one of the
# reference make it.
SPEED_WINDOW_SHARE: Final = 0.25


@dataclass(frozen=True)
class Excess:
    """What a design needs beyond the records: `what` in `unit`, how much (`needed`) and how much they cover, SI."""

    what: str
    unit: str
    needed: float
    covered: float


def fastest(position: Array, sample_time: float, machine: Machine) -> float:
    """The largest speed [m/s] along positions (n,) [m] every `sample_time` [s], as the machine's motions show it."""
    window = SPEED_WINDOW_SHARE * machine.specification.reference_settling_time
    apart = min(max(round(window / sample_time), 1), position.size - 1)
    if apart < 1:
        return 0.0
    return float(np.nanmax(np.abs(position[apart:] - position[:-apart]))) / (apart * sample_time)


def covered_by(records: Sequence[Record], machine: Machine) -> Covered | None:
    """The largest force [N] and speed [m/s] in the machine's records; commands count up to its rated thrust.

    None without records of motion, or where nothing moves in them.
    """
    force = max((float(np.nanmax(np.abs(one.command))) for one in records), default=0.0)
    speed = max((fastest(one.position, one.sample_time, machine) for one in records), default=0.0)
    return Covered(min(force, machine.drive.rated_thrust), speed) if force > 0 and speed > 0 else None


def with_covered(machine: Machine, records: Sequence[Record], source: str) -> Machine:
    """The machine with the range [N], [m/s] of the records that its values are from; `source` says which they are."""
    covered = covered_by(records, machine)
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
    speed = fastest(validation.response.record.reference, machine.sample_time, machine)
    return excess(machine, min(validation.peak_thrust, machine.drive.rated_thrust), speed)


def excess_to_json(design: str, found: Sequence[Excess]) -> list[dict[str, Any]]:
    """Rows for results.json: which design, what it needs and what the records cover (SI)."""
    return [{"design": design, **vars(one)} for one in found]
