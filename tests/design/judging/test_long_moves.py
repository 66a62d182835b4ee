"""Long moves: within thrust and speed, as short as these allow, and settled where a step is not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from design.controller import default_controller, usable_thrust
from design.deadbeat import DesignError
from design.effect_compensation import with_effects
from design.judging.long_moves import RESERVE, largest_step, moves_to_json, plan, run, step, with_anti_windup
from design.linear_response import linear_response
from models.controller import Controller, references
from models.effects.friction_laws import ViscousFriction
from models.effects.structure import CableSpring
from models.machine import Machine, load
from models.plant import delay_split


@pytest.fixture(scope="module")
def machine() -> Machine:
    return load()


@pytest.fixture(scope="module")
def controller(machine: Machine) -> Controller:
    return default_controller(machine)


@pytest.mark.parametrize("stroke", [1e-3, 5e-3, 20e-3])
def test_a_move_keeps_to_the_thrust_and_settles_where_the_same_step_never_does(
    machine: Machine, controller: Controller, stroke: float
) -> None:
    move = plan(machine, controller, stroke)
    assert 0.97 * RESERVE * usable_thrust(machine) < move.thrust <= RESERVE * usable_thrust(machine)
    done = run(machine, controller, move)
    assert done.settling_time <= machine.specification.settling_time
    assert done.thrust <= machine.drive.rated_thrust
    assert done.lag < machine.specification.tolerance
    assert math.isinf(step(machine, controller, stroke).settling_time)
    assert move.duration + done.settling_time > 2 * math.sqrt(machine.plant.mass * stroke / machine.drive.rated_thrust)


def test_a_move_is_watched_for_as_long_as_a_slow_loop_takes(machine: Machine, controller: Controller) -> None:
    """Not only for eight settling times, which a short motion may take with much less than the loop's own time."""
    brief = replace(machine, specification=replace(machine.specification, settling_time=1.5e-3, tolerance=1e-7))
    move, bare = plan(brief, controller, 1e-3), controller.without_compensation()
    done = run(brief, bare, move)
    assert 8 * 1.5e-3 < done.settling_time < done.watched <= 64 * 1.5e-3
    still = replace(brief, specification=replace(brief.specification, tolerance=1e-12))
    assert math.isinf((never := run(still, bare, move)).settling_time)
    assert never.watched == pytest.approx(64 * 1.5e-3), "and what does not settle says for how long"


def test_an_integral_that_does_not_wind_up_brings_the_step_to_rest(machine: Machine, controller: Controller) -> None:
    guarded = with_anti_windup(machine)
    law = guarded.control.law
    assert law is not None
    found = step(guarded, replace(controller, law=law.of_error()), 1e-3)
    assert found.settling_time < 0.2
    assert found.thrust <= machine.drive.rated_thrust


def test_the_profile_leaves_the_linear_plant_at_rest(machine: Machine, controller: Controller) -> None:
    """By the closed form of the plant's motion under the held thrust, not by the polynomials that made it."""
    ts, plant = machine.sample_time, machine.plant
    move = plan(machine, controller, 1e-3)
    thrust = references(controller.without_compensation(), move.target(ts, len(controller.n_ff))).feedforward
    assert thrust[-1] == pytest.approx(0.0, abs=1e-6)
    begin = round(move.duration / ts) + len(controller.n_ff) + delay_split(plant.dead_time, ts)[0]
    left = linear_response(plant, thrust, ts, (begin + np.arange(200) / 4) * ts)
    assert np.max(np.abs(left - move.stroke)) < 1e-9 * move.stroke


def test_a_slow_drive_limits_the_speed(machine: Machine, controller: Controller) -> None:
    slow = replace(machine, drive=replace(machine.drive, rated_speed=0.05))
    move = plan(slow, controller, 20e-3)
    assert (move.limit, plan(machine, controller, 20e-3).limit) == ("speed", "thrust")
    assert 0.049 < move.speed <= 0.05


def test_the_largest_step_takes_what_friction_leaves(machine: Machine, controller: Controller) -> None:
    target = np.full(100, largest_step(machine, controller))
    peak = np.max(np.abs(references(controller.without_compensation(), target).feedforward))
    assert peak == pytest.approx(usable_thrust(machine))


def test_a_move_of_a_second_is_planned_at_twenty_kilohertz(machine: Machine) -> None:
    """200 mm at 0.3 m/s took "more than 20000 samples"."""
    fine = replace(machine, control=replace(machine.control, sample_time=50e-6))
    slow = replace(fine, drive=replace(fine.drive, rated_speed=0.3))
    move = plan(slow, default_controller(slow), 0.2)
    assert move.limit == "speed"
    assert move.duration == pytest.approx(1.25, rel=1e-3)


def test_a_move_of_hours_is_refused(machine: Machine, controller: Controller) -> None:
    with pytest.raises(DesignError, match="more than 200000 samples"):
        plan(machine, controller, 1e3)


def test_the_file_holds_what_the_effects_ask_for_on_each_long_move(machine: Machine) -> None:
    """A drag and a spring ask for c v + k x along x_T*; a design without effects needs no plan."""
    drag, spring = 40.0, 300.0
    other = replace(machine, effects=(ViscousFriction(drag), CableSpring(spring)))
    designed = with_effects(default_controller(other), other)
    move = plan(other, designed, 5e-3)
    (told,) = moves_to_json(other, designed, [move])["moves"]
    thrust, target = np.array(told["plan"]["thrust_N"]), np.array(told["plan"]["target_m"])
    assert target[0] > 0
    assert target.max() == pytest.approx(move.stroke)
    assert target[-1] == pytest.approx(0, abs=1e-12)
    position = references(designed.without_compensation(), target).position
    speed = np.gradient(position, other.sample_time)
    asked = drag * speed + spring * position
    ahead = range(5)  # samples: the dead time, and half of one
    errors = [np.max(np.abs(thrust[: thrust.size - early] - asked[early:])) for early in ahead]
    assert min(errors) < 0.05 * np.max(np.abs(asked))
    (bare,) = moves_to_json(machine, default_controller(machine), [move])["moves"]
    assert "plan" not in bare
