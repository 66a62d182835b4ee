"""What is said of the effects that a machine file states, where the records moved their values."""

from __future__ import annotations

from dataclasses import replace

import pytest

from models.effects.friction_laws import ViscousFriction
from models.effects.motor import Cogging, CurrentLoopLag
from models.effects.structure import CableSpring, Gravity
from models.machine import Provenance, load
from studies.gap_diagnosis.compute import _with_its_name
from studies.gap_diagnosis.stated_effects import first, stated_effects, told

GIVEN = replace(load(), effects=(CableSpring(16580.0), ViscousFriction(5.42)))


def test_a_value_that_moved_surely_and_clearly_is_told_with_what_it_was() -> None:
    known = {"effects.viscous_friction.coefficient": Provenance("identified", "", std=0.4)}
    better = replace(GIVEN, effects=(CableSpring(16600.0), ViscousFriction(13.4)), sources={**GIVEN.sources, **known})
    rows = stated_effects(GIVEN, better)  # the spring by 0.1 %
    assert [(row["effect"], row["before"], row["now"], row["std"]) for row in rows] == [
        ("viscous_friction", 5.42, 13.4, 0.4)
    ]
    assert told(rows) == [
        "Of the effects that the machine file states, these have other values: viscous friction (coefficient "
        "13.4 N s/m in place of 5.42 N s/m)."
    ]
    assert first({"stated_effects": rows}, ["payload_mass"]) == ["viscous_friction", "payload_mass"]
    assert first({}, ["payload_mass"]) == ["payload_mass"]


def test_a_reason_names_the_file_and_not_its_number() -> None:
    shown = [{"name": "a.csv"}, {"name": "b.csv"}]
    assert _with_its_name("record 2: has one of 4 samples", shown) == "b.csv: has one of 4 samples"
    assert _with_its_name("a record of 2 s", shown) == "a record of 2 s"


def test_nothing_is_said_of_what_is_not_sure_or_as_it_was() -> None:
    unsure = {"effects.viscous_friction.coefficient": Provenance("identified", "", std=4.0)}
    better = replace(GIVEN, effects=(CableSpring(16580.0), ViscousFriction(13.4)), sources={**GIVEN.sources, **unsure})
    assert stated_effects(GIVEN, better) == []
    assert told(stated_effects(GIVEN, GIVEN)) == []
    assert stated_effects(replace(GIVEN, effects=()), better) == []


def test_a_lag_is_told_where_it_changes_the_input_delay() -> None:
    """Records show the sum of lag and dead time; the fit of one alone is as sure as the model is complete."""
    late = replace(GIVEN, plant=replace(GIVEN.plant, dead_time=387e-6), effects=(CurrentLoopLag(150e-6),))
    shared = replace(late, plant=replace(late.plant, dead_time=400e-6), effects=(CurrentLoopLag(137e-6),))
    assert stated_effects(late, shared) == []
    (row,) = stated_effects(late, replace(late, effects=(CurrentLoopLag(250e-6),)))
    assert (row["effect"], row["now"]) == ("current_loop_lag", 250e-6)


def test_a_phase_is_told_by_the_angle_that_it_moved() -> None:
    """Of a gravity at a phase of 0 every re-fit had told 6.283."""
    given = replace(load(), effects=(Gravity(12.0, 0.0),))
    for now, told_now in ((6.2823, []), (6.2, [-0.0831853])):
        rows = stated_effects(given, replace(given, effects=(Gravity(12.0, now),)))
        assert [row["now"] for row in rows] == pytest.approx(told_now)


def test_of_an_effect_that_is_stated_twice_each_is_told() -> None:
    """The file of a user's rotary axis had two harmonics of its cogging; one of three times the size had no name."""
    given = replace(load(), effects=(Cogging(0.12, 0.143, 0.7), Cogging(0.03, 0.0714, 1.1)))
    better = replace(load(), effects=(Cogging(0.36, 0.143, 0.7), Cogging(0.03, 0.0714, 1.1)))
    (row,) = rows = stated_effects(given, better)
    assert (row["effect"], row["before"], row["now"]) == ("cogging", 0.12, 0.36)
    assert "cogging (amplitude of number 1 0.36 N in place of 0.12 N)" in told(rows)[0]
    assert stated_effects(given, replace(load(), effects=better.effects[:1])) == []


def test_the_deviation_of_a_stated_effect_is_its_own_where_another_of_its_name_was_found() -> None:
    given = replace(load(), effects=(Cogging(0.5, 0.143, 0.7),))
    known = {"effects.cogging.1.amplitude": Provenance("identified", "", std=0.1)}
    found = (Cogging(0.52, 0.143, 0.7), Cogging(0.03, 0.0714, 1.1))
    assert stated_effects(given, replace(load(), effects=found, sources={**given.sources, **known})) == []
