"""The front of tuned PIDs: which point answers a bound."""

from __future__ import annotations

import math
from typing import Any

import pytest

from design.family import Member
from design.pid import front
from design.pid.front import Front, Point
from design.pid.goal import Goal
from design.pid.problem import Bounds, TuningError
from design.pid.rules import magnitude
from design.pid.tuning import pose
from models.controller import PID
from models.machine import load
from models.plant import sampled


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
