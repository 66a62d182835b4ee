"""e-values on new records: the predictive density against a plain one, and false alarms over many looks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from diagnosis.baseline import Baseline, refit_and_null
from diagnosis.experiments import e_process
from diagnosis.experiments.e_process import SPREAD, TEMPER, EProcess, at_the_priors, log_e_value, predictive
from diagnosis.experiments.look import Found, Look
from diagnosis.experiments.menu import Experiment
from diagnosis.experiments.schedules import strokes
from diagnosis.experiments.within_limits import Bounds, experiments
from diagnosis.model.fit import one_step, weights
from diagnosis.model.kalman import Resonance
from diagnosis.model.parameters import Parameters, bounded, parameters
from diagnosis.model.residual import Candidate, columns
from diagnosis.null import simulated
from diagnosis.records.units import slow_walk, with_units
from diagnosis.verdict import Outcome
from models.effects.base import Effect
from models.effects.catalogue import in_order
from models.effects.friction_laws import ViscousFriction
from models.machine import Machine, load
from models.records.record import Record
from tests.diagnosis.tables import recorded, table

CHANCE = 0.05
AMPLE = Bounds(0.05, 0.3, 100.0)


def test_the_predictive_density_is_that_of_a_conditional_normal() -> None:
    """Against the density of all samples and of the earlier ones, from their covariances."""
    rng = np.random.default_rng(1)
    left, slopes, earlier = rng.standard_normal(9), rng.standard_normal((9, 3)), 5
    whole = multivariate_normal(np.zeros(9), np.eye(9) + slopes @ slopes.T)
    before = multivariate_normal(np.zeros(earlier), np.eye(earlier) + slopes[:earlier] @ slopes[:earlier].T)
    expected = whole.logpdf(left) - before.logpdf(left[:earlier])
    constant = -0.5 * (9 - earlier) * np.log(2 * np.pi)
    assert predictive(left, slopes, earlier) + constant == pytest.approx(expected, abs=1e-12)


def _log_ratio(left: np.ndarray, slopes: np.ndarray, effect: np.ndarray, earlier: int) -> float:
    with_it = predictive(left + effect, np.hstack([slopes, SPREAD * effect[:, None]]), earlier)
    return with_it - predictive(left, slopes, earlier)


def _largest(rng: np.random.Generator, looks: int, variance: float, size: float, there: float) -> float:
    """The largest logarithm of the product over looks in which a machine without the effect, or with it, is named."""
    n, product, most = 12, 0.0, -np.inf
    parameters = rng.standard_normal(2)
    slopes, effect = np.zeros((0, 2)), np.zeros(0)
    left = np.zeros(0)
    for _ in range(looks):
        more, column = rng.standard_normal((n, 2)), size * rng.standard_normal(n)
        slopes, effect = np.vstack([slopes, more]), np.append(effect, column)
        seen = np.sqrt(variance) * rng.standard_normal(n) - more @ parameters - there * column
        left = np.append(left, seen)
        product += log_e_value(_log_ratio(left, slopes, effect, left.size - n))
        most = max(most, product)
    return most


@pytest.mark.parametrize("size", [0.1, 0.5, 2.0])
@pytest.mark.parametrize("variance", [1.0, 1 / TEMPER])
def test_false_alarms_over_all_looks_stay_below_the_chance(size: float, variance: float) -> None:
    """Also where the noise has twice the variance that the model states."""
    rng = np.random.default_rng([round(10 * size), round(10 * variance)])
    alarms = np.mean([_largest(rng, 6, variance, size, there=0.0) > -np.log(CHANCE) for _ in range(600)])
    assert alarms <= CHANCE


def test_an_effect_that_is_there_is_confirmed_even_at_another_size() -> None:
    rng = np.random.default_rng(4)
    found = np.mean([_largest(rng, 3, 1.0, 3.0, there=0.6) > -np.log(CHANCE) for _ in range(100)])
    assert found > 0.95


def test_untempered_ratios_would_raise_false_alarms_where_the_noise_is_larger() -> None:
    """What the power is for: without it the chance is exceeded."""
    rng = np.random.default_rng(5)
    n, alarms = 12, 0
    for _ in range(600):
        column = 2.0 * rng.standard_normal(n)
        ratio = _log_ratio(np.sqrt(3 / TEMPER) * rng.standard_normal(n), np.zeros((n, 1)), column, 0)
        alarms += ratio > -np.log(CHANCE)
    assert alarms / 600 > CHANCE


def test_a_wrong_choice_costs_half_and_names_are_kept_apart() -> None:
    process = EProcess().after(-1e6, {"cogging": -1e6}).after(20.0, {"stribeck": 20.0})
    assert process.any == pytest.approx(-np.log(2) + log_e_value(20.0))
    assert process.of("cogging") == pytest.approx(-np.log(2))
    assert process.of("play") == 0.0
    assert process.is_confirmed("stribeck", 0.02)
    assert not process.is_confirmed("cogging", 0.02)
    assert not process.is_confirmed("stribeck", 1e-6)


@pytest.fixture(scope="module")
def dragged(null_cache: Path) -> tuple[Baseline, Baseline]:
    """A table with a drag that its file lacks: of its first record, and of both."""
    moves = (strokes(table(), 5e-3, (0.1,), passes=2),)
    records = [recorded(table(), moves, [ViscousFriction(40.0)], seed=seed, wrong=0.0)[0] for seed in (1, 2)]
    one, two = (refit_and_null(table(), records[:count], cache=null_cache) for count in (1, 2))
    return one, two


def _look(baseline: Baseline, tried: tuple[str, ...], effects: tuple[Effect, ...], *forces: Resonance) -> Look:
    fitted = baseline.nominal
    fitted = replace(fitted, candidate=replace(fitted.candidate, random_forces=forces))
    return Look(Found(Outcome.NOTHING, (), (), {}), fitted, baseline, tried, effects)


DRAG = ("viscous_friction",), (ViscousFriction(40.0),)
VIBRATION = ("floor_vibration",), (), Resonance(20.0, 0.1, 1.0)


@pytest.mark.parametrize("tried", [DRAG, VIBRATION], ids=["a law of force", "a random force"])
def test_interpolated_samples_are_no_evidence(dragged: tuple[Baseline, Baseline], tried: Any) -> None:
    """Of a log with one of four samples, the ratio counts by a quarter; and without a new record nothing does."""
    before, now = _look(dragged[0], *tried), dragged[1]
    filled = replace(now, records=tuple(replace(record, every=4) for record in now.records))
    whole, quarter = (e_process.tested(before, one, EProcess()) for one in (now, filled))
    assert abs(_ratio(whole.any)) > 1.0
    assert _ratio(quarter.any) == pytest.approx(_ratio(whole.any) / 4, rel=1e-6)
    assert _ratio(quarter.of(tried[0][0])) == pytest.approx(_ratio(whole.of(tried[0][0])) / 4, rel=1e-6)
    assert e_process.tested(before, dragged[0], EProcess()) == EProcess()


def _ratio(log_e: float) -> float:
    """The logarithm of the likelihood ratio that `log_e_value` made this of."""
    return float((log_e + np.log(2 - np.exp(-log_e))) / TEMPER)


@pytest.mark.parametrize("replays", [False, True])
def test_a_controller_alone_is_tested_by_its_replays_of_the_new_records(
    dragged: tuple[Baseline, Baseline], replays: bool
) -> None:
    """No law of force stands beside it, by which anything would be weighed."""
    now = replace(
        dragged[1],
        known_replays=tuple(replace(one, checked=True, departs=None if replays else 5) for one in dragged[1].replays),
    )
    process = e_process.tested(_look(dragged[0], ("controller_mismatch",), ()), now, EProcess())
    assert process.is_confirmed("controller_mismatch", 1e-6) is not replays
    assert (process.any > 0) is not replays
    unchecked = replace(now, known_replays=tuple(replace(one, checked=False) for one in now.known_replays))
    same = e_process.tested(_look(dragged[0], ("controller_mismatch",), ()), unchecked, EProcess())
    assert same.any == same.of("controller_mismatch") == 0.0


def test_on_simulated_tables_without_an_effect_the_mean_e_value_is_one_at_most() -> None:
    """What the linear model promises, of nonsmooth simulations whose nominal values are off by their tolerances: each
    force law at the size that it seems to have in the first record, tested on the second one."""
    machine = with_units(load(), [])
    menu = [one for one in experiments(machine, AMPLE) if one.schedule.name in {"own test", "equal strokes"}]
    layout = parameters(machine, len(menu))
    laws = [kind.typical(machine.priors) for kind in machine.kinds.values() if kind.shown_in() == "force"]
    values = [value for seed in range(3) for value in _e_values(layout, menu, laws, seed)]
    assert len(values) > 40
    assert np.mean(values) <= 1.0
    assert max(values) < 1 / CHANCE


def _e_values(layout: Parameters, menu: Sequence[Experiment], laws: Sequence[Effect], seed: int) -> list[float]:
    rng, machine = np.random.default_rng([seed, 77]), layout.machine
    theta = bounded(layout, layout.deviation * np.clip(rng.standard_normal(layout.count), -2, 2))
    truth = Candidate(layout, theta)
    made = [simulated(truth, _template(machine, one), i, 5000 * seed + i) for i, one in enumerate(menu)]
    fitted = one_step(truth, made, walk=slow_walk(machine))
    base, slopes = at_the_priors(fitted)
    alone = [in_order((law,)) for law in laws]
    moved = columns(fitted.candidate, alone, made, fitted.paths, fitted.residuals, fitted.walk)
    moved, first = moved * weights(made)[:, None], made[0].position.size
    inner = np.eye(slopes.shape[1]) + slopes[:first].T @ slopes[:first]
    found = []
    for column in moved.T:
        free = column[:first] - slopes[:first] @ np.linalg.solve(inner, slopes[:first].T @ column[:first])
        if (energy := free @ column[:first]) > 1e-6:
            shift = -(free @ base[:first]) / energy * column
            found.append(float(np.exp(log_e_value(_log_ratio(base, slopes, shift, first)))))
    return found


def _template(machine: Machine, one: Experiment) -> Record:
    nothing, given = np.zeros(one.schedule.target.size), one.schedule.given
    return Record(machine.sample_time, one.schedule.target, given.position, given.feedforward, nothing, nothing)
