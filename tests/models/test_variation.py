"""Machines that are a little off: which values each error moves, and which it leaves alone."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.friction import branch, elements
from models.machine import Provenance, Tolerance, load
from models.plant import Mode, frequency_response
from models.variation import (
    MOST_DAMPING,
    Variation,
    at_mode,
    drawn,
    known,
    known_apart,
    varied,
    varied_friction,
    varied_plant,
)

MACHINE = load()
PLANT = MACHINE.plant
OMEGA = 2 * math.pi * np.geomspace(0.5, 900, 200)


def test_no_variation_is_the_machine() -> None:
    assert varied(MACHINE, Variation()) == MACHINE


def test_a_wrong_mass_scales_the_whole_plant_and_a_payload_the_rigid_body_alone() -> None:
    heavier, loaded = (varied_plant(PLANT, Variation(**{name: 0.25})) for name in ("mass", "payload"))
    ratio = frequency_response(heavier, OMEGA) / frequency_response(PLANT, OMEGA)
    assert ratio == pytest.approx(np.full(OMEGA.size, 1 / 1.25))
    assert heavier.mass == pytest.approx(1.25 * PLANT.mass)
    assert loaded.mass == pytest.approx(1.25 * PLANT.mass)
    assert [loaded.modes[i] for i in PLANT.flexible] == [PLANT.modes[i] for i in PLANT.flexible]


@given(st.floats(-0.5, 1.0), st.floats(-0.5, 1.0), st.floats(1e-7, 1e-3))
def test_force_and_length_of_the_friction_scale_its_curve(force: float, length: float, distance: float) -> None:
    friction = varied_friction(MACHINE.friction, Variation(friction_force=force, friction_length=length))
    expected = (1 + force) * branch(MACHINE.friction, distance)
    assert branch(friction, distance * (1 + length)) == pytest.approx(expected)
    assert friction.damping == MACHINE.friction.damping


def test_a_stronger_drive_moves_the_axis_more_and_needs_less_reference_for_what_is_known_in_newtons() -> None:
    offset = replace(MACHINE, drive=replace(MACHINE.drive, offset=3.0))
    stronger = varied(offset, Variation(thrust_constant=0.25))
    ratio = frequency_response(stronger.plant, OMEGA) / frequency_response(PLANT, OMEGA)
    assert ratio == pytest.approx(np.full(OMEGA.size, 1.25))
    assert 1.25 * stronger.friction.coulomb_force == pytest.approx(MACHINE.friction.coulomb_force)
    assert stronger.friction.limit == MACHINE.friction.limit
    assert 1.25 * stronger.drive.offset == pytest.approx(3.0)
    damped = replace(MACHINE.friction, damping=(2.0,) * len(MACHINE.friction.limit))
    assert 1.25 * varied_friction(damped, Variation(thrust_constant=0.25)).damping[0] == pytest.approx(2.0)


def test_a_thrust_constant_is_among_what_is_known_where_the_file_tells_its_tolerance() -> None:
    name = "plant.thrust_constant"
    assert name not in {one.name for one in known(MACHINE)}  # only its ratio to the mass is
    machine = replace(MACHINE, tolerance=replace(MACHINE.tolerance, thrust_constant=0.1))
    assert next(one for one in known(machine) if one.name == name).relative == pytest.approx([0.1])


def test_contacts_and_modes_have_errors_of_their_own() -> None:
    count = len(MACHINE.friction.limit)
    wide = tuple(0.01 * i for i in range(count))
    friction = varied_friction(MACHINE.friction, Variation(stiffness=wide, limit=-0.5))
    assert friction.stiffness == pytest.approx(np.array(MACHINE.friction.stiffness) * (1 + np.array(wide)))
    assert friction.limit == pytest.approx(0.5 * np.array(MACHINE.friction.limit))
    second = PLANT.flexible[1]
    plant = varied_plant(PLANT, Variation(frequency=at_mode(PLANT, second, 0.1), modal_gain=0.2, damping=0.5))
    for i, (before, after) in enumerate(zip(PLANT.modes, plant.modes, strict=True)):
        flexible = i in PLANT.flexible
        assert after.frequency == pytest.approx(before.frequency * (1.1 if i == second else 1.0))
        assert after.gain == pytest.approx(before.gain * (1.2 if flexible else 1.0))
        assert after.damping == pytest.approx(1.5 * before.damping)
    gains = varied_plant(PLANT, Variation(modal_gain=(0.1, 0.0, 0.0))).modes
    assert gains[0].gain == pytest.approx(1.1 * PLANT.modes[0].gain)
    with pytest.raises(ValueError, match="2 numbers for 3 modes"):
        varied_plant(PLANT, Variation(damping=(0.1, 0.1)))


def test_what_cannot_be_stays_at_its_end() -> None:
    off = varied(MACHINE, Variation(dead_time=-1.0, offset=-3.0, damping=1e3))
    assert off.plant.dead_time == 0.0
    assert off.drive.offset == MACHINE.drive.offset - 3.0
    assert [off.plant.modes[i].damping for i in PLANT.flexible] == [MOST_DAMPING] * 2
    damped = replace(PLANT, modes=(*PLANT.modes, Mode(0.01, 50.0, 0.999)))
    assert varied_plant(damped, Variation()) == damped


def test_drawn_machines_stay_within_their_ranges_and_repeat_with_their_seed() -> None:
    within = Variation(friction_force=0.3, mass=0.03, frequency=0.02)
    some, again, other = (drawn(MACHINE, within, 50, seed) for seed in (1, 1, 2))
    assert some == again
    assert some != other
    level = np.array([one.friction.coulomb_force / MACHINE.friction.coulomb_force - 1 for one in some])
    mass = np.array([one.plant.mass / PLANT.mass - 1 for one in some])
    shift = np.array(
        [[one.plant.modes[i].frequency / PLANT.modes[i].frequency - 1 for i in PLANT.flexible] for one in some]
    )
    for error, most in ((level, 0.3), (mass, 0.03), (shift, 0.02)):
        assert 0.8 * most < np.max(np.abs(error)) <= most * (1 + 1e-12)
    for one in (level, mass):
        assert abs(np.corrcoef(one, shift[:, 0])[0, 1]) < 0.5
    assert abs(np.corrcoef(shift.T)[0, 1]) < 0.5
    assert all(one.friction.limit == MACHINE.friction.limit and one.drive == MACHINE.drive for one in some)
    assert drawn(MACHINE, Variation(), 1, 0) == [MACHINE]


@pytest.mark.parametrize("name", [field.name for field in fields(Variation)])
def test_every_error_changes_the_machine(name: str) -> None:
    assert varied(MACHINE, Variation(**{name: 1e-4})) != MACHINE


def test_a_deviation_beside_a_value_goes_before_its_tolerance() -> None:
    """Of each value: what the file states beside it, else its [tolerance], else the usual one."""
    said = Provenance("identified", "a record", std=3e-6)
    tolerance = replace(MACHINE.tolerance, mass=0.04)
    machine = MACHINE.with_value("plant.dead_time", PLANT.dead_time, said)
    machine = machine.with_part("tolerance", tolerance, {"mass": Provenance("given", "")})
    found = {one.name: one for one in known(machine)}
    rigid = f"plant.modes.{PLANT.rigid + 1}.gain"
    origins = {name: one.origin for name, one in found.items()}
    assert origins["plant.dead_time"] == "value"
    assert found["plant.dead_time"].deviations == (3e-6,)
    assert origins[rigid] == "tolerance"
    assert found[rigid].relative == pytest.approx([0.04])
    assert origins["friction.limit"] == origins["friction.level"] == "usual"
    assert found["friction.limit"].relative == pytest.approx([Tolerance().limit] * len(MACHINE.friction.limit))
    each = tuple(0.01 * k for k in MACHINE.friction.stiffness)
    own = Provenance("identified", "a record", std=each)
    stiff = known(machine.with_value("friction.stiffness", MACHINE.friction.stiffness, own))
    assert {one.name: one.deviations for one in stiff}["friction.stiffness"] == each
    assert "friction.level" not in {one.name for one in stiff}  # what all have together is in each of theirs


def test_elements_whose_deviations_have_errors_in_common_tell_the_level_of_their_sum() -> None:
    """Two halves of one element, one up where the other is down: either is open by a half, their sum by a per cent."""
    sure, open_by = 0.01, 0.5
    friction = elements(np.array([1e6, 1e6]), np.array([1e-6, 1e-6]))
    common = np.sqrt(1 - 2 * (sure / open_by) ** 2)
    stiff = Provenance("identified", "", std=(open_by * 1e6,) * 2, shares=((common,), (-common,)))
    long = Provenance("identified", "", std=(1e-12, 1e-12), shares=((), ()))
    machine = MACHINE.with_part("friction", friction, {"stiffness": stiff, "limit": long})
    found = {one.name: one for one in known(machine)}
    assert found["friction.stiffness"].relative == pytest.approx([open_by] * 2)
    assert found["friction.level"].deviations[0] == pytest.approx(sure, rel=1e-3)
    assert found["friction.level"].origin == "value"
    apart = {one.name: one for one in known_apart(machine)}
    assert apart["friction.stiffness"].relative == pytest.approx([MACHINE.tolerance.stiffness] * 2)
    assert apart["friction.level"].deviations == (MACHINE.tolerance.friction_level,)
    alone = machine.with_value("friction.stiffness", friction.stiffness, replace(stiff, shares=()))
    assert {one.name: one for one in known_apart(alone)}["friction.stiffness"].relative == pytest.approx([open_by] * 2)


def test_deviations_that_are_not_one_for_each_number_are_none() -> None:
    short = Provenance("identified", "a record", std=(1.0,))
    machine = MACHINE.with_value("friction.stiffness", MACHINE.friction.stiffness, short)
    assert {one.name: one.origin for one in known(machine)}["friction.stiffness"] == "usual"


def test_the_contacts_damping_moves_by_one_time_of_all_and_never_below_none() -> None:
    friction = elements([2e6, 1e6], [1e-6, 1e-5], [200.0, 300.0])
    more, less = (varied_friction(friction, Variation(contact_damping=lag)) for lag in (1e-4, -2e-4))
    assert more.damping == pytest.approx((400.0, 400.0))
    assert less.damping == pytest.approx((0.0, 100.0))
    stronger = varied_friction(friction, Variation(contact_damping=1e-4, thrust_constant=0.25))
    assert stronger.damping == pytest.approx((320.0, 320.0))
