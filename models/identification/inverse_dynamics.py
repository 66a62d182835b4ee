"""Inverse dynamics with least squares as its authors publish it for EMPS, to the printed digits.

A. Janot, M. Gautier, M. Brunot, "Data Set and Reference Models of EMPS", Workshop on Nonlinear System Identification
Benchmarks, 2019:  u = M q'' + F_v q' + F_c sign(q') + offset.  Steps, as the authors' program takes them: the position
through a Butterworth low-pass of order 4 forwards and backwards; twice central differences, one-sided at the two ends;
the first 49 samples left out (the last are not); every column and the force through MATLAB's `decimate`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from models.identification.estimate import Estimate
from models.records.record import Record

Array = NDArray[np.float64]

LEFT_OUT: Final = 49  # samples at the beginning
DECIMATION: Final = 10


@dataclass(frozen=True)
class Regression:
    """The estimate, the samples' time [s], measured and modelled force [N] (n,), and which of them were fitted."""

    estimate: Estimate
    time: Array
    measured: Array
    modelled: Array
    used: NDArray[np.bool_]

    def error(self, *, used: bool = True) -> float:
        """Norm of the force error over that of the force, on the samples fitted or on the others [1]."""
        part = self.used if used else ~self.used
        return float(np.linalg.norm((self.measured - self.modelled)[part]) / np.linalg.norm(self.measured[part]))


def regress(record: Record, *, cutoff: float, by_direction: bool = False, fit_until: float = np.inf) -> Regression:
    """The authors' least squares; by_direction: F_v and F_c of their own for each direction (the offset is in them).

    cutoff [Hz] of the Butterworth filter; samples after fit_until [s] only judge.
    """
    ts = record.sample_time
    b, a = scipy.signal.butter(4, cutoff * 2 * ts)
    path = _both_ways(b, a, record.position)
    speed = np.gradient(path, ts)
    acceleration = np.gradient(speed, ts)
    if by_direction:
        ahead, back = speed > 0, speed < 0
        columns = [acceleration, speed * ahead, speed * back, ahead.astype(float), -back.astype(float)]
        names: tuple[str, ...] = (
            *("mass", "viscous friction forwards", "viscous friction backwards"),
            *("Coulomb friction forwards", "Coulomb friction backwards"),
        )
        units: tuple[str, ...] = ("kg", "N s/m", "N s/m", "N", "N")
    else:
        columns = [acceleration, speed, np.sign(speed), np.ones(speed.size)]
        names, units = ("mass", "viscous friction", "Coulomb friction", "offset"), ("kg", "N s/m", "N", "N")
    whole = np.column_stack([*columns, record.command])[LEFT_OUT:]
    kept, first = _decimated(whole)
    time = (LEFT_OUT + first + DECIMATION * np.arange(len(kept))) * ts
    x, force, used = kept[:, :-1], kept[:, -1], time <= fit_until
    values = np.linalg.lstsq(x[used], force[used], rcond=None)[0]
    left = force[used] - x[used] @ values
    covariance = np.asarray(np.linalg.inv(x[used].T @ x[used]), float) * float(np.var(left, ddof=1))
    estimate = Estimate(names, units, np.asarray(values, float), covariance)
    return Regression(estimate, np.asarray(time, float), force, x @ estimate.values, used)


def _both_ways(b: Array, a: Array, signal: Array) -> Array:
    """MATLAB's filtfilt: as scipy's, but extended by 3 (order) samples at each end."""
    return np.asarray(scipy.signal.filtfilt(b, a, signal, axis=0, padlen=3 * (max(len(a), len(b)) - 1)))


def _decimated(columns: Array) -> tuple[Array, int]:
    """MATLAB's decimate: Chebyshev I of order 8, 0.05 dB, 0.8 of the new Nyquist; it keeps the last sample's phase."""
    b, a = scipy.signal.cheby1(8, 0.05, 0.8 / DECIMATION)
    n = len(columns)
    first = DECIMATION - (DECIMATION * -(-n // DECIMATION) - n) - 1
    return _both_ways(b, a, columns)[first::DECIMATION], first
