"""The plant against closed forms and against control's own discretisation."""

from __future__ import annotations

import math
from dataclasses import replace

import casadi as ca
import control
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from design.deadbeat import polynomials, synthesise
from design.pid.rules import lambda_rule, simc
from models.machine import load
from models.plant import (
    Mode,
    Plant,
    antiresonances,
    bode,
    delay_split,
    equations,
    frequency_response,
    sampled,
    state_space,
)

PLANT = load().plant
TS = 5e-4

gains = st.builds(lambda size, sign: size * sign, st.floats(1e-4, 1.0), st.sampled_from([1, -1]))
vibrating = st.builds(Mode, gain=gains, frequency=st.floats(5.0, 900.0), damping=st.floats(1e-3, 0.5))
plants = st.builds(
    Plant,
    dead_time=st.floats(0.0, 3e-3),
    thrust_constant=st.floats(0.1, 50.0),
    modes=st.lists(vibrating, max_size=4).map(lambda modes: (Mode(0.02, 0.0, 0.0), *modes)),
)


def closed_form(plant: Plant, omega: np.ndarray, stiffness: float = 0.0) -> np.ndarray:
    """Eqs. (1) and (2), term by term."""
    s = 1j * omega
    rational = np.zeros(omega.shape, complex)
    for mode in plant.modes:
        w = 2 * math.pi * mode.frequency
        rational += mode.gain / (s**2 + 2 * mode.damping * w * s + w**2)
    rational *= plant.thrust_constant
    return rational / (1 + stiffness * rational) * np.exp(-s * plant.dead_time)


@given(plants, st.sampled_from([0.0, 1e5, 8e5]))
def test_the_bode_data_are_the_closed_form(plant: Plant, stiffness: float) -> None:
    omega = 2 * math.pi * np.geomspace(0.3, 999.0, 60)
    expected = closed_form(plant, omega, stiffness)
    difference = np.abs(frequency_response(plant, omega, stiffness) - expected)
    # Between the modes their terms cancel: round-off is that of the largest term, not of the remainder.
    assert np.all(difference <= 1e-9 * np.abs(expected) + 1e-14 * np.max(np.abs(expected)))


def test_the_bode_data_of_the_table_agree_to_nine_digits() -> None:
    omega = 2 * math.pi * np.geomspace(0.5, 1000, 2000)
    for stiffness in (0.0, 8e5, 1e5):
        ratio = frequency_response(PLANT, omega, stiffness) / closed_form(PLANT, omega, stiffness)
        assert np.max(np.abs(ratio - 1)) < 1e-9


def test_the_phase_falls_at_every_resonance_and_with_the_dead_time() -> None:
    omega = 2 * math.pi * np.geomspace(0.5, 900, 3000)
    for stiffness, first in ((0.0, -math.pi), (8e5, 0.0), (1e5, 0.0)):
        magnitude, phase = bode(PLANT, omega, stiffness)
        response = frequency_response(PLANT, omega, stiffness)
        assert magnitude * np.exp(1j * phase) == pytest.approx(response, rel=1e-9)
        assert phase[0] == pytest.approx(first, abs=0.02)
        assert phase[-1] == pytest.approx(-math.pi - omega[-1] * PLANT.dead_time, abs=0.05)
        assert np.all(phase < 0.1)


def test_the_expression_is_symbolic() -> None:
    """The same CasADi function serves optimal control: it takes symbols and can be differentiated by a mode's
    frequency.
    """
    omega = ca.SX.sym("omega", 2)
    derivative, position = equations(2)(ca.DM([1, 0, 2, 0]), 0.0, ca.DM([1, 1]), omega, ca.DM([0, 0]), 1.0)
    slope = ca.Function("slope", [omega], [ca.jacobian(derivative, omega)])(ca.DM([3, 5]))
    assert float(ca.evalf(position)) == 3
    assert np.array(slope)[1, 0] == -2 * 3 * 1
    assert np.array(slope)[3, 1] == -2 * 5 * 2


@pytest.mark.parametrize("delay", [0, 1, 2, 5])
@pytest.mark.parametrize("stiffness", [0.0, 8e5])
def test_whole_delays_agree_with_the_library(delay: int, stiffness: float) -> None:
    ours = sampled(replace(PLANT, dead_time=delay * TS), TS, stiffness)
    theirs = control.sample_system(state_space(PLANT, stiffness), TS, method="zoh")
    omega = 2 * math.pi * np.geomspace(1, 900, 100)
    z = np.exp(1j * omega * TS)
    assert ours(z) == pytest.approx(theirs(z) * z**-delay, rel=1e-9)
    assert ours.dt == TS


@pytest.mark.parametrize("fifths", [1, 3, 4, 7, 14])
def test_any_delay_agrees_with_a_finer_grid_on_which_it_is_whole(fifths: int) -> None:
    plant = replace(PLANT, dead_time=fifths * TS / 5)
    coarse = sampled(plant, TS)
    fine = sampled(plant, TS / 5)
    thrust = np.random.default_rng(1).standard_normal(60)
    at_samples = control.forced_response(coarse, inputs=thrust).outputs
    held = control.forced_response(fine, inputs=np.repeat(thrust, 5)).outputs[::5]
    assert np.max(np.abs(at_samples - held)) < 1e-12 * np.max(np.abs(held))


@pytest.mark.parametrize(
    ("dead_time", "split"), [(1e-3, (2, 0.0)), (1.13e-3, (2, 1.3e-4)), (0.0, (0, 0.0)), (3e-4, (0, 3e-4))]
)
def test_a_delay_is_split_into_samples_and_a_rest(dead_time: float, split: tuple[int, float]) -> None:
    whole, rest = delay_split(dead_time, TS)
    assert whole == split[0]
    assert rest == pytest.approx(split[1], abs=1e-15)


@pytest.mark.parametrize("dead_time", [1e-3, 1.2e-3])
def test_numerator_and_denominator_are_the_sampled_plant(dead_time: float) -> None:
    plant = replace(PLANT, dead_time=dead_time)
    numerator, denominator = polynomials(plant, TS)
    model = sampled(plant, TS, whole_delay=False)
    z = np.exp(1j * 2 * math.pi * np.geomspace(20, 900, 50) * TS)
    ratio = np.polyval(numerator[::-1], 1 / z) / np.polyval(denominator[::-1], 1 / z)
    assert ratio == pytest.approx(model(z), rel=1e-6)  # six roots near z = 1: the polynomials are ill-conditioned


def doubled(plant: Plant) -> Plant:
    """The same plant with K_t = 2 times what it was, the gains halved, and the rigid body last."""
    modes = [replace(plant.modes[i], gain=plant.modes[i].gain / 2) for i in (*plant.flexible, plant.rigid)]
    return replace(plant, thrust_constant=2 * plant.thrust_constant, modes=tuple(modes))


def test_the_rigid_body_is_found_wherever_it_stands_and_its_mass_counts_the_thrust_constant() -> None:
    plant = Plant(0.0, 2.0, (Mode(0.01, 80.0, 0.01), Mode(0.02, 40.0, 0.01), Mode(0.05, 0.0, 0.0)))
    assert (plant.rigid, plant.flexible) == (2, (0, 1))
    assert plant.mass == pytest.approx(1 / (2.0 * 0.05))
    assert plant.rigid_gain == pytest.approx(2.0 * 0.05)
    slow = 2 * math.pi * 1e-3  # the response there is the rigid body's, 1 / (M w^2)
    assert abs(frequency_response(plant, [slow])[0]) == pytest.approx(1 / (plant.mass * slow**2), rel=1e-6)


@pytest.mark.parametrize("frequencies", [(40.0,), (0.0, 0.0, 40.0)])
def test_a_plant_without_one_rigid_body_says_so(frequencies: tuple[float, ...]) -> None:
    plant = Plant(0.0, 1.0, tuple(Mode(0.02, frequency, 0.01) for frequency in frequencies))
    with pytest.raises(ValueError, match=f"has {frequencies.count(0.0)} rigid bodies; exactly one"):
        _ = plant.mass


def test_designs_do_not_depend_on_how_the_plant_is_written_down() -> None:
    other = doubled(PLANT)
    one, same = (synthesise(plant, TS, 0.02, 20e-6) for plant in (PLANT, other))
    assert np.allclose(same.thrust, one.thrust, atol=1e-6 * np.max(np.abs(one.thrust)))
    rules = [(simc(plant, TS, 5e-3, 2e-4), lambda_rule(plant, 5e-3, 2e-4)) for plant in (PLANT, other)]
    assert rules[0] == rules[1]


@given(st.floats(0.5, 50.0), st.floats(0.5, 50.0), st.floats(5.0, 200.0))
def test_an_antiresonance_is_where_the_load_swings_alone(motor: float, load: float, held: float) -> None:
    """Two masses on a spring, as seen from the motor: the load swings while the motor is held, and both, if free, at
    held * sqrt(1 + m2 / m1). As seen from the load there is none."""
    mass, free = motor + load, held * math.sqrt(1 + load / motor)
    seen = Plant(1e-3, 1.0, (Mode(1 / mass, 0.0, 0.0), Mode(load / (motor * mass), free, 1e-4)))
    assert list(antiresonances(seen)) == pytest.approx([held], rel=1e-3)
    assert antiresonances(replace(seen, modes=(seen.modes[0], Mode(-1 / mass, free, 0.0)))) == ()
