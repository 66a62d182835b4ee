"""The noise of a record comes out as it was made, also where modes ring and where feedback returns it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from models.identification import response
from tests.coverage.axis import Axis, Log, drawn
from tests.coverage.records import multisine, sweep
from tests.coverage.trial import record


@pytest.mark.parametrize(("kind", "lasting"), [(multisine, 7.0), (sweep, 8.0)], ids=["multisine", "sweep"])
def test_the_noise_is_that_of_the_scale(kind: Callable[[Axis, int], Log], lasting: float) -> None:
    """White noise and rounding; a mode of 0.5 Hz half width among lines of 0.125 Hz, a drag and a P/PI cascade."""
    axis = drawn(2, 2)
    found = response.measured(record(axis, kind(axis, 2)))
    assert found.command is not None
    power = axis.noise**2 + axis.step**2 / 12
    stated = found.variance * np.abs(found.command) ** 2 * lasting / axis.sample_time / power
    near = np.abs(found.frequency - axis.frequency[0]) < 10
    low, high = found.frequency < 6, found.frequency > 200
    for part in (near, low, high, np.ones(near.size, bool)):
        assert 0.5 < np.median(stated[part]) < 2  # polynomials alone are off by decades


def test_the_noise_of_one_sweep_is_smooth_also_across_a_sharp_mode() -> None:
    """Each line's own power scatters by a quarter and is half too large at a mode of nine lines."""
    axis = drawn(62, 2)
    found = response.measured(record(axis, sweep(axis, 62)))
    assert found.command is not None
    power = axis.noise**2 + axis.step**2 / 12
    stated = found.variance * np.abs(found.command) ** 2 * 8.0 / axis.sample_time / power
    near = np.abs(found.frequency / axis.frequency[0] - 1) < axis.damping[0]
    assert np.ptp(np.quantile(stated, [0.1, 0.9])) < 0.4  # of each line's own power 0.7
    assert np.median(stated[near]) == pytest.approx(1, abs=0.2)
