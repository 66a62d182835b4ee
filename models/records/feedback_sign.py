"""Which of two signals a feedback controller holds against the other, from the signs with which its command answers.

A controller pushes back: its command falls where the measured position rises, and rises where the reference does, or
the loop would not be stable. This holds for every machine and every gain, whatever the digits of the two columns, so a
fit of the command's changes by those of both signals shows which is which where the controller is nearly linear.
Swapped signals and a turned command look alike in that fit, as u = C (r - x) has the sign of both. Where the controller
is known, its replay tells them apart, by what it makes of the delay and of the feedforward.
"""

from __future__ import annotations

from dataclasses import replace
from enum import Enum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.controller import Feedback
from models.records.checks import replay
from models.records.record import Record

Array = NDArray[np.float64]

LAGS: Final = 8  # samples back: a reference may be delayed before the controller has it
COMMANDS: Final = 2  # commands back, for the states of filters
MAX_FITTED_SAMPLES: Final = 20_000  # samples that are fitted, out of the whole record
MIN_SIGN_STDS: Final = 20.0  # standard deviations of a coefficient whose sign counts
ALONE: Final = 100.0  # ... and of one that counts where the other signal's coefficients show no sign
# ... and of the surest coefficient: the errors of a set point that is smooth but for its rounding in the log are not
# white, and its coefficients look tens of standard deviations sure with either sign.
BESIDE: Final = 0.01
EXPLAINED: Final = 0.5  # of the variance, below which the command is not that of such a controller
CLEAR: Final = 0.9  # ... and below which the sign over one signal says nothing where the other's shows none
EXACT: Final = 1e-9  # of the command's changes: smaller residuals are of rounding
# Of the largest singular value: smaller ones are of columns that are nearly the same.
MIN_SINGULAR_VALUE_RATIO: Final = 1e-6
MADE: Final = 0.1  # of the commands' standard deviation, and of what the replay leaves else: less shows who made them
SETTLED: Final = 500  # samples at most, after which a replay does not know the beginning any more


class Mistake(Enum):
    """How signals are mapped wrongly; EITHER: one of the first two, which is all that unknown gains show."""

    SWAPPED = "reference and position are swapped"
    TURNED = "the sign of the command is turned"
    FEEDFORWARD = "the sign of the feedforward is turned"
    BOTH = "the signs of command and feedforward are turned"
    EITHER = "reference and position are swapped, or the sign of the command is turned"


def mistake(record: Record, feedback: Feedback | None, reference_delay: int) -> Mistake | None:
    """Which signals are mapped wrongly, by the stated feedback, if that is known and its own, or else by the signs.

    reference_delay: of the feedback [samples].
    """
    if feedback is not None:
        left = {
            None: _left(record, feedback, reference_delay),
            Mistake.SWAPPED: _left(_swapped(record), feedback, reference_delay),
            Mistake.TURNED: _left(replace(record, command=-record.command), feedback, reference_delay),
            Mistake.FEEDFORWARD: _left(replace(record, feedforward=-record.feedforward), feedback, reference_delay),
            Mistake.BOTH: _left(
                replace(record, command=-record.command, feedforward=-record.feedforward), feedback, reference_delay
            ),
        }
        best = min(left, key=lambda one: left[one])
        if left[best] < MADE * min(left[None], 1.0):
            return best
        if left[None] < MADE:
            return None  # else a feedforward that is not logged, say, hides who made them, and the signs are asked
    if np.ptp(record.reference) == 0:
        return None
    wrong = acts_against_the_reference(record) or _turned_against_the_feedforward(record)
    return Mistake.EITHER if wrong else None


def is_made_by(record: Record, feedback: Feedback, reference_delay: int) -> bool:
    """Whether this feedback makes a record's commands, its delay in samples, so that their sign is known [-]."""
    return _left(record, feedback, reference_delay) < MADE


def _swapped(record: Record) -> Record:
    return replace(record, reference=record.position, position=record.reference)


def _left(record: Record, feedback: Feedback, reference_delay: int) -> float:
    """What the replay leaves of a record's commands but for a constant, of their standard deviation [1]."""
    begin = min(record.command.size // 4, SETTLED)
    left = (record.command - replay(record, feedback, reference_delay))[begin:]
    spread = float(np.std(record.command[begin:]))
    return float(np.std(left)) / spread if spread > 0 else np.inf


def acts_against_the_reference(record: Record) -> bool:
    """Whether the command falls with the reference and does not fall with the position, as if the two were swapped [-].

    False where the record does not show it: an open loop, a law that two signals don't explain, too few samples.
    """
    reference, position, explained = _answer(record, record.command - record.feedforward)
    alone = position == 0 and reference < -ALONE and explained > CLEAR
    return alone or (reference < 0 < position and explained > EXPLAINED)


def _turned_against_the_feedforward(record: Record) -> bool:
    """Whether a stable loop made the command's negative, the feedforward taken off, rather than the command [-]."""
    if np.ptp(record.feedforward) == 0:
        return False
    explained = _answer(record, record.command - record.feedforward)[2]
    reference, position, turned = _answer(record, -record.command - record.feedforward)
    clearly = turned > CLEAR and 1 - turned < EXPLAINED * (1 - explained)
    return clearly and reference >= 0 and position < (0 if reference > 0 else -ALONE)


def _answer(record: Record, command: Array) -> tuple[float, float, float]:
    """The surest signs of a command (n,) [N] over the reference and over the position, each in standard deviations or
    0, and what of the command they explain [1]."""
    rows = np.arange(LAGS + 1, record.position.size)
    if rows.size < 10 * (2 * LAGS + COMMANDS):
        return 0.0, 0.0, 0.0
    if rows.size > MAX_FITTED_SAMPLES:
        rows = rows[np.linspace(0, rows.size - 1, MAX_FITTED_SAMPLES).astype(int)]
    changes = [_change(command, rows - back) for back in range(1, COMMANDS + 1)]
    changes += [_change(signal, rows - back) for signal in (record.reference, record.position) for back in range(LAGS)]
    certain, explained = _certainty(np.column_stack(changes), _change(command, rows))
    signals = certain[COMMANDS:]
    sure = max(MIN_SIGN_STDS, BESIDE * float(np.max(np.abs(signals))))
    return _first(signals[:LAGS], sure), _first(signals[LAGS:], sure), explained


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
    kept = values > MIN_SINGULAR_VALUE_RATIO * values[0]
    inverse = right[kept].T / values[kept]
    found = inverse @ (left[:, kept].T @ wanted)
    residual = wanted - columns[:, used] / size[used] @ found
    variance = float(residual @ residual) / max(wanted.size - values.size, 1)
    deviation = np.sqrt(np.sum(inverse**2, axis=1) * max(variance, EXACT**2 * power))
    certain[used] = found / deviation
    return certain, 1 - variance / power


def _first(certain: Array, sure: float) -> float:
    """The first coefficient (k,) beyond so many standard deviations, or 0."""
    beyond = certain[np.abs(certain) > sure]
    return float(beyond[0]) if beyond.size else 0.0
