"""The exported law in a loop with exported tables that are off in everything at once, after pasts unknown to it."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.deployment.plant_source import plant_sources
from design.validation import last_errors, sequence
from models.deployment.coefficients import Coefficients
from models.deployment.running_law import LEARN, RESET, STEP, WIPE
from models.machine import Machine
from models.quantity import keeps_to, show
from models.records.settling import settling_time
from models.variation import drawn
from studies.binomial import CONFIDENCE, interval
from studies.export.compiling import compiled
from studies.perturbed import STRICT_TOLERANCE_SHARE, TOGETHER, perturbations

Array = NDArray[np.float64]

PAST: Final = 5  # targets before the law is asked for anything, which leave the friction where they may
FARTHEST: Final = 3.0  # strokes from one of them to the next
PERIODS: Final = 2  # of the motions, of which the second is judged


def on_tables(
    folder: Path, machine: Machine, known: Coefficients, count: int, seed: int, progress: Callable[[int], None]
) -> dict[str, Any]:
    """How many of `count` tables settle within the specified tolerance in the specified time, and within a quarter of
    it in the reference's; SI. The folder holds the sources of the law and of the session.

    Each table is drawn around `machine`, its scale is noisy, and it moves at random before the law is reset, wipes the
    friction, learns if it can, and makes the motions that are judged, by where the table is and not what its scale
    shows.
    """
    wanted, judged = machine.specification, sequence(machine, known.stroke, periods=PERIODS)
    goals = (
        (wanted.tolerance, wanted.settling_time),
        (STRICT_TOLERANCE_SHARE * wanted.tolerance, wanted.reference_settling_time),
    )
    compiled(folder, ("axis_law.c",), ("-O2", "-c"), "axis_law.o")
    slowest = np.zeros((count, 2))
    for i, quiet in enumerate(drawn(machine, perturbations(machine)[TOGETHER].within, count, seed)):
        table = replace(quiet, scale=quiet.scale.noisy())
        position = _session(folder, table, _rows(machine, table, known, judged, [seed, i]))[-judged.size :]
        errors = last_errors(position, judged, PERIODS)
        slowest[i] = [
            max(settling_time(error, tolerance, known.sample_time) for error in errors) for tolerance, _ in goals
        ]
        progress(i + 1)
    rows = [_rate(slowest[:, i], *goal) for i, goal in enumerate(goals)]
    return {"tables": count, "seed": seed, "confidence": CONFIDENCE, "learns": known.learning is not None, "rows": rows}


def _rate(slowest: Array, tolerance: float, time: float) -> dict[str, Any]:
    """The share of tables whose slowest motion (n,) [s] is in time."""
    hits, count = sum(keeps_to(one, time) for one in slowest), slowest.size
    return {
        "name": f"every motion within {show(tolerance, 'm')} by {show(time, 's')}",
        "hits": hits,
        "share": hits / count,
        "low": interval(hits, count)[0],
        "slowest_s": float(np.max(slowest)),
    }


def _rows(machine: Machine, table: Machine, known: Coefficients, judged: Array, seed: list[int]) -> Array:
    """What is asked (n,), the targets [m] and the scale's noise [m] of a session, as columns (n, 3)."""
    rng, still = np.random.default_rng(seed), round(5 * machine.specification.settling_time / known.sample_time)
    past = np.repeat(known.stroke * np.cumsum(rng.uniform(-FARTHEST, FARTHEST, PAST)), still)
    rest = 0 if known.wipe is None else 2 * (known.wipe.count + known.wipe.still) + known.delay
    begun = [RESET] if known.wipe is None else [RESET, WIPE if known.learning is None else LEARN]
    target = np.concatenate([np.zeros(rest), _lesson(known), judged])
    asked = np.concatenate([np.full(past.size, STEP), begun, np.full(target.size, STEP)])
    noise = table.scale.noise * rng.standard_normal(asked.size)
    return np.column_stack([asked, np.concatenate([past, np.zeros(len(begun)), target]), noise])


def _lesson(known: Coefficients) -> Array:
    """The targets [m] of all rounds of motions that the law learns from: up and down again over the stroke."""
    if known.learning is None:
        return np.zeros(0)
    up = np.where(np.arange(known.learning.motions) < known.learning.motions / 2, 1.0, -1.0)
    return np.tile(np.repeat(known.stroke * np.cumsum(up), known.learning.rest + 1), known.learning.rounds)


def _session(folder: Path, table: Machine, rows: Array) -> Array:
    """Where the table is at each step (n,) [m]."""
    for name, text in plant_sources(table).items():
        (folder / name).write_text(text, encoding="utf-8")
    program = compiled(folder, ("axis_session.c", "axis_plant.c", "axis_law.o"), ("-O2",), "session")
    return np.frombuffer(subprocess.run([str(program)], input=rows.tobytes(), capture_output=True, check=True).stdout)
