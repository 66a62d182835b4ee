"""What an identification of friction by inverse dynamics (by_elements.py) gives. Symbols as in models.friction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.effects.base import Effect
from models.friction import Friction, branch
from models.identification.estimate import Estimate

Array = NDArray[np.float64]

DAMPING: Final = "damping over stiffness"  # the name of tau = D_i / K_i, one for all elements
SPRING: Final = "spring to ground"  # the name of k, in a force k x
SIGNIFICANT_STDS: Final = 3.0  # standard deviations that damping or viscous friction must be away from none


@dataclass(frozen=True)
class ForceFit:
    """Elements, the estimate of all parameters, BIC by number of elements, and what is modelled.

    time [s], measured and modelled force [N], path [m], friction's share [N] (n,); used: which were fitted.
    lag: tau = D_i / K_i and its standard deviation [s] where damping was sought, whether it was taken or not.
    remembered: the force [N] that elements may carry from before the record, which the offset's deviation covers;
    short: the path is too short to show where the longest element ends; least [m]: where the shortest one is no longer
    than what was looked at, that limit, else 0. pass_band [Hz]: of the low-pass. effects: known
    ones, whose force is not in `measured` any more.
    """

    friction: Friction
    estimate: Estimate
    criterion: tuple[float, ...]
    time: Array
    path: Array
    measured: Array
    modelled: Array
    rolling: Array
    used: NDArray[np.bool_]
    lag: tuple[float, float] | None = None
    remembered: float = 0.0
    short: bool = False
    least: float = 0.0
    pass_band: float = math.nan
    effects: tuple[Effect, ...] = ()

    @property
    def damped(self) -> bool:
        """Whether the record shows damping."""
        return max(self.friction.damping) > 0

    @property
    def longest_lag(self) -> float:
        """The longest tau = D_i / K_i that the data allow, at SIGNIFICANT_STDS deviations [s]; nan if none was
        sought."""
        return max(self.lag[0], 0.0) + SIGNIFICANT_STDS * self.lag[1] if self.lag else math.nan

    def damping_std(self) -> Array:
        """Standard deviations of D_i = tau K_i (N,) [N s/m]; zeros if there is no damping."""
        count = len(self.friction.limit)
        if not (self.damped and self.lag):
            return np.zeros(count)
        where = self.estimate.names.index(DAMPING)
        slopes = np.zeros((count, self.estimate.values.size))
        slopes[:, where] = self.friction.stiffness
        slopes[np.arange(count), np.arange(count) - 2 * count] = self.lag[0]
        return np.asarray(np.sqrt(np.einsum("ij,jk,ik->i", slopes, self.estimate.covariance, slopes)))

    def error(self, *, used: bool) -> float:
        """Norm of the force error over that of the force, on the samples used in the fit or on the others [1]."""
        part = self.used if used else ~self.used
        return float(np.linalg.norm((self.measured - self.modelled)[part]) / np.linalg.norm(self.measured[part]))

    def curve(self, distance: Array) -> tuple[Array, Array]:
        """Force climbed [N] at `distance` (m,) [m] behind a reversal from full slip, and its standard deviation [N]."""
        s, count = np.asarray(distance, float)[:, None], len(self.friction.limit)
        stiffness, limit = np.array(self.friction.stiffness), np.array(self.friction.limit)
        slopes = np.hstack([np.minimum(s, 2 * limit), np.where(s > 2 * limit, 2 * stiffness, 0.0)])
        last = self.estimate.covariance[-2 * count :, -2 * count :]
        return branch(self.friction, distance), np.sqrt(np.einsum("ij,jk,ik->i", slopes, last, slopes))

    def slip_force(self) -> tuple[float, float]:
        """T_fc = sum K_i X_i and its standard deviation [N]."""
        far = np.array([4 * max(self.friction.limit)])
        climbed, std = self.curve(far)
        return float(climbed[0]) / 2, float(std[0]) / 2
