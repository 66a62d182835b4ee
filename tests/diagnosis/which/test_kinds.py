"""Kind before form: which kind decides, what a law in another form leaves to a second name, and what is said beside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.answer import drawn_curves
from diagnosis.criteria import Criteria
from diagnosis.model.fit import Fit
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.records.motions import numbered, pieces
from diagnosis.records.units import with_units
from diagnosis.refit import refit_within
from diagnosis.which.detectors.scan import linear_columns, partial_out, scan
from diagnosis.which.kinds import OfKind, beside_free_forms, periods_shown, with_free_forms
from diagnosis.which.stage import Proposal, Stage, excluded
from models.effects.base import VISIBLE_SIGNALS, Effect
from models.effects.catalogue import every
from models.effects.friction_laws import DirectionalFriction, FrictionDrift, Stribeck, ViscousFriction
from models.effects.measured import Measured
from models.effects.motor import Cogging
from models.effects.structure import CableSpring
from models.records.record import Record
from tests.diagnosis.tables import fitted_with, nominal_with, recorded, short, table

MACHINE, CRITERIA = table(), Criteria()
SPEED = Stribeck.kind()


@pytest.mark.parametrize(
    ("share", "rival", "decides"),
    [(0.9, 0.3, True), (0.9, 0.8, False), (0.6, 0.1, False), (0.75, 0.5, False), (0.75, 0.4, True)],
)
def test_a_kind_decides_that_explains_most_and_has_no_rival(share: float, rival: float, decides: bool) -> None:
    assert OfKind(SPEED, share, rival).decides(CRITERIA) == decides


def test_laws_over_one_coordinate_are_of_one_kind() -> None:
    alike = {name for name, kind in every().items() if kind.kind() == SPEED}
    assert alike == {"stribeck", "viscous_friction", "velocity_strengthening"}


def _record(travel: float) -> Record:
    still = np.zeros(50)
    return Record(1e-3, still, still, still, still, np.linspace(0.0, travel, 50))


def test_a_law_over_the_position_repeats_as_often_as_the_travel_holds_its_period() -> None:
    assert periods_shown(Cogging(1.0, 0.03, 0.0), [_record(0.01), _record(0.06)]) == pytest.approx(2.0)
    assert periods_shown(ViscousFriction(10.0), [_record(0.05)]) == float("inf")


def test_a_pitch_beyond_the_travel_beside_its_kind_draws_any_curve() -> None:
    long, short_, spring = Cogging(1.0, 0.06, 0.0), Cogging(1.0, 0.02, 0.0), CableSpring(100.0)
    for effects, drawn in (
        ((long, spring), {"cogging"}),
        ((long, short_), {"cogging"}),
        ((short_, spring), set()),
        ((long, ViscousFriction(10.0)), set()),
        ((long,), set()),
    ):
        assert drawn_curves(effects, [_record(0.05)], CRITERIA) == drawn


@pytest.fixture(scope="module")
def records() -> tuple[Record, ...]:
    return recorded(MACHINE, (short(MACHINE),), seed=1)


def test_a_second_law_that_the_first_ones_free_form_draws_gains_less(records: tuple[Record, ...]) -> None:
    """A fall of friction over ten times the fitted speed goes into the free form; a cogging does not."""
    fitted = nominal_with(MACHINE, (Stribeck(0.1, 2e-3),), records)
    own = partial_out(fitted, numbered(pieces(records), records))
    far = Proposal("directional_friction", 1e6, 20.0, effect=DirectionalFriction(0.05, 2e-6, 0))
    same = Proposal("viscous_friction", 1e6, 20.0, effect=ViscousFriction(30.0))
    less = {one.name: one.gain for one in beside_free_forms((far, same), fitted, records, own)}
    assert less["directional_friction"] < 1e6  # no more than it has in truth, which is nothing
    assert less["viscous_friction"] == 1e6  # of the same kind: left to the refits
    plain = nominal_with(MACHINE, (), records)
    none = partial_out(plain, numbered(pieces(records), records))
    assert beside_free_forms((far, same), plain, records, none) == (far, same)


def test_no_proposal_keeps_a_gain_that_a_free_form_explains_as_it_is_a_late_one(records: tuple[Record, ...]) -> None:
    """Only the first five were looked at: a sixth then came before them all."""
    fitted = nominal_with(MACHINE, (Stribeck(0.1, 2e-3),), records)
    own = partial_out(fitted, numbered(pieces(records), records))
    kinds = (kind for kind in every().values() if kind.kind() != SPEED and kind.shown_in() in VISIBLE_SIGNALS)
    many = [Proposal(kind.name, 1e6, 20.0, effect=kind.typical()) for kind in kinds]
    assert len(many) > 12
    assert max(one.gain for one in beside_free_forms(many, fitted, records, own)) < 1e6


@pytest.mark.parametrize(
    ("law", "alike", "other"),
    [
        (ViscousFriction(3000.0), Stribeck(0.1, 2e-3), FrictionDrift(1e-3)),
        (CableSpring(1e6), Cogging(1.0, 1e-2, 0.0), ViscousFriction(30.0)),
    ],
)
def test_a_law_without_a_shape_has_curves_over_its_coordinate_for_a_free_form(
    law: Effect, alike: Effect, other: Effect, records: tuple[Record, ...]
) -> None:
    """It explains another law over that coordinate and leaves one over another. A drag that grows with the square of
    speed, too, had left 63 of chi-square to a cogging that was not there."""
    fitted = nominal_with(MACHINE, (law,), records)
    own = partial_out(fitted, numbered(pieces(records), records))
    free = with_free_forms(own, fitted, records)
    left = []
    for effect in (alike, other):
        column = linear_columns([effect], fitted, records)[0][:, :1]
        left.append(float(np.linalg.norm(free(column)) / np.linalg.norm(own(column))))
    assert left[0] < 0.5
    assert left[1] > 0.8


@pytest.mark.parametrize("beside", [(), (Cogging(0.5, 0.02, 0.3),)])
def test_beside_a_drag_in_another_form_a_second_law_gains_what_is_its_own(beside: tuple[Effect, ...]) -> None:
    """The drag grows with the square of speed alone. A straight one leaves twice of what chance may gain to a friction
    over the position that is not there; a cogging that is keeps all it gains."""
    speeds = np.linspace(0.0, 0.3, 60)
    drag = Measured("speed", tuple(speeds), tuple(-10.0 * speeds**2), "odd")
    made = recorded(MACHINE, (short(MACHINE),), (drag, *beside), seed=3, wrong=0.5)
    fitted = fitted_with(refit_within(with_units(MACHINE, made), made), ViscousFriction(30.0), made)
    own = partial_out(fitted, numbered(pieces(made), made))
    least = CRITERIA.min_gain
    found = [Proposal(one.effect.name, one.held_out, least, effect=one.effect) for one in scan(fitted, made, own)[0]]
    less = {one.name: one.gain for one in beside_free_forms(found, fitted, made, own)}
    best = found[0]
    assert best.name == (beside[0].name if beside else "position_dependent_friction")
    assert best.gain > 2 * least
    assert less[best.name] > 0.95 * best.gain if beside else less[best.name] < 0.5 * least


def test_what_would_help_with_the_wrong_sign_is_excluded() -> None:
    wrong = Proposal("stribeck", 0.0, 20.0, effect=Stribeck(0.1, 2e-3), forbidden=500.0)
    small, right = replace(wrong, forbidden=10.0), replace(wrong, in_sample_gain=900.0)
    assert [excluded(Stage(_nothing(), (one,)), 0.25) for one in (wrong, small, right)] == [("stribeck",), (), ()]
    more = Proposal("cogging", 3000.0, 20.0, effect=Cogging(1.0, 0.03, 0.0))
    assert excluded(Stage(_nothing(), (more, wrong)), 0.25) == ()


def _nothing() -> Fit:
    layout, nothing = parameters(MACHINE, 1), np.zeros((3, 0))
    return Fit(Candidate(layout, np.zeros(layout.count)), (), (), np.zeros(3), nothing, nothing, 0.0, 0.0)
