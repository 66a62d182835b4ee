"""The filter of a white force that varies: the steady state where it does not, and the likeliest one at the truth."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.experiments.schedules import strokes
from diagnosis.model.kalman import STARTING
from diagnosis.model.varying_noise import LANES, LinearPart, linear_part
from models.machine import load
from tests.diagnosis.tables import nominal_with, recorded

SAMPLES = 6000


@pytest.fixture(scope="module")
def steady() -> tuple[LinearPart, np.ndarray]:
    """A record's linear part, and its innovations by the filter of the steady state."""
    table = load()
    (record,) = recorded(table, (strokes(table, 2e-3, (0.2,)),), seed=2, wrong=0.0)
    fitted = nominal_with(table, (), (record,))
    part = linear_part(fitted.candidate, record, fitted.residuals[0], 0, fitted.walk)
    return part, fitted.residuals[0].innovations


def test_a_force_that_does_not_vary_has_the_steady_state(steady: tuple[LinearPart, np.ndarray]) -> None:
    part, innovations = steady
    e = part.standardised(np.zeros(part.reading.size))
    assert e == pytest.approx(innovations[STARTING:], abs=1e-6)


def made(part: LinearPart, added: np.ndarray, seed: int) -> LinearPart:
    """A record of the same system, driven by white forces of these variances (n,) [N^2] and read with its noise."""
    rng = np.random.default_rng(seed)
    force = np.sqrt(part.white + added) * rng.standard_normal(added.size)
    state, reading = np.zeros(part.start.size), np.empty(added.size)
    for k in range(added.size):
        reading[k] = part.C @ state + np.sqrt(part.noise) * rng.standard_normal()
        state = part.A @ state + part.held * force[k]
        state[-1] += part.walk * rng.standard_normal()
    return part._replace(
        reading=reading, given=np.zeros((added.size, part.start.size)), start=np.zeros(part.start.size)
    )


def test_the_true_variance_is_the_likeliest_and_leaves_white_innovations(steady: tuple[LinearPart, np.ndarray]) -> None:
    part, _ = steady
    where = np.sin(np.arange(SAMPLES) / 150.0) ** 8
    truth = 400.0 * part.white * where
    record = made(part, truth, seed=3)
    costs = record.misfits(truth, np.array([0.0, 0.5, 1.0, 2.0]))
    assert int(np.argmin(costs)) == 2
    even = np.full(SAMPLES, float(np.mean(truth)))
    assert record.misfits(even, np.array([0.3, 1.0, 3.0])).min() > costs[2] + 100
    e = record.standardised(truth)
    assert float(np.mean(e**2)) == pytest.approx(1.0, abs=4 * np.sqrt(2 / e.size))
    assert float(np.mean(e[1:] * e[:-1])) == pytest.approx(0.0, abs=4 / np.sqrt(e.size))


def test_sizes_side_by_side_are_as_likely_as_each_alone(steady: tuple[LinearPart, np.ndarray]) -> None:
    part, _ = steady
    envelope, sizes = np.linspace(0.0, 1.0, part.reading.size), part.white * np.geomspace(0.1, 1e4, 2 * LANES + 3)
    together = part.misfits(envelope, sizes)
    assert together == pytest.approx([_by_matrices(part, size * envelope) for size in sizes], rel=1e-8)


def _by_matrices(part: LinearPart, added: np.ndarray) -> float:
    """-2 log of the likelihood by the textbook's recursion."""
    state, P, total = part.start, part.covariance, 0.0
    for k, reading in enumerate(part.reading):
        e, variance = reading - part.C @ state, part.C @ P @ part.C + part.noise
        gain = P @ part.C / variance
        total += e**2 / variance + np.log(variance) if k >= STARTING else 0.0
        state = part.A @ (state + gain * e) + part.given[k]
        P = part.A @ (P - np.outer(gain, part.C @ P)) @ part.A.T
        P = P + (part.white + added[k]) * np.outer(part.held, part.held)
        P[-1, -1] += part.walk**2
    return float(total)
