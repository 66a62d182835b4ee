"""What a candidate leaves of records: in parallel, by replays that are known, without the machine file's effects."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.model import residual
from diagnosis.model.fit import fit
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate, columns, evaluate, smooth
from diagnosis.model.start_states import search, static_equilibrium_start
from models.effects.catalogue import in_order
from models.effects.friction_laws import DirectionalFriction, Stribeck
from models.effects.motor import Cogging
from models.simulation.effect_kernel import ACTING
from tests.diagnosis.tables import recorded, schedules, table

MACHINE = table()
PLAN = schedules(MACHINE)


def test_an_effect_of_the_machine_files_own_is_no_finding() -> None:
    """Nor is it the second one of two of a name."""
    own, other = Cogging(1.0, 0.03, 0.0), Cogging(2.0, 0.05, 0.0)
    layout = parameters(replace(MACHINE, effects=(own,)), 1)
    both = in_order((own, Stribeck(0.1, 2e-3), other))
    assert Candidate(layout, np.zeros(layout.count), both).added_effects == [Stribeck(0.1, 2e-3), other]


def test_records_beside_each_other_give_what_they_give_one_after_another(monkeypatch: pytest.MonkeyPatch) -> None:
    records, found = recorded(MACHINE, PLAN, seed=13), []
    for cores in (1, 2):
        monkeypatch.setattr("diagnosis.model.parallel.cpu_count", lambda cores=cores: cores)
        candidate = Candidate(layout := parameters(MACHINE, len(records)), static_equilibrium_start(layout, records))
        fitted = fit(candidate, records, iterations=1)
        found.append((fitted.innovations, fitted.slopes, search(fitted, records).theta))
    assert all(np.array_equal(*pair) for pair in zip(*found, strict=True))
    assert found[0][0].size == sum(record.position.size for record in records)


def test_what_is_known_of_a_replay_gives_the_columns_that_replaying_it_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside an effect on the friction, one that leaves it as it is."""
    records = recorded(MACHINE, PLAN, seed=12)
    layout = parameters(MACHINE, len(records))
    candidate = Candidate(layout, static_equilibrium_start(layout, records), (DirectionalFriction(0.05, 2e-6, 0),))
    paths = smooth(candidate, records)
    residuals = evaluate(candidate, records, paths)
    trials = [in_order((*candidate.effects, Cogging(1.0, 0.035, 0.3)))]
    known = columns(candidate, trials, records, paths, residuals)
    monkeypatch.setattr(residual, "changed", lambda *_: frozenset(ACTING))
    assert np.abs(known).max() > 1.0
    np.testing.assert_allclose(columns(candidate, trials, records, paths, residuals), known, atol=1e-9)
