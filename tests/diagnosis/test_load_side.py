"""Friction on the load, thrust and scale at the motor: its law against a simulation of both, its name and its share."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from diagnosis.diagnose import diagnose
from diagnosis.verdict import Outcome
from models.controller import Controller, References
from models.effects.structure import LoadSideFriction
from models.machine import load
from models.plant import Mode
from models.simulation.simulator import simulate
from tests.diagnosis.two_inertias import DAMPING, HELD, LATE, LOAD, MOTOR, SPRING, TS, machine, moves, record, run

STROKES = (50e-6, 50e-6, -50e-6, -20e-6, 20e-6, 100e-6, -100e-6, 30e-6, -80e-6, 200e-6, -200e-6, 50e-6)


def law(share: float) -> LoadSideFriction:
    """With this share of the friction on the load [1]."""
    return LoadSideFriction(share, SPRING, LOAD, DAMPING / 2 / math.sqrt(SPRING * LOAD))


def test_load_and_spring_follow_from_the_plant() -> None:
    """Of a motor and a load, the mode of the motor's own response has the gain m/m_1 over that of the rigid body."""
    (placed,) = LoadSideFriction.placed(machine(reads_motor=True).plant)
    assert placed.values()[1:] == pytest.approx(law(0.3).values()[1:], rel=1e-9)
    assert math.sqrt(placed.stiffness / placed.mass) == pytest.approx(HELD, rel=1e-9)


def test_of_a_plant_without_a_load_at_the_motors_spring_there_is_none() -> None:
    """The scale is on the load, or the load is far lighter or heavier than the motor; nobody looks for the effect."""
    plant = machine(reads_motor=True).plant
    for factor in (-1.0, 0.01, 100.0):
        mode = plant.modes[1]
        other = replace(plant, modes=(plant.modes[0], Mode(factor * mode.gain, mode.frequency, mode.damping)))
        assert LoadSideFriction.placed(other) == ()
        assert LoadSideFriction.name not in replace(load(), plant=other).kinds
    assert LoadSideFriction.name in replace(load(), plant=plant).kinds


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_the_loop_moves_as_with_both_inertias(share: float) -> None:
    """Of moves of 20 to 100 um [m rms], the friction on the load in part or whole."""
    target, reference = moves(STROKES[:7])
    asked = (MOTOR + LOAD) * np.gradient(np.gradient(reference, TS), TS)
    nominal = machine(reads_motor=True)
    controller = Controller(TS, nominal.control.pid, LATE, (1.0,), (0.0,))
    ran = run(asked, reference, on_motor=1.0 - share, reads_motor=True)

    def apart(stated: float) -> float:
        modelled = replace(nominal, effects=(law(stated),))
        given = References(reference, asked, np.zeros_like(asked))
        made = simulate(modelled, controller, target, given=given, seed=0)
        return float(np.sqrt(np.mean((made.record.position - ran.reading) ** 2)))

    assert apart(share) <= 2e-9
    assert apart(abs(share - 0.3)) > 20e-9


def test_from_a_strained_start_it_is_in_equilibrium() -> None:
    """Contacts that hold the axis at the start hold the load with it."""
    nominal = machine(reads_motor=True)
    nominal = replace(nominal, scale=replace(nominal.scale, noise=0.0), effects=(law(0.5),))
    controller = Controller(TS, nominal.control.pid, LATE, (1.0,), (0.0,))
    still, strained = np.zeros(300), 0.8 * np.array(nominal.friction.limit)
    made = simulate(nominal, controller, still, initial_friction=strained)
    assert np.abs(made.position).max() < 1e-12


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_it_is_named_with_its_share(share: float) -> None:
    strokes = [record(1.0 - share, 1, STROKES, reads_motor=True)]
    found = diagnose(machine(reads_motor=True), strokes)
    if share == 0:
        assert (found.outcome, found.effects) == (Outcome.NOTHING, ())
    else:
        assert (found.outcome, found.effects) == (Outcome.ATTRIBUTED, ("load_side_friction",))
        assert found.how_far.closure > 0.95
        (named,) = found.told.candidate.added_effects
        assert named.strength() == pytest.approx(share, abs=0.05)
