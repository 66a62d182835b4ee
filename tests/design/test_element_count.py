"""The number of the compensator's elements where a machine file leaves it open: the fewest that meet, by the judge."""

from __future__ import annotations

from dataclasses import replace

import pytest

from design.controller import assemble, assemble_bare, bare_controller, default_controller, design_deadbeat
from design.element_count import SPARE, Choice, Trial, _trial, choose, largest_count
from design.friction_compensation import simplify
from design.validation import Validation, agreement, validate
from models.friction import elements
from models.machine import Machine, load
from tests.design.rolling_axis import rolling_axis

AXIS = rolling_axis()


@pytest.fixture(scope="module")
def choice() -> Choice:
    return choose(AXIS, bare_controller(AXIS), further=3)


def judged(machine: Machine, count: int) -> Validation:
    """The outcome with a stated number, assembled as every study does."""
    stated = replace(machine, control=replace(machine.control, compensator_elements=count))
    return validate(stated, default_controller(stated))


def test_the_chosen_number_is_the_fewest_that_meets_by_brute_force(choice: Choice) -> None:
    in_time = (1 - SPARE) * AXIS.specification.settling_time
    settles = [judged(AXIS, count).slowest.settling_time for count in range(1, choice.count + 1)]
    assert settles[0] > in_time
    assert 1 + next(i for i, time in enumerate(settles) if time <= in_time) == choice.count > 1
    assert [one.settling_time for one in choice.trials[: choice.count]] == settles
    assert [one.spare for one in choice.trials[: choice.count]] == [False] * (choice.count - 1) + [True]
    assert choice.meets
    assert choice.spare


def test_without_time_to_spare_the_quickest_that_meets_is_taken() -> None:
    """A specification of which the best number takes all but two per cent."""
    machine = rolling_axis(count=6)
    best = min(judged(machine, count).slowest.settling_time for count in range(1, 7))
    tight = replace(machine, specification=replace(machine.specification, settling_time=1.02 * best))
    tight = replace(tight, control=replace(tight.control, compensator_elements="auto"))
    found = choose(tight, bare_controller(tight))
    assert found.meets
    assert not found.spare
    assert len(found.trials) == found.most == 6
    assert found.trials[found.count - 1].settling_time == pytest.approx(best)


def test_the_curve_goes_on_beyond_the_chosen_number_and_ends_at_the_machine_s_own(choice: Choice) -> None:
    count = choice.count
    assert [one.count for one in choice.trials] == [*range(1, count + 4), 80]
    assert choice.trials[-1].meets
    assert choice.trials[-1].dispersion < min(one.dispersion for one in choice.trials[:count])


def test_who_assembles_a_controller_gets_the_chosen_number(choice: Choice) -> None:
    deadbeat = design_deadbeat(AXIS)
    law = assemble(AXIS, deadbeat)
    assert law.friction_compensation == simplify(AXIS.friction, choice.count)
    assert law.without_compensation() == assemble_bare(AXIS, deadbeat)
    stated = rolling_axis(choice.count)
    assert law == assemble(stated, design_deadbeat(stated))


def test_where_no_number_meets_all_are_tried_and_the_one_that_settles_first_is_taken() -> None:
    machine = rolling_axis(count=6, tolerance=4e-9, in_time=8e-3)
    found = choose(machine, bare_controller(machine), further=3)
    assert not found.meets
    assert [one.count for one in found.trials] == [1, 2, 3, 4, 5, 6]
    best = min(found.trials, key=lambda one: (one.settling_time, one.dispersion))
    assert found.count == best.count
    assert best.settling_time == judged(machine, best.count).slowest.settling_time > machine.specification.settling_time


def test_a_thrust_beyond_the_rating_does_not_meet(choice: Choice) -> None:
    peak = choice.trials[choice.count - 1].peak_thrust
    weak = replace(AXIS, drive=replace(AXIS.drive, rated_thrust=0.97 * peak))
    tried: list[int] = []

    def stop(count: int, most: int) -> None:
        assert most == 80
        tried.append(count)
        if count > choice.count:
            raise InterruptedError

    with pytest.raises(InterruptedError):
        choose(weak, bare_controller(AXIS), tell=stop)
    assert tried == [*range(1, choice.count + 2)]


def test_no_more_are_tried_than_the_machine_has_elements_with_a_force() -> None:
    machine = load()
    assert largest_count(machine) == 10
    assert largest_count(replace(machine, friction=elements([0.0, 1e5, 2e5], [1e-6, 2e-6, 3e-6]))) == 2
    assert largest_count(rolling_axis(count=150)) == 100


def test_a_stated_number_is_not_judged(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("a search where the number is stated")

    monkeypatch.setattr("design.controller.choose", refuse)
    law = default_controller(load())
    assert law.friction_compensation is not None
    assert len(law.friction_compensation.limit) == 5


def test_of_numbers_that_miss_the_one_that_settles_first_goes_first_periodic_or_not() -> None:
    """Three elements with 87.6 ms stood before five with 23.6 ms, whose last periods differed by a little more."""
    slow = Trial(3, 87.6e-3, 20.8e-6, 1.0, periodic=True, meets=False, spare=False)
    quick = Trial(5, 23.6e-3, 5.6e-6, 1.0, periodic=False, meets=False, spare=False)
    assert min(slow, quick, key=lambda one: one.rank) is quick
    alike = replace(quick, count=4, periodic=True)
    assert min(quick, alike, key=lambda one: one.rank) is alike
    assert min(quick, replace(slow, count=9, meets=True), key=lambda one: one.rank).count == 9


@pytest.mark.parametrize(("share", "meets"), [(0.04, True), (0.06, False)])
def test_periods_that_differ_by_far_less_than_the_tolerance_are_no_miss(
    share: float, meets: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A heavy axis of 90 contacts differed by more than a count of 0.1 um, within +-5 um, and "missed" for that."""
    found = replace(judged(AXIS, 80), repeat_error=share * AXIS.specification.tolerance)
    assert found.repeat_error > agreement(AXIS)
    monkeypatch.setattr("design.element_count.validate", lambda *_args, **_given: found)
    assert _trial(AXIS, bare_controller(AXIS), 80, None, 0).meets == meets
