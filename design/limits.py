"""What no PID passes on this machine: the dead time, Bode's integral, and a plant that does not answer.

Symbols as in the diagram of design/loop.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from design.family import Member
from design.loop import controller_response, frequency_response, sensitivities
from models.controller import Feedback
from models.plant import Plant, delay_split, sampled, state_space

Array = NDArray[np.float64]
FREQUENCIES = 4000  # at which the phase is looked at and the integrals are taken, evenly spread in their logarithm


@dataclass(frozen=True)
class Area:
    """Integrals of ln |S| over frequency [nat rad/s]: where it is below 0, above 0, and what Bode allows below 0."""

    suppressed: float
    amplified: float
    allowed: float


def highest_crossover(plant: Plant, sample_time: float, ms: ArrayLike) -> Array:
    """The highest frequency (n,) [rad/s] at which a PID can have |L| = 1 in a stable loop with |S| <= ms (n,) [1].

    sample_time [s]. At |L| = 1 the bound asks for a phase of at least 2 asin(1 / (2 ms)) above -180 degrees. The
    difference quotient leads by at most 90 degrees - omega T_s / 2, the other parts not at all, so no PID with gains
    >= 0 does; the rest is the plant's phase, exact behind its hold.
    """
    omega = np.geomspace(1e-5, 1.0, FREQUENCIES, endpoint=False) * math.pi / sample_time
    lag = omega * (plant.dead_time + sample_time / 2)
    rational = np.angle(state_space(plant)(1j * omega))
    rational = np.where(rational > 1e-9, rational - 2 * math.pi, rational)  # -180 .. 0 degrees
    whole, _ = delay_split(plant.dead_time, sample_time)  # its samples are a factor: as states they took gigabytes
    within = frequency_response(sampled(plant, sample_time, whole_delay=False), omega)
    exact = within * np.exp(-1j * omega * whole * sample_time)
    phase = rational - lag + np.angle(exact * np.exp(-1j * (rational - lag)))
    left = phase + math.pi + math.pi / 2 - omega * sample_time / 2
    needed = 2 * np.arcsin(1 / (2 * np.atleast_1d(np.asarray(ms, float))))
    return np.array([np.max(omega[left >= least], initial=0.0) for least in needed])


def least_sensitivity(plant: NDArray[np.complex128], mcs: float) -> Array:
    """Lower bound on |S| [1] at frequencies where P is `plant` (n,) [m/N], for any controller with |CS| <= mcs [N/m].

    S = 1 - P CS: where the plant hardly answers, as at a zero below a mode, nothing is suppressed.
    """
    return np.asarray(np.maximum(1 - np.abs(plant) * mcs, 0.0), float)


def bode_area(member: Member, feedback: Feedback, ms: float, mcs: float) -> Area:
    """Bode's integral for one loop [nat rad/s]: ln |S| integrates to 0 up to Nyquist's frequency, L being delayed.

    Any controller with |S| <= ms [1] and |CS| <= mcs [N/m] has |S| <= min(ms, 1 + |P| mcs), which bounds the area above
    0 and so the one below.
    """
    ts = float(member.plant.dt)
    omega = np.geomspace(1e-6, 1, FREQUENCIES) * math.pi / ts
    plant = frequency_response(member.plant, omega)
    log = np.log(np.abs(sensitivities(plant, controller_response(feedback, ts, omega))["S"]))
    most = np.log(np.minimum(ms, 1 + np.abs(plant) * mcs))
    return Area(*(float(np.trapezoid(part, omega)) for part in (np.maximum(-log, 0), np.maximum(log, 0), most)))
