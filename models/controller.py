"""The sampled 2DoF law of Figs. 6 and 13: x_T*, u_ff and u_rf from the target, dead-time compensation, PID."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import lfilter

from models.compiled import compiled
from models.friction import Friction, follow
from models.quantity import value

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PID:
    """C(z) at sample k, with e[k] = x_T*[k - delay] - x[k] and a = tau / (tau + T_s):

    I[k] = I[k-1] + ki T_s e[k];  d[k] = a d[k-1] + (1 - a) (e[k] - e[k-1]) / T_s;  u_fb = kp e + I + kd d.
    """

    kp: float = value("N/m", "proportional gain", at_least=0)
    ki: float = value("N/(m s)", "integral gain", at_least=0)
    kd: float = value("N s/m", "derivative gain", at_least=0)
    derivative_filter: float = value("s", "time constant tau of the derivative's filter", at_least=0)


@dataclass(frozen=True)
class Controller:
    """One 2DoF law at one sample time: x_T* = N_ff(z) r, u_ff = D_ff(z) r, u_M = u_fb + u_ff + u_rf.

    n_ff, d_ff: coefficients of z^0, z^-1, ... [m/m] and [N/m]; reference_delay [samples]: the z^-d by which the PID's
    reference waits for the dead time (Smith's method); friction_compensation: the RFM, or None for u_rf = 0.
    """

    sample_time: float
    pid: PID
    reference_delay: int
    n_ff: tuple[float, ...]
    d_ff: tuple[float, ...]
    friction_compensation: Friction | None = None

    def without_compensation(self) -> Controller:
        """The same law with u_rf = 0 (Fig. 6)."""
        return replace(self, friction_compensation=None)


@dataclass(frozen=True)
class References:
    """What the controller knows before the motion, each of shape (n,): x_T* [m], u_ff [N], u_rf [N]."""

    position: Array
    feedforward: Array
    compensation: Array


def references(controller: Controller, target: ArrayLike) -> References:
    """x_T*, u_ff and u_rf over the target r (n,) [m], from rest at r = 0 before its first sample.

    The RFM follows x_T* from the virgin state, and keeps its history over the whole of r.
    """
    r = np.asarray(target, float)
    position = np.asarray(lfilter(controller.n_ff, 1.0, r), float)
    feedforward = np.asarray(lfilter(controller.d_ff, 1.0, r), float)
    compensation = np.zeros(r.size)
    if controller.friction_compensation is not None:
        compensation, _ = follow(controller.friction_compensation, position)
    return References(position, feedforward, compensation)


@compiled
def pid_step(
    error: float, previous: float, integral: float, slope: float, gains: Array, sample_time: float
) -> tuple[float, float, float]:
    """One sample of the PID: (u_fb [N], I [N], d [m/s]) from e[k], e[k-1] [m], I, d at k-1; gains (kp, ki, kd, tau)."""
    keep = gains[3] / (gains[3] + sample_time)
    integral = integral + gains[1] * sample_time * error
    slope = keep * slope + (1.0 - keep) * (error - previous) / sample_time
    return gains[0] * error + integral + gains[2] * slope, integral, slope
