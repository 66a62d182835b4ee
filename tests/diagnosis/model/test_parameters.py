"""The nominal parameters: how far they may go."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from diagnosis.model.parameters import FURTHER, applied, bounded, parameters
from tests.diagnosis.tables import table

MACHINE = table()


@given(st.floats(0, 1e-4), st.floats(-1, 1))
def test_no_dead_time_goes_below_zero(dead_time: float, share: float) -> None:
    machine = replace(MACHINE, plant=replace(MACHINE.plant, dead_time=dead_time))
    layout = parameters(machine, 1)
    theta = np.where(layout.of("dead_time")[0] == np.arange(layout.count), share * 1e-3, 0.0)
    moved = applied(layout, bounded(layout, theta)).plant.dead_time
    assert 0.0 <= moved <= dead_time + FURTHER * layout.deviation[layout.of("dead_time")][0] * (1 + 1e-12)
