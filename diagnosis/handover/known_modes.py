"""Vibration modes that the machine file knows better than the records of a diagnosis tell.

A sweep tells a mode to a thousandth; motions hardly excite it, and a re-fit to them moves it to make up for whatever
else the model lacks. Within the motions that takes something off the gap; beyond, designs are made for modes that are
not there. So a file has its modes as the earlier records told them, with the deviations stated beside their values,
unless these records leave less than half of the gap with other ones: then the structure has changed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.baseline import Baseline
from diagnosis.handover.files import Content
from diagnosis.handover.final_fit import Finished, finished
from diagnosis.handover.gate import outweighs, with_fit
from diagnosis.handover.overrun import OVERRUN
from diagnosis.model.parameters import modes_as_stated
from models.records.record import Record

Array = NDArray[np.float64]

FIXED: Final = 1e-3  # of a stated deviation: within it a value that is held stays


def with_known_modes(found: Finished, baseline: Baseline) -> Finished:
    """The fit behind a file with its modes as well known as the file states, where it moved one of them far from where
    they are known to be, unless it surely leaves less than half of what the other does."""
    layout = found.candidate.layout
    deviation = modes_as_stated(layout)
    known = deviation < layout.deviation
    moved = _farthest(found, known, deviation)
    if moved <= OVERRUN:
        return found
    held = _held(found, known, deviation, baseline.records)
    if _farthest(held, known, deviation) > OVERRUN:  # a rough record outweighs what the file states
        held = _held(found, known, np.where(known, FIXED, 1.0) * deviation, baseline.records)
    held = replace(held, modes_kept=moved, frequency_alone=_farthest_mode(found, known, deviation))
    free, kept = (with_fit(Content.REFITTED, one, baseline) for one in (found, held))
    return found if outweighs(free, kept) else held


def _farthest(found: Finished, known: NDArray[np.bool_], deviation: Array) -> float:
    """By how many of these deviations (P,) a fit moved the value that it moved the most of those known (P,) [1]."""
    return float(np.max(np.abs(found.candidate.theta[known]) / deviation[known], initial=0.0))


def _farthest_mode(found: Finished, known: NDArray[np.bool_], deviation: Array) -> tuple[float, float]:
    """The frequency [Hz] in the file, and in a fit, of the mode of which it moved a known value (P,) the most."""
    layout, theta = found.candidate.layout, found.candidate.theta
    farthest = int(np.argmax(np.where(known, np.abs(theta) / deviation, 0.0)))
    at = int(np.flatnonzero(layout.of(layout.names[farthest]) == farthest)[0])
    stated = layout.machine.plant.modes[layout.machine.plant.flexible[at]].frequency
    return stated, float(stated * np.exp(theta[layout.of("mode_frequency")[at]]))


def _held(found: Finished, known: NDArray[np.bool_], deviation: Array, records: Sequence[Record]) -> Finished:
    """The fit begun again with values (P,) where they are known, with these deviations (P,)."""
    candidate = found.candidate
    layout = replace(candidate.layout, deviation=deviation)
    begin = replace(candidate, layout=layout, theta=np.where(known, 0.0, candidate.theta))
    return finished(replace(found.fitted, candidate=begin), records)
