"""The measured curve of a law: what it and what is left beside it are over its coordinate."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.model.fit import Fit, fit
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.records.motions import pieces
from diagnosis.where.law_curve import law_curve
from models.effects.friction_laws import ViscousFriction
from models.effects.motor import CurrentLoopLag
from models.records.record import Record
from tests.diagnosis.tables import recorded, short, table

MACHINE = table()
DRAG = 40.0


@pytest.fixture(scope="module")
def records() -> tuple[Record, ...]:
    return recorded(MACHINE, (short(MACHINE),), [ViscousFriction(DRAG)], seed=1, wrong=0.0)


def _with(drag: float, records: tuple[Record, ...]) -> Fit:
    layout = parameters(MACHINE, 1)
    return fit(Candidate(layout, np.zeros(layout.count), (ViscousFriction(drag),)), records, iterations=0)


@pytest.mark.parametrize("fitted", [DRAG, 0.5 * DRAG])
def test_a_drag_is_a_straight_line_whatever_of_it_the_fit_has(fitted: float, records: tuple[Record, ...]) -> None:
    """What the fitted law lacks is in what is left."""
    curve = law_curve("viscous_friction", ViscousFriction.kind(), _with(fitted, records), records, pieces(records))
    assert curve is not None
    assert (curve.coordinate, curve.unit) == ("speed", "m/s")
    fast = curve.knots > 0.05
    assert fast.any()
    assert curve.force[fast] == pytest.approx(-DRAG * curve.knots[fast], rel=0.02)
    assert np.all((curve.low <= curve.high) & np.isfinite(curve.force))


def test_a_law_without_a_coordinate_in_the_records_has_no_curve(records: tuple[Record, ...]) -> None:
    given = _with(DRAG, records), records, pieces(records)
    assert law_curve("current_loop_lag", CurrentLoopLag.kind(), *given) is None
