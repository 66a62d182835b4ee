"""The front of tuned PIDs: which point answers a bound."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from design.family import Member, linear, with_effects
from design.loop import assess
from design.pid import front
from design.pid.front import Front, Point
from design.pid.goal import Goal
from design.pid.problem import Bounds, TuningError
from design.pid.rules import fast_rule, magnitude, quickest_time, simc, slow_rule
from design.pid.tuning import pose
from models.controller import PID
from models.effects.motor import CurrentLoopLag
from models.machine import Machine, load
from models.plant import Mode, sampled
from tests.design.machines import quicker


def test_a_bound_without_a_pid_is_answered_by_the_next_stricter_one_or_else_the_first() -> None:
    points = tuple(Point(f"{bound}", PID(1.0, 1.0, 0.0, 0.0), (), bound) for bound in (1.4, 1.8, 2.4))
    assert [Front(points, ()).nearest(ms).bound for ms in (1.8, 2.0, 3.0, 1.2)] == [1.8, 1.8, 2.4, 1.4]


def test_where_neither_the_first_nor_the_loosest_level_has_a_pid_no_other_is_tried(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    machine, tried = load(), []

    def none(_problem: Any, bounds: Bounds, *starts: Any) -> None:
        tried.append((bounds.ms, bounds.mt, [name for part in starts for name, _ in part]))
        raise TuningError("no PID")

    monkeypatch.setattr(front, "tuned_from", none)
    problem = pose([Member("P_l", sampled(machine.plant, machine.sample_time))], Goal(), magnitude(machine))
    with pytest.raises(TuningError, match="no PID"):
        front.tuned(problem, (1.2, 1.6, 2.0, 3.0), Bounds(2.0, math.inf, 1e8), machine)
    starts = ["slow rule", "fast rule", "present PID"]
    assert tried == [(1.2, 1.4, starts), (3.0, 3.0, starts)]


@pytest.mark.parametrize("times", [0.02, 8.0, 50.0])
def test_the_rules_have_the_time_of_the_machine(times: float) -> None:
    """An axis that is so many times as quick has loops of the same peaks, as often as quick."""
    here = load()
    there = quicker(here, times)
    assert quickest_time(there) == pytest.approx(quickest_time(here) / times, rel=1e-9)
    peaks = [[(one.name, one.ms) for one in front.rules(machine, alone(machine))] for machine in (here, there)]
    assert [name for name, _ in peaks[0]].count("SIMC") == len(front.RULE_TIMES)
    assert [name for name, _ in peaks[1]] == [name for name, _ in peaks[0]]
    assert [ms for _, ms in peaks[1]] == pytest.approx([ms for _, ms in peaks[0]], rel=1e-6)


def test_a_rule_is_no_quicker_than_a_strong_mode_allows() -> None:
    """A mode of half the rigid body's gain at 40 Hz: without it the loop of the same dead time may be quicker."""
    machine = load()
    rigid, mode, _ = machine.plant.modes
    strong = replace(mode, frequency=40.0, gain=-0.5 * rigid.gain, damping=0.02)
    soft, stiff = (with_modes(machine, modes) for modes in ((rigid, strong), (rigid,)))
    assert quickest_time(soft) > 2 * quickest_time(stiff)
    for rule in (slow_rule, fast_rule):
        assert assess(sampled(soft.plant, soft.sample_time), rule(soft)).stable


def alone(machine: Machine) -> list[Member]:
    """The machine's plant as the only member."""
    return [Member("P_l", sampled(machine.plant, machine.sample_time))]


def with_modes(machine: Machine, modes: tuple[Mode, ...]) -> Machine:
    """The machine with other modes [SI]."""
    return replace(machine, plant=replace(machine.plant, modes=modes))


def test_the_rules_know_how_late_an_effect_makes_the_thrust() -> None:
    """With the plant's own dead time alone, SIMC's loop at 1.15 times the quickest peaked at 2.04."""
    lagging = replace(load(), effects=(CurrentLoopLag(2e-3),))
    (first, *_) = front.rules(lagging, [Member("P_l", with_effects(lagging))])
    expected = assess(
        with_effects(lagging),
        simc(
            linear(lagging).late,
            lagging.sample_time,
            front.RULE_TIMES[0] * quickest_time(lagging),
            lagging.control.pid.derivative_filter,
        ),
    )
    assert first.ms == pytest.approx(expected.ms.value, rel=1e-9)
    assert first.ms < 1.7
