"""The response with lag, drag and a spring against an independent formula, continuous and behind a hold."""

from __future__ import annotations

import numpy as np
import pytest

from models.identification.modal.transfer import Array, Complex, response
from models.plant import Mode, Plant
from tests.coverage.axis import Axis, drawn

FREQUENCY = np.array([3.0, 38.0, 77.0, 180.0])


def plant_of(axis: Axis) -> Plant:
    """Its modes and dead time."""
    triples = zip(axis.gain, axis.frequency, axis.damping, strict=True)
    return Plant(axis.dead_time, 1.0, (Mode(1 / axis.mass, 0.0, 0.0), *(Mode(*map(float, one)) for one in triples)))


@pytest.mark.parametrize("seed", [2, 9, 16, 39])
def test_it_is_the_axis_response(seed: int) -> None:
    axis = drawn(seed, seed % 5)
    assert axis.drag > 0
    assert axis.lag > 0
    found = response(plant_of(axis), FREQUENCY, 0.0, lag=axis.lag, drag=axis.drag)
    assert np.max(np.abs(found / axis.response(FREQUENCY) - 1)) < 1e-11


def sprung(axis: Axis, frequency: Array, spring: float) -> Complex:
    """The axis's response (n,) [m/N], delay and lag apart from the loop, with a spring to ground [N/m] around it."""
    late = np.exp(-2j * np.pi * frequency * axis.dead_time) / (1 + 2j * np.pi * frequency * axis.lag)
    free = axis.response(frequency) / late
    return np.asarray(late * free / (1 + spring * free))


@pytest.mark.parametrize("seed", [2, 9, 16, 39])
@pytest.mark.parametrize("share", [1e-4, 0.05, 4.0])
def test_a_spring_holds_the_axis(seed: int, share: float) -> None:
    """Of a share of the inertia at 3 Hz; continuous, and behind a hold as the sum over all aliases."""
    axis = drawn(seed, seed % 5)
    ts, spring = axis.sample_time, share * axis.mass * (2 * np.pi * 3.0) ** 2
    found = response(plant_of(axis), FREQUENCY, 0.0, lag=axis.lag, drag=axis.drag, spring=spring)
    assert np.max(np.abs(found / sprung(axis, FREQUENCY, spring) - 1)) < 1e-9
    aliases = FREQUENCY[:, None] + np.arange(-400, 401) / ts
    s = 2j * np.pi * aliases
    each = sprung(axis, aliases.ravel(), spring).reshape(aliases.shape)
    held = np.sum(each * (1 - np.exp(-s * ts)) / (s * ts), axis=1)
    found = response(plant_of(axis), FREQUENCY, ts, lag=axis.lag, drag=axis.drag, spring=spring)
    assert np.max(np.abs(found / held - 1)) < 1e-7


@pytest.mark.parametrize("seed", [2, 9, 16, 39])
def test_behind_a_hold_it_is_the_sum_over_all_aliases(seed: int) -> None:
    """X*(jw) = sum over k of P(jw_k) (1 - exp(-j w_k T)) / (j w_k T) with w_k = w + 2 pi k / T: they fall fast."""
    axis = drawn(seed, seed % 5)
    ts = axis.sample_time
    aliases = FREQUENCY[:, None] + np.arange(-400, 401) / ts
    s = 2j * np.pi * aliases
    each = axis.response(aliases.ravel()).reshape(aliases.shape)
    held = np.sum(each * (1 - np.exp(-s * ts)) / (s * ts), axis=1)
    found = response(plant_of(axis), FREQUENCY, ts, lag=axis.lag, drag=axis.drag)
    assert np.max(np.abs(found / held - 1)) < 1e-7
