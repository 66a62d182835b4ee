"""The condensed robust problem: its derivatives, and Newton's solution beside IPOPT's of the whole program."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.deadbeat import synthesise
from design.trajectory import newton as condensed
from design.trajectory.history_aware import Limits
from design.trajectory.newton import Histories, outcome
from design.trajectory.robust import RobustProblem, RobustTask, RobustTrajectory, build_robust, solve_robust
from design.trajectory.scenarios import Feedback, Scenario
from models.machine import Machine, load

STROKE, TS, RATIO = 20e-6, 5e-4, 0.1
LIMITS = Limits(thrust=150.0)


def machine() -> Machine:
    table = load()
    return replace(table, plant=replace(table.plant, dead_time=0.8e-3))


def starts(share: float) -> list[np.ndarray[tuple[int], np.dtype[np.float64]]]:
    limit = np.array(machine().friction.limit)
    return [-share * limit, 0.8 * share * limit]


@pytest.fixture(scope="module")
def solved() -> tuple[RobustProblem, RobustTrajectory]:
    """Two histories, 44 samples and 12 ms after them, solved by IPOPT."""
    table = machine()
    scenarios = tuple(Scenario(table.plant, table.friction, h) for h in range(2))
    loop = Feedback(TS, table.control.pid, 2, 47, 71)
    built = build_robust(RobustTask(table.plant, scenarios, loop, TS, 44, STROKE))
    net = synthesise(table.plant, TS, 22e-3, STROKE).thrust
    first = solve_robust(built, starts(1.0), net, LIMITS, ratios=(0.3, RATIO))
    assert first.solution.status == "Solve_Succeeded"
    return built, first


def decisions(built: RobustProblem, found: RobustTrajectory) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    assert built.condensed is not None
    values, unit = found.solution.values, built.condensed.thrust_unit
    return np.concatenate([values["net"] / unit, values["assist"] / unit, values["worst"] / (0.1 * STROKE)])


def test_the_condensed_problem_is_the_program(solved: tuple[RobustProblem, RobustTrajectory]) -> None:
    built, found = solved
    assert built.condensed is not None
    at = Histories(np.array(starts(1.0)), RATIO, 150.0)
    objective, error, violation = outcome(built.condensed, decisions(built, found), at)
    assert objective == pytest.approx(found.solution.objective, rel=1e-9)
    assert STROKE * error == pytest.approx(found.error, abs=1e-7 * STROKE)
    assert violation <= 1e-6


def test_its_derivatives_are_those_of_its_differences(solved: tuple[RobustProblem, RobustTrajectory]) -> None:
    """Gradient of the Lagrangian by central differences, and its Hessian by those of the gradient."""
    built, found = solved
    problem = built.condensed
    assert problem is not None
    at, v = Histories(np.array(starts(0.97)), RATIO, 150.0), decisions(built, found)
    rng = np.random.default_rng(3)
    multipliers = rng.normal(size=condensed._sweep(problem, v, at).excess.shape)
    every = np.ones(multipliers.shape, bool)

    def lagrangian(u: np.ndarray[tuple[int], np.dtype[np.float64]]) -> float:
        quadratic = u[-1] + u @ problem.decisions.weight @ u / 2
        return float(quadratic + np.sum(multipliers * condensed._sweep(problem, u, at).excess))

    def gradient(u: np.ndarray[tuple[int], np.dtype[np.float64]]) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        sweep = condensed._sweep(problem, u, at)
        rows = condensed._gradients(problem, condensed._derivatives(problem, sweep), every)
        slope = problem.decisions.weight @ u
        slope[-1] += 1
        return np.asarray(slope + multipliers.ravel() @ rows, float)

    sweep = condensed._sweep(problem, v, at)
    hessian = condensed._hessian(problem, sweep, condensed._derivatives(problem, sweep), multipliers)
    for _ in range(3):
        way = rng.normal(size=v.size)
        step = 1e-6 * way
        there, back = lagrangian(v + step), lagrangian(v - step)
        assert (there - back) / 2 == pytest.approx(gradient(v) @ step, rel=1e-5)
        change = (gradient(v + step) - gradient(v - step)) / 2
        assert hessian @ step == pytest.approx(change, abs=1e-4 * np.max(np.abs(change)))


@pytest.mark.parametrize("share", [0.98, 0.9])
def test_newton_finds_what_ipopt_finds_from_the_same_begin(
    solved: tuple[RobustProblem, RobustTrajectory], share: float
) -> None:
    built, first = solved
    quick = solve_robust(built, starts(share), first, LIMITS, ratios=(RATIO,))
    known = solve_robust(replace(built, condensed=None), starts(share), first, LIMITS, ratios=(RATIO,))
    assert quick.solution.status == "Solved_By_Newton"
    assert known.solution.status == "Solve_Succeeded"
    assert quick.solution.violation <= 1e-9
    assert quick.solution.objective == pytest.approx(known.solution.objective, rel=1e-5)
    assert np.max(np.abs(quick.error)) == pytest.approx(np.max(np.abs(known.error)), rel=1e-4)
    assert quick.solution.objective != pytest.approx(first.solution.objective, rel=1e-3)


def test_a_solution_of_newton_starts_the_next_one_either_way(solved: tuple[RobustProblem, RobustTrajectory]) -> None:
    built, first = solved
    near = solve_robust(built, starts(0.98), first, LIMITS, ratios=(RATIO,))
    again = solve_robust(built, starts(0.96), near, LIMITS, ratios=(RATIO,))
    slow = solve_robust(built, starts(0.96), near, Limits(150.0, slew=400.0), ratios=(RATIO,))
    assert again.solution.status == "Solved_By_Newton"
    assert slow.solution.status == "Solve_Succeeded"  # a limit of the slew is IPOPT's
    assert np.max(np.abs(np.diff(slow.thrust, prepend=0.0))) <= 400.0 * (1 + 1e-6)
