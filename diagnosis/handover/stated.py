"""What is said of a model beside the names of its effects: its whole input delay, and which way friction is larger."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.model.fit import Fit, coordinate_of, coordinates
from diagnosis.which.table import covariance_of

MIN_DIRECTION_SHARE: Final = 0.25  # part of the whole difference between the directions that is not worth a word


@dataclass(frozen=True)
class InputDelay:
    """By how much a thrust acts later than its command [s]: the dead time, the lag of the current loop and the half
    sample of the hold, which at the frequencies of a motion are one quantity; deviation: of the fitted sum; delivered:
    the whole delay as the machine file has it."""

    dead_time: float
    lag: float
    hold: float
    deviation: float
    delivered: float

    def to_json(self) -> dict[str, float]:
        """As results.json has it."""
        total = self.dead_time + self.lag + self.hold
        parts = {"dead_time_s": self.dead_time, "lag_s": self.lag, "hold_s": self.hold}
        return {"total_s": total, "std_s": self.deviation, **parts, "delivered_s": self.delivered}


def input_delay(fitted: Fit, segment: NDArray[np.int64] | None = None) -> InputDelay:
    """The input delay [s] of a fit; segment: see `table.deviations_of`."""
    candidate = fitted.candidate
    along, begin, lag = np.zeros(candidate.layout.count + fitted.effect_jacobian.shape[1]), candidate.layout.count, 0.0
    along[candidate.layout.of("dead_time")] = 1.0
    for effect in candidate.effects:
        lag += effect.input_delay()
        if effect.delayed_by:
            along[begin + coordinate_of(effect, effect.delayed_by)] = effect.input_delay()  # slope over the logarithm
        begin += coordinates(effect).size
    dead, hold = candidate.machine.plant.dead_time, 0.5 * fitted.paths[0].path.sample_time
    variance = float(along @ covariance_of(fitted, segment) @ along)
    nominal = candidate.nominal
    stated = sum(effect.input_delay() for effect in nominal.effects)
    return InputDelay(dead, lag, hold, max(variance, 0.0) ** 0.5, nominal.plant.dead_time + stated + hold)


@dataclass(frozen=True)
class Direction:
    """Which way friction is larger, by how much [N] at the rms speed of the motions [m/s], the smaller way taken off
    the larger one, and what of it differs: "the contacts", "the drag" or "the whole friction"; effects: the names of
    those that make it so."""

    larger: str
    difference: float
    speed: float
    part: str
    effects: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """As results.json has it."""
        return {
            "larger": self.larger,
            "difference_N": self.difference,
            "speed_m_per_s": self.speed,
            "part": self.part,
            "effects": list(self.effects),
        }


def direction(fitted: Fit) -> Direction | None:
    """What the effects of a fit that differ by direction say (SI); None where there is none."""
    candidate = fitted.candidate
    effects = [one for one in candidate.effects if any(one.larger_forwards())]
    if not effects:
        return None
    machine, speed = candidate.machine, _rms([seen.path.speed for seen in fitted.residuals])
    contacts = float(np.dot(machine.friction.stiffness, machine.friction.limit))
    drag = sum(one.viscous_drag() for one in candidate.effects)
    asymmetry, further = (sum(sizes) for sizes in zip(*(one.larger_forwards() for one in effects), strict=True))
    parts = {
        "the contacts": 2 * asymmetry * contacts,
        "the drag": 2 * speed * (asymmetry * drag + further),
    }
    whole = sum(parts.values())
    alone = [name for name, size in parts.items() if abs(whole - size) < MIN_DIRECTION_SHARE * abs(whole)]
    larger = "forwards" if whole > 0 else "backwards"
    names = tuple(dict.fromkeys(one.name for one in effects))
    return Direction(larger, abs(whole), speed, alone[0] if alone else "the whole friction", names)


def _rms(parts: Sequence[NDArray[np.float64]]) -> float:
    return float(np.sqrt(np.mean(np.concatenate([part.ravel() for part in parts]) ** 2)))
