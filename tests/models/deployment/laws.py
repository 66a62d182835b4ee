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

KINDS: Final = ("PID", "cascade", "filters and anti-windup", "no compensator", "without an integral")


@cache
def designed(kind: str) -> tuple[Machine, Controller]:
    """A machine and the controller designed for it."""
    if kind == "PID":
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
