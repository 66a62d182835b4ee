"""Iterative learning: the feedforward of the next round from the error of this one, for motions that repeat exactly.

The correction is the least-squares inverse of the linear loop, regularised, and low-passed without phase where the loop
no longer controls (S. Arimoto, S. Kawamura, F. Miyazaki, J. Robotic Systems 1, 1984; D. Bristow, M. Tharayil, A.
Alleyne, IEEE Control Systems 26, 2006). It knows no friction but a stiffness, and no names.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.loop import controller_response, frequency_response
from models.machine import Machine
from models.plant import sampled
from models.records.record import Record

Array = NDArray[np.float64]

STEP: Final = 0.5  # of the correction that a round takes
WEIGHT: Final = 0.03  # of the largest |PS|, below which an error is rather left than inverted
PASS: Final = 4.0  # crossover frequencies up to which it learns
STEEP: Final = 4  # order of the low-pass
ROUNDS: Final = 10


def corrected(record: Record, machine: Machine, limit: float) -> Array:
    """The feedforward (n,) [N] of the next round, within a limit [N], from the record of this one.

    machine: as it is known; its loop is that in place, with friction as a spring of its slope behind a reversal.
    """
    n, ts, delay = record.position.size, machine.sample_time, machine.control.reference_delay
    path = np.concatenate([np.full(delay, record.reference[0]), record.reference])[:n]
    omega = 2 * math.pi * np.fft.rfftfreq(2 * n, ts)
    omega[0] = omega[1] * 1e-3  # the integral has no response at rest
    plant = frequency_response(sampled(machine.plant, ts, machine.presliding.stiffness_1), omega)
    feedback = controller_response(machine.control.feedback, ts, omega)
    reach = plant / (1 + plant * feedback)
    inverse = np.conj(reach) / (np.abs(reach) ** 2 + (WEIGHT * np.max(np.abs(reach))) ** 2)
    crossing = omega[np.flatnonzero(np.abs(plant * feedback) >= 1)]
    keeps = 1 / (1 + (omega / (PASS * float(crossing[-1]) if crossing.size else omega[-1])) ** (2 * STEEP))
    change = np.fft.irfft(np.fft.rfft(path - record.position, 2 * n) * inverse * keeps, 2 * n)[:n]
    return np.asarray(np.clip(record.feedforward + STEP * change, -limit, limit), float)
