"""Detectors by themselves: a law whose effect is not linear is looked at from afar."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from diagnosis.experiments.schedules import dwell_sweep
from diagnosis.which.detectors import View, _from_afar
from diagnosis.which.stage import Proposal
from models.effects.base import parameters
from models.effects.motor import Cogging, GainAsymmetry
from models.effects.scale import ScaleDrift, ScalePeriodicError
from tests.diagnosis.tables import nominal_with, recorded, table


def seen(drift: float) -> Any:
    """Records of a table whose scale drifts at so many m/s, with nothing of it in the model."""
    machine = table()
    records = recorded(machine, [dwell_sweep(machine, (0.3, 0.9))], [ScaleDrift(drift)], seed=2, wrong=0.0)
    nothing: Any = None
    return View(nominal_with(machine, (), records), SimpleNamespace(records=records), nothing)  # type: ignore[arg-type]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_law_of_the_reading_alone_is_tried_at_large_sizes_of_either_sign(sign: float) -> None:
    (item,) = parameters(ScaleDrift, table().priors)
    found = _from_afar(seen(sign * 4 * item.high), Proposal("scale_drift", -200.0, 20.0, effect=ScaleDrift(1e-9)))
    assert found.effect == ScaleDrift(sign * 5 * item.high)
    assert found.in_sample_gain > 1000
    assert found.gain == -200.0  # on held-out motions it still gains nothing to first order


@pytest.mark.parametrize(
    "effect", [Cogging(1.0, 30e-3, 0.0), GainAsymmetry(0.01), ScalePeriodicError(1e-7, 2e-5, 0.0)], ids=lambda e: e.name
)
def test_no_other_law_is(effect: Any) -> None:
    """One of force does not move the path, and one with a period is looked for along it."""
    proposal = Proposal(effect.name, 5.0, 20.0, effect=effect)
    assert _from_afar(seen(0.0), proposal) is proposal
