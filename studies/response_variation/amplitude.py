"""Fig. 2 with its friction: the nonsmooth plant's frequency response, which depends on the amplitude of the motion.

A motion x = a sin(omega t) meets a friction whose fundamental is K(a) x, with a complex K(a) that does not depend on
the frequency, as the elements are rate independent. So eq. (2) holds with K(a) in place of K_e: where no element slips
K is the sum of their stiffnesses; far beyond the presliding region it is imaginary, 4 T_fc / (pi a), a loss that takes
away amplitude where the mass needs less force than that.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from models.controller import References
from models.friction import describing_stiffness
from models.machine import Machine
from models.plant import bode
from models.plant import frequency_response as rolling
from models.simulation.simulator import simulate

Array = NDArray[np.float64]

STROKES: Final = (0.1, 1.0, 5.0, 50.0, 250.0)  # amplitudes in specified strokes: 2 um to 5 mm on the paper's table
MACRO: Final = 50.0  # strokes of the amplitude whose balance of mass and friction sets the frequencies:
LOWEST: Final = 0.3  # of that at which both take the same force, 3.5 Hz on the paper's table,
HIGHEST: Final = 60.0
DROOP: Final = 0.9  # of the rolling plant's amplitude: where less is left, the amplitude has decreased
SIMULATED_CYCLES: Final = 6  # of a simulated sine, of which the first grow
GROWING: Final = 2
READ: Final = 3  # and the last are evaluated
SIMULATED: Final = ((1.0, (0.6, 1.5, 3.0)), (MACRO, (0.6, 0.9, 1.5, 2.5)))  # strokes, and frequencies in units of that


def by_amplitude(machine: Machine) -> dict[str, Any]:
    """Magnitude [m/N] and phase [deg] by amplitude [m], and what simulated sines of the nonsmooth machine give."""
    balance = _balance(machine, MACRO * machine.specification.stroke)
    frequency = np.geomspace(LOWEST * balance, min(HIGHEST * balance, 0.5 / machine.sample_time), 300)
    omega = 2 * math.pi * frequency
    known = np.abs(rolling(machine.plant, omega))
    curves = []
    for factor in STROKES:
        amplitude = factor * machine.specification.stroke
        stiffness = describing_stiffness(machine.friction, amplitude)
        magnitude, phase = _response(machine, omega, stiffness)
        curves.append(
            {
                "amplitude_m": amplitude,
                "stiffness_N_per_m": stiffness.real,
                "loss_N_per_m": stiffness.imag,
                "magnitude_m_per_N": magnitude,
                "phase_deg": phase,
                "droop_Hz": _droop(frequency, magnitude / known),
            }
        )
    magnitude, phase = bode(machine.plant, omega)
    points = [
        _simulated(machine, factor * machine.specification.stroke, part * balance)
        for factor, parts in SIMULATED
        for part in parts
    ]
    return {
        "frequency_Hz": frequency,
        "rolling": {"magnitude_m_per_N": magnitude, "phase_deg": np.degrees(phase)},
        "curves": curves,
        "simulated": points,
        "largest_difference": max(abs(one["magnitude_m_per_N"] / one["expected_m_per_N"] - 1) for one in points),
        "droop": DROOP,
    }


def _balance(machine: Machine, amplitude: float) -> float:
    """The frequency [Hz] at which a sine of the mass takes as much force as the Coulomb friction; amplitude [m]."""
    return math.sqrt(4 * machine.friction.coulomb_force / (math.pi * amplitude * machine.plant.mass)) / (2 * math.pi)


def _response(machine: Machine, omega: Array, stiffness: complex) -> tuple[Array, Array]:
    """(magnitude [m/N], phase [deg]) of eq. (2) with a complex stiffness [N/m] at omega [rad/s]."""
    late = np.exp(-1j * omega * machine.plant.dead_time)
    plant = rolling(machine.plant, omega) / late
    response = plant / (1 + stiffness * plant)
    angle = np.unwrap(np.angle(response)) - omega * machine.plant.dead_time
    return np.abs(response), np.degrees(angle)


def _droop(frequency: Array, ratio: Array) -> float | None:
    """The highest frequency [Hz] below which less than DROOP of the rolling amplitude is left; None: no such one."""
    short = np.flatnonzero(ratio < DROOP)
    whole = np.flatnonzero(ratio >= DROOP)
    if short.size == 0 or whole.size == 0 or short[0] > whole[0]:
        return None
    return float(frequency[whole[0]])


def _simulated(machine: Machine, amplitude: float, hertz: float) -> dict[str, float]:
    """Position over thrust [m/N] at the fundamental, with the nonsmooth machine's feedback on a sine of amplitude [m].

    expected: eq. (2) with K(a) at the amplitude that the table really has.
    """
    ts, omega = machine.sample_time, 2 * math.pi * hertz
    cycle = round(1 / (hertz * ts))
    k = np.arange(SIMULATED_CYCLES * cycle)
    path = amplitude * np.minimum(k / (GROWING * cycle), 1.0) * np.sin(omega * k * ts)
    still = np.zeros(k.size)
    response = simulate(machine, machine.feedback_only(), path, given=References(path, still, still))
    last = slice(k.size - READ * cycle, None)
    turn = np.column_stack([np.sin(omega * k * ts), np.cos(omega * k * ts), np.ones(k.size)])[last]
    moved, pushed = (
        float(np.hypot(*np.linalg.lstsq(turn, signal[last], rcond=None)[0][:2]))
        for signal in (response.position, response.record.command)
    )
    stiffness = describing_stiffness(machine.friction, moved)
    return {
        "amplitude_m": amplitude,
        "frequency_Hz": hertz,
        "magnitude_m_per_N": moved / pushed,
        "expected_m_per_N": float(_response(machine, np.array([omega]), stiffness)[0][0]),
    }
