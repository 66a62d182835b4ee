"""Tables of the set: their unpublished parameters, and their entries in an ensemble file."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.friction import branch
from models.machine import Machine
from studies.response_variation.search import RANGES, Range

Array = NDArray[np.float64]

ZERO_OUTCOME: Final = 1e-12  # Stands for an outcome of none [s], [m],
NEVER_SETTLED: Final = 1e3  # and for that of a motion that never settles.
_SEARCHED: Final = {one.name: one for one in RANGES}
# The three gains stand for the four numbers that the search draws them from.
COORDINATES: Final = (
    *(_SEARCHED[name] for name in ("mass", "stand", "load", "damping_1", "damping_2", "dead_time")),
    Range("kp", 0.25e6, 8e6, "N/m", "proportional gain"),
    Range("ki", 1e7, 5e8, "N/(m s)", "integral gain"),
    Range("kd", 2e3, 3e4, "N s/m", "derivative gain"),
    *(_SEARCHED[name] for name in ("derivative_filter", "slope_1", "slope_2", "smallest", "largest", "shape")),
)


def coordinates(machine: Machine) -> Array:
    """The unpublished parameters (len(COORDINATES),) of a table, in the units that COORDINATES give, such as [kg]."""
    plant = machine.plant
    stand, load = (plant.modes[i] for i in plant.flexible)
    moved = plant.thrust_constant * plant.mass  # the gains are per newton of thrust, the mass of thrust reference
    ratio = load.gain * moved
    pid, friction, facts = machine.control.pid, machine.friction, machine.presliding
    limits = np.array(friction.limit)
    forces = limits * np.array(friction.stiffness)
    climbed = float(branch(friction, facts.boundary))
    end = 2 * float(limits[-1])
    return np.array(
        [
            plant.mass,
            1 / (stand.gain * moved),
            ratio / (1 + ratio),
            stand.damping,
            load.damping,
            plant.dead_time,
            pid.kp,
            pid.ki,
            pid.kd,
            pid.derivative_filter,
            climbed / facts.boundary,
            (2 * friction.coulomb_force - climbed) / (end - facts.boundary),
            limits[0],
            limits[-2],
            np.polyfit(np.log(limits[:-1]), np.log(forces[:-1]), 1)[0],
        ]
    )


def most_central(machines: Sequence[Machine], outcomes: ArrayLike) -> int:
    """The index of the medoid: the table with the least sum of distances to the others.

    Distances are those of the logarithms of the unpublished parameters and of the outcomes (len(machines), m), each in
    units of its deviation over the tables: central in parameters and in behaviour.
    """
    points = np.hstack(
        [logarithms(machines), np.log(np.clip(np.asarray(outcomes, float), ZERO_OUTCOME, NEVER_SETTLED))]
    )
    deviation = np.std(points, axis=0)
    points = points / np.where(deviation > 0, deviation, 1.0)
    apart = np.linalg.norm(points[:, None] - points[None], axis=2)
    return int(np.argmin(np.sum(apart, axis=1)))


def logarithms(machines: Sequence[Machine]) -> Array:
    """Natural logarithms of the unpublished parameters (machines, len(COORDINATES)); one that is zero, such as ki,
    counts as a thousandth of the least that the search draws."""
    least = [one.low / 1000 for one in COORDINATES]
    return np.asarray(np.log(np.maximum([coordinates(machine) for machine in machines], least)))


def spread(values: Array, searched: Range) -> dict[str, Any]:
    """The central 90 % range of the values, and its share [1] of the range searched, on the logarithm."""
    low, middle, high = np.quantile(values, [0.05, 0.5, 0.95])
    least = searched.low / 1000  # stands for zero, of which there is no logarithm
    share = float(np.log(max(high, least) / max(low, least)) / np.log(searched.high / searched.low))
    word = "pinned down" if share < 1 / 3 else ("narrowed" if share < 2 / 3 else "left open")
    return {"quantile_05": low, "median": middle, "quantile_95": high, "share": share, "word": word}


def texts(machine: Machine) -> dict[str, str | list[str]]:
    """A table's entries in an ensemble file: dotted names of the values that differ, as text with a unit."""
    said: dict[str, str | list[str]] = {
        "plant.dead_time": f"{machine.plant.dead_time!r} s",
        "friction.stiffness": [f"{k!r} N/m" for k in machine.friction.stiffness],
        "friction.limit": [f"{x!r} m" for x in machine.friction.limit],
        "friction.damping": [f"{d!r} N s/m" for d in machine.friction.damping],
    }
    for i, mode in enumerate(machine.plant.modes, start=1):
        said[f"plant.modes.{i}.gain"] = f"{mode.gain!r} 1/kg"
        said[f"plant.modes.{i}.damping"] = f"{mode.damping!r}"
    pid = machine.control.pid
    gains = {"kp": "N/m", "ki": "N/(m s)", "kd": "N s/m", "derivative_filter": "s"}
    said |= {f"control.pid.{name}": f"{getattr(pid, name)!r} {unit}" for name, unit in gains.items()}
    return said
