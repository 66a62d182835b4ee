"""Draws of the machines that records allow have the fit's covariance, and stay where a file may have them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import truncnorm

from design.controller import default_controller
from design.redesign.stated import machines_as_stated
from design.validation import sequence
from diagnosis.criteria import Criteria
from diagnosis.handover.files import FILE, machine_of
from diagnosis.handover.posterior import drawn, spreads, unexplained_force
from diagnosis.model.fit import Fit, bounds_of, coordinates
from diagnosis.model.kalman import STARTING
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.refit import refit
from diagnosis.which.table import covariance_of, deviations_of
from models.effects.base import parameters as effect_parameters
from models.effects.friction_laws import ViscousFriction
from models.effects.motor import CurrentLoopLag
from models.friction import branch, elements
from models.machine import Machine, load
from models.machine import parameters as values_of
from models.machine_file import loaded
from models.records.record import Record
from models.simulation.simulator import simulate
from models.variation import known as known_of
from tests.diagnosis.where.cases import case, still, windy

Array = NDArray[np.float64]

MACHINE = replace(load(), specification=replace(load().specification, interval=0.15))
DRAG = ViscousFriction(60.0)
COUNT = 1500


@pytest.fixture(scope="module")
def fitted() -> Fit:
    """The nominal values and the drag fitted to a record of them."""
    noisy = replace(MACHINE, scale=MACHINE.scale.noisy(), effects=(DRAG,))
    record = simulate(noisy, default_controller(MACHINE), sequence(MACHINE, periods=1, lead=100), seed=2).record
    nominal = replace(MACHINE, scale=MACHINE.scale.noisy())
    return refit(parameters(nominal, 1), [record], (DRAG,))


@pytest.fixture(scope="module")
def nothing() -> Fit:
    """A current loop's lag fitted to a record of a drive that has none."""
    nominal = replace(MACHINE, scale=MACHINE.scale.noisy())
    record = simulate(nominal, default_controller(MACHINE), sequence(MACHINE, periods=1, lead=100), seed=2).record
    return refit(parameters(nominal, 1), [record], (CurrentLoopLag(2e-5),))


def test_the_deviations_of_values_are_those_of_drawn_machines_and_cover_the_truth(fitted: Fit) -> None:
    deviations = {name: np.array(one.deviations) for name, one in spreads(fitted).items()}
    machines = [one.machine for one in drawn(fitted, None, COUNT, seed=4)]
    for name, number in (
        ("plant.dead_time", [one.plant.dead_time for one in machines]),
        ("plant.modes.1.gain", [one.plant.rigid_gain for one in machines]),
        ("drive.offset", [one.drive.offset for one in machines]),
    ):
        # Logarithms are drawn, whose spread is as large as the values' to the first order.
        np.testing.assert_allclose(np.std(np.array(number), axis=0), deviations[name], rtol=0.12)
    known = {one.name: np.array(one.number) for one in values_of(replace(MACHINE, effects=()))}
    told = {one.name: np.array(one.number) for one in values_of(replace(fitted.candidate.machine, effects=()))}
    for name in ("plant.dead_time", "plant.modes.1.gain", "plant.modes.2.frequency"):
        assert abs(told[name] - known[name]) < 4 * deviations[name], name
    assert deviations["plant.dead_time"] < 0.5 * MACHINE.tolerances.dead_time


def _of_halves(tolerance: float) -> Fit:
    """Of each element two halves of the same limit, whose stiffnesses are known to a tolerance [1]: the records leave
    either nearly as open, and know friction to some per cent."""
    half = elements(np.repeat(MACHINE.friction.stiffness, 2) / 2, np.repeat(MACHINE.friction.limit, 2))
    known = replace(MACHINE.tolerance, stiffness=tolerance)
    nominal = replace(MACHINE, friction=half, tolerance=known, scale=MACHINE.scale.noisy())
    record = simulate(nominal, default_controller(MACHINE), sequence(MACHINE, periods=1, lead=100), seed=2).record
    return refit(parameters(nominal, 1), [record])


def test_elements_that_stand_in_for_each_other_are_drawn_with_the_sum_that_is_sure() -> None:
    """Draws of their logarithms had more friction in the mean."""
    found = _of_halves(tolerance=0.7)
    limit = found.candidate.layout.machine.friction.limit
    open_by = np.sqrt(np.diag(covariance_of(found)))[np.array(found.candidate.layout.names) == "presliding_stiffness"]
    assert np.median(open_by) > 0.4
    distance = np.geomspace(0.5 * min(limit), 2 * max(limit), 20)
    curves = np.array([branch(one.machine.friction, distance) for one in drawn(found, None, 400, seed=7)])
    np.testing.assert_allclose(np.mean(curves, axis=0), branch(found.candidate.machine.friction, distance), rtol=0.02)


def _lag(candidate: Candidate) -> float:
    (effect,) = candidate.effects
    assert isinstance(effect, CurrentLoopLag)
    return effect.time


def test_a_lag_near_none_is_drawn_with_the_dead_time_that_stands_in_for_it(nothing: Fit) -> None:
    """The records tell the sum of both, of each only that it is not below none. Its logarithm is open by 1.5, and of a
    voice coil's by 6.7: as draws of that, one lag in eight was at the end of its range, a hundred times as long."""
    candidate, covariance = nothing.candidate, covariance_of(nothing)
    lag, delay = _lag(candidate), candidate.machine.plant.dead_time
    pair = np.append(candidate.layout.of("dead_time"), candidate.layout.count)
    own = covariance[np.ix_(pair, pair)] * np.outer((1.0, lag), (1.0, lag))
    stated, sum_known = float(np.sqrt(own[1, 1])), float(np.sqrt(own.sum()))
    assert stated > lag > 4 * sum_known
    assert deviations_of(nothing)[0]["time"] == pytest.approx(stated)
    found = drawn(nothing, None, COUNT, seed=6)
    lags = np.array([_lag(one) for one in found])
    sums = lags + np.array([one.machine.plant.dead_time for one in found])
    low, high = bounds_of(effect_parameters(CurrentLoopLag, candidate.nominal.priors)[0])
    wanted = truncnorm((low - lag) / stated, np.inf, lag, stated)
    np.testing.assert_allclose(np.std(sums), sum_known, rtol=4 / np.sqrt(2 * COUNT))
    moved = own[1].sum() / stated**2 * (wanted.mean() - lag)  # of the sum with the lag, which is longer in the mean
    np.testing.assert_allclose(np.mean(sums), lag + delay + moved, atol=4 * sum_known / np.sqrt(COUNT))
    np.testing.assert_allclose(np.mean(lags), wanted.mean(), atol=4 * stated / np.sqrt(COUNT))
    np.testing.assert_allclose(np.std(lags), wanted.std(), rtol=4 / np.sqrt(COUNT))
    assert low <= np.min(lags)
    assert np.max(lags) < lag + 5 * stated < high


def test_draws_have_the_covariance_of_the_fit(fitted: Fit) -> None:
    """The correlations of a value with another are checked with their own: of 1500 draws, to 0.1 at four deviations."""
    found = drawn(fitted, None, COUNT, seed=3)
    names = np.array(fitted.candidate.layout.names)
    inner = np.isin(names, ("payload_mass", "dead_time", "friction_level", "amplifier_offset"))
    values = np.array([np.append(one.theta[inner], coordinates(one.effects[0])) for one in found])
    covariance = covariance_of(fitted)
    kept = np.append(np.flatnonzero(inner), names.size)
    wanted = covariance[np.ix_(kept, kept)]
    deviation = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose(np.std(values, axis=0), deviation, rtol=4 / np.sqrt(2 * COUNT))
    middle = np.append(fitted.candidate.theta[inner], coordinates(fitted.candidate.effects[0]))
    np.testing.assert_allclose((np.mean(values, axis=0) - middle) / deviation, 0.0, atol=4 / np.sqrt(COUNT))
    np.testing.assert_allclose(np.corrcoef(values.T), wanted / np.outer(deviation, deviation), atol=4 / np.sqrt(COUNT))
    layout, starts = fitted.candidate.layout, names == "initial_friction_state"
    for one in found:
        assert np.all((layout.low <= one.theta) & (one.theta <= layout.high))
        reach = np.array(layout.machine.friction.limit) * np.exp(one.theta[names == "presliding_limit"])
        assert np.all(np.abs(one.theta[starts]) <= reach * (1 + 1e-12))  # an element begins within its own limit


def test_machines_of_the_file_have_friction_as_well_known_as_the_records_show() -> None:
    """The friction's branch, over which a design runs, has the deviation of the fit, by its slopes; drawn one by one,
    the same elements make it many times as unsure."""
    count, fitted = 600, _of_halves(tolerance=0.3)
    file = loaded(machine_of(fitted.candidate.layout.machine, fitted.candidate, stated=spreads(fitted)), FILE)
    kinks = 2 * np.unique(file.friction.limit)  # of the branch: its deviation there is one-sided
    distance = np.array([kinks[0] / 2, *np.sqrt(kinks[1:] * kinks[:-1]), 2 * kinks[-1]])
    wanted = _deviation_of_branch(fitted, distance)

    def spread(machine: Machine) -> Array:
        drawn = machines_as_stated(machine, count, seed=5)
        return np.asarray(np.std([branch(one.friction, distance) for one in drawn], axis=0))

    np.testing.assert_allclose(spread(file), wanted, rtol=4 / np.sqrt(2 * count))
    level = next(one for one in known_of(file) if one.name == "friction.level")
    assert level.deviations[0] * 2 * file.friction.coulomb_force == pytest.approx(wanted[-1], rel=1e-3)
    alone = replace(file, sources={name: replace(one, shares=()) for name, one in file.sources.items()})
    assert np.min(spread(alone) / wanted) > 3


def _deviation_of_branch(fitted: Fit, distance: Array) -> Array:
    """The deviation [N] of the branch at these distances [m], by its slopes along theta."""
    candidate, count = fitted.candidate, fitted.candidate.layout.count
    step, here = 1e-6, branch(candidate.machine.friction, distance)
    moved = [replace(candidate, theta=candidate.theta + step * row) for row in np.eye(count)]
    slopes = np.array([(branch(one.machine.friction, distance) - here) / step for one in moved])
    return np.asarray(np.sqrt(np.einsum("in,ij,jn->n", slopes, covariance_of(fitted)[:count, :count], slopes)))


def test_the_file_of_a_lag_near_none_tells_the_sum_that_is_sure(nothing: Fit) -> None:
    candidate, covariance = nothing.candidate, covariance_of(nothing)
    deviations = deviations_of(nothing)
    file = loaded(machine_of(candidate.layout.machine, candidate, deviations, stated=spreads(nothing)), FILE)
    pair = np.append(candidate.layout.of("dead_time"), candidate.layout.count)
    own = covariance[np.ix_(pair, pair)] * np.outer((1.0, _lag(candidate)), (1.0, _lag(candidate)))
    machines = machines_as_stated(file, 600, seed=5)
    sums = [one.plant.dead_time + float(one.effects[0].values()[0]) for one in machines]
    assert np.std(sums) == pytest.approx(np.sqrt(own.sum()), rel=4 / np.sqrt(2 * 600))


def test_the_force_that_a_wind_leaves_is_given_on_and_none_where_the_weights_hold() -> None:
    def left(records: Sequence[Record], fit: Fit) -> tuple[NDArray[np.float64], ...]:
        file = SimpleNamespace(judged=SimpleNamespace(candidate=fit.candidate), finished=fit)
        handover = SimpleNamespace(adopted=file, named=lambda _: None)
        baseline = SimpleNamespace(records=records, criteria=Criteria(), nominal=fit)
        found: Any = SimpleNamespace(baseline=baseline, how_far=SimpleNamespace(handover=handover))
        return unexplained_force(found)

    records, fit = windy(0)
    found = left(records, fit)
    assert [one.size for one in found] == [record.position.size - STARTING for record in records]
    wind = [calm.command - blown.command for calm, blown in zip(still(), records, strict=True)]
    for one, true in zip(found, wind, strict=True):
        assert np.corrcoef(one, true[STARTING:])[0, 1] > 0.9
        assert np.std(one) == pytest.approx(np.std(true), rel=0.15)
    assert left(*case("")) == ()
