"""The deadbeat feedforward: N_ff(z) = N(z) Q(z) and D_ff(z) = D(z) Q(z) with P_l(z) = z^-d N(z) / D(z).

A step r gives x_T* = N_ff r and u_ff = D_ff r; after n = T / T_s samples x_T* rests on r and u_ff on 0. Every sequence
u[0 .. n-1] that brings the plant's state to rest on the target belongs to one Q and the other way round, so the design
chooses the sequence: its conditions are linear and well scaled in the modes' states, while D has 2m roots near z = 1.

Symbols: n samples of thrust u [N]; s states; S (s, n) state reached after n samples; G (n, n) x_T* at samples 1 .. n.
At rest between the samples too: the whole state rests, not only its output.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final, Literal, get_args

import casadi as ca
import numpy as np
import osqp
import scipy
from numpy.typing import NDArray
from scipy import sparse

from models.machines.consistency import MAX_SETTLING_SAMPLES
from models.plant import Mode, Plant, delay_split, sampled_matrices
from models.quantity import keeps_to, show
from models.variation import Variation, at_mode, varied_plant

Array = NDArray[np.float64]
Objective = Literal["thrust", "thrust_difference", "peak_thrust", "mode_robustness"]

OBJECTIVES: Final[dict[Objective, str]] = {
    "thrust": "least sum of squares of the thrust",
    "thrust_difference": "least sum of squares of the thrust's differences",
    "peak_thrust": "least peak thrust",
    "mode_robustness": "least vibration left when a mode's frequency is off by up to 5 %",
}
MODE_ERRORS: Final = (-0.05, -0.025, 0.025, 0.05)  # "mode_robustness" looks at these relative errors of a frequency.
ROUGHNESS: Final = 1e-6  # The weight of the thrust's differences beside the vibration left keeps the thrust smooth.
# A constraint is met with equality if it is this near its bound, as a share of the stroke or of the thrust's scale.
ACTIVE: Final = 1e-10


class DesignError(ValueError):
    """A design that is impossible; the message says why, and what is possible.

    >>> pos.design_deadbeat(machine, settling_time=15e-3)
    Traceback (most recent call last):
    design.deadbeat.DesignError: a stroke of 20 µm cannot settle in 15 ms within 133.5 N ...
    """


@dataclass(frozen=True)
class Constraints:
    """What u_ff and x_T* must keep to: |thrust| [N], overshoot [1, of the stroke], None: free; never backwards.

    >>> limits = pos.Constraints(thrust=120.0, overshoot=0.0)
    >>> pos.design_deadbeat(machine, settling_time=22e-3, constraints=limits)
    Deadbeat(20 µm in 22 ms, peak thrust ... N, overshoot 0 m)
    """

    thrust: float | None = None
    overshoot: float | None = None
    monotone: bool = False

    def __post_init__(self) -> None:
        """Raises DesignError for bounds that nothing can keep."""
        if self.thrust is not None and not self.thrust > 0:
            raise DesignError(
                f"a feedforward may use {show(self.thrust, 'N')} of thrust, which moves nothing; allow more than 0"
            )
        if self.overshoot is not None and not self.overshoot >= 0:
            raise DesignError(f"the overshoot must be at least 0, a share of the stroke, not {self.overshoot:g}")


@dataclass(frozen=True, eq=False)  # arrays have no one answer to ==
class Deadbeat:
    """One feedforward for steps of any height, designed for `stroke` [m] in `settling_time` [s].

    thrust (n,) [N] and position (n + 1,) [m] are u_ff and x_T* for the stroke. n_ff [m/m] and d_ff [N/m] are the
    coefficients of z^0, z^-1, ... of N_ff and D_ff; numerator, denominator and free those of N, D and Q.

    >>> deadbeat
    Deadbeat(20 µm in 20 ms, peak thrust ... N, overshoot ... m)
    """

    sample_time: float
    stroke: float
    settling_time: float
    thrust: Array
    position: Array
    n_ff: tuple[float, ...]
    d_ff: tuple[float, ...]
    numerator: Array
    denominator: Array
    free: Array

    def __repr__(self) -> str:
        peak, beyond = float(np.max(np.abs(self.thrust))), float(np.max(self.position)) - self.stroke
        return (
            f"Deadbeat({show(self.stroke, 'm')} in {show(self.settling_time, 's')}, peak thrust {show(peak, 'N')}, "
            f"overshoot {show(beyond if beyond > 1e-9 * self.stroke else 0.0, 'm')})"
        )


@dataclass(frozen=True)
class _Problem:
    """Conditions on w = u / scale: reach w = goal (rest on the target), x_T* / stroke at samples 1 .. n = path w."""

    scale: float
    reach: Array
    goal: Array
    path: Array
    units: Array  # of the states: strokes, strokes per rad, and the thrust under way


def synthesise(
    plant: Plant,
    sample_time: float,
    settling_time: float,
    stroke: float,
    objective: Objective = "thrust_difference",
    constraints: Constraints = Constraints(),
) -> Deadbeat:
    """The deadbeat feedforward that is best by `objective` within `constraints`; times [s], stroke [m].

    Raises DesignError for a stroke or time that means nothing, and, with the shortest settling time that can be met,
    where there is no such feedforward.
    """
    count = _samples(settling_time, sample_time)
    _check_stroke(stroke)
    if objective not in get_args(Objective):
        raise DesignError(f"objective {objective!r} is unknown; choose one of {', '.join(get_args(Objective))}")
    problem = _problem(plant, sample_time, count, stroke)
    if problem is None:
        raise DesignError(_why_not(plant, sample_time, settling_time, stroke, objective, constraints))
    solution = (
        _least_peak(problem, constraints)
        if objective == "peak_thrust"
        else _least_squares(problem, _effort(plant, sample_time, problem, objective), constraints)
    )
    if solution is None:
        raise DesignError(_why_not(plant, sample_time, settling_time, stroke, objective, constraints))
    return _deadbeat(plant, sample_time, stroke, settling_time, problem.scale * solution)


def least_peak_thrust(
    plant: Plant, sample_time: float, settling_time: float, stroke: float, *, monotone: bool = False
) -> float:
    """The least peak of |u_ff| [N] with which the stroke [m] can be done in settling_time [s]; inf if none can."""
    problem = _problem(plant, sample_time, _samples(settling_time, sample_time), stroke)
    solution = None if problem is None else _least_peak(problem, Constraints(monotone=monotone))
    return math.inf if problem is None or solution is None else float(problem.scale * np.max(np.abs(solution)))


def shortest_settling_time(plant: Plant, sample_time: float, stroke: float, constraints: Constraints) -> float:
    """The shortest settling time [s], a whole number of samples, that the constraints allow; inf if none up to
    MAX_SETTLING_SAMPLES.

    What can be done in n samples can be done in n + 1, so that halving the interval finds it.

    >>> round(pos.shortest_settling_time(machine.plant, machine.sample_time, 20e-6, pos.Constraints(thrust=133.5)), 9)
    0.019
    """

    if not (math.isfinite(sample_time) and sample_time > 0):
        raise DesignError(f"the sample time is {show(sample_time, 's')}; give one above 0, such as 500 us")
    _check_stroke(stroke)

    def possible(count: int) -> bool:
        """A rigid body alone needs thrust >= 4 M stroke / T^2, and no vibration helps it: that saves most programs."""
        reach = plant.rigid_gain * (count * sample_time) ** 2 / 4
        if constraints.thrust is not None and constraints.thrust * reach < stroke * (1 - 1e-6):
            return False
        problem = _problem(plant, sample_time, count, stroke)
        return problem is not None and _least_peak(problem, constraints) is not None

    low, high = 0, 8
    while not possible(high):
        low, high = high, 2 * high
        if high > MAX_SETTLING_SAMPLES:
            return math.inf
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if possible(middle) else (middle, high)
    return high * sample_time


def _check_stroke(stroke: float) -> None:
    if not (math.isfinite(stroke) and stroke > 0):
        raise DesignError(f"the stroke is {show(stroke, 'm')}; give one above 0, such as 20 um")


def _samples(settling_time: float, sample_time: float) -> int:
    if not (math.isfinite(settling_time) and settling_time > 0):
        raise DesignError(f"the settling time is {show(settling_time, 's')}; give one above 0, such as 20 ms")
    count = round(settling_time / sample_time)
    if count > MAX_SETTLING_SAMPLES:
        raise DesignError(
            f"a settling time of {show(settling_time, 's')} is {count} samples, and a deadbeat is designed for up to "
            f"{MAX_SETTLING_SAMPLES}, {show(MAX_SETTLING_SAMPLES * sample_time, 's')}; give it in seconds, "
            "such as 20e-3"
        )
    if count < 1 or abs(settling_time / sample_time - count) > 1e-6:
        nearest = max(count, 1) * sample_time
        raise DesignError(
            f"the settling time must be a whole number of samples of {show(sample_time, 's')}, "
            f"not {show(settling_time, 's')}; take {show(nearest, 's')}"
        )
    return count


def _problem(plant: Plant, sample_time: float, count: int, stroke: float) -> _Problem | None:
    """The problem for `count` samples; None where they are fewer than the states, which nothing can bring to rest."""
    a, b, c = sampled_matrices(plant, sample_time, whole_delay=False)
    states = len(a)
    if count < states:
        return None
    powers = _reach(a, b, count)
    if not np.all(np.isfinite(powers)):
        raise DesignError(
            f"the response of the modes overflows over {count} samples; correct their gains and frequencies"
        )
    goal = np.zeros(states)
    goal[2 * plant.rigid] = 1.0
    scale = stroke / (plant.rigid_gain * (count * sample_time) ** 2)
    units = np.ones(states)
    for j, mode in enumerate(plant.modes):
        units[2 * j : 2 * j + 2] = stroke, stroke * _rate(mode, count * sample_time)
    units[2 * len(plant.modes) :] = scale
    path = np.zeros((count, count))
    impulse = (c @ powers)[0, ::-1]
    for k in range(count):
        path[k, : k + 1] = impulse[: k + 1][::-1]
    # The same conditions with orthonormal rows: the vibrating states are 400 times less in reach than the rigid body's.
    orthonormal, mixing = np.linalg.qr((scale * powers / units[:, None]).T)
    try:
        reached = np.linalg.solve(mixing.T, goal)
    except np.linalg.LinAlgError as error:
        raise DesignError(_inseparable(plant, sample_time)) from error
    return _Problem(scale, orthonormal.T, reached, scale / stroke * path, units)


def _vibration(plant: Plant, sample_time: float, problem: _Problem) -> Array:
    """Rows (m, n) whose sum of squares on w is what wrong mode frequencies leave, relative to the stroke."""
    count = problem.reach.shape[1]
    rows = [np.zeros((0, count))]
    for j in plant.flexible:
        for error in MODE_ERRORS:
            off = varied_plant(plant, Variation(frequency=at_mode(plant, j, error)))
            a, b, _ = sampled_matrices(off, sample_time, whole_delay=False)
            rows.append((_reach(a, b, count) / problem.units[:, None])[2 * j : 2 * j + 2])
    return problem.scale * np.vstack(rows)


def _inseparable(plant: Plant, sample_time: float) -> str:
    """Which modes no thrust brings to rest apart: the two whose frequencies are nearest."""
    order = sorted(plant.flexible, key=lambda j: plant.modes[j].frequency)
    pairs = list(pairwise(order))
    if not pairs:
        return f"no thrust brings the machine to rest to round-off; correct its modes or {show(sample_time, 's')}"
    one, other = min(pairs, key=lambda pair: plant.modes[pair[1]].frequency / plant.modes[pair[0]].frequency)
    return (
        f"no thrust brings the {len(plant.modes)} modes to rest one by one; the nearest are plant.modes.{one + 1} and "
        f"plant.modes.{other + 1}, {show(plant.modes[one].frequency, 'Hz')} and "
        f"{show(plant.modes[other].frequency, 'Hz')}: join modes that are alike and leave out those that hardly show"
    )


def _reach(a: Array, b: Array, count: int) -> Array:
    """S (s, n): column k is what a unit thrust at sample k leaves in the state at sample n."""
    columns = np.empty((len(a), count))
    column = b[:, 0]
    for k in range(count - 1, -1, -1):
        columns[:, k] = column
        column = a @ column
    return columns


def _rate(mode: Mode, duration: float) -> float:
    """What the mode's velocity is measured in, per unit of its displacement [1/s]."""
    return 2 * math.pi * mode.frequency if mode.frequency > 0 else 1 / duration


def _bounds(problem: _Problem, constraints: Constraints) -> tuple[Array, Array, Array]:
    """(A, lower, upper) of the constraints lower <= A w <= upper, the deadbeat itself first."""
    count = problem.reach.shape[1]
    rows, lower, upper = [problem.reach], [problem.goal], [problem.goal]
    if constraints.thrust is not None:
        rows.append(np.eye(count))
        lower.append(np.full(count, -constraints.thrust / problem.scale))
        upper.append(np.full(count, constraints.thrust / problem.scale))
    if constraints.overshoot is not None:
        rows.append(problem.path)
        lower.append(np.full(count, -np.inf))
        upper.append(np.full(count, 1 + constraints.overshoot))
    if constraints.monotone:
        rows.append(np.diff(problem.path, axis=0, prepend=0.0))
        lower.append(np.zeros(count))
        upper.append(np.full(count, np.inf))
    return np.vstack(rows), np.concatenate(lower), np.concatenate(upper)


def _effort(plant: Plant, sample_time: float, problem: _Problem, objective: Objective) -> Array:
    """F (m, n) of a quadratic objective |F w|^2."""
    count = problem.reach.shape[1]
    if objective == "thrust":
        return np.eye(count)
    difference = np.diff(np.eye(count), axis=0, prepend=0.0, append=0.0)
    if objective == "thrust_difference":
        return difference
    return np.vstack([_vibration(plant, sample_time, problem), ROUGHNESS * difference])


def _least_squares(problem: _Problem, factor: Array, constraints: Constraints) -> Array | None:
    """w (n,) with the least |factor w|^2 within the constraints; None if there is none.

    A QP, by OSQP. Where it comes to no end, as next to the least thrust with which the stroke can be done, by HiGHS,
    whose method of active sets has vertices for its steps.
    """
    a, lower, upper = _bounds(problem, constraints)
    count = a.shape[1]
    hessian = factor.T @ factor
    solver = osqp.OSQP()
    solver.setup(
        sparse.csc_matrix(np.triu(hessian / np.max(np.abs(hessian)))),
        np.zeros(count),
        sparse.csc_matrix(a),
        lower,
        upper,
        eps_abs=1e-8,
        eps_rel=1e-8,
        max_iter=200_000,
        adaptive_rho_interval=50,  # not by time, so that two runs take the same steps
        polishing=True,
        verbose=False,
    )
    result = solver.solve(raise_error=False)
    if result.info.status_val == osqp.SolverStatus.OSQP_SIGINT:
        raise KeyboardInterrupt  # OSQP took the signal for itself
    found = _refined(np.asarray(result.x), a, lower, upper) if result.info.status == "solved" else None
    return found if found is not None else _by_active_sets(hessian, a, lower, upper)


def _by_active_sets(hessian: Array, a: Array, lower: Array, upper: Array) -> Array | None:
    """The same w by HiGHS, through CasADi."""
    count = a.shape[1]
    active_sets = ca.conic(
        "active_sets",
        "highs",
        {"h": ca.Sparsity.dense(count, count), "a": ca.Sparsity.dense(*a.shape)},
        {"error_on_fail": False, "highs": {"output_flag": False}},
    )
    found = active_sets(h=hessian / np.max(np.abs(hessian)), g=0.0, a=a, lba=lower, uba=upper)
    return _refined(np.array(found["x"])[:, 0], a, lower, upper) if active_sets.stats()["success"] else None


def _least_peak(problem: _Problem, constraints: Constraints) -> Array | None:
    """w with the least max |w| within the constraints; None if there is none. A linear program, by HiGHS."""
    a, lower, upper = _bounds(problem, replace(constraints, thrust=None))
    count, conditions = a.shape[1], problem.goal.size
    peak = np.hstack([np.vstack([np.eye(count), -np.eye(count)]), -np.ones((2 * count, 1))])
    above, below = np.isfinite(upper[conditions:]), np.isfinite(lower[conditions:])
    rows = np.vstack([a[conditions:][above], -a[conditions:][below]])
    limits = np.concatenate([upper[conditions:][above], -lower[conditions:][below]])
    result = scipy.optimize.linprog(
        np.append(np.zeros(count), 1.0),
        A_ub=np.vstack([peak, np.hstack([rows, np.zeros((len(rows), 1))])]),
        b_ub=np.concatenate([np.zeros(2 * count), limits]),
        A_eq=np.hstack([problem.reach, np.zeros((conditions, 1))]),
        b_eq=problem.goal,
        bounds=[(None, None)] * count + [(0, None)],
    )
    if not result.success:
        return None
    if constraints.thrust is not None and not keeps_to(result.x[-1] * problem.scale, constraints.thrust):
        return None
    return _refined(result.x[:-1], a, lower, upper)


def _refined(solution: Array, a: Array, lower: Array, upper: Array) -> Array | None:
    """The nearest w that meets the deadbeat and the active constraints to round-off; None if there is none near.

    Only what the solver left within ACTIVE of its bound is held there: a small step of x_T* is not an active bound.
    """
    refined, close = solution, 1e-6
    at_lower, at_upper = a @ solution - lower < ACTIVE, upper - a @ solution < ACTIVE
    equal = lower == upper
    for active in ((at_lower | at_upper | equal), equal):
        bound = np.where(at_lower | equal, lower, upper)
        refined = solution
        for _ in range(3):  # each pass takes off what round-off left of the one before
            refined = refined + np.linalg.lstsq(a[active], (bound - a @ refined)[active], rcond=1e-12)[0]
        missed = np.max(np.maximum(lower - a @ refined, a @ refined - upper), initial=0.0)
        if missed < close:
            return refined
    return None


def _why_not(
    plant: Plant,
    sample_time: float,
    settling_time: float,
    stroke: float,
    objective: Objective,
    constraints: Constraints,
) -> str:
    """What no solver found, and what it takes."""
    shortest = shortest_settling_time(plant, sample_time, stroke, constraints)
    if keeps_to(shortest, settling_time):
        return (
            f"neither OSQP nor HiGHS finds the least {objective} for a stroke of {show(stroke, 'm')} in "
            f"{show(settling_time, 's')}, though there is one; allow a little more time or thrust, or take another "
            "objective"
        )
    limit = "" if constraints.thrust is None else f" within {show(constraints.thrust, 'N')}"
    shape = " with a monotone x_T*" if constraints.monotone else ""
    shape += "" if constraints.overshoot is None else f" with at most {constraints.overshoot:.0%} overshoot"
    needed = least_peak_thrust(plant, sample_time, settling_time, stroke, monotone=constraints.monotone)
    need = f"it takes {show(needed, 'N', 3)}" if math.isfinite(needed) else "no thrust does it"
    advice = (
        f"the shortest that can is {show(shortest, 's')}"
        if math.isfinite(shortest)
        else f"none up to {MAX_SETTLING_SAMPLES} samples can"
    )
    return (
        f"a stroke of {show(stroke, 'm')} cannot settle in {show(settling_time, 's')}{limit}{shape} ({need}); {advice}"
    )


def _deadbeat(plant: Plant, sample_time: float, stroke: float, settling_time: float, thrust: Array) -> Deadbeat:
    """N_ff and D_ff from the thrust's samples, and the polynomials N, D, Q behind them."""
    a, b, c = sampled_matrices(plant, sample_time, whole_delay=False)
    state, position = np.zeros(len(a)), np.zeros(thrust.size + 1)
    for k, u in enumerate(thrust):
        state = a @ state + b[:, 0] * u
        position[k + 1] = float(c[0] @ state)
    position[-1] = stroke  # met to round-off; exact here, so that N_ff(1) = 1
    n_ff = np.diff(position, prepend=0.0) / stroke
    d_ff = np.diff(thrust, prepend=0.0, append=0.0) / stroke
    numerator, denominator = polynomials(plant, sample_time)
    order = denominator.size - 1
    convolution = np.zeros((d_ff.size, d_ff.size - order))
    for k in range(convolution.shape[1]):
        convolution[k : k + order + 1, k] = denominator
    free = np.asarray(np.linalg.lstsq(convolution, d_ff, rcond=None)[0], float)
    return Deadbeat(
        sample_time,
        stroke,
        settling_time,
        thrust,
        position,
        tuple(n_ff.tolist()),
        tuple(d_ff.tolist()),
        numerator,
        denominator,
        free,
    )


def polynomials(plant: Plant, sample_time: float) -> tuple[Array, Array]:
    """(N, D) of P_l(z) = z^-d N(z) / D(z), coefficients of z^0, z^-1, ...; D has the sampled poles, D[0] = 1.

    A dead time that is not a whole number of samples gives N one coefficient more. For reading: designs use the states.
    """
    poles = np.exp(sample_time * np.concatenate([_poles(mode) for mode in plant.modes]))
    denominator = np.real(np.poly(poles))
    a, b, c = sampled_matrices(plant, sample_time, whole_delay=False)
    impulse = np.append(0.0, (c @ _reach(a, b, len(a) + 1))[0, ::-1])
    _, rest = delay_split(plant.dead_time, sample_time)
    numerator = np.convolve(denominator, impulse)[: denominator.size + (rest > 0)]
    return numerator, denominator


def _poles(mode: Mode) -> NDArray[np.complex128]:
    omega = 2 * math.pi * mode.frequency
    root = np.emath.sqrt(mode.damping**2 - 1.0)
    return np.asarray(omega * np.array([-mode.damping + root, -mode.damping - root]), complex)
