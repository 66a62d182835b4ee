"""What the search finds where nothing is missing, and what its simulated tables share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from diagnosis import null
from diagnosis.criteria import Criteria
from diagnosis.model.fit import Fit, fit, one_step
from diagnosis.model.motions import numbered, pieces
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.model.start_states import static_equilibrium_start
from diagnosis.null import Null
from diagnosis.which.scan import NuisanceProjection, partial_out, scan
from models.records.record import Record
from tests.diagnosis.tables import recorded, table
from tests.diagnosis.where.cases import fitted, schedules

MACHINE = table()
PLAN = schedules(MACHINE)
RECORDS = recorded(MACHINE, PLAN, seed=41)
CRITERIA = Criteria()


def test_columns_of_the_same_table_give_the_findings_that_it_gives_alone() -> None:
    found = fitted(MACHINE, RECORDS)
    projection = partial_out(found, numbered(pieces(RECORDS), RECORDS))
    alone, known = scan(found, RECORDS, projection)
    kinds = {effect.name for effect in known}
    assert "current_loop_lag" not in kinds  # the dead time explains nearly all of it
    assert {"cogging", "additional_mode", "viscous_friction"} <= kinds
    shared, _ = scan(found, RECORDS, projection, known=known)
    plain, again = ({one.effect.name: one.held_out for one in findings} for findings in (alone, shared))
    assert again == pytest.approx(plain, rel=1e-4, abs=1e-3)  # columns are kept in single precision


def test_what_tables_share_gives_the_thresholds_that_each_gives_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    layout = parameters(MACHINE, len(RECORDS))
    shared = null.null(layout, RECORDS, draws=4)

    def alone_scan(fitted: Fit, records: Sequence[Record], own: NuisanceProjection, known: object = None) -> object:
        del known
        return scan(fitted, records, own)

    monkeypatch.setattr(null, "scan", alone_scan)
    alone = null.null(layout, RECORDS, draws=4)
    for name, gains in alone.gains.items():  # of the first table, they are the same by construction
        assert max(shared.gains[name][1:]) == pytest.approx(max(gains[1:]), rel=0.3, abs=0.1 * CRITERIA.min_gain), name


def test_one_step_from_the_truth_is_as_good_as_a_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    layout = parameters(MACHINE, len(RECORDS))
    start = Candidate(layout, static_equilibrium_start(layout, RECORDS))
    assert one_step(start, RECORDS).cost < fit(start, RECORDS, iterations=0).cost - CRITERIA.min_gain
    step = null.null(layout, RECORDS, draws=3)
    monkeypatch.setattr(null, "one_step", fit)
    whole = null.null(layout, RECORDS, draws=3)
    for name, gains in whole.gains.items():
        assert step.gains[name] == pytest.approx(gains, abs=0.1 * CRITERIA.min_gain), name
    assert np.array(step.variance) == pytest.approx(np.array(whole.variance), rel=1e-3)
    assert step.spike(CRITERIA) == pytest.approx(whole.spike(CRITERIA), rel=0.02)


def test_a_threshold_is_beyond_the_largest_gain_by_chance() -> None:
    found = Null({"cogging": (3.0, 50.0), "play": (0.0, 1.0)}, ((1.0,), (1.0,)), (4.0, 7.0))
    assert found.thresholds(CRITERIA) == {"cogging": CRITERIA.null_safety * 50.0, "play": CRITERIA.min_gain}
    assert found.spike(CRITERIA) == CRITERIA.spike_safety * 7.0
