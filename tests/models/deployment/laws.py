"""Machines with controllers of every kind that a drive may have to run, and the file of each."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from design.controller import assemble, design_deadbeat
from design.deployment.drive_file import controller_to_json
from models.controller import Controller
from models.machine import Machine, load
from studies.command import to_text
from tests.models.feedback.axis import CASCADE, FILTERS, axis

KINDS: Final = ("PID", "cascade", "filters and anti-windup", "no compensator", "without an integral", "learning")
LEARNING: Final = {
    "rounds": 2,
    "motions_per_round": 4,
    "rest_s": 45e-3,
    "hold_s": 10e-3,
    "length_candidates": [0.5, 0.8, 1.0, 1.25, 2.0],
    "least_force": 0.05,
    "faultless_error_m": [1e-8 * k for k in range(40)],
    "mass_error_per_m": [2e4 - 1e3 * k for k in range(40)],
    "dead_time_error_s_per_m": [1 - 0.02 * k for k in range(40)],
    "largest_error": 0.5,
    "largest_dead_time_error_s": 5e-4,
    "position_by_dead_time": {"per_s": [2.0 * k for k in range(43)], "per_s2": [500.0 + k for k in range(43)]},
}
"""A `learning` of few motions and lengths for the tests' laws: any numbers of the right size will do."""


@cache
def designed(kind: str) -> tuple[Machine, Controller]:
    """A machine and the controller designed for it."""
    if kind in {"PID", "learning"}:
        table = load()
        return table, assemble(table, design_deadbeat(table))
    if kind == "no compensator":
        table = load()
        return table, assemble(table, design_deadbeat(table)).without_compensation()
    given = {
        "cascade": (CASCADE, None, 0.0),
        "filters and anti-windup": (CASCADE, FILTERS, 5e-3),
        "without an integral": (replace(CASCADE, integral_time=0.0), None, 0.0),
    }[kind]
    machine = axis(*given)
    return machine, assemble(machine, design_deadbeat(machine))


def written(kind: str, folder: Path) -> Path:
    """The controller.json of a kind, in a folder."""
    machine, controller = designed(kind)
    wanted = machine.specification
    content = controller_to_json(machine, controller, wanted.stroke, wanted.reference_settling_time)
    if kind == "learning":
        content["learning"] = LEARNING
    path = folder / "controller.json"
    path.write_text(to_text(content), encoding="utf-8")
    return path


def motions(machine: Machine, strokes: int = 6) -> np.ndarray:
    """A target (n,) [m] of strokes up and down, of which two follow each other before the first has ended."""
    stroke, settled = machine.specification.stroke, round(machine.specification.settling_time / machine.sample_time)
    heights = np.cumsum([0.0, *([1.0, 1.0, -1.5, 0.3, 2.0, -1.0] * strokes)[:strokes]]) * stroke
    return np.repeat(heights, [3, *([3 * settled, settled // 3, 2 * settled] * strokes)[:strokes]])


def content_of(path: Path) -> dict[str, object]:
    """What a file holds."""
    content: dict[str, object] = json.loads(path.read_text(encoding="utf-8"))
    return content
