"""An axis of another kind, whose presliding needs many elements: 12 kg, 4 kHz, a cascade, 8 N of rolling friction."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from models.friction import Friction, elements
from models.machine import FROM_ELEMENTS, Machine, Specification, with_derived_presliding
from tests.models.feedback.axis import axis

FORCE, LENGTH, REACH = 8.0, 13e-6, 97.5e-6  # the virgin curve is FORCE (1 - exp(-x / LENGTH)), up to REACH


def exponential(count: int) -> Friction:
    """That curve as elements, which slip where its slope changes."""
    limit = np.geomspace(LENGTH / 20, REACH, count)
    slope = np.diff(1 - np.exp(-np.append(0, limit) / LENGTH)) / np.diff(np.append(0, limit))
    stiffness = slope - np.append(slope[1:], 0.0)
    return elements(stiffness * FORCE / (stiffness @ limit), limit)


def rolling_axis(
    stated: int | Literal["auto"] = "auto", *, count: int = 80, tolerance: float = 0.5e-6, in_time: float = 12e-3
) -> Machine:
    """The axis with so many friction elements; short strokes of 20 um, x_T* at rest after 8 ms."""
    machine = axis()
    machine = replace(
        machine,
        friction=exponential(count),
        presliding=FROM_ELEMENTS,
        control=replace(machine.control, compensator_elements=stated),
        specification=Specification(20e-6, tolerance, in_time, 8e-3, interval=0.1, motions=3),
    )
    return with_derived_presliding(machine)
