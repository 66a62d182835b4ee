"""What the re-fit and the search decide before any effect is named."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis import residual
from diagnosis.fit import at_bounds
from diagnosis.initial import balanced
from diagnosis.nominal import parameters
from diagnosis.residual import Candidate, columns, look, smooth
from diagnosis.shaking import _steady
from diagnosis.where_words import _drive
from diagnosis.which import FORM, REST, SECOND, further, refit_within
from models.effects.catalogue import in_order
from models.effects.friction import DirectionalFriction
from models.effects.kernel import ACTING
from models.effects.motor import Cogging, DacQuantisation
from tests.diagnosis.tables import recorded, schedules, table

MACHINE = table()
WEAK = replace(MACHINE, drive=replace(MACHINE.drive, rated_thrust=60.0))
PLAN = schedules(MACHINE)


@pytest.mark.parametrize("truth", [MACHINE, WEAK], ids=["follows", "does not"])
def test_whether_the_drive_follows_beyond_its_rating_is_read_off_the_records(truth: Any) -> None:
    records = recorded(truth, PLAN, seed=11)
    most = max(float(np.abs(record.command).max()) for record in records)
    assert most > WEAK.drive.rated_thrust
    found = refit_within(WEAK, records).candidate.layout.machine
    follows = truth is MACHINE
    assert found.drive.rated_thrust == (most if follows else WEAK.drive.rated_thrust)
    assert found.sources["drive.rated_thrust"].kind == ("identified" if follows else "paper")


def test_a_drive_that_follows_beyond_its_rating_is_said() -> None:
    said = list(_drive(SimpleNamespace(followed=158.12)))  # type: ignore[arg-type]
    assert said == ["The drive followed commands of up to 158 N, more than the rated thrust of the machine file."]
    assert not list(_drive(SimpleNamespace(followed=None)))  # type: ignore[arg-type]


def test_a_force_that_is_there_after_some_motions_only_is_not_steady() -> None:
    rng, ts = np.random.default_rng(3), 5e-4
    t = np.arange(60_000) * ts
    floor = np.sin(2 * np.pi * 8.0 * t + 0.3 * np.cumsum(rng.standard_normal(t.size)) * ts**0.5)
    since = t % 10.0  # a motion every ten seconds, after which it decays
    slosh = np.exp(-since / 0.5) * np.sin(2 * np.pi * 8.0 * since)
    noise = 0.1 * rng.standard_normal(t.size)

    def steady(e: Any) -> float:
        fitted: Any = SimpleNamespace(seen=[SimpleNamespace(innovations=e + noise)])
        return _steady(fitted, 8.0, ts)

    assert steady(floor) > 0.8
    assert steady(slosh) < 0.2


def test_a_further_effect_has_to_gain_more_than_the_form_of_the_first_may_be_wrong_by() -> None:
    floors = np.array([900.0, 1000.0])
    assert further(1e5, 990.0, floors) == FORM * 1e5  # nothing is surely left: all of it may be form
    assert further(1e5, 5000.0, floors) == REST * 4000.0
    assert further(100.0, 5000.0, floors) == SECOND


def test_what_is_known_of_a_replay_gives_the_columns_that_replaying_it_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside an effect on the friction, one that leaves it as it is."""
    records = recorded(MACHINE, PLAN, seed=12)
    layout = parameters(MACHINE, len(records))
    candidate = Candidate(layout, balanced(layout, records), (DirectionalFriction(0.05, 2e-6),))
    paths = smooth(candidate, records)
    seen = look(candidate, records, paths)
    trials = [in_order((*candidate.effects, Cogging(1.0, 0.035, 0.3)))]
    known = columns(candidate, trials, records, paths, seen)
    monkeypatch.setattr(residual, "changed", lambda *_: frozenset(ACTING))
    assert np.abs(known).max() > 1.0
    np.testing.assert_allclose(columns(candidate, trials, records, paths, seen), known, atol=1e-9)


def test_a_step_beyond_its_prior_range_is_no_bent_law() -> None:
    """Many steps tell their size; a shape that only its bound keeps is another law."""
    assert not at_bounds(DacQuantisation(0.15, 1.0))
    assert not at_bounds(Cogging(1.0, 0.05, 0.3))
    assert at_bounds(Cogging(1.0, 0.09, 0.3))
