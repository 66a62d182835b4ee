"""The oracle against closed forms: what every other result rests on."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from models.controller import PID, Controller
from models.friction import Friction, elements
from models.machine import Machine, load
from models.plant import Mode, Plant
from models.simulation.exact import respond

TS = 5e-4
MASS, STIFFNESS = 50.0, 8e5


def open_loop(friction: Friction, thrust: float, dead_time: float = 0.0) -> tuple[Machine, Controller]:
    """A free mass with this friction, and a controller that only puts out `thrust` from the first sample on."""
    table = load()
    machine = replace(
        table,
        plant=Plant(dead_time, 1.0, (Mode(1 / MASS, 0.0, 0.0),)),
        friction=friction,
        scale=replace(table.scale, resolution=0.0),
        drive=replace(table.drive, rated_thrust=1e6),
    )
    return machine, Controller(TS, PID(0, 0, 0, 0), 0, (0.0,), (thrust,))


def test_a_mass_on_a_sticking_element_is_an_oscillator() -> None:
    machine, controller = open_loop(elements([STIFFNESS], [1.0]), 5.0)
    position, force = respond(machine, controller, np.ones(400))
    omega = math.sqrt(STIFFNESS / MASS)
    expected = 5.0 / STIFFNESS * (1 - np.cos(omega * np.arange(400) * TS))
    assert position == pytest.approx(expected, abs=1e-16)
    assert force == pytest.approx(STIFFNESS * expected, abs=1e-9)


def test_the_dead_time_may_end_within_a_sample() -> None:
    machine, controller = open_loop(elements([STIFFNESS], [1.0]), 5.0, dead_time=2.3 * TS)
    position, _ = respond(machine, controller, np.ones(100))
    age = np.maximum(np.arange(100) - 2.3, 0) * TS
    assert position == pytest.approx(5.0 / STIFFNESS * (1 - np.cos(math.sqrt(STIFFNESS / MASS) * age)), abs=1e-16)


def test_sticking_slipping_and_sticking_again_are_joined_at_the_exact_times() -> None:
    """Thrust F > K X: x = F/K (1 - cos w t) until x = X, then constant acceleration (F - K X) / M: never turns."""
    limit, thrust = 5e-6, 10.0
    machine, controller = open_loop(elements([STIFFNESS], [limit]), thrust)
    position, _ = respond(machine, controller, np.ones(60))
    omega = math.sqrt(STIFFNESS / MASS)
    switch = math.acos(1 - STIFFNESS * limit / thrust) / omega
    speed = thrust / STIFFNESS * omega * math.sin(omega * switch)
    time = np.arange(60) * TS
    after = time - switch
    slipping = limit + speed * after + 0.5 * (thrust - STIFFNESS * limit) / MASS * after**2
    expected = np.where(time < switch, thrust / STIFFNESS * (1 - np.cos(omega * time)), slipping)
    assert position == pytest.approx(expected, abs=1e-15)


def test_a_turn_puts_the_element_back_to_its_limit() -> None:
    """After slipping the mass coasts, turns, and swings about x_turn - X + F/K with what is stored at the turn."""
    limit, thrust = 2e-6, 1.2
    machine, controller = open_loop(elements([STIFFNESS], [limit]), thrust)
    position, _ = respond(machine, controller, np.ones(200))
    omega, slip = math.sqrt(STIFFNESS / MASS), STIFFNESS * limit
    switch = math.acos(1 - slip / thrust) / omega
    speed = thrust / STIFFNESS * omega * math.sin(omega * switch)
    deceleration = (slip - thrust) / MASS
    turn = switch + speed / deceleration
    top = limit + 0.5 * speed**2 / deceleration
    centre = top - limit + thrust / STIFFNESS
    time = np.arange(200) * TS
    expected = centre + (top - centre) * np.cos(omega * (time - turn))
    late = time > turn  # from here the swing stays within the element's 2 X
    assert np.count_nonzero(late) > 100
    assert position[late] == pytest.approx(expected[late], abs=1e-15)


def test_a_damped_element_decays_as_a_damped_oscillator() -> None:
    damping = 2000.0
    machine, controller = open_loop(elements([STIFFNESS], [1.0], damping), 5.0)
    position, _ = respond(machine, controller, np.ones(300))
    omega = math.sqrt(STIFFNESS / MASS)
    zeta = damping / (2 * math.sqrt(STIFFNESS * MASS))
    root = omega * math.sqrt(1 - zeta**2)
    time = np.arange(300) * TS
    shape = np.exp(-zeta * omega * time) * (np.cos(root * time) + zeta * omega / root * np.sin(root * time))
    assert position == pytest.approx(5.0 / STIFFNESS * (1 - shape), abs=1e-16)


def test_the_exact_oracle_refuses_a_scale_with_noise() -> None:
    machine, controller = open_loop(elements([STIFFNESS], [1.0]), 1.0)
    noisy = replace(machine, scale=replace(machine.scale, noise=1e-8))
    with pytest.raises(ValueError, match="no noise"):
        respond(noisy, controller, np.ones(3))
