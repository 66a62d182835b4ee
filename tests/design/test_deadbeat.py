"""Deadbeat feedforwards: closed forms, round-off after the settling time, and what the constraints ask for."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import get_args

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from design.deadbeat import (
    Constraints,
    Deadbeat,
    DesignError,
    Objective,
    least_peak_thrust,
    shortest_settling_time,
    synthesise,
)
from design.linear_response import linear_response
from models.machine import load
from models.plant import Mode, Plant
from models.variation import Variation, at_mode, varied_plant

TS, STROKE = 5e-4, 20e-6
PLANT = load().plant
MASS = 50.0
DOUBLE_INTEGRATOR = Plant(1e-3, 1.0, (Mode(1 / MASS, 0.0, 0.0),))


def remains(plant: Plant, deadbeat: Deadbeat) -> float:
    """Largest deviation after the settling time, between the samples too, of the stroke; by the closed form."""
    times = deadbeat.settling_time + plant.dead_time + np.arange(0, 0.2, TS / 7)
    return float(np.max(np.abs(linear_response(plant, deadbeat.thrust, TS, times) / deadbeat.stroke - 1)))


@pytest.mark.parametrize("count", [2, 7, 40])
def test_double_integrator_with_the_least_thrust_squared(count: int) -> None:
    """u_k = 12 r M ((n - 1) / 2 - k) / (T_s^2 n (n^2 - 1)), the projection on what moves by r and stops."""
    deadbeat = synthesise(DOUBLE_INTEGRATOR, TS, count * TS, STROKE, "thrust")
    k = np.arange(count)
    expected = 12 * STROKE * MASS * ((count - 1) / 2 - k) / (TS**2 * count * (count**2 - 1))
    assert deadbeat.thrust == pytest.approx(expected, rel=1e-7, abs=1e-7 * np.max(np.abs(expected)))


@pytest.mark.parametrize("count", [2, 8, 40])
def test_double_integrator_with_the_least_peak_is_bang_bang(count: int) -> None:
    """|u| = 4 r M / (n T_s)^2 for an even n: full thrust for one half, full brake for the other."""
    deadbeat = synthesise(DOUBLE_INTEGRATOR, TS, count * TS, STROKE, "peak_thrust")
    peak = 4 * STROKE * MASS / (count * TS) ** 2
    assert deadbeat.thrust == pytest.approx(np.repeat([peak, -peak], count // 2), rel=1e-7)
    assert least_peak_thrust(DOUBLE_INTEGRATOR, TS, count * TS, STROKE) == pytest.approx(peak, rel=1e-7)


@pytest.mark.parametrize("objective", get_args(Objective))
@pytest.mark.parametrize("dead_time", [1e-3, 1.17e-3])
def test_nothing_remains_after_the_settling_time(objective: Objective, dead_time: float) -> None:
    plant = replace(PLANT, dead_time=dead_time)
    deadbeat = synthesise(plant, TS, 20e-3, STROKE, objective, Constraints(thrust=133.5))
    assert remains(plant, deadbeat) < 1e-9
    assert np.max(np.abs(deadbeat.thrust)) <= 133.5 * (1 + 1e-6)


stiff_plants = st.builds(
    lambda mass, modes: Plant(1e-3, 1.0, (Mode(1 / mass, 0.0, 0.0), *modes)),
    st.floats(1, 200),
    st.lists(
        st.builds(
            Mode,
            gain=st.floats(1e-4, 5e-3),
            frequency=st.sampled_from([38.0, 81.0, 140.0, 260.0]),
            damping=st.floats(0, 0.1),
        ),
        max_size=3,
        unique_by=lambda mode: mode.frequency,
    ),
)


@settings(max_examples=30)
@given(stiff_plants, st.integers(30, 80), st.floats(1e-6, 1e-3))
def test_nothing_remains_for_any_number_of_modes(plant: Plant, count: int, stroke: float) -> None:
    assert remains(plant, synthesise(plant, TS, count * TS, stroke)) < 1e-9


@pytest.mark.parametrize("dead_time", [1e-3, 1.2e-3])
def test_the_polynomials_are_those_of_the_plant_times_a_free_one(dead_time: float) -> None:
    deadbeat = synthesise(replace(PLANT, dead_time=dead_time), TS, 20e-3, STROKE)
    d_ff, n_ff = np.array(deadbeat.d_ff), np.array(deadbeat.n_ff)
    assert np.max(np.abs(np.convolve(deadbeat.denominator, deadbeat.free) - d_ff)) < 1e-8 * np.max(np.abs(d_ff))
    assert np.max(np.abs(np.convolve(deadbeat.numerator, deadbeat.free)[: n_ff.size] - n_ff)) < 1e-8
    assert np.sum(n_ff) == pytest.approx(1, abs=1e-12)
    assert np.cumsum(d_ff)[:-1] * STROKE == pytest.approx(deadbeat.thrust, abs=1e-9)
    assert np.cumsum(n_ff) * STROKE == pytest.approx(deadbeat.position, abs=1e-15)


@pytest.mark.parametrize(("dead_time", "whole"), [(1e-3, 2), (1.2e-3, 2), (0.9e-3, 1), (0.0, 0)])
def test_the_trajectory_is_where_the_plant_is_whole_samples_of_dead_time_later(dead_time: float, whole: int) -> None:
    plant = replace(PLANT, dead_time=dead_time)
    deadbeat = synthesise(plant, TS, 20e-3, STROKE)
    times = (np.arange(41) + whole) * TS
    assert linear_response(plant, deadbeat.thrust, TS, times) == pytest.approx(deadbeat.position, abs=1e-14)


def test_a_monotone_trajectory_costs_thrust_but_does_not_turn() -> None:
    deadbeat = synthesise(PLANT, TS, 22e-3, STROKE, constraints=Constraints(monotone=True))
    free = synthesise(PLANT, TS, 22e-3, STROKE)
    assert np.min(np.diff(free.position)) < -1e-7  # the freedom is used, or the next line proves nothing
    assert np.min(np.diff(deadbeat.position)) > -1e-12
    assert np.sum(np.diff(deadbeat.thrust) ** 2) > np.sum(np.diff(free.thrust) ** 2)
    assert remains(PLANT, deadbeat) < 1e-9


def test_an_overshoot_is_kept_within_its_limit() -> None:
    stand = Plant(1e-3, 1.0, (Mode(1 / 50, 0.0, 0.0), Mode(1 / 10, 60.0, 0.01)))
    free = synthesise(stand, TS, 20e-3, STROKE)
    bound = synthesise(stand, TS, 20e-3, STROKE, constraints=Constraints(overshoot=0.02))
    assert np.max(free.position) > 1.05 * STROKE
    assert np.max(bound.position) < 1.0201 * STROKE
    assert remains(stand, bound) < 1e-9


def test_freedom_spent_on_robustness_leaves_less_vibration() -> None:
    """In 40 ms there is freedom to spend: any frequency 5 % off leaves a fifth at most of what it may leave else."""
    plain, robust = (
        _worst_left(synthesise(PLANT, TS, 40e-3, STROKE, o)) for o in ("thrust_difference", "mode_robustness")
    )
    assert robust < 0.2 * plain


def _worst_left(deadbeat: Deadbeat) -> float:
    times = deadbeat.settling_time + PLANT.dead_time + np.arange(0, 0.1, TS)
    wrong = [
        varied_plant(PLANT, Variation(frequency=at_mode(PLANT, mode, error)))
        for mode in (1, 2)
        for error in (-0.05, -0.03, 0.03, 0.05)
    ]
    return max(float(np.max(np.abs(linear_response(plant, deadbeat.thrust, TS, times) - STROKE))) for plant in wrong)


def test_the_least_peak_is_below_what_the_other_objectives_need() -> None:
    peaks = {o: np.max(np.abs(synthesise(PLANT, TS, 20e-3, STROKE, o).thrust)) for o in get_args(Objective)}
    assert peaks["peak_thrust"] == min(peaks.values())
    assert peaks["peak_thrust"] == pytest.approx(least_peak_thrust(PLANT, TS, 20e-3, STROKE), rel=1e-9)


@given(
    plant=stiff_plants,
    count=st.integers(30, 60),
    room=st.floats(1.0, 1.05),
    objective=st.sampled_from(get_args(Objective)),
    monotone=st.booleans(),
)
def test_what_the_least_peak_can_do_every_objective_can_next_to_it(
    plant: Plant, count: int, room: float, objective: Objective, monotone: bool
) -> None:
    """OSQP alone came to no end at one of twelve, and the stroke was said to be impossible."""
    least = least_peak_thrust(plant, TS, count * TS, STROKE, monotone=monotone)
    assume(math.isfinite(least))
    limit = least * room * (1 + 1e-6)
    found = synthesise(plant, TS, count * TS, STROKE, objective, Constraints(thrust=limit, monotone=monotone))
    assert np.max(np.abs(found.thrust)) <= limit * (1 + 1e-6)
    assert remains(plant, found) < 1e-9


@pytest.mark.parametrize("constraints", [Constraints(thrust=133.5), Constraints(thrust=133.5, monotone=True)])
def test_the_shortest_settling_time_can_be_met_and_none_shorter(constraints: Constraints) -> None:
    shortest = shortest_settling_time(PLANT, TS, STROKE, constraints)
    synthesise(PLANT, TS, shortest, STROKE, constraints=constraints)
    with pytest.raises(DesignError, match=f"the shortest that can is {shortest * 1e3:g} ms"):
        synthesise(PLANT, TS, shortest - TS, STROKE, constraints=constraints)


def test_the_least_peak_falls_with_the_settling_time_whatever_the_shape() -> None:
    """More time is never worse; and a shape costs thrust, until it costs none."""
    times = np.arange(41, 65) * TS
    free, monotone = ([least_peak_thrust(PLANT, TS, time, STROKE, monotone=m) for time in times] for m in (False, True))
    assert np.all(np.isfinite(monotone))
    assert np.all(np.diff(free) < 0)
    assert np.all(np.diff(monotone) < 0)
    assert np.all(np.array(monotone) >= np.array(free) * (1 - 1e-6))
    assert monotone[-1] == pytest.approx(free[-1], rel=1e-6)


@pytest.mark.parametrize("dead_time", [1e-3, 1.2e-3])
def test_fewer_samples_than_states_are_no_deadbeat_for_any_number_of_modes(dead_time: float) -> None:
    for count in range(6):
        modes = tuple(Mode(1e-3, 40.0 * (i + 1), 0.01) for i in range(count))
        plant = Plant(dead_time, 1.0, (Mode(0.02, 0.0, 0.0), *modes))
        states = 2 * (count + 1) + (dead_time > 1e-3)
        for samples in range(1, states):
            assert least_peak_thrust(plant, TS, samples * TS, STROKE) == math.inf
        assert math.isfinite(shortest_settling_time(plant, TS, STROKE, Constraints(thrust=500.0)))


@pytest.mark.parametrize(
    ("settling_time", "stroke", "says"),
    [
        (20.2e-3, STROKE, "must be a whole number of samples of 500 µs, not 20.2 ms; take 20 ms"),
        (0.0, STROKE, "give one above 0"),
        (math.nan, STROKE, "give one above 0"),
        (20e-3, 0.0, "the stroke is 0 m; give one above 0"),
        (20e-3, math.inf, "the stroke is inf"),
    ],
)
def test_what_means_nothing_is_said(settling_time: float, stroke: float, says: str) -> None:
    with pytest.raises(DesignError, match=says):
        synthesise(PLANT, TS, settling_time, stroke)
