"""What carries over from record to record, and what belongs to a record."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.closure import Closure
from diagnosis.criteria import Criteria
from diagnosis.diagnose import is_withdrawn
from diagnosis.handover import transfer
from diagnosis.handover.hand_over import HowFar, Terms
from diagnosis.handover.transfer import Matrix, PerRecord, Transfer, differing, without_effects_of_records
from diagnosis.how_far import Gap
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from models.effects.catalogue import in_order
from models.effects.friction_laws import ViscousFriction
from models.effects.motor import Cogging, DacQuantisation
from models.machine import load


def _phase(part: str, *, differs: bool) -> PerRecord:
    return PerRecord(part, "phase", "1", (0.0, 1.0), (0.1, 0.1), differs)


def test_all_ripples_of_a_law_go_where_one_phase_differs_and_the_files_own_stay() -> None:
    own, added = Cogging(9.0, 0.05, 0.0), (Cogging(1.0, 0.0025, 1.0), Cogging(0.4, 0.00125, 2.0), ViscousFriction(9.0))
    machine = replace(load(), effects=(own,))
    layout = parameters(machine, 2)
    candidate = Candidate(layout, np.zeros(layout.count), in_order((own, *added)))
    offset = PerRecord("nominal", "offset", "N", (1.0, 3.0), (0.1, 0.1), differs=True)
    phases = [_phase("cogging", differs=False), _phase("cogging", differs=True), _phase("cogging", differs=False)]
    left = without_effects_of_records(candidate, [offset, *phases])
    assert set(left.effects) == {own, added[2]}
    same = without_effects_of_records(candidate, [offset, *(_phase("cogging", differs=False) for _ in range(3))])
    assert same.effects == candidate.effects


@pytest.mark.parametrize(
    ("values", "deviations", "turns", "found"),
    [
        ((2.86, 1.24), (0.19, 0.10), True, True),
        ((6.15, 2.22), (2.7, 0.26), True, False),  # too uncertain to tell
        ((0.02, 6.27), (0.01, 0.01), True, False),  # the same angle but for a turn
        ((0.02, 6.27), (0.01, 0.01), False, True),
        ((3.4, 3.1, 3.3), (0.15, 0.15, 0.15), False, False),
        ((3.4, 3.1, 4.8), (0.15, 0.15, 0.15), False, True),
    ],
)
def test_values_differ_where_their_deviations_do_not_explain_it(
    values: tuple[float, ...], deviations: tuple[float, ...], turns: bool, found: bool
) -> None:
    assert differing(values, deviations, turns=turns) == found


def test_elsewhere_is_what_files_leave_of_records_that_they_were_not_fitted_to() -> None:
    rows = (
        (Gap(1.0, 1e-6, None), Gap(3.0, 3e-6, 2e-3)),
        (Gap(4.0, 4e-6, None), Gap(1.0, 1e-6, 1e-3)),
    )
    found = Matrix("re-fitted", rows).elsewhere()
    assert found.force == pytest.approx(12.5**0.5)
    assert found.position == pytest.approx(12.5**0.5 * 1e-6)
    assert found.settling == pytest.approx(2e-3)


@pytest.mark.parametrize(("with_it", "without"), [(0.02, 0.03), (0.04, 0.03)])
def test_a_law_whose_phases_differ_stays_where_it_carries_over(
    with_it: float, without: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As phases with deviations that are too small differ, too. Left out are those that leave more of other records."""
    layout = parameters(load(), 2)
    plain = Candidate(layout, np.zeros(layout.count), ())
    ripple = replace(plain, effects=(Cogging(1.0, 0.0025, 1.0),))
    baseline: Any = SimpleNamespace(records=(None, None))

    def fit(candidate: Candidate, *_: object) -> Any:
        return SimpleNamespace(candidate=candidate, fitted=SimpleNamespace(candidate=candidate))

    def leaves(name: str, whole: Any, *_: object) -> Matrix:
        gap = Gap(with_it if whole.candidate.effects else without, 1e-6, None)
        return Matrix(name, ((gap, gap), (gap, gap)))

    found = (PerRecord("cogging", "phase", "1", (0.709, 0.660), (0.001, 0.001), differs=True),)
    monkeypatch.setattr(transfer, "alone", lambda *_: ())
    monkeypatch.setattr(transfer, "per_record", lambda *_: found)
    monkeypatch.setattr(transfer, "_matrix", leaves)
    monkeypatch.setattr(transfer, "as_delivered", lambda *_: leaves("as delivered", fit(plain)))
    monkeypatch.setattr(
        transfer,
        "replace",
        lambda one, **changed: fit(changed["candidate"]).fitted if "candidate" in changed else replace(one, **changed),
    )
    monkeypatch.setattr(transfer, "finished", lambda one, *_: fit(one.candidate))
    kept, shown = transfer.transferred([fit(plain), fit(ripple)], baseline)
    assert bool(kept[-1].candidate.effects) == (with_it < without)
    assert shown.matrices[-1].elsewhere().force == pytest.approx(min(with_it, without))
    assert [one.kept_out for one in shown.values] == [with_it > without]


@pytest.mark.parametrize(
    ("kept_out", "excess", "by_force"), [(True, 5.0, False), (False, 5.0, False), (False, 1.0, True)]
)
def test_a_file_without_the_effects_of_single_records_takes_no_name_back(
    kept_out: bool, excess: float, by_force: bool
) -> None:
    """A cogging that a record's own phase keeps out of the file; what the file closes is not what the cogging does."""
    layout = parameters(load(), 2)
    ripple = Candidate(layout, np.zeros(layout.count), (Cogging(1.0, 0.0025, 1.0),))
    value = PerRecord("cogging", "phase", "1", (0.7, 1.9), (0.1, 0.1), differs=True, kept_out=kept_out)
    unused: Any = None
    shown = Transfer((), (value, replace(value, part="nominal", name="offset", kept_out=False)))
    terms = Terms(0.1, 0.0036, 0.0036, 0.0011)
    gap = Gap(1.0, 1.0, None)
    far = HowFar((), gap, "simulated", terms, (-0.004, 0.0004), (-0.004, 0.0004), unused, 1.0, transfer=shown)
    assert far.left_out == (("cogging",) if kept_out else ())
    fitted: Any = SimpleNamespace(candidate=ripple)
    closure = Closure(0.94, (0.89, 0.97), excess, unused, by_force=by_force)
    assert is_withdrawn(("cogging",), fitted, closure, far, Criteria()) == (not kept_out)
    at_floor = replace(closure, excess=1.0, by_force=False)
    assert is_withdrawn(("cogging",), fitted, at_floor, far, Criteria()) == (not kept_out)
    assert not is_withdrawn(("cogging",), fitted, at_floor, replace(far, interval=(-0.004, 0.3)), Criteria())


def test_where_nothing_is_left_a_file_that_surely_closes_next_to_nothing_takes_a_name_back() -> None:
    """A thrust ripple of a motor whose thrust fades, by -0.04 to 0.015; a converter's steps are as fine as noise, and a
    right name closed -0.14 to 0.11."""
    layout = parameters(load(), 1)
    unused: Any = None
    terms = Terms(0.1, 0.0036, 0.0036, 0.0011)
    closure = Closure(0.94, (0.89, 0.97), 0.5, unused)
    for effect, high, back in (
        (Cogging(1.0, 0.0025, 1.0), 0.015, True),
        (Cogging(1.0, 0.0025, 1.0), 0.3, False),
        (DacQuantisation.typical(), 0.11, False),
    ):
        fitted: Any = SimpleNamespace(candidate=Candidate(layout, np.zeros(layout.count), (effect,)))
        far = HowFar((), Gap(1.0, 1.0, None), "simulated", terms, (-0.14, high), (-0.14, high), unused, 1.0)
        assert is_withdrawn((effect.name,), fitted, closure, far, Criteria()) == back


@pytest.mark.parametrize(
    ("low", "bent", "back"), [(0.2, False, False), (0.2, True, True), (0.0, False, True), (-1.0, False, True)]
)
def test_on_a_rough_drive_a_name_stands_only_if_it_surely_closes_beside_a_plant_within_its_bounds(
    low: float, bent: bool, back: bool
) -> None:
    """A nut's backlash had been a mode of 242 Hz, with the plant's own at 80 % of its frequency, and as one that closed
    -100 to 100 %."""
    layout = parameters(load(), 1)
    theta = np.where(np.isin(layout.names, ["mode_frequency"]) & bent, layout.high, 0.0)
    rough = Candidate(layout, theta, (Cogging(1.0, 0.0025, 1.0),), roughness=(100.0,))
    unused: Any = None
    terms = Terms(0.1, 0.09, 0.03, 0.0011, measure="force")
    far = HowFar((), Gap(1.0, 1.0, None), "repeats", terms, (low, 1.0), (low, 1.0), unused, 1.0)
    fitted: Any = SimpleNamespace(candidate=rough)
    closure = Closure(0.94, (0.89, 0.97), 0.5, unused)
    assert is_withdrawn(("cogging",), fitted, closure, far, Criteria()) == back
