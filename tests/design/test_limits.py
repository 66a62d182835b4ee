"""What no PID passes: by closed forms, by many PIDs, and by Bode's integral."""

from __future__ import annotations

import math

import numpy as np
import pytest

from design.family import Member
from design.limits import bode_area, highest_crossover, least_sensitivity
from design.loop import controller_response, frequency_response, spectral_radius
from models.controller import PID
from models.machine import load
from models.plant import Mode, Plant, sampled

TS = 5e-4


@pytest.mark.parametrize("dead_time", [1e-3, 1.3e-3])
def test_the_dead_times_limit_is_the_closed_form_for_a_rigid_body(dead_time: float) -> None:
    """Phase -180 degrees - omega (L + T_s / 2) + 90 degrees - omega T_s / 2: omega (L + T_s) = 90 degrees - margin."""
    rigid = Plant(dead_time, 1.0, (Mode(1 / 45, 0.0, 0.0),))
    expected = (math.pi / 2 - 2 * math.asin(1 / 4)) / (dead_time + TS)
    assert highest_crossover(rigid, TS, 2.0)[0] == pytest.approx(expected, rel=3e-3)


def test_no_pid_of_many_crosses_over_above_the_limit() -> None:
    plant = load().plant
    model, omega = sampled(plant, TS), np.linspace(0.001, 0.5, 3000) * math.pi / TS
    response, rng = frequency_response(model, omega), np.random.default_rng(2)
    levels: list[float] = []
    found: list[float] = []
    for _ in range(300):
        kp, ki, kd, tau = (10 ** rng.uniform(*ends) for ends in ((5, 6.7), (6, 8.5), (3.5, 4.6), (-5, -3.3)))
        loop = response * controller_response(PID(kp, ki, kd, tau), TS, omega)
        ms = float(np.max(1 / np.abs(1 + loop)))
        crossings = omega[:-1][(np.abs(loop[:-1]) >= 1) & (np.abs(loop[1:]) < 1)]
        if 1 < ms < 4 and crossings.size and spectral_radius(model, PID(kp, ki, kd, tau)) < 1:
            levels.append(ms)
            found.append(crossings[-1])
    assert len(found) > 10
    assert np.all(np.array(found) <= highest_crossover(plant, TS, levels) * 1.001)


def test_bodes_integral_is_zero_and_its_allowance_a_bound() -> None:
    machine = load()
    member = Member("P_l", sampled(machine.plant, TS))
    area = bode_area(member, machine.control.pid, 2.5, 4e7)
    assert area.suppressed == pytest.approx(area.amplified, rel=0.01)
    assert area.amplified < area.allowed
    assert least_sensitivity(np.array([0j, 1e-8 + 0j, 1e-6 + 0j]), 4e7) == pytest.approx([1.0, 0.6, 0.0])


def test_the_limit_is_sought_up_to_nyquist_and_for_any_delay() -> None:
    """A strong mode in phase leads on; with 1000 samples of delay as states the search took 60 GB."""
    led = Plant(0.0, 1.0, (Mode(1 / 45, 0.0, 0.0), Mode(0.5, 600.0, 0.9)))
    assert highest_crossover(led, TS, 4.0)[0] > 0.6 * math.pi / TS
    assert highest_crossover(Plant(0.0, 1.0, (Mode(1 / 45, 0.0, 0.0),)), TS, 2.0)[0] < 0.4 * math.pi / TS  # no artefact
    late = Plant(1000 * TS, 1.0, (Mode(1 / 45, 0.0, 0.0),))
    expected = (math.pi / 2 - 2 * math.asin(1 / 4)) / (1001 * TS)
    assert highest_crossover(late, TS, 2.0)[0] == pytest.approx(expected, rel=3e-3)
