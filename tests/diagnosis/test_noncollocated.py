"""Friction at the motor or on the load, the scale on the load: its laws against a simulation of both, and its name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.diagnose import diagnose
from diagnosis.verdict import Outcome
from models.controller import Controller, References
from models.effects.friction_laws import NoncollocatedFriction
from models.effects.structure import FrictionDrivenMode
from models.simulation.effect_kernel import Path, replay
from models.simulation.simulator import simulate
from tests.diagnosis.two_inertias import HELD, LATE, LOAD, MOTOR, STEPS, TS, machine, moves, record, run

STROKES = (50e-6, 50e-6, -50e-6, -20e-6, 20e-6, 100e-6, -100e-6, 30e-6, -80e-6, 200e-6, -200e-6, 50e-6)


def test_the_contacts_go_with_the_inertia_that_they_touch() -> None:
    """Along the load's way, the law with c = 1/w^2 gives the friction that acted on the motor."""
    _, reference = moves(STROKES)
    ran = run(np.gradient(np.gradient(reference, TS), TS), reference, on_motor=True)
    position, speed = (signal.reshape(-1, STEPS) for signal in (ran.position, ran.speed))
    path = Path(TS, position, speed, position[:, 0], ran.command)
    left = []
    for advance in (0.0, 0.5 / HELD**2, 1 / HELD**2):
        friction = replay(machine().friction, (NoncollocatedFriction(advance),), path, 0.0).friction
        left.append(np.sqrt(np.mean((friction.ravel() - ran.friction) ** 2)))
    assert left[0] > 0.05  # N (rms), of friction of 1.5 N
    assert left[1] > 0.3 * left[0]
    assert left[2] < 0.1 * left[0]  # the damping beside the spring is not in the law


@pytest.mark.parametrize("on_motor", [True, False])
def test_where_the_friction_acts_is_named_with_its_frequency(on_motor: bool) -> None:
    found = diagnose(machine(), [record(on_motor, 1, STROKES)])
    if on_motor:
        assert (found.outcome, found.effects) == (Outcome.ATTRIBUTED, ("noncollocated_friction",))
        assert found.how_far.closure > 0.95
        (law,) = found.told.candidate.added_effects
        assert law.strength() == pytest.approx(1 / HELD**2, rel=0.05)
    else:
        assert (found.outcome, found.effects) == (Outcome.ATTRIBUTED, ("friction_driven_mode",))
        assert found.how_far.closure > 0.95
        (law,) = found.told.candidate.added_effects
        assert law.strength() == pytest.approx(1 / LOAD, rel=0.02)
        (mode,) = law.modes()
        assert mode.frequency == pytest.approx(machine().plant.modes[1].frequency, rel=5e-3)


@pytest.mark.parametrize(
    ("gain", "least", "most"), [(0.0, 50e-9, np.inf), (0.5 / LOAD, 25e-9, np.inf), (1 / LOAD, 0, 1e-9)]
)
def test_friction_on_the_load_moves_it_as_the_mode_that_it_drives(gain: float, least: float, most: float) -> None:
    """In the closed loop, of moves of 20 to 100 um: with a gain of 1/m_2 both simulations read the same [m rms]."""
    target, reference = moves(STROKES[:7])
    asked = (MOTOR + LOAD) * np.gradient(np.gradient(reference, TS), TS)
    nominal = machine()
    mode = nominal.plant.modes[1]
    modelled = replace(nominal, effects=(FrictionDrivenMode(gain, mode.frequency, mode.damping),))
    controller = Controller(TS, nominal.control.pid, LATE, (1.0,), (0.0,))
    made = simulate(modelled, controller, target, given=References(reference, asked, np.zeros_like(asked)), seed=0)
    apart = made.record.position - run(asked, reference, on_motor=False).reading
    assert least <= np.sqrt(np.mean(apart**2)) <= most


def test_from_a_strained_start_it_is_in_equilibrium() -> None:
    """Contacts that hold the axis at the start drive no mode until they yield or move."""
    nominal = replace(machine(), scale=replace(machine().scale, noise=0.0))
    controller = Controller(TS, nominal.control.pid, LATE, (1.0,), (0.0,))
    still, strained = np.zeros(300), 0.8 * np.array(nominal.friction.limit)
    mode = nominal.plant.modes[1]
    modelled = replace(nominal, effects=(FrictionDrivenMode(1 / LOAD, mode.frequency, mode.damping),))
    made = simulate(modelled, controller, still, initial_friction=strained)
    assert np.abs(made.position).max() < 1e-12
