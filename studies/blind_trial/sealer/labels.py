"""What the labels of cases on the one table and on drawn machines share, and how an effect is sized to its distance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

IDENTIFIABLE: Final = 30.0  # from this distance on, an effect has to be found
REPLAYED: Final = "controller_mismatch"  # seen in the command itself, not through the table
NEAR: Final = 1 / 6  # of the distance that is aimed at
PARAMETERS: Final = (
    "payload_mass",
    "thrust_constant",
    "dead_time",
    "mode_frequency",
    "mode_damping",
    "friction_level",
    "presliding_stiffness",
    "amplifier_offset",
)


@dataclass(frozen=True)
class Told:
    """An effect as its label tells it: its size in a unit, what else was drawn, its functional form in words, and its
    distance [1] alone (None where only a replay of the controller shows it)."""

    name: str
    size: float
    unit: str
    shape: dict[str, float]
    form: str
    distance: float | None


def body(
    told: Sequence[Told],
    shift: Mapping[str, Any],
    parameters: Sequence[str],
    more: Mapping[str, Any],
    *,
    case: str,
    kind: str,
    severity: str,
) -> dict[str, Any]:
    """What is sealed of a case: its effects, how far the true values are off, which parameters are wrong, and `more`
    that the scorer needs."""
    visible = [one.distance is None or one.distance >= IDENTIFIABLE for one in told]
    return {
        "case": case,
        "name": [one.name for one in told],
        "kind": kind,
        "severity": severity,
        "identifiable": all(visible) and bool(visible),
        "parameters": list(parameters),
        "disabled": [one.name for one in told] if kind == "disabled" else [],
        **more,
        "effects": [asdict(one) for one in told],
        "nominal_shift": {name: np.asarray(number).tolist() for name, number in shift.items()},
    }


def near(far: float, goal: float) -> bool:
    """Whether a distance [1] is as near to the one that is aimed at as it needs to be."""
    return abs(far / goal - 1) < NEAR


def next_size(points: Sequence[tuple[float, float]], goal: float, low: float, high: float) -> float | None:
    """The size between `low` and `high`, in their unit, to try next for a distance `goal` [1], after pairs of size and
    distance in the order of size: along the power law through the outermost; None where it was tried already."""
    at, far = (np.log([point[i] for point in points]) for i in range(2))
    power = np.clip((far[-1] - far[0]) / (at[-1] - at[0]), 0.3, 3.0) if len(points) > 1 else 1.0
    best = int(np.argmin(np.abs(far - np.log(goal))))
    size = float(np.clip(np.exp(at[best] + (np.log(goal) - far[best]) / power), low, high))
    return None if any(abs(size / tried - 1) < 1e-3 for tried, _ in points) else size


def nearest(points: Sequence[tuple[float, float]], goal: float) -> tuple[float, float]:
    """The pair of size and distance [1] whose distance is the nearest to `goal`."""
    return min(points, key=lambda point: abs(np.log(point[1] / goal)))
