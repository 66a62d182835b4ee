"""Which of two signals a feedback controller holds against the other, from the signs with which its command answers.

A controller pushes back: its command falls where the measured position rises, and rises where the reference does, or
the loop would not be stable. This holds for every machine and every gain, whatever the digits of the two columns, so a
fit of the command's changes by those of both signals shows which is which where the controller is nearly linear.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.records.record import Record

Array = NDArray[np.float64]

LAGS: Final = 8  # samples back: a reference may be delayed before the controller has it
COMMANDS: Final = 2  # commands back, for the states of filters
MOST: Final = 20_000  # samples that are fitted, out of the whole record
SURE: Final = 10.0  # standard deviations of a coefficient whose sign counts
EXPLAINED: Final = 0.5  # of the variance, below which the command is not that of such a controller
EXACT: Final = 1e-9  # of the command's changes: smaller residuals are of rounding
ALIKE: Final = 1e-6  # of the largest singular value: smaller ones are of columns that are nearly the same


def acts_against_the_reference(record: Record) -> bool:
    """Whether the command falls with the reference and rises with the position, as if the two were swapped [-].

    False where the record does not show it: an open loop, a law that two signals don't explain, too few samples.
    """
    count, command = record.position.size, record.command - record.feedforward
    rows = np.arange(LAGS + 1, count)
    if rows.size < 10 * (2 * LAGS + COMMANDS):
        return False
    if rows.size > MOST:
        rows = rows[np.linspace(0, rows.size - 1, MOST).astype(int)]
    changes = [_change(command, rows - back) for back in range(1, COMMANDS + 1)]
    changes += [_change(signal, rows - back) for signal in (record.reference, record.position) for back in range(LAGS)]
    certain, explained = _certainty(np.column_stack(changes), _change(command, rows))
    reference, position = _first(certain[COMMANDS : COMMANDS + LAGS]), _first(certain[COMMANDS + LAGS :])
    return explained > EXPLAINED and reference < 0 < position


def _change(signal: Array, rows: NDArray[np.int_]) -> Array:
    """How much a signal (n,) changed to these samples (k,) from those before them."""
    return np.asarray(signal[rows] - signal[rows - 1])


def _certainty(columns: Array, wanted: Array) -> tuple[Array, float]:
    """The coefficients (k,) of a least-squares fit of `wanted` (n,) in their standard deviations, and R^2."""
    size = np.sqrt(np.mean(columns**2, axis=0))
    used = size > 0
    power = float(np.var(wanted))
    certain = np.zeros(size.size)
    if power == 0 or not np.any(used):
        return certain, 0.0
    left, values, right = np.linalg.svd(columns[:, used] / size[used], full_matrices=False)
    kept = values > ALIKE * values[0]
    inverse = right[kept].T / values[kept]
    found = inverse @ (left[:, kept].T @ wanted)
    residual = wanted - columns[:, used] / size[used] @ found
    variance = float(residual @ residual) / max(wanted.size - values.size, 1)
    deviation = np.sqrt(np.sum(inverse**2, axis=1) * max(variance, EXACT**2 * power))
    certain[used] = found / deviation
    return certain, 1 - variance / power


def _first(certain: Array) -> float:
    """The first coefficient whose sign is sure, or 0."""
    sure = certain[np.abs(certain) > SURE]
    return float(sure[0]) if sure.size else 0.0
