"""A loop that only the sticking friction makes unstable: found, with its cause, and nowhere else."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from design.family import largest_pole
from design.judging.sticking import MAX_SPRINGS, advice_on, cause_of, springs, state_of, sticking
from design.loop import spectral_radius
from models.effects.friction_laws import NoncollocatedFriction
from models.effects.structure import FrictionDrivenMode, LoadSideFriction
from models.friction import Friction
from models.machine import DEFAULT, Machine, load
from models.plant import Mode, Plant, against_spring, sampled
from models.simulation.simulator import simulate
from tests.design.machines import far_side


@pytest.fixture(scope="module")
def belt() -> Machine:
    return far_side(load())


def unstable_on_contacts() -> Machine:
    """A rigid table whose loop cannot damp how the mass swings on its stiffest contacts, for a dead time of 3 ms."""
    table = load()
    plant = replace(table.plant, dead_time=3e-3, modes=(table.plant.modes[table.plant.rigid],))
    return replace(table, plant=plant)


def swing_left(machine: Machine) -> float:
    """The way [m] that the position still swings over in the last second of four behind a step of the target."""
    ts = machine.sample_time
    target = np.where(np.arange(round(4 / ts)) < 100, 0.0, machine.specification.stroke)
    position = simulate(machine, machine.feedback_only(), target).record.position
    return float(np.ptp(position[-round(1 / ts) :]))


@pytest.mark.parametrize("file", [DEFAULT, DEFAULT.parent / "emps.toml"], ids=lambda file: file.stem)
def test_the_machines_of_the_project_are_stable_while_their_friction_sticks(file: Path) -> None:
    assert sticking(load(file)) is None


def test_a_mode_of_negative_gain_is_found_where_the_friction_swings_it_up(belt: Machine) -> None:
    found = sticking(belt)
    assert found is not None
    assert (found.modes, found.makes_work, found.heals) == ((belt.plant.modes[1],), True, True)
    assert found.slope == pytest.approx(sum(belt.friction.stiffness))
    loop = spectral_radius(sampled(belt.plant, belt.sample_time, found.slope), belt.control.pid)
    assert found.pole == pytest.approx(loop, rel=1e-9)
    assert loop > 1 > largest_pole(belt, belt.control.pid)
    assert found.growth_time == pytest.approx(belt.sample_time / math.log(loop))


def test_the_simulation_goes_on_swinging_there_and_rests_where_nothing_is_found(belt: Machine) -> None:
    turned = far_side(load(), gain=0.98)
    assert sticking(turned) is None
    assert swing_left(belt) > belt.specification.tolerance > 5 * swing_left(turned)


def test_a_softer_friction_does_not_swing_it_up(belt: Machine) -> None:
    stiffness = tuple(1e-3 * one for one in belt.friction.stiffness)
    assert sticking(replace(belt, friction=replace(belt.friction, stiffness=stiffness))) is None


def test_a_loop_that_is_unstable_anyhow_is_left_to_others(belt: Machine) -> None:
    quick = replace(belt, control=load().control)
    assert largest_pole(quick, quick.control.pid) > 1
    assert sticking(quick) is None
    assert sticking(quick, belt.control.pid) is not None


def test_all_modes_of_negative_gain_are_named_where_one_of_them_is_not_enough(belt: Machine) -> None:
    rigid, mode = belt.plant.modes
    half = tuple(Mode(mode.gain / 2, frequency, mode.damping) for frequency in (36.0, 40.0))
    other = Mode(-mode.gain, 90.0, mode.damping)
    found = sticking(replace(belt, plant=replace(belt.plant, modes=(rigid, other, *half))))
    assert found is not None
    assert found.modes == half
    assert "modes of negative gain at 36 Hz and 40 Hz: in the model" in cause_of(found)


def test_a_feedback_that_does_not_damp_the_contacts_is_no_mode_s_fault() -> None:
    found = sticking(unstable_on_contacts())
    assert found is not None
    assert (found.modes, found.makes_work) == ((), False)
    assert "the feedback does not damp" in cause_of(found)
    assert "pid_tradeoff" in advice_on(found)


def test_the_damping_of_elements_that_stick_counts() -> None:
    table = unstable_on_contacts()
    damped = replace(table.friction, damping=tuple(2e3 for _ in table.friction.limit))
    assert sticking(replace(table, friction=damped)) is None


def test_the_springs_are_those_that_stick_on_behind_a_reversal() -> None:
    friction = Friction(stiffness=(1.0, 4.0, 2.0), limit=(3e-6, 1e-6, 2e-6), damping=(10.0, 40.0, 20.0))
    assert springs(friction) == [(7.0, 70.0), (3.0, 30.0), (1.0, 10.0)]
    many = springs(Friction(stiffness=(1.0,) * 50, limit=tuple(1e-6 * i for i in range(1, 51)), damping=(0.0,) * 50))
    assert len(many) == MAX_SPRINGS
    assert (many[0], many[-1]) == ((50.0, 0.0), (1.0, 0.0))


def test_it_is_told_with_slope_frequency_cause_and_advice(belt: Machine) -> None:
    found = sticking(belt)
    assert found is not None
    assert "against a slope of 2160 N/mm it swings at 3" in state_of(found)
    assert "the mode of negative gain at 38 Hz: in the model friction acts where the thrust does" in cause_of(found)
    assert "gap_diagnosis tells whether the friction drives such a mode (friction_driven_mode)" in advice_on(found)
    assert "A copy of the machine file without this mode is stable, but knows nothing of that" in advice_on(found)
    assert "copy" not in advice_on(replace(found, heals=False)).lower()
    assert "work" not in cause_of(replace(found, makes_work=False))


def test_a_friction_that_drives_a_mode_of_its_own_is_a_spring_where_it_acts() -> None:
    """A motor of m_1 and a load of m_2 on a spring, scale and friction on the load: the plant against the friction's
    slope has the frequencies of those masses on two springs. A user's ball screw was said to swing ever wider."""
    first, second, coupling, held = 400.0, 650.0, 3e7, 2e8
    frequency = math.sqrt(coupling * (1 / first + 1 / second)) / (2 * math.pi)
    plant = Plant(
        dead_time=0.0,
        thrust_constant=1.0,
        modes=(Mode(1 / (first + second), 0.0, 0.0), Mode(-1 / (first + second), frequency, 0.0)),
    )
    masses, springs_ = np.diag([first, second]), np.array([[coupling, -coupling], [-coupling, coupling + held]])
    exact = np.sqrt(np.linalg.eigvals(np.linalg.solve(masses, springs_)).real)
    a, b, c = against_spring(plant, held, by_friction=(Mode(1 / second, frequency, 0.0),))
    found = np.linalg.eigvals(a)
    assert np.max(np.abs(found.real)) < 1e-6 * np.max(exact)
    for one in exact:
        assert np.min(np.abs(found - 1j * one)) < 1e-6 * one
    s = 2j * math.pi * 17.0
    forced = np.linalg.solve(masses * s**2 + springs_, [1.0, 0.0])[1]  # of the load, by the motor
    assert (c @ np.linalg.solve(s * np.eye(6) - a, b))[0, 0] == pytest.approx(forced, rel=1e-9)
    alone, _, _ = against_spring(plant, held)
    assert np.max(np.linalg.eigvals(alone).real) > 1.0  # at the motor it would put energy in


def test_such_a_mode_takes_the_warning_away(belt: Machine) -> None:
    _, mode = belt.plant.modes
    driven = FrictionDrivenMode(2 * abs(mode.gain), mode.frequency, mode.damping)
    assert sticking(replace(belt, effects=(driven,))) is None
    assert swing_left(replace(belt, effects=(driven,))) < belt.specification.tolerance
    for away in (NoncollocatedFriction(1e-6), LoadSideFriction(0.4, 1e6, 10.0, 0.02)):
        assert sticking(replace(belt, effects=(away,))) is None
