"""What a drive needs to learn its axis by itself: numbers of a controller.json's `learning`.

A bank of compensators, one for each presliding length that is tried, is led along beside the law. So nothing has to be
kept of the path, and a sample takes the same memory and time however long the learning lasts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

Row = tuple[float, ...]

MOST_LENGTHS: Final = 200
MOST_ROUNDS: Final = 100


@dataclass(frozen=True)
class Learning:
    """How the law learns; SI. See `models.deployment.learning_steps` for what is computed with them.

    rounds of `motions` each, after the wipe; a motion over the stroke ends `rest` samples behind its step, and the
    thrust there is averaged over `window` samples before and that one. length (K,) [1]: the presliding lengths that are
    tried, over the nominal one, which is number `nominal`. least [1]: below which the friction's scale is not taken.
    mass (n,) [1/m], dead_time (n,) [s/m]: by which the mean tracking error (n,) [m] behind a step tells what mass and
    dead time are off by, of which `faultless` [1], [s] is there without a fault; most [1], [s]: the largest that are
    believed. early, sooner (M,): what x_T*'s response to a step of the target gains per second, and per second
    squared, of a longer dead time.
    """

    rounds: int
    motions: int
    rest: int
    window: int
    length: Row
    nominal: int
    least: float
    mass: Row
    dead_time: Row
    faultless: tuple[float, float]
    most: tuple[float, float]
    early: Row
    sooner: Row

    @property
    def stretch(self) -> Row:
        """How far the elements of each length tried go for a metre of the path, in the nominal elements' metres [1]."""
        return tuple(1.0 / length for length in self.length)


def learning_numbers(content: Mapping[str, Any], sample_time: float) -> Learning | None:
    """The `learning` of a controller.json at a sample time [s]; None for a file that does not say all of it.

    Raises ValueError, a sentence, or KeyError.
    """
    if "length_candidates" not in content:
        return None
    faultless = _numbers(content["faultless_error_m"])
    mass, dead_time = _numbers(content["mass_error_per_m"]), _numbers(content["dead_time_error_s_per_m"])
    early, sooner = (_numbers(content["position_by_dead_time"][key]) for key in ("per_s", "per_s2"))
    length = _numbers(content["length_candidates"])
    rest, window = round(float(content["rest_s"]) / sample_time), round(float(content["hold_s"]) / sample_time)
    rounds, motions = int(content["rounds"]), int(content["motions_per_round"])
    if not len(faultless) == len(mass) == len(dead_time):
        raise ValueError("learning: its three rows over the tracking error must be equally long")
    if len(early) != len(sooner):
        raise ValueError("learning: position_by_dead_time must have two rows of equal length")
    if len(length) > MOST_LENGTHS or min(length) <= 0 or 1.0 not in length:
        raise ValueError(f"learning: length_candidates must be at most {MOST_LENGTHS} numbers above 0, 1 among them")
    if not (0 <= window <= rest and len(faultless) <= rest):
        raise ValueError("learning: a motion must last as long as its rest and its tracking error do")
    if not (1 <= rounds <= MOST_ROUNDS and 1 <= motions <= MOST_ROUNDS):
        raise ValueError(f"learning: rounds and motions_per_round must be from 1 to {MOST_ROUNDS}")
    told = [math.fsum(g * e for g, e in zip(row, faultless, strict=True)) for row in (mass, dead_time)]
    scalars = (content[key] for key in ("least_force", "largest_error", "largest_dead_time_error_s"))
    least, most, latest = _numbers(scalars)
    at = length.index(1.0)
    numbers = (length, at, least, mass, dead_time, (told[0], told[1]), (most, latest), early, sooner)
    return Learning(rounds, motions, rest, window, *numbers)


def _numbers(values: Any) -> Row:
    numbers = tuple(float(number) for number in values)
    if not numbers or not all(math.isfinite(number) for number in numbers):
        raise ValueError("learning must hold finite numbers")
    return numbers
