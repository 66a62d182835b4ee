"""The predictor and the smoother against what linear estimation says of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from control import forced_response
from hypothesis import given
from hypothesis import strategies as st

from diagnosis.model.kalman import (
    MAX_START_SAMPLES,
    STARTING,
    SUBSTEPS,
    Predictor,
    Resonance,
    adjoint,
    at_rest,
    beside_start,
    changes,
    discretised,
    innovations,
    likeliest_start,
    predictor,
    responses,
    smoothed,
    wrong_start,
)
from models.machine import load
from models.plant import sampled

MACHINE = load()
TS = MACHINE.sample_time


def _model(**options: object) -> Predictor:
    return predictor(MACHINE.plant, TS, noise=4e-8, **{"walk": 4e-3, "white_force": 0.08, **options})


def test_the_discrete_plant_is_the_exact_one() -> None:
    plant = replace(MACHINE.plant, dead_time=0.0)
    force = np.random.default_rng(0).standard_normal(300)
    a, b, c = discretised(plant, TS)
    state, x = np.zeros(c.size), []
    for f in force:
        x.append(c @ state)
        state = a @ state + b @ np.full(SUBSTEPS, f)
    reference = forced_response(sampled(plant, TS), U=force).outputs
    assert np.allclose(x, reference, rtol=1e-9, atol=1e-9 * np.max(np.abs(reference)))


def test_a_force_that_is_linear_in_every_sample_moves_the_plant_exactly() -> None:
    """By the plant's response to lines in continuous time, of which a force has its own in each sample."""
    plant = replace(MACHINE.plant, dead_time=0.0)
    rng = np.random.default_rng(1)
    begins, ends = rng.standard_normal((2, 200))
    middles = (np.arange(SUBSTEPS) + 0.5) / SUBSTEPS
    force = begins[:, None] + (ends - begins)[:, None] * middles
    a, b, c = discretised(plant, TS)
    state, x = np.zeros(c.size), []
    for f in force:
        x.append(c @ state)
        state = a @ state + b @ f
    fine = 400
    t = (np.arange(fine) + 0.5) / fine
    held = (begins[:, None] + (ends - begins)[:, None] * t).ravel()
    reference = forced_response(sampled(plant, TS / fine), U=held).outputs[::fine]
    assert np.allclose(x, reference, rtol=0, atol=1e-5 * np.max(np.abs(reference)))


@given(seed=st.integers(0, 1000))
def test_the_adjoint_gives_every_inner_product(seed: int) -> None:
    rng, model = np.random.default_rng(seed), _model()
    e, force, reading = rng.standard_normal(203), rng.standard_normal((3, 203, SUBSTEPS)), rng.standard_normal((3, 203))
    by_force, by_reading = adjoint(model, e)
    found = e @ responses(model, force, reading) * model.deviation
    wanted = np.einsum("ns,kns->k", by_force, force) + reading @ by_reading
    assert np.allclose(found, wanted, rtol=1e-9, atol=1e-9 * np.max(np.abs(wanted)))


def test_columns_side_by_side_are_the_filter_itself() -> None:
    rng, model = np.random.default_rng(1), _model(random_forces=(Resonance(8.0, 0.1, 0.02),))
    force, reading = rng.standard_normal((11, 403, SUBSTEPS)), rng.standard_normal((11, 403))
    alone = [innovations(model, force[j], reading[j], np.zeros(model.C.size)) for j in range(11)]
    whitened = np.stack(alone, axis=1) / model.deviation
    assert np.allclose(responses(model, force, reading), whitened, rtol=1e-10, atol=1e-10 / model.deviation)
    still = np.zeros(model.C.size)
    by_force = np.stack([innovations(model, one, np.zeros(403), still) for one in force], axis=1) / model.deviation
    assert np.allclose(responses(model, force), by_force, rtol=1e-10, atol=1e-10 * np.max(np.abs(by_force)))


def test_what_dies_away_ends_at_zero_and_not_in_subnormal_numbers() -> None:
    """Products with subnormal numbers took forty times as long, and a quarter of a refit's slopes were such."""
    rigid = replace(MACHINE.plant, modes=MACHINE.plant.modes[:1])
    model = predictor(rigid, TS, noise=4e-8, walk=0.4, white_force=0.08)
    force, reading = np.zeros((5, 40_000, SUBSTEPS)), np.zeros((5, 40_000))
    force[:, :100], reading[:, :100] = np.random.default_rng(2).standard_normal((2, 5, 100, 1))[0], 1e-6
    found = responses(model, force, reading)
    assert np.all(found[:1000] != 0)
    assert np.all(found[-1000:] == 0)
    assert np.min(np.abs(found[found != 0])) > np.finfo(float).tiny


def _simulated(
    model: Predictor,
    walk: float,
    noise: float,
    seed: int,
    n: int = 40_000,
    white_force: float = 0.08,
    begin: tuple[float, float] = (0.0, 0.0),
) -> tuple[np.ndarray, np.ndarray]:
    """Reading (n,) and unknown force (n,) of the very model that the filter assumes, whose table has the position
    and speed `begin` at first."""
    rng, state = np.random.default_rng(seed), np.zeros(model.C.size)
    state[:2] = begin
    reading, force = np.empty(n), np.empty(n)
    held = model.A[:, -1].copy()
    held[-1] = 0.0
    for k in range(n):
        reading[k], force[k] = model.C @ state + noise * rng.standard_normal(), state[-1]
        state = model.A @ state + held * white_force * rng.standard_normal()
        state[-1] += walk * rng.standard_normal()
    return reading, force


def test_innovations_of_its_own_model_are_white_and_of_the_stated_size() -> None:
    model = _model()
    reading, _ = _simulated(model, 4e-3, 4e-8, 2)
    e = innovations(model, np.zeros((reading.size, SUBSTEPS)), reading, np.zeros(model.C.size))[2000:] / model.deviation
    n = e.size
    assert np.mean(e**2) == pytest.approx(1.0, abs=5 * np.sqrt(2 / n))
    lags = [e[:-lag] @ e[lag:] / n for lag in (1, 2, 5, 20, 100)]
    assert np.max(np.abs(lags)) < 5 / np.sqrt(n)


def test_the_smoother_finds_the_unknown_force_better_than_the_filter() -> None:
    model = _model()
    reading, force = _simulated(model, 4e-3, 4e-8, 3)
    still, zero = np.zeros((reading.size, SUBSTEPS)), np.zeros(model.C.size)
    both = smoothed(model, still, reading, zero)[5000:-5000, -1]
    past = smoothed(replace(model, back=np.zeros_like(model.back)), still, reading, zero)[5000:-5000, -1]
    truth = force[5000:-5000]
    assert np.std(both - truth) < 0.8 * np.std(past - truth)


@pytest.mark.parametrize("starting_walk", [None, 0.1])
def test_a_table_that_moves_when_its_record_begins_leaves_white_innovations(starting_walk: float | None) -> None:
    """However slow the filter: from rest at the first reading, it takes thousands of samples to settle."""
    model = _model(walk=1e-5, white_force=1e-3, starting_walk=starting_walk)
    seen = model.start_seen(MAX_START_SAMPLES)
    length = len(seen)
    assert length > 3000
    begin = (3e-7, 1e-4)
    reading, _ = _simulated(model, 1e-5, 4e-8, 4, 3 * length, 1e-3, begin)
    still = np.zeros((reading.size, SUBSTEPS))
    resting, fitted = at_rest(model, reading), likeliest_start(model, still, reading)
    before, after = (innovations(model, still, reading, one) / model.deviation for one in (resting, fitted))
    counts = slice(STARTING, length)
    assert np.mean(before[counts] ** 2) > 3.0
    assert np.mean(after[counts] ** 2) == pytest.approx(1.0, abs=5 * np.sqrt(2 / length))
    error = (fitted[:2] - begin) / model.start_units
    information = seen.T @ seen
    assert error @ information @ error < 18.4  # of chi-square with two degrees of freedom, once in 10,000
    assert np.allclose(beside_start(model, before.copy())[counts], after[counts], atol=1e-8)


def test_changes_are_those_of_the_innovations_after_their_start_was_fitted() -> None:
    rng, model = np.random.default_rng(6), _model(walk=1e-5, white_force=1e-3)
    force, reading = rng.standard_normal((3, 4000, SUBSTEPS)), 1e-6 * rng.standard_normal((3, 4000))
    found = changes(model, force, reading)
    alone = responses(model, force, reading).T
    assert np.allclose(found.T, alone - wrong_start(model, alone) @ model.start_seen(4000).T, atol=1e-12)
    assert np.max(np.abs(wrong_start(model, found.T))) < 1e-5 * np.max(np.abs(wrong_start(model, alone)))
