"""The effects that the machine file states, such as a spring or a drag: how far the records moved their values."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from models.effects.base import parameters
from models.effects.catalogue import named, paired
from models.machine import Machine
from models.quantity import listed, show
from studies.wording import effect, words

MIN_MOVE_STDS: Final = 3.0  # deviations, and
CLEARLY: Final = 0.01  # of itself: a value of a stated effect that moved by less is not told


def stated_effects(given: Machine, better: Machine) -> list[dict[str, Any]]:
    """The values of stated effects that the file handed over has surely and clearly otherwise, with their deviation
    there [SI]; but for a lag, where lag and dead time are together what they were, as the records show their sum."""
    rows, before_all, now_all = [], _input_delay(given), _input_delay(better)
    as_late = abs(now_all - before_all) <= CLEARLY * before_all
    several = Counter(one.name for one in given.effects)
    place = {id(one): path for path, one in named(better.effects).items()}
    for path, (before, after) in paired(given.effects, better.effects).items():
        whose = f" of number {path.rpartition('.')[2]}" if several[before.name] > 1 else ""
        for item in parameters(type(before)):
            old, new = float(getattr(before, item.name)), float(getattr(after, item.name))
            size = abs(old)
            if item.role == "phase":  # the same phase has many numbers, and 0 is no small one
                size, new = 1.0, old + math.remainder(new - old, math.tau)
            source = better.sources.get(f"effects.{place[id(after)]}.{item.name}")
            std = float(np.max(source.std)) if source is not None and source.std is not None else 0.0
            if item.role == "switch" or (as_late and item.name == before.delayed_by):
                continue
            if abs(new - old) > max(MIN_MOVE_STDS * std, CLEARLY * size):
                row = {"effect": before.name, "name": f"{item.name}{whose}", "unit": item.unit}
                rows.append({**row, "before": old, "now": new, "std": std})
    return rows


def _input_delay(machine: Machine) -> float:
    """By how much later than its command a thrust acts, the hold apart [s]."""
    return machine.plant.dead_time + sum(effect.input_delay() for effect in machine.effects)


def first(results: Mapping[str, Any], names: Sequence[str]) -> list[str]:
    """The names of values that are off, those of stated effects first."""
    return list(dict.fromkeys([*(row["effect"] for row in results.get("stated_effects", ())), *names]))


def moved_values(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Each of them in words, with the value before."""
    return [
        f"{effect(row['effect'])} ({words(row['name'])} {show(row['now'], row['unit'], 4)} in place of "
        f"{show(row['before'], row['unit'], 4)})"
        for row in rows
    ]


def told(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """A sentence on them; none without any."""
    if not rows:
        return []
    return [f"Of the effects that the machine file states, these have other values: {listed(moved_values(rows))}."]
