"""Tuning at the edge: brute-force optima, certificates, both starts alike, and refusals that say why."""

from __future__ import annotations

import control
import numpy as np
import pytest

from design.family import Member, family, slopes
from design.loop import assess, controller_response, frequency_response, grid, sensitivities, sensitivity, stays_below
from design.pid.goal import Goal, achieved
from design.pid.problem import Bounds, Problem, TuningError
from design.pid.rules import lambda_rule, simc
from design.pid.tuning import MAX_PLANTS, pose, tune, tune_pid, tuned_from
from models.controller import PID
from models.ensemble import load_ensemble
from models.machine import load
from tests.diagnosis.units import Change

MACHINE = load()
SLOW = simc(MACHINE.plant, MACHINE.sample_time, 12e-3, 2e-4)
BOUNDS = Bounds(1.8, 1.8, 3e7)


def chain(order: int, sample_time: float) -> Member:
    """1 / (s + 1)^order behind a hold."""
    a = -np.eye(order) + np.diag(np.ones(order - 1), 1)
    b, c = np.eye(order)[:, [-1]], np.eye(order)[[0]]
    return Member("chain", control.sample_system(control.ss(a, b, c, 0), sample_time))


def best_pi(member: Member, ms: float) -> tuple[float, float]:
    """(kp, ki) by brute force: |1 + kp P + ki P I|^2 = 1 / ms^2 is a quadratic in ki at every frequency."""
    ts = member.plant.dt
    omega = np.geomspace(0.01, 20, 20001)
    p = frequency_response(member.plant, omega)
    i = p * ts / (1 - np.exp(-1j * omega * ts))

    def largest(kp: float) -> float:
        a, b, c = np.abs(i) ** 2, 2 * np.real((1 + kp * p) * np.conj(i)), np.abs(1 + kp * p) ** 2 - 1 / ms**2
        root = np.sqrt(np.maximum(b**2 - 4 * a * c, 0))
        first = ((-b - root) / (2 * a))[(b**2 > 4 * a * c) & (-b > root)]
        return float(np.min(first)) if np.min(c) > 0 else 0.0

    gains = np.linspace(0.3, 1.5, 601)
    values = [largest(kp) for kp in gains]
    return float(gains[np.argmax(values)]), float(np.max(values))


def pi_problem(member: Member) -> Problem:
    return pose([member], Goal(), PID(1.0, 0.5, 0.0, 0.0), derivative=False, derivative_filter=0.0, lowest=1e-4)


@pytest.mark.parametrize(("order", "ms"), [(3, 1.4), (3, 2.0), (4, 1.4), (4, 1.7)])
def test_the_largest_integral_gain_is_that_of_a_brute_force_search(order: int, ms: float) -> None:
    member = chain(order, 0.01)
    found = tune(pi_problem(member), Bounds(ms), [("slow", PID(0.2, 0.1, 0.0, 0.0))], tolerance=1e-5).pid
    kp, ki = best_pi(member, ms)
    assert found.ki == pytest.approx(ki, rel=1e-4)
    assert found.kp == pytest.approx(kp, rel=1e-2)  # flat: 1 % of it is 1e-4 of ki


@pytest.fixture(scope="module")
def problem() -> Problem:
    return pose(family(MACHINE), Goal(), MACHINE.control.pid)


def test_the_tuned_loop_keeps_its_bounds_over_the_family_and_uses_them(problem: Problem) -> None:
    found = tune(problem, BOUNDS, [("slow", SLOW)])
    assert all(loop.stable for loop in found.loops)
    assert found.ms == pytest.approx(BOUNDS.ms, rel=2e-4)
    assert max(loop.mcs.value for loop in found.loops) <= BOUNDS.mcs * (1 + 2e-4)
    for member, loop in zip(problem.members, found.loops, strict=True):
        omega = grid(member.plant, found.pid, 2000)
        s = sensitivities(
            frequency_response(member.plant, omega), controller_response(found.pid, MACHINE.sample_time, omega)
        )
        assert np.max(np.abs(s["S"])) <= loop.ms.value * (1 + 1e-6)
        assert np.max(np.abs(s["T"])) <= BOUNDS.mt * (1 + 2e-4)
        assert stays_below(sensitivity(member.plant, found.pid, "S"), BOUNDS.ms * (1 + 3e-4))


def test_more_plants_than_a_program_has_room_for_are_all_held(problem: Problem) -> None:
    others = load_ensemble()[::10]
    members = family(MACHINE, others=others)
    assert len(members) == 20 + 4 * len(others) > MAX_PLANTS
    found = tune(pose(members, Goal(), MACHINE.control.pid), BOUNDS, [("slow", SLOW)])
    assert len(found.loops) == len(members)
    for member in members:
        assert assess(member.plant, found.pid, count=1000).stable
        assert stays_below(sensitivity(member.plant, found.pid, "S"), BOUNDS.ms * (1 + 3e-4))
        assert stays_below(sensitivity(member.plant, found.pid, "CS"), BOUNDS.mcs * (1 + 3e-4))
    assert found.ms == pytest.approx(BOUNDS.ms, rel=3e-4)
    assert found.value < tune(problem, BOUNDS, [("slow", SLOW)]).value


def test_two_starts_find_the_same_and_a_failed_one_is_reported(problem: Problem) -> None:
    unstable = PID(1e8, 1e10, 0.0, 0.0)
    starts = [("slow", SLOW), ("slower", simc(MACHINE.plant, MACHINE.sample_time, 20e-3, 2e-4)), ("bad", unstable)]
    found = tune(problem, BOUNDS, starts)
    slow, slower, bad = found.attempts
    assert slow.value is not None
    assert slower.value == pytest.approx(slow.value, rel=1e-3)
    assert bad.value is None
    assert bad.outcome
    elsewhere = tuned_from(problem, BOUNDS, starts[2:], starts[:1])
    assert elsewhere.attempts == (bad, slow)
    assert elsewhere.pid == tune(pose(problem.members, Goal(), MACHINE.control.pid), BOUNDS, starts[:1]).pid  # the bits


def test_a_front_says_all_that_was_tried_where_no_start_leads_to_a_pid(problem: Problem) -> None:
    unstable = [("bad", PID(1e8, 1e10, 0.0, 0.0))]
    with pytest.raises(TuningError) as refused:
        tuned_from(problem, BOUNDS, unstable, [("worse", unstable[0][1])])
    assert [attempt.start for attempt in refused.value.attempts] == ["bad", "worse"]
    assert refused.value.reason.startswith("no PID with |S| <= ")
    assert refused.value.reason.endswith(" plants was found")  # neither what was tried nor advice


def test_no_nearby_pid_within_the_bounds_has_a_larger_integral_gain(problem: Problem) -> None:
    found = tune(problem, BOUNDS, [("slow", SLOW)])
    rng = np.random.default_rng(1)
    for _ in range(40):
        factors = 1 + 0.1 * rng.uniform(-1, 1, 3)
        other = PID(
            found.pid.kp * factors[0], found.pid.ki * 1.005, found.pid.kd * factors[1],
            found.pid.derivative_filter * factors[2],
        )  # fmt: skip
        loops = [assess(member.plant, other, count=100) for member in problem.members]
        assert (
            max(loop.ms.value for loop in loops) > BOUNDS.ms
            or max(loop.mt.value for loop in loops) > BOUNDS.mt
            or max(loop.mcs.value for loop in loops) > BOUNDS.mcs
        )


@pytest.mark.parametrize(
    "goal", [Goal("band", band=(0.8, 6.4), integral_time=0.05), Goal("step", begin=25e-3, end=50e-3)]
)
def test_the_other_objectives_are_better_in_what_they_seek(goal: Goal) -> None:
    members = [member for member in family(MACHINE) if member.nominal]
    found = tune(pose(members, goal, MACHINE.control.pid), BOUNDS, [("slow", SLOW)])
    integral = tune(pose(members, Goal(), MACHINE.control.pid), BOUNDS, [("slow", SLOW)])
    assert found.value == pytest.approx(achieved(members, found.pid, goal))
    assert found.value <= achieved(members, integral.pid, goal) * (1 + 1e-3)
    assert found.pid.ki <= integral.pid.ki * (1 + 1e-3)


def test_a_goal_needs_the_numbers_that_it_is_about() -> None:
    for unsaid in ({"objective": "band"}, {"objective": "step"}, {"objective": "band", "band": (6.4, 0.8)}):
        with pytest.raises(ValueError, match="must be two"):
            Goal(**unsaid)


def test_bounds_that_nothing_meets_are_a_sentence() -> None:
    members = [member for member in family(MACHINE) if member.nominal]
    with pytest.raises(TuningError, match=r"no PID with \|S\| <= 1.01.*slow: .*raise a bound"):
        tune(pose(members, Goal(), MACHINE.control.pid), Bounds(1.01, 1.01, 1e3), [("slow", SLOW)])


def test_the_family_is_what_was_asked() -> None:
    names = [member.name for member in family(MACHINE, 0.03, 0.1)]
    assert len(names) == len(set(names)) == 20
    assert sum(member.nominal for member in family(MACHINE)) == 4
    assert len(family(MACHINE, 0.0, 0.0)) == 4
    assert len(family(MACHINE, 0.0, 0.0, [MACHINE])) == 8
    assert slopes(MACHINE)["steepest"] == pytest.approx(sum(MACHINE.friction.stiffness))


def test_rules_place_the_poles_they_name() -> None:
    """Lambda: (lambda s + 1)^3 for the rigid body without dead time. SIMC: its series form multiplied out."""
    gain = MACHINE.plant.thrust_constant * MACHINE.plant.modes[0].gain
    pid = lambda_rule(MACHINE.plant, 5e-3, 0.0)
    poles = np.roots([1, gain * pid.kd, gain * pid.kp, gain * pid.ki])
    assert poles == pytest.approx([-200] * 3, rel=1e-3)
    pid = simc(MACHINE.plant, MACHINE.sample_time, 5e-3, 0.0)
    slow = 4 * (5e-3 + MACHINE.plant.dead_time + MACHINE.sample_time / 2)
    assert np.roots([pid.kd, pid.kp, pid.ki]) == pytest.approx([-1 / slow] * 2, rel=1e-6)


def test_a_machine_told_in_other_units_of_time_has_the_same_pid() -> None:
    """A tenth of all times: the rule that a tuning starts from is then too slow for the contacts, and the present PID,
    of a loop that runs, takes its place."""
    quick = Change(time=0.1)
    usual, other = (tune_pid(one, mode_error=0, mass_error=0).pid for one in (MACHINE, quick.machine(MACHINE)))
    assert other.ki / quick.factor("N/(m s)") == pytest.approx(usual.ki, rel=1e-3)
    assert other.kp / quick.factor("N/m") == pytest.approx(usual.kp, rel=2e-2)  # flat along the optimum
    assert other.kd / quick.factor("N s/m") == pytest.approx(usual.kd, rel=2e-2)
