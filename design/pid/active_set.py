"""Rounds of a tuning from one start: solve at some slots, look between them, let what exceeds a bound join, again.

See `design.pid.tuning` for the method.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Final

import numpy as np

from design.loop import (
    Assessment,
    Complex,
    Sensitivity,
    assess,
    controller_response,
    frequency_response,
    sensitivities,
)
from design.pid.goal import achieved
from design.pid.problem import Array, Bounds, Problem, Slot, Tuning
from design.pid.program import SLOTS
from models.controller import PID
from models.identification.solving import interruptible

MAX_ROUNDS: Final = 40  # A start is given up after so many rounds in which frequencies join.
# The exact bounds come in once a round moves the gains by less than this share of the largest gain.
EXACT_BOUNDS_GAIN_CHANGE: Final = 0.05
# The rounds end when one moves the gains by less than this share of the largest gain, and by less than SETTLED times
# the tolerance: the optimum is flat, so the gains need not be as exact as the peaks.
FINAL_GAIN_CHANGE: Final = 0.04
SETTLED: Final = 1e2
MAX_KEPT_EXCESS: Final = 1.01  # A solution that exceeds no bound by more than this factor is one to come back to.
TRUST: Final = 3.0  # A gain may change by this factor in the first round, since the program knows few frequencies.
LEAST_TRUST: Final = 1.05  # A start is given up if even so small a change leaves the bounds.
EXACT_TRUST: Final = 0.1  # With the exact bounds, which let a loop pass -1, only this share of that change is allowed.
BASE: Final = 40  # The program begins with so many slots, spread over the nominal members.
NEARLY: Final = 0.8  # A maximum above this share of its bound is among the first slots: it is likely to become active.
LONGEST_FILTER: Final = 0.98  # The largest a = tau / (tau + T_s) that is sought, short of 1, where tau is infinite.


class Ending(Enum):
    """Why the rounds from one start ended, as a sentence about `rounds` of them."""

    CERTIFIED = "certified after {rounds} rounds"
    NOTHING_WITHIN = "IPOPT found no point within the bounds (round {rounds})"
    UNSTABLE = "it keeps to the bounds, but a loop is unstable"
    NEVER_SETTLED = "a peak still exceeds its bound after {rounds} rounds"


@dataclass(frozen=True)
class Result:
    """What became of one start after so many rounds; `tuning` is there if it was certified.

    active: how many plants the program had to see, where it did not see them all.
    """

    ending: Ending
    rounds: int
    tuning: Tuning | None = None
    active: int | None = None

    def __str__(self) -> str:
        sentence = self.ending.value.format(rounds=self.rounds)
        return sentence if self.active is None else f"{sentence}, with {self.active} plants that count"


def from_start(problem: Problem, bounds: Bounds, start: PID, tolerance: float) -> Result:
    """Rounds of solving and looking between the slots, from one start.

    First with the stricter bounds, which keep a stable loop stable; with the exact ones once the gains hardly move.
    start: in SI, as is tolerance [1], relative.
    """
    guess = before = _scaled(problem, start)
    slots = _tightest(problem, start, bounds, _critical(problem, start, bounds, NEARLY) + _base(problem))
    trust, exact, kept = TRUST, False, False
    for count in range(1, MAX_ROUNDS + 1):
        solution = _solve(problem, bounds, slots, guess, trust, exact=exact)
        if solution is None:  # too far: back to where the bounds were kept, or half the way, and on in shorter steps
            trust, guess, exact = math.sqrt(trust), before if kept else 0.5 * (before + guess), False
            if trust < LEAST_TRUST:
                return Result(Ending.NOTHING_WITHIN, count)
            continue
        moved = float(np.max(np.abs(solution[:4] - guess[:4])) / np.max(guess[:3]))
        pid = _pid(problem, solution)
        above = _critical(problem, pid, bounds, 1 + 0.01 * tolerance)
        excess = float(np.max(_shares(problem, pid, bounds, above), initial=0.0))
        if excess <= MAX_KEPT_EXCESS:
            before, kept = solution, True
        elif not kept:
            before = guess
        guess, certain = solution, excess <= 1 + tolerance
        if certain and exact and moved < min(FINAL_GAIN_CHANGE, SETTLED * tolerance):
            loops = tuple(assess(member.plant, pid) for member in problem.members)
            if not all(loop.stable for loop in loops):
                return Result(Ending.UNSTABLE, count)
            between = _above_between(problem, loops, bounds, tolerance)
            if not between:
                value = achieved(problem.members, pid, problem.goal)
                return Result(Ending.CERTIFIED, count, Tuning(pid, bounds, value, loops, ()))
            above += between
        exact = moved < EXACT_BOUNDS_GAIN_CHANGE
        slots = _tightest(problem, pid, bounds, above + slots)
    return Result(Ending.NEVER_SETTLED, MAX_ROUNDS)


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
    order = np.argsort(-_shares(problem, pid, bounds, others), kind="stable")[: SLOTS - len(base)]
    return base + [others[i] for i in order]


def _shares(problem: Problem, pid: PID, bounds: Bounds, slots: Sequence[Slot]) -> Array:
    """The largest of |S|, |T| and |CS| over their bounds (n,) [1] at each slot."""
    omega, response = np.array([w for w, _ in slots]), np.array([p for _, p in slots])
    return shares(sensitivities(response, controller_response(pid, problem.sample_time, omega)), bounds)


def shares(found: Mapping[Sensitivity, Complex], bounds: Bounds) -> Array:
    """The largest of |S| [1], |T| [1] and |CS| [N/m] over their bounds (n,) [1]."""
    sizes = ((found["S"], bounds.ms), (found["T"], bounds.mt), (found["CS"], bounds.mcs))
    return np.asarray(np.max([np.abs(size) / bound for size, bound in sizes], axis=0), float)


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
        s = sensitivities(response, controller_response(pid, problem.sample_time, omega))
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
    room = next(room for room in problem.solvers if room >= len(slots))
    solver = problem.solvers[room]
    filled = [*slots, *[slots[0]] * (room - len(slots)), *problem.band]
    omega, response = np.array([w for w, _ in filled]), np.array([value for _, value in filled])
    towards = 1 + response * controller_response(pid, problem.sample_time, omega)
    towards /= np.abs(towards)
    p = response * problem.scale.kp
    data = np.vstack([p.real, p.imag, omega * problem.sample_time, towards.real, towards.imag])
    limits = [min(bounds.ms, 1e6), min(bounds.mt, 1e6), min(bounds.mcs / problem.scale.kp, 1e9), float(exact)]
    with interruptible():
        found = solver(
            x0=np.clip(guess, lower, upper),
            p=np.concatenate([limits, data.ravel(order="F")]),
            lbx=lower,
            ubx=upper,
            lbg=-np.inf,
            ubg=0.0,
        )
    status = solver.stats()["return_status"]
    return np.array(found["x"]).ravel() if status in {"Solve_Succeeded", "Solved_To_Acceptable_Level"} else None


def _scaled(problem: Problem, pid: PID) -> Array:
    scale, ts = problem.scale, problem.sample_time
    keep = pid.pole(ts)
    gains = [a / b if b else 0.0 for a, b in ((pid.kp, scale.kp), (pid.ki, scale.ki), (pid.kd, scale.kd))]
    value = achieved(problem.members, pid, problem.goal) * scale.kp
    return np.array([*gains, keep, 0.0 if problem.goal.objective == "integral" else value])


def _pid(problem: Problem, x: Array) -> PID:
    scale, ts = problem.scale, problem.sample_time
    keep = float(np.clip(x[3], 0.0, LONGEST_FILTER))
    kp, ki, kd = (float(max(share, 0.0)) for share in x[:3])
    return PID(kp * scale.kp, ki * scale.ki, kd * scale.kd, keep * ts / (1 - keep))
