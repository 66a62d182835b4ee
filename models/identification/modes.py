"""P_l(s) of eq. (1) from a measured frequency response: modes, gains, damping and dead time, with uncertainties.

Weighted least squares on the complex response, with a current loop's lag and, of an axis that rolled, viscous drag and
a spring to ground as candidates beside the modes (modal/transfer.py); how many modes there are is decided in
modal/order.py. Several responses of one machine are fitted together. Symbols: k gain, f frequency [Hz], zeta damping, L
dead time [s].
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from models.identification import MOST_MODES
from models.identification.estimate import Estimate
from models.identification.force.fit import SPRING
from models.identification.modal.fitting import Beside, decoded, left_of, sizes
from models.identification.modal.foreign import left_out
from models.identification.modal.order import (
    HEAVY,
    MAX_MODE_GAIN_RATIO,
    Candidate,
    Chosen,
    Order,
    beside_unseen,
    chosen,
)
from models.identification.modal.problem import Problem, Structure, problem_of
from models.identification.modal.transfer import Array, Complex, response
from models.identification.response import FrequencyResponse
from models.identification.unusable import UnusableError
from models.plant import Plant

FEWEST_LINES: Final = 12
POOR: Final = 0.1  # squared relative error of the lines from which on no model fits them at all
LAG: Final = "current loop lag"
DRAG: Final = "viscous friction"
NAMED: Final = {"lag": (LAG, "s"), "drag": (DRAG, "N s/m"), "spring": (SPRING, "N/m")}


@dataclass(frozen=True)
class Spring:
    """What is known beforehand of a spring to ground: its stiffness [N/m], 0 for none, and whether the response may say
    otherwise."""

    stiffness: float = 0.0
    sought: bool = True


UNKNOWN: Final = Spring()


@dataclass(frozen=True)
class Fit:
    """P_l, its parameters' estimate, which lines (n,) of each response were used, BIC by number of modes, reduced
    chi-square; the current loop's lag [s] and the viscous drag [N s/m] where the response shows them, else 0; the
    spring to ground [N/m], as known beforehand or, where it is in the estimate, as the response shows it.

    orders: what was found at each number of modes, for a stabilisation diagram; worth: by how much BIC would rise
    without each part. early [s]: a dead time below none that was found, and taken as none; 0 if none was. bent: the low
    lines are bent by friction.
    """

    plant: Plant
    estimate: Estimate
    used_lines: tuple[NDArray[np.bool_], ...]
    criterion: tuple[float, ...]
    chi_square: float
    lag: float = 0.0
    drag: float = 0.0
    spring: float = 0.0
    orders: tuple[Order, ...] = ()
    worth: tuple[tuple[str, float], ...] = ()
    early: float = 0.0
    bent: bool = False

    @property
    def used(self) -> NDArray[np.bool_]:
        """Which lines (n,) of the first response were used."""
        return self.used_lines[0]

    @property
    def beside(self) -> Beside:
        """What acts beside the modes [SI]."""
        return Beside(self.lag, self.drag, self.spring)


def fit(measured: FrequencyResponse, *, count: int | None = None, spring: Spring = UNKNOWN) -> Fit:
    """P_l from a frequency response (thrust constant 1); see the module's head.

    count: so many modes, whatever the response shows. spring: to ground, as known.
    Low lines that rolling friction bends are left out: the lowest line used is raised by third octaves until the lowest
    octave left fits as well as the rest (its reduced chi-square at most 3 times that of the rest, or 1) and every mode
    is one of the structure: above that line, damped by less than 0.2, its gain below ten times the rigid body's (a
    light rotor sees the mode of a heavy load larger than that body). A record that rolled throughout
    (`measured.rolling`) has no such lines.
    Raises ValueError for fewer than 12 lines [Hz], an UnusableError where the whole response is bent.
    """
    f = measured.frequency
    if f.size < FEWEST_LINES:
        raise ValueError(
            f"{f.size} lines are too few to fit modes; measure {FEWEST_LINES} at least, or name its kind if it is no "
            "excitation"
        )
    if measured.rolling:
        return _fit([measured], [np.ones(f.size, bool)], count, spring)
    lowest = float(f[0])
    while np.sum(f >= lowest) >= FEWEST_LINES and lowest < f[-1] / 4:
        found = _fit([measured], [f >= lowest], count, spring)
        if not found.bent and _fits_low(measured, found, lowest):
            return found
        lowest *= 2 ** (1 / 3)
    from_file = "; say so (--rolling) if this response was measured like that" if measured.sample_time == 0 else ""
    raise UnusableError(
        f"no line below {f[-1] / 4:.3g} Hz agrees with a rigid body and modes: friction bends the whole response; "
        f"excite while the axis rolls, or with strokes well beyond the presliding region{from_file}"
    )


def fit_together(
    measured: Sequence[FrequencyResponse],
    used: Sequence[NDArray[np.bool_]],
    *,
    count: int | None = None,
    spring: Spring = UNKNOWN,
) -> Fit:
    """One P_l from several responses of a machine, each by its used lines (n,); if one has no stated variance, all
    lines count alike, relative to their size [1]."""
    return _fit(measured, used, count, spring)


def misfit(measured: FrequencyResponse, used: NDArray[np.bool_], plant: Plant, beside: Beside) -> float:
    """Reduced chi-square [1] of a plant and what acts beside its modes, none of it fitted, on the used lines (n,);
    where no variance is stated, the mean squared relative error of real and imaginary parts."""
    problem = problem_of([measured], [used])
    left = left_of(plant, beside, problem)
    return float(left @ left) / problem.size


def model(
    plant: Plant, frequency: Array, sample_time: float, *, lag: float = 0.0, drag: float = 0.0, spring: float = 0.0
) -> Complex:
    """P_l (n,) [m/N] at frequencies [Hz]: behind a zero-order hold at the samples, or continuous for sample_time 0;
    lag [s] of the current loop, drag [N s/m], spring to ground [N/m]."""
    return response(plant, frequency, sample_time, lag=lag, drag=drag, spring=spring)


def _fit(
    measured: Sequence[FrequencyResponse],
    used: Sequence[NDArray[np.bool_]],
    count: int | None,
    spring: Spring,
) -> Fit:
    problem = problem_of(measured, used, spring.stiffness)
    rolling = all(one.rolling for one in measured)
    candidates = Structure(lag=True, drag=rolling, spring=rolling and spring.sought)

    def search(among: Problem) -> Chosen:
        return chosen(among, MOST_MODES, candidates, exactly=count, rolling=rolling or len(measured) > 1)

    found = search(problem)
    if len(measured) == 1 and measured[0].settled > 0 and not found.bent:
        found, kept = left_out(problem, found, search)
        mask = used[0].copy()
        mask[mask] = kept
        used, problem = [mask], problem_of(measured, [mask], spring.stiffness)
    best = found.best if found.bent else beside_unseen(problem, found.best, candidates)
    plant, beside = decoded(best.theta, best.structure, problem)
    early, plant = min(plant.dead_time, 0.0), replace(plant, dead_time=max(plant.dead_time, 0.0))
    rigid, *modes = plant.modes
    plant = replace(plant, modes=(rigid, *sorted(modes, key=lambda mode: mode.frequency)))
    criterion = tuple(order.criterion for order in found.orders)
    chi_square = best.cost / max(problem.size - best.theta.size, 1)
    worth = tuple(found.worth.items())
    estimate = _estimate(best, problem)
    return Fit(
        plant, estimate, tuple(used), criterion, chi_square, beside.lag, beside.drag, beside.spring,
        found.orders, worth, early, found.bent,
    )  # fmt: skip


def _fits_low(measured: FrequencyResponse, found: Fit, lowest: float) -> bool:
    """Whether the lowest octave used is as the fit says: see `fit`."""
    problem = problem_of([measured], [found.used])
    left = left_of(found.plant, found.beside, problem).reshape(2, -1)
    size = np.sum(left**2, axis=0) * (0.5 if problem.known else 1.0)  # squared error over variance, or over |P|^2
    low, known = measured.frequency[found.used] < 2 * lowest, problem.known
    rest = float(np.median(size[~low])) / math.log(2)  # the mean of an exponential variable from its median
    level = max(1.0, rest) if known else max(rest, 1e-6)
    rigid, *modes = found.plant.modes
    structural = all(
        mode.frequency > 1.1 * lowest and mode.damping < HEAVY and abs(mode.gain) < MAX_MODE_GAIN_RATIO * rigid.gain
        for mode in modes
    )
    return structural and (known or rest < POOR) and bool(np.mean(size[low]) < 3 * level)


def _estimate(best: Candidate, problem: Problem) -> Estimate:
    """The parameters as a machine file has them, by linear propagation; a dead time below none as none."""
    first, theta, unit = best.structure.before, best.theta, problem.unit
    order = [*range(first), *(first + 3 * i + j for i in np.argsort(theta[first + 1 :: 3]) for j in range(3))]
    theta, covariance = theta[order], best.covariance[np.ix_(order, order)]
    rigid = math.exp(theta[0])
    names, units, values = ["rigid body gain", "dead time"], ["1/kg", "s"], [rigid, max(theta[1], 0.0) * unit]
    slopes = np.zeros((theta.size, theta.size))
    slopes[0, 0], slopes[1, 1] = rigid, unit
    for part in best.structure.parts:
        row, size = best.structure.index(part), sizes(problem)[part] / (1.0 if part == "lag" else rigid)
        names, units = [*names, NAMED[part][0]], [*units, NAMED[part][1]]
        values.append(theta[row] * size)
        slopes[row, row], slopes[row, 0] = size, 0.0 if part == "lag" else -theta[row] * size
    for i, (k, f, zeta) in enumerate(theta[first:].reshape(-1, 3)):
        row = first + 3 * i
        mode = f"mode {i + 2}"  # as machine files count them, where the rigid body is the first
        names += [f"{mode} gain", f"{mode} frequency", f"{mode} damping"]
        units += ["1/kg", "Hz", "1"]
        values += [rigid * k, math.exp(f), math.exp(zeta)]
        slopes[row, 0], slopes[row, row] = rigid * k, rigid
        slopes[row + 1, row + 1], slopes[row + 2, row + 2] = math.exp(f), math.exp(zeta)
    return Estimate(tuple(names), tuple(units), np.array(values), slopes @ covariance @ slopes.T)
