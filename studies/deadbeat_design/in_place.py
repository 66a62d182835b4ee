"""What the drive does without this design: the feedback in place, whose reference is the target's step itself."""

from __future__ import annotations

import math
from collections.abc import Mapping
from statistics import median
from typing import Any, Final

from design.validation import Validation, validate
from models.machine import Machine
from models.quantity import show

LATER_RATIO: Final = 1.1  # times what a simpler controller takes, from which on a design is called later


def beside_in_place(machine: Machine, judged: Validation, stroke: float, seed: int) -> dict[str, Any]:
    """The same motions by the feedback as the machine file states it, with its own way of taking a reference, and
    whether the design that was judged settles later than both this and the specification ask for, in its slowest motion
    or in the median; times in s, inf for never. A drive that makes a profile of the target settles otherwise: its
    records show that."""
    found = validate(machine, machine.feedback_only(), stroke=stroke, seed=seed)
    bare, designed = _slowest_and_median(found), _slowest_and_median(judged)
    in_time = machine.specification.settling_time
    later = [name for name in bare if designed[name] > max(LATER_RATIO * bare[name], in_time)]
    return {
        "settling_s": [one.settling_time for one in found.achieved],
        "dispersion_m": found.worst_dispersion,
        **{f"{name}_s": time for name, time in bare.items()},
        **{f"design_{name}_s": time for name, time in designed.items()},
        "later": later,
    }


def _slowest_and_median(judged: Validation) -> dict[str, float]:
    times = [one.settling_time for one in judged.achieved]
    return {"slowest": judged.slowest.settling_time, "median": median(times)}


def in_place_row(found: Mapping[str, Any]) -> tuple[str, str]:
    """A line for the terminal; a warning where the design is no improvement on what runs already."""
    said = f"slowest motion {_time(found['slowest_s'])}, median {_time(found['median_s'])}"
    if not found["later"]:
        return "feedback in place, a step as its reference, settles", said
    ours = f"{_time(found['design_slowest_s'])} and {_time(found['design_median_s'])}"
    advice = "do not put this design in its place before a record shows that it settles sooner"
    return "WARNING, feedback in place, a step as its reference", f"{said}; this design {ours}: {advice}"


def _time(time: float) -> str:
    return "never" if math.isinf(time) else show(time, "s")
