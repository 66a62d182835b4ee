"""A fitted candidate as a machine file, where a fit has left what a file may state."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.handover.files import judged_file, machine_of, starts_of
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from models.effects.base import Effect
from models.effects.friction_laws import DirectionalFriction
from models.effects.structure import CableSpring
from models.machine import load

MACHINE = load()


def written(effect: Effect) -> Effect:
    """The effect as it is read from the file that is written of a candidate with it."""
    layout = parameters(MACHINE, 1)
    candidate = Candidate(layout, np.zeros(layout.count), (effect,))
    (found,) = judged_file(machine_of(MACHINE, candidate), starts_of(candidate)).machine.effects
    return found


def test_a_size_whose_sign_a_fit_has_turned_is_nothing_in_the_file() -> None:
    """Fits of single records do so where the effect is not there; the file was refused by its own reader."""
    found = written(CableSpring(stiffness=-584.3))
    assert isinstance(found, CableSpring)
    assert found.stiffness == 0.0


def test_a_size_beyond_an_end_that_is_not_allowed_itself_is_just_within() -> None:
    found = written(DirectionalFriction(asymmetry=-1.5, distance=1e-5, forgets=0))
    assert isinstance(found, DirectionalFriction)
    assert found.asymmetry == pytest.approx(-1.0)
    assert found.asymmetry > -1


def test_what_a_file_may_state_stays_to_the_last_digit() -> None:
    effect = CableSpring(stiffness=1234.5678901234567)
    assert written(effect) == effect


def test_a_value_that_left_its_tolerance_behind_says_so() -> None:
    """A dead time known to 20 us, moved by 320: the file had said "within the tolerance of the file's value"."""
    layout = parameters(MACHINE, 1)
    theta = np.zeros(layout.count)
    theta[layout.of("dead_time")] = 16 * MACHINE.tolerances.dead_time
    detail = machine_of(MACHINE, Candidate(layout, theta, ())).sources["plant.dead_time"].detail
    assert detail == "diagnosis, 16 usual tolerances from the file's value"


def test_a_value_that_left_its_stated_deviation_far_behind_says_so() -> None:
    """A mode that a sweep showed to a thousandth, moved by two hundredths within the file's tolerance."""
    (_, first, *_), name = MACHINE.plant.modes, "plant.modes.2.frequency"
    stated = replace(MACHINE.sources[name], std=1e-3 * first.frequency)
    known = replace(MACHINE, sources={**MACHINE.sources, name: stated})
    layout = parameters(known, 1)
    theta = np.zeros(layout.count)
    theta[layout.of("mode_frequency")[0]] = np.log(1.02)
    moved = Candidate(layout, theta, ())
    assert machine_of(known, moved).sources[name].detail == (
        "diagnosis, 20 stated standard deviations from the file's value"
    )
    usual = replace(moved, layout=parameters(MACHINE, 1))
    assert machine_of(MACHINE, usual).sources[name].detail == "diagnosis, 4 usual tolerances from the file's value"
    near = replace(usual, theta=theta / 4)
    assert machine_of(MACHINE, near).sources[name].detail == "diagnosis, within the tolerance of the file's value"
