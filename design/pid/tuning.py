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
from dataclasses import replace
from typing import Final

import numpy as np

from design.family import MASS_ERROR, MODE_ERROR, Member, family, slopes
from design.loop import (
    Assessment,
    Complex,
    assess,
    controller_response,
    frequency_response,
    grid,
    sensitivities,
)
from design.pid.active_set import LONGEST_FILTER, Result, from_start, shares
from design.pid.goal import OBJECTIVES, Goal, achieved
from design.pid.problem import Array, Attempt, Bounds, Problem, Slot, Tuning, TuningError, mt_bound
from design.pid.program import ROOMS, program
from design.pid.rules import magnitude, slow_rule
from models.controller import PID
from models.machine import Machine
from models.quantity import show

Start = tuple[str, PID]

PEAK_TOLERANCE: Final = 1e-4  # A certified peak may exceed its bound by this share.
# A program sees so many plants at most; more that are alike would crowd each other out of its slots.
MAX_PLANTS: Final = 24
# With an integral |CS| is the contact stiffness at low frequencies: its bound is at least so many times the steepest.
MIN_STIFFNESS_BOUND_RATIO: Final = 1.2
MAX_GAIN_RATIO: Final = 50.0  # A gain may be this many times the one that a problem is scaled with.


def tune_pid(
    machine: Machine,
    *,
    ms: float = 2.0,
    mt: float | None = None,
    noise: float | None = None,
    mode_error: float = MODE_ERROR,
    mass_error: float = MASS_ERROR,
) -> Tuning:
    """The PID of the largest integral gain whose loop keeps to its bounds in every state of the machine's friction.

    ms, mt [1]: bounds on |S| and |T|; without one on |T| that on |S|, but at least LEAST_MT. noise [N/m]: bound on
    |CS|, by default what the present PID has, but more than the steepest contact stiffness, which an integral needs.
    mode_error, mass_error [1]: how far the modes' frequencies and the mass may be off to both sides. Takes some
    seconds. Raises TuningError where no PID keeps to the bounds.

    >>> tuning = pos.tune_pid(machine, ms=2.0, mode_error=0, mass_error=0)
    >>> tuning.ms < 2.001 and all(loop.stable for loop in tuning.loops)
    True
    """
    members, present = family(machine, mode_error, mass_error), machine.control.pid
    if noise is None:
        noise = noise_bound(machine, [assess(member.plant, present) for member in members])
    bounds = Bounds(ms, mt_bound(ms) if mt is None else mt, noise)
    problem = pose(members, Goal(), magnitude(machine))
    return tuned_from(problem, bounds, [("slow rule", slow_rule(machine))], [("present PID", present)])


def noise_bound(machine: Machine, present: Sequence[Assessment]) -> float:
    """The bound on |CS| [N/m] where none is asked for: that of the present PID's loops, or what an integral needs."""
    return max(MIN_STIFFNESS_BOUND_RATIO * max(slopes(machine).values()), *(loop.mcs.value for loop in present))


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
        keep = (replace(scale, derivative_filter=derivative_filter).pole(ts),) * 2
    band = [slot for omega, p in check for slot in _slots_in_band(omega, p, goal)]
    return Problem(
        tuple(members),
        goal,
        scale,
        {room: program(members, goal, scale, room, len(band)) for room in ROOMS},
        np.array([1e-4, 1e-6, 0.0, keep[0], -np.inf]),
        np.array([MAX_GAIN_RATIO, MAX_GAIN_RATIO, MAX_GAIN_RATIO if derivative else 0.0, keep[1], np.inf]),
        check,
        tuple(band),
    )


def tune(
    problem: Problem, bounds: Bounds, starts: Sequence[tuple[str, PID]], tolerance: float = PEAK_TOLERANCE
) -> Tuning:
    """The best certified PID within the bounds from several named starts, each attempt reported.

    tolerance [1]: by which a peak may exceed its bound, relative. Raises TuningError if no start leads to one.
    """
    best: Tuning | None = None
    attempts = []
    for name, start in starts:
        result = _with_active_plants(problem, bounds, start, tolerance)
        found = result.tuning
        attempts.append(Attempt(name, str(result), None if found is None else found.value))
        if found is not None and (best is None or _rank(problem, found) < _rank(problem, best)):
            best = found
    if best is None:
        tried = "; ".join(f"{attempt.start}: {attempt.outcome}" for attempt in attempts)
        limit = f", |T| <= {bounds.mt:g}, |CS| <= {show(bounds.mcs, 'N/m')}"
        none = f"no PID with |S| <= {bounds.ms:g}{limit} for all {len(problem.members)} plants was found"
        advice = "raise a bound, or take plants out of the family"
        raise TuningError(f"{none} ({tried}); {advice}", tuple(attempts), none)
    return replace(best, attempts=tuple(attempts))


def tuned_from(problem: Problem, bounds: Bounds, starts: Sequence[Start], others: Sequence[Start]) -> Tuning:
    """`tune` from the starts, and from the others [-] where none of these leads to a PID."""
    try:
        return tune(problem, bounds, starts)
    except TuningError as error:
        if not others:
            raise
        tried = error
    try:
        found = tune(problem, bounds, others)
    except TuningError as error:
        raise TuningError(str(error), (*tried.attempts, *error.attempts), error.reason) from tried
    return replace(found, attempts=(*tried.attempts, *found.attempts))


def _with_active_plants(problem: Problem, bounds: Bounds, start: PID, tolerance: float) -> Result:
    """`from_start` for any number of plants: with a few, and those that then exceed a bound join, from the same start.

    Many plants that are much alike would crowd each other out of the program's slots.
    """
    nominal = [i for i, member in enumerate(problem.members) if member.nominal]
    worst = np.argsort(-_largest_shares(problem, start, bounds), kind="stable")
    seen = (
        list(dict.fromkeys([*nominal, *worst.tolist()]))[:MAX_PLANTS]
        if len(worst) > MAX_PLANTS
        else list(range(len(worst)))
    )
    while True:
        part = replace(
            problem, members=tuple(problem.members[i] for i in seen), check=tuple(problem.check[i] for i in seen)
        )
        result = from_start(part, bounds, start, tolerance)
        found = result.tuning
        if found is None or len(seen) == len(worst):
            return result
        worst_shares = _largest_shares(problem, found.pid, bounds)
        beyond = [
            int(i)
            for i in np.argsort(-worst_shares)[: MAX_PLANTS // 4]
            if worst_shares[i] > 1 + tolerance and i not in seen
        ]
        if not beyond:  # on the check's frequencies; what is certified holds between them too
            loops = tuple(assess(member.plant, found.pid) for member in problem.members)
            beyond = [i for i, loop in enumerate(loops) if i not in seen and _exceeds(loop, bounds, tolerance)]
            if not beyond:
                value = achieved(problem.members, found.pid, problem.goal)
                return replace(result, tuning=replace(found, value=value, loops=loops), active=len(seen))
        seen += beyond


def _largest_shares(problem: Problem, pid: PID, bounds: Bounds) -> Array:
    """The largest of |S|, |T| and |CS| over their bounds (members,) [1], at the check's frequencies."""
    ts = problem.sample_time
    looked = [shares(sensitivities(p, controller_response(pid, ts, omega)), bounds) for omega, p in problem.check]
    return np.array([np.max(one) for one in looked])


def _exceeds(loop: Assessment, bounds: Bounds, tolerance: float) -> bool:
    pairs = ((loop.ms, bounds.ms), (loop.mt, bounds.mt), (loop.mcs, bounds.mcs))
    return not loop.stable or any(peak.value > bound * (1 + tolerance) for peak, bound in pairs)


def _slots_in_band(omega: Array, response: Complex, goal: Goal) -> list[Slot]:
    """Every eighth frequency of the goal's band, and its ends; none unless the objective looks at them."""
    if goal.objective != "band":
        return []
    inside = np.flatnonzero((omega >= 2 * math.pi * goal.band[0]) & (omega <= 2 * math.pi * goal.band[1]))
    chosen = np.unique([*inside[::8], inside[-1]])
    return [(float(omega[i]), complex(response[i])) for i in chosen]


def _rank(problem: Problem, tuning: Tuning) -> float:
    """Less is better."""
    return -tuning.value if problem.goal.objective == "integral" else tuning.value
