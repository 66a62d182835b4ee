"""The sampled loop's linear part over a whole motion, lifted: each signal as a matrix on the motion's inputs.

Symbols: n samples; inputs w = (u_ff (n,), x_T* (n,), f (n,)), f the friction held over each interval of the thrust,
that is from k T_s + L on. All signals are departures from rest, so the feedback's integral begins at zero. A column of
`lift` is the response to one input's unit value; what is linear of the problem is solved before any optimisation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from models.controller import PID
from models.plant import Plant, delay_split, state_space, transition

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Lifted:
    """Matrices on w (3 n,): position (n + 1, 3 n) at the samples, middle (n, 3 n), command (n, 3 n), state (2 m, 3 n).

    middle: predicted position x + v T_s / 2 half-way through each interval of the thrust, where the friction is taken
    (second order, as in models/simulation/simulator.py); state: of the modes at the end of the last interval. SI units.
    """

    samples: int
    position: Array
    middle: Array
    command: Array
    state: Array

    def on_thrust(self, signal: Array) -> Array:
        """The part of `signal`, one of the matrices, that acts on u_ff; unit of the signal per [N]."""
        return signal[:, : self.samples]

    def on_reference(self, signal: Array) -> Array:
        """The part of `signal` that acts on x_T*; unit of the signal per [m]."""
        return signal[:, self.samples : 2 * self.samples]

    def on_friction(self, signal: Array) -> Array:
        """The part of `signal` that acts on f; unit of the signal per [N]."""
        return signal[:, 2 * self.samples :]


def feedforward_only(plant: Plant, sample_time: float, samples: int) -> Lifted:
    """`lift` without feedback and without the whole samples [s] of dead time: position is x_T* of a feedforward."""
    _, rest = delay_split(plant.dead_time, sample_time)
    return lift(replace(plant, dead_time=rest), sample_time, samples, None, 0)


def lift(plant: Plant, sample_time: float, samples: int, pid: PID | None, reference_delay: int) -> Lifted:
    """The loop of Fig. 6 around `plant`, over `samples` samples [s]; without `pid` only what u_ff and f do."""
    n, columns = samples, 3 * samples
    unit = np.eye(columns)
    thrust, reference, friction = unit[:n], unit[n : 2 * n], unit[2 * n :]
    continuous = state_space(plant)
    output = np.asarray(continuous.C)[0]
    predict = output @ (np.eye(continuous.nstates) + 0.5 * sample_time * np.asarray(continuous.A))
    whole, rest = delay_split(plant.dead_time, sample_time)
    phi, gamma = transition(continuous.A, continuous.B, sample_time)
    part = sample_time - rest  # where the sample falls in its interval
    phi_part, gamma_part = transition(continuous.A, continuous.B, part)
    state = np.zeros((continuous.nstates, columns))
    position, middle, command = np.zeros((n + 1, columns)), np.zeros((n, columns)), np.zeros((n, columns))
    error, integral, slope = np.zeros((3, columns))
    for k in range(n + 1 + whole):  # sample k falls into the interval j of the thrust, or ends it
        j = k - whole - 1
        if 0 <= j < n:
            net = (command[j] - friction[j])[None, :]
            middle[j] = predict @ state
            if k <= n and rest > 0:
                position[k] = output @ (phi_part @ state + gamma_part @ net)
            state = phi @ state + gamma @ net
        if k <= n and rest == 0:
            position[k] = output @ state
        if k < n:
            command[k] = thrust[k]
            if pid is not None:
                before, error = error, reference[max(k - reference_delay, 0)] - position[k]
                keep = pid.pole(sample_time)
                integral = integral + pid.ki * sample_time * error
                slope = keep * slope + (1 - keep) * (error - before) / sample_time
                command[k] = command[k] + pid.kp * error + integral + pid.kd * slope
    return Lifted(n, position, middle, command, state)
