"""Samples by phase and direction, and signals by bands of frequency."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.records.motions import numbered, pieces
from diagnosis.where.energy import PHASES, _band, bands, label_samples
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
