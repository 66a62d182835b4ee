"""What the settling times of the records hang on, and how the error of a machine file's settling times scatters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.judging.scatter import dither_of
from design.validation import ROUNDING
from diagnosis.handover.gate import File
from diagnosis.how_far import EXACT, quiet, settling_differences
from diagnosis.null import simulated
from models.machine import Machine
from models.records.record import Record, motions
from models.records.settling import Margin, settling_margin
from studies.scattered import QUANTILE, RUNS

Array = NDArray[np.float64]

ENDS: Final = {"median": 0.5, "quantile": QUANTILE, "largest": 1.0}


def settling_told(
    files: Sequence[File], records: Sequence[Record], driving: Sequence[Record], seed: int
) -> dict[str, Any] | None:
    """The margins of the measured settling times, and the mean error of each file's over runs with a dither; SI.

    driving: the records that drive the files' loops. None where no motions settle in the records.
    """
    machine = files[0].machine
    margins = [one for record in records for one in _margins(record, machine)]
    if not margins:
        return None
    edge = ROUNDING * machine.specification.tolerance  # a reading on the edge of the band is off it by rounding alone
    near = [one.nearest if one.nearest > edge else 0.0 for one in margins if np.isfinite(one.nearest)]
    rows = []
    for file in files:
        over = [_error(file, records, driving, dither_of(machine), seed + 1 + run) for run in range(RUNS)]
        ends = {f"{key}_s": float(np.quantile(over, q, method="higher")) for key, q in ENDS.items()}
        rows.append({"file": file.name, "single_s": _error(file, records, driving, 0.0, seed), **ends})
    least, median = (float(np.quantile(near, q)) if near else None for q in (0.0, 0.5))
    return {
        "motions": len(margins),
        "nearest_least_m": least,
        "nearest_median_m": median,
        "runs": RUNS,
        "dither_m": dither_of(machine),
        "rows": rows,
    }


def _margins(record: Record, machine: Machine) -> list[Margin]:
    """What each settling time in a record hangs on; empty for a record that is not a sequence of steps."""
    if not settling_differences(record, record, machine).size:
        return []
    parts = motions(record.target, float(record.reference[0]))
    errors = [record.position[one.start : one.stop] - one.target for one in parts]
    return [settling_margin(error, machine.specification.tolerance, record.sample_time) for error in errors]


def _error(file: File, records: Sequence[Record], driving: Sequence[Record], dither: float, seed: int) -> float:
    """The mean error of a file's settling times [s] with a dither [m]: on the readings of a measured record as they
    stand, on those of the simulation in its loop, so that the feedback answers to it."""
    rng, found, machine = np.random.default_rng(seed), list[Array](), file.machine
    candidate = quiet(file.judged.candidate, max(dither, EXACT))
    for i, (record, drives) in enumerate(zip(records, driving, strict=True)):
        shaken = replace(record, position=record.position + dither * rng.standard_normal(record.position.size))
        made = simulated(candidate, drives, i, seed)
        found.append(settling_differences(shaken, made, machine)[:, 1])
    return float(np.mean(np.concatenate(found)))
