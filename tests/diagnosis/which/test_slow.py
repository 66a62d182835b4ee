"""A slow force that the filter's own random force follows is searched beside one that stands still."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.baseline import Baseline, refit_and_null
from diagnosis.closure import Closure, NoiseFloor
from diagnosis.criteria import Criteria
from diagnosis.diagnose import NAMED, diagnosed
from diagnosis.verdict import Outcome
from diagnosis.which.select import select
from diagnosis.which.slow import hidden, slow_force
from diagnosis.which.stage import Stage
from models.effects.base import Effect
from models.effects.structure import CableSpring
from tests.diagnosis.tables import recorded, short, table

MACHINE, CRITERIA = table(), Criteria()
SPRING = CableSpring(4.0)  # 0.18 N over the travel


def _baseline(effects: Sequence[Effect], cache: Path) -> Baseline:
    return refit_and_null(MACHINE, recorded(MACHINE, (short(MACHINE),), effects, seed=3), cache=cache)


@pytest.fixture(scope="module")
def slow(null_cache: Path) -> Baseline:
    return _baseline([SPRING], null_cache)


@pytest.fixture(scope="module")
def searched(slow: Baseline) -> Stage:
    """The one stage of a search that finds nothing."""
    (stage,) = select(slow)
    return stage


def test_a_spring_that_innovations_do_not_show_is_named(slow: Baseline, searched: Stage) -> None:
    """Beside a force that walks it gains less than chance may; beside one that stands still, hundreds of times that."""
    (proposal,) = (one for one in searched.scanned if one.name == SPRING.name)
    assert proposal.gain < CRITERIA.min_gain
    found = diagnosed(slow)
    assert (found.outcome, found.effects) == (Outcome.ATTRIBUTED, (SPRING.name,))
    (spring,) = found.told.candidate.added_effects
    assert isinstance(spring, CableSpring)
    assert spring.stiffness == pytest.approx(SPRING.stiffness, rel=0.25)
    (row,) = (one for one in found.which if one.name == SPRING.name)
    assert row.gain > 100 * row.threshold  # as the report shows it, beside a force that stands still


def test_with_its_entry_disabled_no_other_law_is_named_for_it(slow: Baseline) -> None:
    """A cogging of less than two periods would draw it."""
    found = diagnosed(slow, disabled={SPRING.name})
    assert found.outcome not in NAMED


def test_without_such_a_force_nothing_takes_off_enough(null_cache: Path) -> None:
    baseline = _baseline((), null_cache)
    (stage,) = select(baseline)
    assert slow_force(stage, baseline) is None


def test_a_spring_that_the_machine_file_has_is_not_taken_from(slow: Baseline) -> None:
    """A file's spring that is too stiff does not get a second one with the other sign."""
    stiff = replace(MACHINE, effects=(replace(SPRING, stiffness=8.0),))
    baseline = refit_and_null(stiff, slow.records)
    stages = slow_force(Stage(baseline.nominal), baseline)
    assert stages is None or stages[1].added != SPRING.name


@pytest.mark.parametrize(
    ("by_force", "excess", "stands_out"), [(True, 3.1, True), (True, 2.9, False), (False, 3.1, False)]
)
def test_a_force_is_hidden_where_it_alone_stands_out(by_force: bool, excess: float, stands_out: bool) -> None:
    floor = NoiseFloor((np.zeros(1),), (), 1.0, "simulated", lambda: pytest.fail("asks for a gap"))
    closure = Closure(0.0, (0.0, 0.0), 0.0, floor, by_force=by_force, force_excess=excess)
    assert hidden(closure, CRITERIA) == stands_out
