"""A machine told in other units of mass, length and time is the same machine: it gets the same names and the same gap.

What follows from the records is compared, and not the null, which takes most of the time and is simulated from the same
quantities: of both it is the same here.
"""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from diagnosis.answer import Answer, largest_adequate
from diagnosis.baseline import Baseline
from diagnosis.criteria import Criteria
from diagnosis.experiments.schedules import amplitude_ladder, strokes, together
from diagnosis.model.kalman import predictor
from diagnosis.null import Null
from diagnosis.records.motions import pieces
from diagnosis.records.units import WALK, holds, loop_time, noise, slow_walk, units, white_force, with_units
from diagnosis.refit import refit_within
from diagnosis.verdict import Outcome
from diagnosis.where.force import steady_deviation
from diagnosis.which.detectors.random_force import levels
from diagnosis.which.free_form import members
from diagnosis.which.prune import prune
from diagnosis.which.select import select
from models.effects.base import Effect, parameters
from models.effects.catalogue import every
from models.effects.friction_laws import DirectionalFriction, ViscousFriction
from models.effects.priors import REFERENCE, Priors, Units
from models.effects.structure import AdditionalMode
from models.friction import elements
from models.machine import Machine
from models.quantity import declaration, nearest
from models.records.record import Record
from tests.diagnosis.slow import leg
from tests.diagnosis.tables import recorded, table
from tests.diagnosis.units import Change

MACHINE = table()
PLAN = (together("short", [amplitude_ladder(MACHINE, (5e-6, 20e-6, 100e-6)), strokes(MACHINE, 45e-3, (0.2,))]),)
SMOOTH = replace(MACHINE, scale=replace(MACHINE.scale, resolution=0.0, noise=4e-8))
"""With a scale that does not round: a reading that goes over to the next step by the rounding of other units makes
another simulated floor, by 0.6 % of its energy."""
ALL = Change(force=1 / 40, length=3.0, time=0.5)
MOTOR = Change(force=1e-4, length=1e3)
PIEZO = Change(force=0.05, length=1e-3)
CHANGES = (Change(force=1 / 40), Change(length=3.0), Change(time=0.5), ALL)


def _answer(change: Change, effects: list[Any]) -> tuple[Answer, dict[str, float]]:
    """What the search says of a short record in other units, and what effects gain that are worth a look."""
    return _found(change.machine(SMOOTH), tuple(map(change.record, recorded(SMOOTH, PLAN, effects, seed=3))))


def _found(axis: Machine, records: tuple[Record, ...]) -> tuple[Answer, dict[str, float]]:
    machine = with_units(axis, records)
    chance = Null({}, ((0.9,),), (4.0,))
    found = Baseline(refit_within(machine, records), records, pieces(records, loop_time(machine)), chance)
    stages = select(found)
    gains = {one.name: one.gain for one in stages[0].proposals if one.gain > Criteria().min_gain}
    return largest_adequate(prune(stages, found).stages, found, seed=0), gains


@pytest.mark.parametrize(
    ("effects", "names", "outcome"),
    [([ViscousFriction(60.0)], ("viscous_friction",), Outcome.ATTRIBUTED), ([], (), Outcome.PARAMETERS)],
)
def test_the_same_machine_in_other_units_gets_the_same_answer(
    effects: list[Any], names: tuple[str, ...], outcome: Outcome
) -> None:
    """To what rounding makes of it, in all three units at once; with an effect and with none."""
    (here, gains), (there, other) = _answer(Change(), effects), _answer(ALL, effects)
    assert (here.outcome, here.names) == (there.outcome, there.names) == (outcome, names)
    assert there.closure.closure == pytest.approx(here.closure.closure, abs=1e-5)
    assert there.closure.interval == pytest.approx(here.closure.interval, abs=1e-5)
    assert other == pytest.approx(gains, rel=1e-3)


@pytest.mark.parametrize("effect", [DirectionalFriction(0.06, 2e-6, 0), AdditionalMode(4e-3, 220.0, 0.02)])
def test_a_motor_of_milligrams_gets_the_names_of_a_table(effect: Effect) -> None:
    """The drag beside a direction had the size of the table's, which hid the direction, and a mode of so light an axis
    was larger than one of the table can be."""
    found, _ = _answer(MOTOR, [effect])
    assert (found.outcome, found.names) == (Outcome.ATTRIBUTED, (effect.name,))


def test_a_thrust_asked_for_in_amperes_changes_no_modal_gain() -> None:
    """Of a motor of 62 N/A whose file says so. A mode that the search added moved by the amperes and not the newtons:
    its gain was 62 times as large in the file, which simulates it by the newtons."""
    constant, effect = 62.0, AdditionalMode(4e-3, 220.0, 0.02)
    change = Change(force=1 / constant)
    amperes = replace(change.machine(SMOOTH), plant=replace(SMOOTH.plant, thrust_constant=constant))
    here, there = (
        _found(machine, tuple(map(told.record, recorded(SMOOTH, PLAN, [effect], seed=3))))[0]
        for machine, told in ((SMOOTH, Change()), (amperes, change))
    )
    assert (here.outcome, here.names) == (there.outcome, there.names) == (Outcome.ATTRIBUTED, (effect.name,))
    ((mode,), (other,)) = (one.stages[-1].fitted.candidate.added_effects for one in (here, there))
    assert other.values() == pytest.approx(mode.values(), rel=1e-3)
    assert other.strength() == pytest.approx(effect.strength(), rel=0.1)


@pytest.mark.parametrize("name", sorted(every()))
@pytest.mark.parametrize("change", [MOTOR, PIEZO])
def test_a_free_form_is_as_wide_as_the_machine_asks(name: str, change: Change) -> None:
    kind, priors = every()[name], Priors(units=_units_in(change))
    usual, here = Priors(units=_units_in(Change())), kind.typical(Priors(units=_units_in(Change())))
    there = kind.typical(priors)
    assert [_told(one, change) for one in members(here, usual)] == [
        pytest.approx(list(one.values())) for one in members(there, priors)
    ]


@pytest.mark.parametrize("name", sorted(every()))
@pytest.mark.parametrize("change", [MOTOR, PIEZO])
def test_a_machine_file_may_have_every_usual_size(name: str, change: Change) -> None:
    kind, priors = every()[name], Priors(units=_units_in(change))
    for field, item in zip(fields(kind), parameters(kind, priors), strict=True):
        declared = declaration(field)
        assert declared is not None
        for size in (item.low, item.high):
            assert nearest(size, declared) == size or item.role == "phase", item.name


def _units_in(change: Change) -> Units:
    (record,) = recorded(MACHINE, PLAN[:1], seed=3)
    return units(change.machine(MACHINE), [change.record(record)])


def _told(effect: Effect, change: Change) -> list[float]:
    """Its parameters in other units; a loss that is stated at 100 N goes with the square of the forces."""
    items = zip(parameters(type(effect)), effect.values(), strict=True)
    return [number * (change.force**-2 if one.name == "loss" else change.factor(one.unit)) for one, number in items]


def test_an_axis_that_its_friction_does_not_hold_counts_nothing_in_it() -> None:
    """On an air bearing with a cable chain of 0.02 N, lengths and forces are counted in tolerance and thrust;
    with contacts that are as soft but whose force counts, as a seal's, they are not."""
    friction = MACHINE.friction
    chain = replace(
        friction,
        stiffness=tuple(1e-4 * one for one in friction.stiffness),
        limit=tuple(10 * one for one in friction.limit),
    )
    air, seal = (
        replace(MACHINE, friction=replace(chain, limit=tuple(much * one for one in chain.limit))) for much in (1, 1000)
    )
    assert holds(MACHINE)
    assert holds(seal)
    assert not holds(air)
    found = units(air)
    assert (found.contact, found.force) == (MACHINE.specification.tolerance, 0.1 * MACHINE.drive.rated_thrust)
    assert noise(air) == MACHINE.scale.noisy().reading_deviation
    for change in CHANGES:
        assert not holds(change.machine(air))


@pytest.mark.parametrize("change", CHANGES)
def test_what_sizes_are_counted_in_changes_with_the_units(change: Change) -> None:
    (record,) = recorded(MACHINE, PLAN, seed=3)
    other = change.machine(MACHINE)
    before, after = units(MACHINE, [record]), units(other, [change.record(record)])
    told = {"force": "N", "thrust": "N", "mass": "kg", "contact": "m", "travel": "m", "reading": "m"}
    told |= {"loop": "s", "sample": "s"}
    assert vars(after) == pytest.approx({name: change.factor(told[name]) * size for name, size in vars(before).items()})
    assert white_force(other) == pytest.approx(change.force * white_force(MACHINE))
    assert levels(change.force * 0.08, change.force * 16.5) == pytest.approx(
        [change.force * one for one in levels(0.08, 16.5)]
    )


@pytest.mark.parametrize("name", sorted(every()))
def test_every_usual_size_is_counted_in_what_changes_with_the_units(name: str) -> None:
    """But for the saturation, whose loss is stated at 100 N on any machine."""
    (record,) = recorded(MACHINE, PLAN[:1], seed=3)
    here, there = (
        parameters(every()[name], Priors(units=units(change.machine(MACHINE), [change.record(record)])))
        for change in (Change(), ALL)
    )
    for one, other in zip(here, there, strict=True):
        factor = ALL.force**-2 if one.name == "loss" else ALL.factor(one.unit)
        assert (other.low, other.high, other.typical) == pytest.approx(
            (one.low * factor, one.high * factor, one.typical * factor)
        ), one.name
        assert other.points == one.points
        assert other.linear_within == pytest.approx(one.linear_within)


def test_the_reference_table_has_the_sizes_of_the_catalogue() -> None:
    (long,) = recorded(MACHINE, (strokes(MACHINE, 60e-3, (0.2,)),), seed=3)
    known = units(MACHINE, [long])
    assert vars(known) == pytest.approx(vars(REFERENCE))
    for kind in every().values():
        for one, other in zip(parameters(kind), parameters(kind, Priors(units=known)), strict=True):
            assert (other.low, other.high, other.points) == pytest.approx((one.low, one.high, one.points))


def test_no_period_along_the_way_is_longer_than_the_way() -> None:
    """It would draw any curve; and none is left out that the magnets of a long axis have."""
    for travel in (5e-3, 45e-3, 0.5, 2.0):
        known = replace(REFERENCE, travel=max(travel, 1280 * REFERENCE.contact))
        for name in ("cogging", "thrust_ripple", "position_dependent_friction"):
            (item,) = (one for one in parameters(every()[name], Priors(units=known)) if one.role == "period")
            assert item.high <= known.travel * 1.0001
            assert item.low <= 20e-3


def test_no_frequency_is_looked_for_beyond_what_the_samples_show() -> None:
    slow = leg(62.5)
    for item in parameters(every()["additional_mode"], Priors(units=units(slow))):
        if item.name == "frequency":
            assert item.low < item.high <= 0.4 * 62.5


@given(st.floats(-4, 4), st.floats(-3, 3), st.floats(-1.5, 1.5))
def test_the_filter_is_the_same_in_any_units(force: float, length: float, time: float) -> None:
    """Its gains, its deviation and the smoother's band, to rounding."""
    change = Change(10**force, 10**length, 10**time)
    both = (MACHINE, change.machine(MACHINE))
    forces = [(white_force(machine), noise(machine)) for machine in both]
    given = [{"walk": 0.05 * white, "noise": reading, "white_force": white} for white, reading in forces]
    here, there = (predictor(one.plant, one.sample_time, **known) for one, known in zip(both, given, strict=True))
    state = [change.length, change.length / change.time] * len(MACHINE.plant.modes) + [change.force]
    assert there.deviation == pytest.approx(change.length * here.deviation)
    assert there.gain * change.length == pytest.approx(here.gain * state, rel=1e-5)
    assert there.back / np.outer(state, 1 / np.array(state)) == pytest.approx(here.back, rel=1e-4, abs=1e-6)
    bands = [steady_deviation(one.plant, one.sample_time, **known) for one, known in zip(both, given, strict=True)]
    assert bands[1] == pytest.approx(change.force * bands[0], rel=1e-4)


def test_the_unknown_force_walks_as_far_in_a_time_however_fine_the_samples() -> None:
    coarse, fine = (
        replace(MACHINE, control=replace(MACHINE.control, sample_time=MACHINE.sample_time / n)) for n in (4, 64)
    )
    assert slow_walk(coarse) / slow_walk(fine) == pytest.approx(4.0)
    assert slow_walk(MACHINE) == WALK > slow_walk(coarse)


def test_a_machine_without_friction_has_a_white_force_and_lengths() -> None:
    smooth = replace(MACHINE, friction=elements([1.0], [1e-30]))
    assert white_force(smooth) > 0
    assert min(vars(units(smooth)).values()) > 0
