"""The PID at the edge of stability: the most friction suppression that |S|, |T| and |CS| allow over a family of plants.

A semi-infinite program: the bounds hold at every frequency, the program (CasADi, IPOPT, exact derivatives) sees some.
|1 + L| is asked to be large along where 1 + L pointed in the round before, which is stricter than asking for its size:
so no step of the gains leads through -1 and a stable loop stays stable (the convex-concave procedure of Hast, Astrom,
Bernhardsson and Boyd, ECC 2013). Where a peak rises over its bound that frequency joins, and the program is solved
again, until nothing moves, every peak keeps to its bound between the frequencies too, and every loop is stable by its
eigenvalues: then it is certified.

Symbols as in the diagram of `design.loop`. Unknowns: (kp, ki, kd), scaled, and a = tau / (tau + T_s); C is linear in
the gains. A slot is one frequency of one member of the family: P and z there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import casadi as ca
import control
import numpy as np
from numpy.typing import NDArray

from design.family import Member
from design.loop import (
    Assessment,
    Complex,
    assess,
    frequency_response,
    grid,
    pid_response,
    sensitivities,
    sensitivity,
)
from design.pid_program import OBJECTIVES, SLOTS, Goal, program
from models.controller import PID
from models.plant import Plant
from models.quantity import show

Array = NDArray[np.float64]
Slot = tuple[float, complex]  # omega [rad/s] and P there [m/N]

TOLERANCE: Final = 1e-4  # by which a certified peak may exceed its bound, relative
ROUNDS: Final = 40  # in which frequencies join the grid
NEAR: Final = 0.05  # of the largest gain: a round that moves less is followed by one with the exact bounds
LEAST_TRUST: Final = 1.05
WITHIN: Final = 0.04  # of the largest gain: a round that moves less may be the last,
SETTLED: Final = 1e2  # and one that moves less than this by the tolerance, since the best is flat
EXACT_TRUST: Final = 0.1  # of the factor's excess over 1, for the exact bounds
BASE: Final = 40  # slots of the nominal members together that it begins with
NEARLY: Final = 0.8  # of its bound: a maximum above it is among the first slots
TRUST: Final = 3.0  # factor by which a gain may change in a round
LONGEST_FILTER: Final = 0.98  # of a = tau / (tau + T_s)
REACH: Final = 50.0  # of the largest gain over the one a problem is scaled with


class TuningError(ValueError):
    """No PID keeps to the bounds; the message says what was tried and what would help."""


@dataclass(frozen=True)
class Bounds:
    """What every loop of the family keeps to: peaks |S| <= ms [1], |T| <= mt [1], |CS| <= mcs [N/m]."""

    ms: float
    mt: float = math.inf
    mcs: float = math.inf


@dataclass(frozen=True)
class Attempt:
    """One start and what became of it, a sentence; `value` as the objective has it, None if it failed."""

    start: str
    outcome: str
    value: float | None


@dataclass(frozen=True)
class Tuning:
    """A certified PID: `loops` are the family's, in its order; `value` is the objective's (see `achieved`)."""

    pid: PID
    bounds: Bounds
    value: float
    loops: tuple[Assessment, ...]
    attempts: tuple[Attempt, ...]

    @property
    def ms(self) -> float:
        """The family's largest peak of |S| [1]."""
        return max(loop.ms.value for loop in self.loops)


@dataclass(frozen=True)
class Problem:
    """A program built once for a family and a goal, its bounds and slots parameters; see `pose` and `tune`.

    scale: the PID whose gains the unknowns are measured in. lower, upper (5,): of the unknowns. check: per member the
    frequencies (n,) [rad/s] and P there (n,) [m/N], at which every solution is looked at. band: slots of the objective.
    """

    members: tuple[Member, ...]
    goal: Goal
    scale: PID
    solver: ca.Function
    lower: Array
    upper: Array
    check: tuple[tuple[Array, Complex], ...]
    band: tuple[Slot, ...]

    @property
    def sample_time(self) -> float:
        """T_s [s]."""
        return float(self.members[0].plant.dt)


def simc(plant: Plant, sample_time: float, closed_loop: float, derivative_filter: float) -> PID:
    """Skogestad's rule for k'' exp(-theta s) / s^2 with closed-loop time constant `closed_loop` tau_c [s]; times [s].

    K_c = 1 / (4 k'' (tau_c + theta)^2), tau_I = tau_D = 4 (tau_c + theta) in series form (J. Process Control 13, 2003,
    table 1); theta = L + T_s / 2 for the hold.
    """
    slow = closed_loop + plant.dead_time + sample_time / 2
    gain = 1 / (4 * _rigid_gain(plant) * slow**2)
    return PID(2 * gain, gain / (4 * slow), gain * 4 * slow, derivative_filter)


def lambda_rule(plant: Plant, closed_loop: float, derivative_filter: float) -> PID:
    """Three poles of the rigid body's loop at -1 / lambda, dead time left out; lambda = `closed_loop`; times [s]."""
    gain = 1 / _rigid_gain(plant)
    return PID(3 * gain / closed_loop**2, gain / closed_loop**3, 3 * gain / closed_loop, derivative_filter)


def pose(
    members: Sequence[Member],
    goal: Goal,
    scale: PID,
    *,
    derivative: bool = True,
    derivative_filter: float | None = None,
    count: int = 500,
    lowest: float = 2e-3,
) -> Problem:
    """The program for a family and a goal, to be solved by `tune` for any bounds.

    scale: a PID of the right magnitude. derivative: False for a PI. derivative_filter [s]: None if it is to be chosen.
    count, lowest [1, of Nyquist's frequency]: of the grid of each member, to which its resonances are added.
    """
    if goal.objective not in OBJECTIVES:
        raise TuningError(f"objective {goal.objective!r} is unknown; choose one of {', '.join(OBJECTIVES)}")
    ts = members[0].plant.dt
    grids = [grid(member.plant, None, count, lowest) for member in members]
    check = tuple(
        (omega, frequency_response(member.plant, omega)) for omega, member in zip(grids, members, strict=True)
    )
    keep = (0.0, LONGEST_FILTER)
    if derivative_filter is not None:
        keep = (derivative_filter / (derivative_filter + ts),) * 2
    band = [slot for omega, p in check for slot in _slots_in_band(omega, p, goal)]
    return Problem(
        tuple(members),
        goal,
        scale,
        program(members, goal, scale, len(band)),
        np.array([1e-4, 1e-6, 0.0, keep[0], -np.inf]),
        np.array([REACH, REACH, REACH if derivative else 0.0, keep[1], np.inf]),
        check,
        tuple(band),
    )


def tune(problem: Problem, bounds: Bounds, starts: Sequence[tuple[str, PID]], tolerance: float = TOLERANCE) -> Tuning:
    """The best certified PID within the bounds from several named starts, each attempt reported.

    tolerance [1]: by which a peak may exceed its bound, relative. Raises TuningError if no start leads to one.
    """
    best: Tuning | None = None
    attempts = []
    for name, start in starts:
        found, outcome = _from_start(problem, bounds, start, tolerance)
        attempts.append(Attempt(name, outcome, None if found is None else found.value))
        if found is not None and (best is None or _rank(problem, found) < _rank(problem, best)):
            best = found
    if best is None:
        tried = "; ".join(f"{attempt.start}: {attempt.outcome}" for attempt in attempts)
        limit = f", |T| <= {bounds.mt:g}, |CS| <= {show(bounds.mcs, 'N/m')}"
        raise TuningError(
            f"no PID with |S| <= {bounds.ms:g}{limit} for all {len(problem.members)} plants was found ({tried}); "
            "raise a bound, or take plants out of the family"
        )
    return replace(best, attempts=tuple(attempts))


def achieved(members: Sequence[Member], pid: PID, goal: Goal) -> float:
    """The goal's value: ki [N/(m s)]; largest |PS| in the band [m/N]; or largest |x| [m] per newton from `begin` on."""
    if goal.objective == "integral":
        return pid.ki
    if goal.objective == "band":
        return max(_in_band(member.plant, pid, goal.band) for member in members)
    return max(float(np.max(np.abs(_step_error(m.plant, pid, goal)))) for m in members if m.nominal)


def _from_start(problem: Problem, bounds: Bounds, start: PID, tolerance: float) -> tuple[Tuning | None, str]:
    """Rounds of solving and looking between the slots; the certified tuning or None, and what happened.

    First with the stricter bounds, which keep a stable loop stable; with the exact ones once the gains hardly move.
    """
    guess = before = _scaled(problem, start)
    slots = _tightest(problem, start, bounds, _critical(problem, start, bounds, NEARLY) + _base(problem))
    trust, exact = TRUST, False
    for count in range(1, ROUNDS + 1):
        solution = _solve(problem, bounds, slots, guess, trust, exact=exact)
        if solution is None:  # too far: back half the way, and on in shorter steps
            trust, guess, exact = math.sqrt(trust), 0.5 * (before + guess), False
            if trust < LEAST_TRUST:
                return None, f"IPOPT found no point within the bounds (round {count})"
            continue
        moved = float(np.max(np.abs(solution[:4] - guess[:4])) / np.max(guess[:3]))
        before, guess, pid = guess, solution, _pid(problem, solution)
        above = _critical(problem, pid, bounds, 1 + 0.01 * tolerance)
        certain = not _critical(problem, pid, bounds, 1 + tolerance) if above else True
        if certain and exact and moved < min(WITHIN, SETTLED * tolerance):
            loops = tuple(assess(member.plant, pid) for member in problem.members)
            if not all(loop.stable for loop in loops):
                return None, "it keeps to the bounds, but a loop is unstable"
            between = _above_between(problem, loops, bounds, tolerance)
            if not between:
                value = achieved(problem.members, pid, problem.goal)
                return Tuning(pid, bounds, value, loops, ()), f"certified after {count} rounds"
            above += between
        exact = moved < NEAR
        slots = _tightest(problem, pid, bounds, above + slots)
    return None, f"a peak still exceeds its bound after {ROUNDS} rounds"


def _trust(problem: Problem, guess: Array, factor: float) -> tuple[Array, Array]:
    """Bounds on the unknowns: gains within a factor of the guess."""
    lower, upper = problem.lower.copy(), problem.upper.copy()
    lower[:3] = np.maximum(lower[:3], guess[:3] / factor)
    upper[:3] = np.minimum(upper[:3], np.maximum(guess[:3], 1e-3) * factor)
    return lower, np.maximum(lower, upper)


def _tightest(problem: Problem, pid: PID, bounds: Bounds, slots: Sequence[Slot]) -> list[Slot]:
    """As many slots as a program has room for: those of `_base`, and of the others where a bound is nearest."""
    base = _base(problem)
    others = sorted(set(slots) - set(base), key=lambda slot: (slot[0], slot[1].real))
    if not others:
        return base
    omega, response = np.array([w for w, _ in others]), np.array([p for _, p in others])
    s = sensitivities(response, pid_response(pid, problem.sample_time, omega))
    shares = [np.abs(s["S"]) / bounds.ms, np.abs(s["T"]) / bounds.mt, np.abs(s["CS"]) / bounds.mcs]
    order = np.argsort(-np.max(shares, axis=0), kind="stable")[: SLOTS - len(base)]
    return base + [others[i] for i in order]


def _base(problem: Problem) -> list[Slot]:
    """A few slots of each nominal member, evenly spread in the logarithm of frequency."""
    slots = []
    each = BASE // sum(member.nominal for member in problem.members)
    for member, (omega, response) in zip(problem.members, problem.check, strict=True):
        if member.nominal:
            chosen = np.unique(np.linspace(0, omega.size - 1, each).round().astype(int))
            slots += [(float(omega[i]), complex(response[i])) for i in chosen]
    return slots


def _critical(problem: Problem, pid: PID, bounds: Bounds, share: float) -> list[Slot]:
    """Where a member's |S|, |T| or |CS| has a maximum above `share` of its bound, also between the check's points."""
    found = []
    for member, (omega, response) in zip(problem.members, problem.check, strict=True):
        s = sensitivities(response, pid_response(pid, problem.sample_time, omega))
        tops = []
        for magnitude, bound in ((s["S"], bounds.ms), (s["T"], bounds.mt), (s["CS"], bounds.mcs)):
            tops += _tops(omega, np.log(np.abs(magnitude)), math.log(share * bound))
        if tops:
            found += list(zip(tops, frequency_response(member.plant, tops).tolist(), strict=True))
    return found


def _tops(omega: Array, values: Array, above: float) -> list[float]:
    """The tops [rad/s] of parabolas through three of `values` (n,) whose middle is a maximum, and the grid's ends."""
    left, middle, right = values[:-2], values[1:-1], values[2:]
    index = np.flatnonzero((middle >= left) & (middle > right))
    bend = left[index] - 2 * middle[index] + right[index]
    shift = 0.5 * (left[index] - right[index]) / bend
    high = middle[index] - 0.5 * shift**2 * bend > above
    index, shift = index[high], shift[high]
    spacing = np.where(shift > 0, omega[index + 2] - omega[index + 1], omega[index + 1] - omega[index])
    ends = [float(omega[i]) for i in (0, -1) if values[i] > above]
    return [*(omega[index + 1] + shift * spacing).tolist(), *ends]


def _above_between(problem: Problem, loops: Sequence[Assessment], bounds: Bounds, tolerance: float) -> list[Slot]:
    """The peaks between the check's frequencies that exceed their bounds."""
    found = []
    for member, loop in zip(problem.members, loops, strict=True):
        for peak, bound in ((loop.ms, bounds.ms), (loop.mt, bounds.mt), (loop.mcs, bounds.mcs)):
            if peak.value > bound * (1 + tolerance):
                found.append((peak.omega, complex(frequency_response(member.plant, peak.omega)[0])))
    return found


def _solve(
    problem: Problem, bounds: Bounds, slots: Sequence[Slot], guess: Array, trust: float, *, exact: bool
) -> Array | None:
    """The program's solution in scaled unknowns, or None."""
    pid = _pid(problem, guess)
    lower, upper = _trust(problem, guess, 1 + (trust - 1) * (EXACT_TRUST if exact else 1))
    filled = [*slots, *[slots[0]] * (SLOTS - len(slots)), *problem.band]
    omega, response = np.array([w for w, _ in filled]), np.array([value for _, value in filled])
    towards = 1 + response * pid_response(pid, problem.sample_time, omega)
    towards /= np.abs(towards)
    p = response * problem.scale.kp
    data = np.vstack([p.real, p.imag, omega * problem.sample_time, towards.real, towards.imag])
    limits = [min(bounds.ms, 1e6), min(bounds.mt, 1e6), min(bounds.mcs / problem.scale.kp, 1e9), float(exact)]
    found = problem.solver(
        x0=np.clip(guess, lower, upper),
        p=np.concatenate([limits, data.ravel(order="F")]),
        lbx=lower,
        ubx=upper,
        lbg=-np.inf,
        ubg=0.0,
    )
    status = problem.solver.stats()["return_status"]
    return np.array(found["x"]).ravel() if status in {"Solve_Succeeded", "Solved_To_Acceptable_Level"} else None


def _slots_in_band(omega: Array, response: Complex, goal: Goal) -> list[Slot]:
    """Every eighth frequency of the goal's band, and its ends; none unless the objective looks at them."""
    if goal.objective != "band":
        return []
    inside = np.flatnonzero((omega >= 2 * math.pi * goal.band[0]) & (omega <= 2 * math.pi * goal.band[1]))
    chosen = np.unique([*inside[::8], inside[-1]])
    return [(float(omega[i]), complex(response[i])) for i in chosen]


def _step_error(plant: control.StateSpace, pid: PID, goal: Goal) -> Array:
    """x (n,) [m] per newton from `begin` to `end` after a unit step of d, by the closed loop's matrices."""
    model = sensitivity(plant, pid, "PS")
    state, found = np.zeros(model.nstates), []
    for _ in range(round(goal.end / plant.dt)):
        state = model.A @ state + model.B[:, 0]
        found.append(float(model.C[0] @ state))
    return np.array(found[round(goal.begin / plant.dt) - 1 :])


def _in_band(plant: control.StateSpace, pid: PID, band: tuple[float, float]) -> float:
    omega = grid(plant, pid, 400)
    ends = 2 * math.pi * np.array(band)
    omega = np.concatenate([[ends[0]], omega[(omega > ends[0]) & (omega < ends[1])], [ends[1]]])
    response = frequency_response(plant, omega)
    return float(np.max(np.abs(sensitivities(response, pid_response(pid, plant.dt, omega))["PS"])))


def _scaled(problem: Problem, pid: PID) -> Array:
    scale, ts = problem.scale, problem.sample_time
    keep = pid.derivative_filter / (pid.derivative_filter + ts)
    gains = [a / b if b else 0.0 for a, b in ((pid.kp, scale.kp), (pid.ki, scale.ki), (pid.kd, scale.kd))]
    value = achieved(problem.members, pid, problem.goal) * scale.kp
    return np.array([*gains, keep, 0.0 if problem.goal.objective == "integral" else value])


def _pid(problem: Problem, x: Array) -> PID:
    scale, ts = problem.scale, problem.sample_time
    keep = float(np.clip(x[3], 0.0, LONGEST_FILTER))
    kp, ki, kd = (float(max(share, 0.0)) for share in x[:3])
    return PID(kp * scale.kp, ki * scale.ki, kd * scale.kd, keep * ts / (1 - keep))


def _rank(problem: Problem, tuning: Tuning) -> float:
    """Less is better."""
    return -tuning.value if problem.goal.objective == "integral" else tuning.value


def _rigid_gain(plant: Plant) -> float:
    return plant.thrust_constant * sum(mode.gain for mode in plant.modes if mode.frequency == 0)
