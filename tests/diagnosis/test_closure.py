"""The closure of a gap that is known: a slow signal in white noise, of which a share is taken out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from diagnosis.closure import RandomEnergy, gap_closure, gap_share, weighted

COUNT, MOTIONS = 20_000, 40
SEGMENT = np.repeat(np.arange(MOTIONS), COUNT // MOTIONS)


def _gap(rng: np.random.Generator, size: float) -> np.ndarray:
    """Pulses of a thirtieth of a motion, another in each."""
    pulse = np.exp(-0.5 * ((np.arange(COUNT // MOTIONS) - 200) / 15) ** 2)
    return size * np.concatenate([rng.standard_normal() * pulse for _ in range(MOTIONS)])


@given(seed=st.integers(0, 200), taken=st.sampled_from([0.0, 0.5, 0.9, 1.0]))
def test_the_closure_is_the_share_of_energy_that_is_taken_off(seed: int, taken: float) -> None:
    rng = np.random.default_rng(seed)
    gap, noise = _gap(rng, 2.0), rng.standard_normal(COUNT)
    floors = [rng.standard_normal(COUNT) for _ in range(2)]
    found, (low, high) = gap_closure(gap + noise, (1 - taken) * gap + noise, floors, SEGMENT)
    assert found == pytest.approx(1 - (1 - taken) ** 2, abs=0.12)
    assert low <= found <= high


def test_weighting_by_the_gap_narrows_the_interval() -> None:
    """Beside the plain ratio of energies, by the scatter over draws of noise."""
    plain, weighed = [], []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        gap, noise = _gap(rng, 1.0), rng.standard_normal(COUNT)
        floor = rng.standard_normal(COUNT)
        before, after = gap + noise, 0.3 * gap + noise
        plain.append((before @ before - after @ after) / (before @ before - floor @ floor))
        weighed.append(gap_closure(before, after, [floor], SEGMENT)[0])
    assert np.std(weighed) < 0.5 * np.std(plain)


def test_a_share_is_near_one_where_the_gap_is_and_small_elsewhere() -> None:
    rng = np.random.default_rng(0)
    share = gap_share(_gap(rng, 5.0) + rng.standard_normal(COUNT), [rng.standard_normal(COUNT)])
    assert share.shape == (COUNT // 2 + 1,)
    assert share[100:300].mean() > 0.8
    assert share[-3000:].mean() < 0.05
    assert np.allclose(weighted(np.ones(COUNT), np.ones(COUNT // 2 + 1)), 1.0)


def test_what_late_commands_add_to_the_floor_counts_as_explained() -> None:
    """A variance that no model takes off: here all, or half, of what separates the records from the floor."""
    rng, n = np.random.default_rng(5), 24_000
    segment = np.repeat(np.arange(24), n // 24)
    floors = [rng.standard_normal(n) for _ in range(2)]
    late = [RandomEnergy(floor + np.sqrt(5.0) * rng.standard_normal(n), 0.1) for floor in floors]
    for extra, explained in ((0.5, 1.0), (1.0, 0.5)):
        before = np.sqrt(1.0 + extra) * rng.standard_normal(n)
        assert gap_closure(before, before, floors, segment)[0] == 0.0
        found, (low, high) = gap_closure(before, before, floors, segment, late)
        assert abs(found - explained) < 0.15
        assert low - 0.02 <= explained <= high + 0.02
