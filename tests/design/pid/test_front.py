"""The front of tuned PIDs: which point answers a bound."""

from __future__ import annotations

from design.pid.front import Front, Point
from models.controller import PID


def test_a_bound_without_a_pid_is_answered_by_the_next_stricter_one_or_else_the_first() -> None:
    points = tuple(Point(f"{bound}", PID(1.0, 1.0, 0.0, 0.0), (), bound) for bound in (1.4, 1.8, 2.4))
    assert [Front(points, ()).nearest(ms).bound for ms in (1.8, 2.0, 3.0, 1.2)] == [1.8, 1.8, 2.4, 1.4]
