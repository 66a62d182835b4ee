"""Profiles for a drive's own cascade: what they add up to, at every rate, and what the cascade makes of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.deployment.drive_profile import Drive, cascade_of, on_the_drive, profiles
from models.controller import PID, references
from models.feedback.forms import nearest_pid
from models.simulation.simulator import simulate
from tests.models.deployment.laws import designed, motions
from tests.models.feedback.axis import CASCADE

INCREMENT = 1e-9


@pytest.mark.parametrize("ratio", [0.25, 1.0, 2.0])
def test_set_point_speed_and_torque_belong_together(ratio: float) -> None:
    machine, controller = designed("PID")
    ts, target = machine.sample_time, motions(machine)
    known = references(controller, target)
    made = profiles(known, controller.reference_delay, ts, Drive(ratio * ts, INCREMENT, 150.0))
    travelled = np.cumsum(made.velocity) * made.interval
    assert travelled == pytest.approx(made.position - made.position[0], abs=2 + 1e-3 * np.max(np.abs(made.position)))
    assert made.position[-1] * INCREMENT == pytest.approx(target[-1], abs=2 * INCREMENT)
    impulse = np.sum(made.torque) * made.interval * 0.15
    assert impulse == pytest.approx(np.sum(known.feedforward + known.compensation) * ts, abs=0.1)
    lines = list(made.rows())
    assert lines[0].startswith("time_s,target_position_607Ah")
    assert len(lines) == made.position.size + 1


def test_an_interval_that_does_not_fit_is_refused() -> None:
    machine, controller = designed("PID")
    known = references(controller, motions(machine))
    for ratio in (1.5, 0.4):
        with pytest.raises(ValueError, match="multiple or a whole fraction"):
            profiles(known, 2, machine.sample_time, Drive(ratio * machine.sample_time, INCREMENT, 150.0))


def test_the_cascade_is_the_machine_s_or_the_nearest_to_its_pid() -> None:
    machine, _ = designed("cascade")
    assert cascade_of(machine) == replace(CASCADE, velocity_feedforward=1.0, acceleration_feedforward=0.0)
    table, _ = designed("PID")
    pid = nearest_pid(replace(CASCADE, velocity_filter=1e-4))
    found = cascade_of(replace(table, control=replace(table.control, pid=pid)))
    assert nearest_pid(found).kp == pytest.approx(pid.kp)
    assert nearest_pid(found).ki == pytest.approx(pid.ki)
    proportional = cascade_of(replace(table, control=replace(table.control, pid=replace(pid, ki=0.0))))
    assert proportional.position_gain == pytest.approx(pid.kp / pid.kd)
    assert proportional.integral_time == 0.0
    assert nearest_pid(proportional).kp == pytest.approx(pid.kp)
    with pytest.raises(ValueError, match=r"control\.cascade"):
        cascade_of(replace(table, control=replace(table.control, pid=PID(1e6, 0.0, 0.0, 0.0))))


def test_with_torque_offset_the_cascade_follows_and_without_it_lags() -> None:
    machine, controller = designed("PID")
    target = motions(machine)
    known, errors = references(controller, target), {}
    for torque in (True, False):
        law, given = on_the_drive(machine, controller, known, torque=torque)
        response = simulate(machine, law, target, given=given)
        errors[torque] = float(np.max(np.abs(response.position - given.position)))
    assert errors[True] < 0.5 * errors[False]
