"""Experiments within a machine's limits, and what they would tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.experiments.confusability import distances, products
from diagnosis.experiments.information import information_of, told_by, usual_sizes
from diagnosis.experiments.propose import virtual
from diagnosis.experiments.schedules import Schedule, together
from diagnosis.experiments.within_limits import BUILDERS, Bounds, experiments
from diagnosis.records.units import units
from models.controller import References
from models.machine import load

AMPLE = Bounds(0.05, 0.3, 100.0)
TIGHT = Bounds(2e-3, 0.01, 4.0)
EFFECTS = ("viscous_friction", "cogging", "thrust_ripple")


def largest(planned: Schedule, sample_time: float) -> tuple[float, float, float]:
    given = planned.given
    way = np.abs(np.diff(np.concatenate([[0.0], given.position]))).max() / sample_time
    return (
        float(max(np.abs(given.position).max(), np.abs(planned.target).max())),
        float(way),
        float(np.abs(given.feedforward + given.compensation).max()),
    )


@pytest.mark.parametrize("bounds", [AMPLE, TIGHT, replace(AMPLE, distance=1e-4), replace(AMPLE, force=0.5)])
def test_no_experiment_goes_beyond_the_bounds(bounds: Bounds) -> None:
    machine = load()
    for one in experiments(machine, bounds):
        distance, speed, force = largest(one.schedule, machine.sample_time)
        assert distance <= bounds.distance, one.words
        assert speed <= bounds.speed * (1 + 1e-9), one.words
        assert force <= bounds.force, one.words


def test_the_whole_menu_fits_ample_bounds_and_is_short() -> None:
    machine = load()
    found = experiments(machine, AMPLE)
    assert len(found) == len(BUILDERS)
    assert found[0].schedule.name == "own test"
    assert max(one.schedule.target.size for one in found) * machine.sample_time < 10.0


def test_a_smaller_travel_makes_shorter_strokes_instead_of_none() -> None:
    sizes = [
        max(largest(one.schedule, load().sample_time)[0] for one in experiments(load(), b)) for b in (AMPLE, TIGHT)
    ]
    assert sizes[1] == pytest.approx(sizes[0] * TIGHT.distance / AMPLE.distance, rel=0.02)


def test_bounds_keep_what_is_within_them_only() -> None:
    ramp = np.linspace(0.0, 1e-3, 11)
    planned = Schedule("ramp", ramp, References(ramp, np.zeros(11), np.zeros(11)))
    assert Bounds(1e-3, 0.2, 0.0).keep(planned, 5e-4)
    for less in (Bounds(0.9e-3, 0.2, 0.0), Bounds(1e-3, 0.19, 0.0)):
        assert not less.keep(planned, 5e-4)
    pushed = replace(planned, given=References(ramp, np.full(11, 1.0), np.zeros(11)))
    assert not Bounds(1e-3, 0.2, 0.9).keep(pushed, 5e-4)


def test_what_two_experiments_tell_is_no_more_than_they_tell_in_one_record() -> None:
    """Their sum bounds it from below, as the minima are over parameters that both share; and more tells more."""
    machine = load()
    menu = experiments(machine, AMPLE)
    chosen = [one for one in menu if one.schedule.name in {"own test", "equal strokes"}]
    each = information_of(machine, chosen, EFFECTS)
    joined = together("both", [one.schedule for one in chosen])
    longest = max(one.schedule.given.position.max() for one in chosen)
    priors = replace(machine.priors, units=replace(units(machine), travel=longest))
    fitted, record = virtual(replace(machine, priors=priors), joined)
    whole = distances(products(fitted, [record], EFFECTS, usual_only=True), EFFECTS) ** 2
    alone = np.sum([one.distance for one in each], axis=0)
    assert np.all(np.diag(alone) < 1.1 * np.diag(whole))
    assert all(np.linalg.eigvalsh(one.parameters).min() > -1e-6 for one in each)
    seconds = [one.seconds for one in each]
    assert seconds == [one.schedule.target.size * machine.sample_time for one in chosen]


def test_a_record_that_there_was_tells_as_much_as_the_same_experiment() -> None:
    machine = load()
    possible = experiments(machine, AMPLE)
    (own,) = (one for one in possible if one.schedule.name == "own test")
    (planned,) = information_of(machine, [own], EFFECTS)
    fitted, record = virtual(machine, own.schedule)
    np.testing.assert_allclose(
        told_by(fitted, [record], EFFECTS, usual_sizes(machine, [own])), planned.distance, rtol=1e-9
    )
    wider = told_by(fitted, [record], EFFECTS, usual_sizes(machine, possible))  # an effect's size goes with the travel
    assert not np.allclose(wider, planned.distance)


def test_an_experiment_that_the_machine_does_not_follow_is_left_out() -> None:
    machine = load()
    slack = replace(machine, control=replace(machine.control, pid=replace(machine.control.pid, kp=1.0, ki=0.0, kd=1.0)))
    menu = experiments(machine, AMPLE)[:1]
    assert len(information_of(machine, menu, EFFECTS)) == 1
    assert information_of(slack, menu, EFFECTS) == ()
