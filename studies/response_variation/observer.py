"""Fig. 7b: the friction as a disturbance observer estimates it offline, from thrust and position alone.

What the thrust puts in less what the motion takes is the disturbance: f = u(t - L) - x / P'(s), behind a low-pass Q(s).
Over one period of a motion that repeats itself, the discrete Fourier transform does this exactly at each frequency.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.validation import Validation
from models.plant import frequency_response

Array = NDArray[np.float64]

CUTOFF: Final = 3.0  # over the time in which x_T* settles: 150 Hz on the paper's table
ORDER: Final = 4  # Q = 1 / (1 + (f / cutoff)^4), without a lag


def estimated(validation: Validation) -> dict[str, Any]:
    """The friction [N] of every positive motion of a validation, estimated and true, over time and position.

    From the scale's readings and the commands of the last period; the plant is known exactly, as is the thrust.
    """
    machine, record = validation.machine, validation.response.record
    cutoff = CUTOFF / machine.specification.reference_settling_time
    estimate = disturbance(validation, cutoff)
    true = validation.response.friction
    motions, shown = [], round(min(0.1, machine.specification.interval) / machine.sample_time)
    for one in validation.positive:
        part = slice(one.motion.start, one.motion.start + shown)
        motions.append(
            {
                "reversal": one.motion.reversal,
                "position_m": record.position[part],
                "estimated_N": estimate[part],
                "true_N": true[part],
                "steady_estimated_N": float(np.mean(estimate[one.motion.stop - shown // 4 : one.motion.stop])),
                "steady_true_N": float(np.mean(true[one.motion.stop - shown // 4 : one.motion.stop])),
            }
        )
    return {
        "cutoff_Hz": cutoff,
        "time_s": np.arange(shown) * machine.sample_time,
        "steady_s": shown // 4 * machine.sample_time,
        "motions": motions,
        "rms_N": float(np.sqrt(np.mean((estimate - true) ** 2))),
        "largest_N": float(np.max(np.abs(estimate - true))),
    }


def disturbance(validation: Validation, cutoff: float) -> Array:
    """The friction (n,) [N] over the last period, from command and reading, up to a cutoff frequency [Hz]."""
    machine, record = validation.machine, validation.response.record
    ts, count = machine.sample_time, record.command.size
    frequency = np.fft.rfftfreq(count, ts)
    omega = 2 * math.pi * frequency
    plant = np.ones(frequency.size, complex)
    plant[1:] = frequency_response(machine.plant, omega[1:]) * np.exp(1j * omega[1:] * machine.plant.dead_time)
    hold = np.sinc(frequency * ts) * np.exp(-1j * omega * (ts / 2 + machine.plant.dead_time))
    position = np.fft.rfft(record.position - record.position[0])
    taken = np.where(frequency > 0, position / plant, 0.0)
    rated = machine.drive.rated_thrust
    given = np.fft.rfft(np.clip(record.command, -rated, rated) - machine.drive.offset) * hold
    low_pass = 1 / (1 + (frequency / cutoff) ** ORDER)
    return np.fft.irfft((given - taken) * low_pass, count)
