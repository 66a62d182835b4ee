"""Samples by phase and direction, and signals by bands of frequency."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.records.motions import numbered, pieces
from diagnosis.where.energy import (
    PHASES,
    _band,
    bands,
    bootstrap_counts,
    bootstrap_interval,
    closure_interval,
    label_samples,
)
from models.records.record import Record, feeding_sequence


@pytest.mark.parametrize(
    ("sample_time", "last"), [(16e-3, (10.0, 31.25)), (0.5e-3, (300.0, 1000.0)), (1.5e-3, (100.0, 1 / 3e-3))]
)
def test_the_last_band_is_no_sliver_and_holds_half_the_sampling_frequency(
    sample_time: float, last: tuple[float, float]
) -> None:
    spans = bands(sample_time)
    assert spans[-1] == pytest.approx(last)
    assert [low for low, _ in spans[1:]] == [high for _, high in spans[:-1]]
    tone = np.tile([1.0, -1.0], 50)
    parts = [_band(tone, low, high, sample_time) for low, high in spans]
    assert [float(np.mean(part**2)) for part in parts] == pytest.approx([0.0] * (len(spans) - 1) + [1.0])


@pytest.mark.parametrize("motions", [2, 3, 6, 12, 30])
def test_the_interval_of_a_share_holds_the_true_one_however_few_the_motions(motions: int) -> None:
    """Of 2, 3 and 6 motions the quantiles of the draws alone held 53, 74 and 82 %. Where gaps differ much from one
    motion to the next, a few of a hundred are missed beyond the five."""
    rng, trials, held = np.random.default_rng(1), 300, 0
    for _ in range(trials):
        whole = np.exp(rng.normal(0.0, 1.0, motions))
        drawn = bootstrap_counts(motions, int(rng.integers(1 << 30))) @ np.stack(
            [whole * rng.beta(2, 3, motions), whole], 1
        )
        low, high = bootstrap_interval(drawn[:, 0] / drawn[:, 1], motions)
        held += low <= 0.4 <= high
    assert held >= 0.88 * trials


@pytest.mark.parametrize(("closure", "interval"), [(0.7, (0.0, 1.0)), (-0.2, (-0.2, 1.0))])
def test_one_motion_leaves_open_all_of_a_gap_and_nothing(closure: float, interval: tuple[float, float]) -> None:
    """All draws are of that one, so that the interval had no width."""
    assert closure_interval(closure, np.full(100, closure), 1) == interval


def test_no_closure_lies_beyond_all_of_a_gap() -> None:
    """Student's interval of two motions reaches far beyond what a share can be."""
    low, high = closure_interval(0.9, np.array([0.8, 0.9, 1.0, 0.9]), 2)
    assert low == pytest.approx(-0.37, abs=0.01)
    assert high == 1.0
    assert closure_interval(1.2, np.array([1.1, 1.2, 1.3, 1.2]), 2)[1] == 1.2


def test_behind_a_jump_of_the_reference_the_table_starts_settles_and_rests() -> None:
    """Steps of 20 µm every 0.3 s, of which 25 ms are settling."""
    target = feeding_sequence(20e-6, 2, 0.3, 0.5e-3)
    record = Record(0.5e-3, target, target, 0 * target, 0 * target, target)
    known = pieces((record,))
    found = label_samples((record,), known, numbered(known, (record,)), np.ones(target.size), 0.025)
    jumps = np.flatnonzero(np.diff(target)) + 1
    for jump in jumps:
        names = [PHASES[i] for i in found.phase[jump - 1 : jump + 51]]
        assert names == ["dwell"] + 5 * ["start"] + 45 * ["settle"] + ["dwell"]
    assert np.count_nonzero(found.phase != PHASES.index("dwell")) == 50 * jumps.size
    assert found.direction[jumps + 5].tolist() == np.sign(np.diff(target)[jumps - 1]).tolist()
