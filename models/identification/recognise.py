"""What a record shows, and so how it is identified: by its target, its feedforward and its inertial force."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.identification.force.linear import FEWEST
from models.identification.response import FrequencyResponse, period
from models.machine import Machine
from models.records.checks import derivative_of_error
from models.records.columns import Columns
from models.records.files import Loaded, known_of, load
from models.records.record import Record
from models.records.tables.sizes import LIMITS, Limits, RecordError

Array = NDArray[np.float64]

MAX_AVERAGING_S: Final = 0.05  # s over which a reading is averaged, and
MAX_AVERAGED_SHARE: Final = 0.1  # of the record at most
MIN_AVERAGED_SAMPLES: Final = 3  # samples
AWAY: Final = 0.1  # of the reading's scatter: what an average may take off it
NOISES: Final = 3.0  # of the scale's noise, below which what it takes off is that
# Of the command's scatter: a record whose inertial force is below shows friction alone.
MAX_SLOW_INERTIA_SHARE: Final = 0.05
OWN: Final = 0.5  # of an excitation's variance, that the reference's motion must leave of it
STRAIGHT: Final = (
    0.01  # of the way: by so much a reference of one speed may be off a straight line under the excitation
)


def read(
    machine: Machine, path: Path, columns: Columns | None = None, *, trusted: bool = False, limits: Limits = LIMITS
) -> Loaded:
    """The record or frequency response in a file [SI], checked against the machine that it is said to be of.

    columns: how the file calls its signals; by default as the machine file maps them. trusted: what makes a record
    implausible is said among the findings, instead of refusing it. limits: of the file's size. Raises RecordError.
    """
    return load(path, columns or machine.record, trusted=trusted, limits=limits, **known_of(machine))


def recognised(machine: Machine, loaded: Loaded) -> str:
    """Which of models.records.kinds.KINDS a file is [-].

    A file with frequencies is a response. One whose target steps is a motion; one with a feedforward that repeats and
    is not that of its motion, or that acts while the reference keeps its speed, an excitation; one whose inertial force
    stays below MAX_SLOW_INERTIA_SHARE of the command's scatter a hysteresis; any other shows the dynamics. Raises
    RecordError for a record that is too short to show which.
    """
    if isinstance(loaded.content, FrequencyResponse):
        return "response"
    record = loaded.content
    steps = np.count_nonzero(np.diff(record.target))
    if 0 < steps < record.target.size / 20:
        return "motion"
    if np.ptp(record.feedforward) > 0 and (_straight(record) or _repeats_beside_the_motion(record)):
        return "excitation"
    if record.position.size < FEWEST:
        raise RecordError(
            f"{loaded.name}: {record.position.size} samples are too few to tell slow loops from fast strokes; record "
            "for longer, or name its kind"
        )
    inertia = np.diff(_without_noise(record, machine), 2) / record.sample_time**2 / machine.plant.rigid_gain
    return "hysteresis" if np.std(inertia) < MAX_SLOW_INERTIA_SHARE * np.std(record.command) else "dynamics"


def _without_noise(record: Record, machine: Machine) -> Array:
    """The reading [m], or rad, averaged over as long as leaves the motion as it is: a short one would take the noise's
    acceleration for the table's, a long one averages a fast motion away."""
    noise = max(machine.scale.noise, machine.scale.resolution)
    moves = max(AWAY * float(np.std(record.position)), NOISES * noise)
    longest = min(round(MAX_AVERAGING_S / record.sample_time), round(MAX_AVERAGED_SHARE * record.position.size))
    width = max(longest, MIN_AVERAGED_SAMPLES)
    while True:
        smooth = np.convolve(record.position, np.hanning(width + 2)[1:-1] / np.sum(np.hanning(width + 2)), "valid")
        cut = (record.position.size - smooth.size) // 2
        if width == MIN_AVERAGED_SAMPLES or np.std(record.position[cut : cut + smooth.size] - smooth) < moves:
            return np.asarray(smooth)
        width = max(width // 2, MIN_AVERAGED_SAMPLES)


def replayable(machine: Machine, loaded: Loaded, kind: str, columns: Columns) -> Loaded:
    """A motion record [SI] as the controller of the machine file made it, which is replayed to identify from it: that
    controller takes the derivative of the error, and the one that ran may have taken the position's, as columns say.

    Other kinds are identified from command and position alone, and stay as they are.
    """
    control, record = machine.control, loaded.content
    if kind != "motion" or columns.derivative == "error" or not isinstance(record, Record):
        return loaded
    return replace(loaded, content=derivative_of_error(record, control.pid, control.reference_delay))


def _repeats_beside_the_motion(record: Record) -> bool:
    """Whether the feedforward repeats, and is not what acceleration, speed, friction and place of the reference ask for
    (in the least squares), as that of strokes that are repeated is."""
    if period(record.feedforward) is None:
        return False
    speed = np.gradient(record.reference)
    parts = np.column_stack([np.gradient(speed), speed, np.sign(speed), record.reference - record.reference[0]])
    parts = parts[:, np.ptp(parts, axis=0) > 0]
    parts = (parts - np.mean(parts, axis=0)) / np.maximum(np.std(parts, axis=0), 1e-300)
    wanted = record.feedforward - np.mean(record.feedforward)
    left = wanted - parts @ np.linalg.lstsq(parts, wanted, rcond=None)[0]
    return float(np.var(left)) > OWN * float(np.var(wanted))


def _straight(record: Record) -> bool:
    """Whether the reference stands still or moves at one speed while the feedforward acts, which then belongs to no
    motion; before, the axis may have started."""
    acts = np.flatnonzero(record.feedforward != record.feedforward[0])
    part = record.part(int(acts[0]), int(acts[-1]) + 1)
    line = np.linspace(part.reference[0], part.reference[-1], part.reference.size)
    away = float(np.max(np.abs(part.reference - line)))
    return away <= STRAIGHT * max(float(np.ptp(part.reference)), float(np.ptp(part.position)))
