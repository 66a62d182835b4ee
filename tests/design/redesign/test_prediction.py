"""What a design is expected to achieve: the interval's coverage, and that the axis itself is within it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.signal
from numpy.typing import NDArray

from design.redesign.designs import designed
from design.redesign.outcome import judged_target, outcome
from design.redesign.prediction import interval_of, predicted, resampled
from design.redesign.stated import machines_as_stated
from models.controller import references
from models.machine import Provenance
from models.simulation.simulator import simulate
from tests.design.redesign.axes import KNOWN, TRUE


def test_one_more_value_like_the_others_is_in_the_interval_as_often_as_stated() -> None:
    """Exactly 36 in 40 for 39 values at 90 %: distribution-free, so normal draws do."""
    rng, inside = np.random.default_rng(0), 0
    for _ in range(4000):
        values = rng.standard_normal(40)
        inside += interval_of(values[:39], 0.9).holds(values[39])
    assert inside / 4000 == pytest.approx(0.9, abs=4 * np.sqrt(0.09 / 4000))


def test_motions_that_never_settle_are_counted() -> None:
    """All of them where the loop runs away, and none where it settles."""
    design = designed(KNOWN, "old")
    pid = KNOWN.control.pid
    away = replace(design, controller=design.controller.with_feedback(replace(pid, kp=-pid.kp)))
    assert predicted(design, [KNOWN] * 3, seed=1).never == 0
    assert predicted(away, [KNOWN] * 3, seed=1).never == 2 * KNOWN.specification.motions


def test_few_values_give_their_ends() -> None:
    found = interval_of(np.array([3.0, 1.0, 2.0]), 0.9)
    assert (found.low, found.median, found.high) == (1.0, 2.0, 3.0)


def test_runs_on_machines_like_the_axis_tell_what_the_axis_does() -> None:
    design = designed(KNOWN, "old")
    found = predicted(design, [TRUE] * 20, seed=4)
    measured = outcome(simulate(TRUE, design.controller, judged_target(TRUE), seed=77).record, TRUE)
    assert measured is not None
    assert found.interval("settling").holds(measured.settling, slack=KNOWN.sample_time)
    assert found.interval("dispersion").holds(measured.dispersion, slack=0.05 * measured.dispersion)
    assert found.interval("settling").low > predicted(design, [KNOWN] * 20, seed=4).interval("settling").median


def test_draws_have_the_stated_deviations() -> None:
    """Of 400 draws the deviation is known to 3.5 %; a value without a stated one follows the file's tolerance."""
    said = Provenance("identified", "a record", std=2e-5)
    machine = KNOWN.with_value("plant.dead_time", KNOWN.plant.dead_time, said)
    level = tuple(0.01 * k for k in machine.friction.stiffness)
    machine = machine.with_value(
        "friction.stiffness", machine.friction.stiffness, Provenance("identified", "a record", std=level)
    )
    drawn = machines_as_stated(machine, 400, seed=2)
    dead = np.array([one.plant.dead_time for one in drawn])
    stiff = np.array([one.friction.stiffness for one in drawn])
    mass = np.array([one.plant.mass for one in drawn])
    assert np.std(dead) == pytest.approx(2e-5, rel=0.15)
    assert np.mean(dead) == pytest.approx(KNOWN.plant.dead_time, abs=4e-6)
    np.testing.assert_allclose(np.std(stiff, axis=0) / np.mean(stiff, axis=0), 0.01, rtol=0.15)
    assert np.std(mass) / np.mean(mass) == pytest.approx(machine.tolerance.mass, rel=0.15)


def test_a_thrust_constant_that_is_known_by_its_tolerance_is_drawn_with_all_that_it_moves() -> None:
    """Where the mass is sure, response and friction in the reference's newtons scatter by it, together."""
    machine = replace(KNOWN, tolerance=replace(KNOWN.tolerance, thrust_constant=0.05, mass=1e-6, friction_level=1e-6))
    drawn = machines_as_stated(machine, 400, seed=2)
    response = np.log([1 / one.plant.mass for one in drawn])
    assert np.std(response) == pytest.approx(0.05, rel=0.15)
    constant = np.log([one.plant.thrust_constant for one in drawn])
    np.testing.assert_allclose(response - np.mean(response), constant - np.mean(constant), atol=1e-4)
    stiff = np.log([one.friction.stiffness[0] for one in drawn])
    assert np.corrcoef(constant, stiff)[0, 1] < -0.2  # beside the tolerance of each element's own


def wind(size: float, seconds: float, seed: int) -> NDArray[np.float64]:
    """A force of `size` [N] rms that forgets itself within 50 ms."""
    keep = np.exp(-KNOWN.sample_time / 0.05)
    white = np.random.default_rng(seed).standard_normal(round(seconds / KNOWN.sample_time))
    return np.asarray(size * scipy.signal.lfilter([np.sqrt(1 - keep**2)], [1, -keep], white))


def test_a_force_that_no_model_explains_acts_in_the_prediction_as_on_the_axis() -> None:
    """The axis has a wind that the records of another day showed; without it the interval is far too good."""
    design, target = designed(KNOWN, "old"), judged_target(KNOWN)
    known = references(design.controller, target)
    found = predicted(design, [KNOWN] * 20, 4, [wind(2.0, 5.0, 1), wind(2.0, 8.0, 2)])
    still = predicted(design, [KNOWN] * 20, 4)
    outside, inside = 0, 0
    for day in range(6):
        push = wind(2.0, target.size * KNOWN.sample_time, 50 + day)
        given = replace(known, feedforward=known.feedforward + push)
        measured = outcome(simulate(KNOWN, design.controller, target, given=given, seed=80 + day).record, KNOWN)
        assert measured is not None
        inside += found.interval("dispersion").holds(measured.dispersion)
        outside += not still.interval("dispersion").holds(measured.dispersion)
    assert outside == 6
    assert inside >= 5
    assert found.saturated == still.saturated == 0


def test_a_force_goes_on_where_its_record_ends() -> None:
    force = wind(1.0, 1.0, 3) + 5.0
    found = resampled([force], 3 * force.size, seed=2)
    assert np.max(np.abs(np.diff(found))) <= np.max(np.abs(np.diff(force))) + 1e-12
    assert abs(np.mean(found)) < 0.2
    assert np.array_equal(resampled([], 7, seed=2), np.zeros(7))


def test_few_values_have_the_level_that_they_can_have() -> None:
    levels = [interval_of(np.arange(float(count)), 0.9).level for count in (1, 10, 19, 40)]
    assert levels == pytest.approx([0.0, 9 / 11, 0.9, 37 / 41])
