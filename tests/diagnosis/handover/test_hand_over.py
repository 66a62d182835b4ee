"""The closure's terms: of the unknown force, and of the position where that does not surely show a gap; and the file
that has some of the effects, where one of them does harm."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from diagnosis.handover import hand_over
from diagnosis.handover.files import Content
from diagnosis.handover.gate import File, Handover, Sums
from diagnosis.handover.hand_over import all_but_one, closure_terms
from diagnosis.how_far import Gap
from diagnosis.model.kalman import Resonance
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.verdict import Outcome
from models.effects.base import Effect
from models.effects.scale import ScalePeriodicError
from models.effects.structure import CableSpring
from models.machine import load

MOTIONS = 40


def _left(force: float, position: float) -> Sums:
    """What a file leaves of motions of a hundred samples each: root mean squares [N] and [m]."""
    scatter, ones = np.random.default_rng(0).uniform(0.8, 1.2, MOTIONS), np.full(MOTIONS, 100.0)
    scatter /= scatter.mean()
    return Sums(force**2 * ones * scatter, position**2 * ones * scatter, ones, 0.0 * ones, 0.0 * ones)


def _files(*left: tuple[float, float]) -> tuple[Sums, Sums, Sums]:
    first, then, last = (_left(*one) for one in left)
    return first, then, last


FLOOR = Gap(1.0, 1e-8, None)


def test_a_gap_in_force_is_closed_in_force() -> None:
    terms, interval = closure_terms(_files((9.0, 5e-7), (3.0, 2e-8), (2.0, 2e-8)), FLOOR)
    assert (terms.measure, terms.to_json()["unit"]) == ("force", "N")
    assert terms.closure() == pytest.approx((9 - 4) / (9 - 1))
    assert interval[0] <= terms.closure() <= interval[1]
    assert terms.closure(terms.delivered) == pytest.approx((81 - 4) / (81 - 1))


def test_where_the_force_is_within_its_floor_the_position_tells() -> None:
    """A mode that is missing hardly shows in a slow unknown force."""
    terms, interval = closure_terms(_files((0.99, 5e-7), (0.98, 5e-8), (0.97, 2e-8)), FLOOR)
    assert (terms.measure, terms.to_json()["unit"]) == ("position", "m")
    assert terms.closure() == pytest.approx((25 - 4) / (25 - 1))
    assert 0.8 < interval[0] <= interval[1] < 0.95


def test_where_the_force_is_not_surely_above_its_floor_the_position_tells() -> None:
    """A mode that is missing left 7.8 mN above a floor of 7.5, and 7.4 nm above 6.3."""
    terms, _ = closure_terms(_files((9.0, 5e-7), (1.01, 5e-8), (1.02, 2e-8)), FLOOR)
    assert terms.measure == "position"
    terms, _ = closure_terms(_files((9.0, 5e-7), (1.1, 5e-8), (1.02, 2e-8)), FLOOR)
    assert terms.measure == "force"
    terms, _ = closure_terms(_files((9.0, 5e-7), (1.01, 1.01e-8), (1.02, 1.0e-8)), FLOOR)
    assert terms.measure == "force"  # as neither is surely
    terms, _ = closure_terms(_files((9.0, 5e-7), (1.01, 5e-8), (1.02, 2e-8)), FLOOR, rough=True)
    assert terms.measure == "force"


def test_what_acts_at_random_adds_to_the_force_alone() -> None:
    terms, _ = closure_terms(_files((0.99, 5e-7), (0.98, 5e-8), (0.97, 2e-8)), FLOOR, random=0.5)
    assert terms.measure == "force"


def test_nothing_closes_a_gap_that_neither_shows() -> None:
    terms, interval = closure_terms(_files((0.99, 9e-9), (0.98, 8e-9), (0.97, 7e-9)), FLOOR)
    assert not terms.shows
    assert terms.closure() == 0.0
    assert interval[0] <= 0.0 <= interval[1]


LAYOUT = parameters(load(), 1)
RIGHT, HARMFUL, TONE = ScalePeriodicError(1e-7, 1e-5, 0.3), CableSpring(900.0), Resonance(47.0, 0.1, 0.04)


def _candidate(*effects: Effect, forces: tuple[Resonance, ...] = ()) -> Candidate:
    return Candidate(LAYOUT, np.zeros(LAYOUT.count), effects, forces)


def _judged_by_its_effects(name: str, made: Any, _: Any = None) -> File:
    """What a spring that is not there does to the position, and an encoder error that is to both."""
    names = [effect.name for effect in made.candidate.effects]
    force, position = (1.0 if "scale_periodic_error" in names else 2.0), (4e-7 if "cable_spring" in names else 2e-7)
    sums, finished = _left(force, position), SimpleNamespace(candidate=made.candidate, fitted=made)
    return File(name, cast(Any, None), Gap(force, position, None), sums, cast(Any, finished))


@pytest.fixture
def stubbed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fits of the files left out: what is tested is which of them are made and chosen."""
    monkeypatch.setattr(hand_over, "finished", lambda given, _: given)
    monkeypatch.setattr(hand_over, "with_fit", _judged_by_its_effects)
    monkeypatch.setattr(hand_over, "is_believed", lambda *_: True)
    monkeypatch.setattr(hand_over, "offset_alone", lambda *_: None)


def _handed(*effects: Effect, forces: tuple[Resonance, ...] = (), adopted: bool = True) -> Handover:
    @dataclass(frozen=True)
    class Made:
        candidate: Candidate

    delivered = replace(_judged_by_its_effects("as delivered", Made(_candidate())), finished=None)
    refitted = _judged_by_its_effects("re-fitted", Made(_candidate()))
    with_all = _judged_by_its_effects("with effects", Made(_candidate(*effects, forces=forces)))
    baseline: Any = SimpleNamespace(records=())
    outcome = Outcome.ATTRIBUTED if adopted else Outcome.NONE
    return hand_over._gated(delivered, [refitted, with_all], [], baseline, outcome)


@pytest.mark.usefixtures("stubbed")
def test_a_file_with_one_harmful_law_is_handed_over_without_it() -> None:
    """As on a stage whose encoder error was sure and whose spring did harm: neither was handed over."""
    for effects in ((RIGHT, HARMFUL), (HARMFUL, RIGHT)):
        found = _handed(*effects)
        assert (found.adopted.name, found.without) == (Content.SOME, ("cable_spring",))
        assert found.adopted.fitted.candidate.effects == (RIGHT,)
        assert [file.name for file in found.files] == [
            "as delivered",
            "re-fitted",
            "with some of the effects",
            "with effects",
        ]
        assert {(harm.file, harm.measure) for harm in found.harms} == {("with effects", "position")}


@pytest.mark.usefixtures("stubbed")
def test_where_nothing_harms_or_nothing_helps_no_law_is_left_out() -> None:
    assert _handed(RIGHT).adopted.name == Content.EFFECTS
    alone = _handed(HARMFUL)
    assert (alone.adopted.name, len(alone.files)) == ("re-fitted", 3)
    unsure = _handed(RIGHT, HARMFUL, adopted=False)
    assert (unsure.adopted.name, len(unsure.files)) == ("as delivered", 3)  # the re-fit leaves as much


@pytest.mark.usefixtures("stubbed")
@pytest.mark.parametrize(("better", "adopted"), [(True, "offset alone"), (False, "as delivered")])
def test_an_offset_that_helps_takes_the_place_of_a_re_fit_that_is_not_believed(
    monkeypatch: pytest.MonkeyPatch, better: bool, adopted: str
) -> None:
    offset = File("offset alone", cast(Any, None), Gap(0.5, 2e-7, None), _left(0.5, 2e-7))
    monkeypatch.setattr(hand_over, "beside_doubted", lambda *_: [offset] if better else [])
    monkeypatch.setattr(hand_over, "is_believed", lambda file, _: file.name == "as delivered")
    found = _handed(RIGHT, adopted=False)
    assert found.adopted.name == adopted
    assert [file.name for file in found.files].count("offset alone") == better
    assert {"re-fitted", "with effects"} <= {file.name for file in found.files}
    monkeypatch.setattr(hand_over, "is_believed", lambda *_: True)
    assert "offset alone" not in [file.name for file in _handed(RIGHT, adopted=False).files]


def test_random_forces_are_left_out_as_one_law() -> None:
    given = _candidate(RIGHT, HARMFUL, forces=(TONE, TONE))
    left = [(name, [effect.name for effect in one.effects], len(one.random_forces)) for name, one in all_but_one(given)]
    assert left == [
        ("scale_periodic_error", ["cable_spring"], 2),
        ("cable_spring", ["scale_periodic_error"], 2),
        ("floor_vibration", ["scale_periodic_error", "cable_spring"], 0),
    ]
    assert list(all_but_one(_candidate(RIGHT))) == []
