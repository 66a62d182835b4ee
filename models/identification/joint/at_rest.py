"""What the scale adds to a position, which every record shows while its axis rests."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.identification.joint.steps import Identified
from models.machine import Machine, Provenance
from models.quantity import show
from models.records.checks import scatter_at_rest
from models.records.files import Loaded
from models.records.record import Record

Array = NDArray[np.float64]

MIN_NOISE_STEPS: Final = 0.1  # of a step: less noise is lost in the rounding, which then is no noise either


def with_noise(found: Identified, records: Sequence[Loaded]) -> Identified:
    """The machine with the noise of its scale as the records show it at rest, where its file only assumes one or
    has 0, which means that none is known.

    The deviation of a reading from sample to sample less that of the rounding, the median over the records; as its
    standard deviation how far the records are apart, a tenth of it at least.
    """
    machine = found.machine
    source = machine.sources.get("scale.noise")
    if machine.scale.noise > 0 and (source is None or source.kind != "assumed"):
        return found
    shown = [(noise, one) for one in records if (noise := _noise(one, machine)) is not None]
    if not shown:
        return found
    values = np.array([noise for noise, _ in shown])
    noise, std = float(np.median(values)), max(float(np.std(values)), 0.1 * float(np.median(values)))
    nearest = min(shown, key=lambda one: abs(one[0] - noise))[1]
    by = Provenance("identified", "reading at rest", record=nearest.name, sha256=nearest.sha256, std=std)
    told = (
        f"At rest the reading has a noise of {show(noise, 'm', 2)} beside its rounding ({_of(values)}); the machine "
        "file has it."
    )
    return replace(found, machine=machine.with_value("scale.noise", noise, by), of_all=(*found.of_all, told))


def _of(values: Array) -> str:
    """How many records show it, and how far apart."""
    if values.size == 1:
        return "one record rests for long enough"
    return f"{values.size} records show {show(float(values.min()), 'm', 2)} to {show(float(values.max()), 'm', 2)}"


def _noise(loaded: Loaded, machine: Machine) -> float | None:
    """The noise before rounding [m] that a record shows at rest, if any."""
    if not isinstance(loaded.content, Record):
        return None
    scatter, step = scatter_at_rest(loaded.content), machine.scale.resolution
    if scatter is None:
        return None
    variance = scatter**2 - step**2 / 12
    return math.sqrt(variance) if variance > (MIN_NOISE_STEPS * step) ** 2 else None
