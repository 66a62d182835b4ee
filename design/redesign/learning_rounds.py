"""Iterative learning: the feedforward of the next round from the error of this one, for motions that repeat exactly.

The correction is the regularised least-squares inverse of two loops at once: friction is a spring behind a reversal,
and none while the axis slides. It is low-passed without phase where the loop no longer controls, and learns nothing
where the error of either loop would grow from round to round (S. Arimoto, S. Kawamura, F. Miyazaki, J. Robotic Systems
1, 1984; D. Bristow, M. Tharayil, A. Alleyne, IEEE Control Systems 26, 2006). It knows no other friction, and no names.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.family import with_effects
from design.loop import controller_response, frequency_response
from design.redesign.outcome import judged_motions
from models.machine import Machine
from models.records.record import Record

Array = NDArray[np.float64]

CORRECTION_SHARE: Final = 0.5  # of the correction that a round takes
WEIGHT: Final = 0.03  # of the largest |PS|, below which an error is rather left than inverted
PASS: Final = 4.0  # crossover frequencies up to which it learns
STEEP: Final = 4  # order of the low-pass
ROUND_COUNT: Final = 10


def learning_filter(machine: Machine, omega: Array) -> NDArray[np.complex128]:
    """From the error to the correction (m,) [N/m] at angular frequencies (m,) [rad/s]: of whichever of the two loops,
    it takes the part CORRECTION_SHARE of an error that it inverts fully, and 0 of one that it would make larger."""
    ts = machine.sample_time
    feedback = controller_response(machine.control.feedback, ts, omega)
    springs = (machine.presliding.stiffness_1, 0.0)
    plants = np.stack([frequency_response(with_effects(machine, slope=spring), omega) for spring in springs])
    reach = plants / (1 + plants * feedback)
    size = np.abs(reach)
    inverse = np.sum(np.conj(reach), axis=0) / np.sum(size**2 + (WEIGHT * np.max(size)) ** 2, axis=0)
    crossing = omega[np.flatnonzero(np.any(np.abs(plants * feedback) >= 1, axis=0))]
    keeps = 1 / (1 + (omega / (PASS * float(crossing[-1]) if crossing.size else omega[-1])) ** (2 * STEEP))
    shrinks = np.max(np.abs(1 - CORRECTION_SHARE * inverse * reach), axis=0) <= 1
    return np.asarray(inverse * (CORRECTION_SHARE * keeps * shrinks), np.complex128)


def corrected(record: Record, machine: Machine, limit: float) -> Array:
    """The feedforward (n,) [N] of the next round, within a limit [N], from the record of this one.

    machine: as it is known; its loop is that in place. Nothing is learned from what comes before the motions that are
    judged: what the friction remembers of earlier motions is there, which is another each time.
    """
    n, ts, delay = record.position.size, machine.sample_time, machine.control.reference_delay
    path = np.concatenate([np.full(delay, record.reference[0]), record.reference])[:n]
    omega = np.asarray(2 * math.pi * np.fft.rfftfreq(2 * n, ts), float)
    omega[0] = omega[1] * 1e-3  # the integral has no response at rest
    judged = judged_motions(record, machine)
    error = path - record.position
    error[: judged[0].start if judged else 0] = 0.0
    change = np.fft.irfft(np.fft.rfft(error, 2 * n) * learning_filter(machine, omega), 2 * n)[:n]
    return np.asarray(np.clip(record.feedforward + change, -limit, limit), float)
