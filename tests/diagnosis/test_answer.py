"""What is read off the stages of a search before the verdict: rivals, series, laws at the end of their range."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.answer import (
    Answer,
    broadband,
    closes_too_little,
    not_seen_to_repeat,
    overfitting_series,
    rivalling,
    small_beside,
    strongest_at_bound,
)
from diagnosis.baseline import Baseline
from diagnosis.criteria import Criteria
from diagnosis.experiments.schedules import amplitude_ladder, strokes, together
from diagnosis.model.fit import Fit, fit, parameters_at_bounds
from diagnosis.model.kalman import Resonance
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.records.motions import pieces
from diagnosis.records.units import loop_time
from diagnosis.verdict import Outcome
from diagnosis.which.stage import Proposal, Stage, strongest_first
from models.effects.base import Effect
from models.effects.friction_laws import Stribeck, ViscousFriction
from models.effects.motor import Cogging
from models.effects.structure import CableSpring, HardeningSpring
from tests.diagnosis.tables import nominal_with, recorded, table

MACHINE, CRITERIA = table(), Criteria()


def _fit(cost: float, effects: Sequence[Effect] = (), own: Sequence[Effect] = ()) -> Fit:
    layout = parameters(replace(MACHINE, effects=tuple(own)), 1)
    nothing = np.zeros((3, 0))
    candidate = Candidate(layout, np.zeros(layout.count), (*own, *effects))
    return Fit(candidate, (), (), np.zeros(3), nothing, nothing, cost, 0.0)


def _stage(cost: float, added: str | None = None, rivals: Sequence[tuple[str, float]] = ()) -> Stage:
    return Stage(_fit(cost), added=added, rivals=tuple(rivals))


def test_what_explains_as_much_is_a_rival_unless_it_is_in_the_model_too() -> None:
    first, tried = _stage(9000.0), [("cogging", 1000.0), ("play", 1005.0), ("stribeck", 4000.0)]
    second = _stage(1000.0, "cogging", tried)
    assert rivalling([first, second], CRITERIA) == (("cogging", "play"),)
    third = _stage(100.0, "play", [("play", 100.0)])
    assert rivalling([first, second, third], CRITERIA) == ()


def test_what_leaves_no_more_force_is_a_rival_though_chi_square_prefers_the_other() -> None:
    first, tried = _stage(9000.0), [("thrust_ripple", 1000.0), ("play", 2000.0)]
    second = replace(_stage(1000.0, "thrust_ripple", tried), by_force=("play",))
    assert rivalling([first, second], CRITERIA) == (("thrust_ripple", "play"),)
    assert rivalling([first, replace(second, by_force=())], CRITERIA) == ()


def test_the_strongest_effect_is_the_one_that_took_off_the_most_in_all_its_stages() -> None:
    stages = [_stage(1000.0), _stage(600.0, "play"), _stage(300.0, "cogging"), _stage(150.0, "cogging")]
    assert strongest_first(stages) == ("cogging", "play")


def _with(own: Effect, *effects: Effect, cost: float, promised: float = 0.0) -> Stage:
    """A stage of a machine whose file has `own`; promised: what one more cogging would gain."""
    proposal = Proposal("cogging", promised, 20.0, effect=Cogging.typical())
    return Stage(_fit(cost, effects, [own]), (proposal,), added="cogging" if effects else None)


def test_an_effect_of_the_machine_files_own_neither_makes_a_series_nor_is_found_at_its_bounds() -> None:
    """At the end of its range, and of the same name as the one that was found."""
    own, found, another = (Cogging(size, pitch, 0.0) for size, pitch in ((9.0, 1.0), (1.0, 0.03), (1.0, 0.04)))
    first, second = _with(own, cost=9000.0), _with(own, found, cost=1000.0, promised=6000.0)
    assert parameters_at_bounds(own, MACHINE.priors)
    assert not parameters_at_bounds(found, MACHINE.priors)
    assert not strongest_at_bound([first, second])
    assert overfitting_series([first, second], CRITERIA) == set()
    third = _with(own, found, another, cost=900.0, promised=6000.0)
    assert overfitting_series([first, second, third], CRITERIA) == {"cogging"}
    enough = CRITERIA.series_gain * 8000.0
    modest = _with(own, found, another, cost=900.0, promised=0.99 * enough)
    assert overfitting_series([first, second, modest], CRITERIA) == set()


def test_a_force_over_all_frequencies_is_no_vibration() -> None:
    """Lines that gain nearly as much as the first one, in two stages and beside them; a floor's third gains nothing."""

    def of(*gains: float) -> list[Stage]:
        lines = [Proposal("floor_vibration", one, 40.0, random_force=Resonance(10.0, 0.1, 1.0)) for one in gains]
        names = [None, *("floor_vibration" for _ in gains)]
        return [Stage(_fit(0.0), (line,), added=name) for line, name in zip(lines, names, strict=False)]

    assert broadband(of(412.0, 270.0, 142.0), CRITERIA) == {"floor_vibration"}
    assert broadband(of(9668.0, 48.0, 20.0), CRITERIA) == set()
    assert broadband(of(412.0, 270.0), CRITERIA) == set()
    assert broadband([*of(412.0, 270.0, 142.0)[:2], Stage(_fit(0.0), added="floor_vibration")], CRITERIA) == set()


def test_a_found_effect_at_the_end_of_its_range_is_seen() -> None:
    own = Cogging(0.1, 0.03, 0.0)
    bent = Cogging(1.0, 9.0, 0.0)
    assert strongest_at_bound([_with(own, cost=9000.0), _with(own, bent, cost=1000.0)])


def test_a_law_of_the_same_kind_that_gains_little_beside_another_is_a_part_of_its_form() -> None:
    """A drag and a falling friction are both odd laws of the speed; cogging is none."""
    drag, falling, cogging = ViscousFriction.typical(), Stribeck.typical(), Cogging.typical()
    first = replace(_stage(10000.0), fitted=_fit(10000.0))
    second = replace(_stage(2000.0, "viscous_friction"), fitted=_fit(2000.0, [drag]))
    for left, parts in ((1000.0, {"stribeck": "viscous_friction"}), (200.0, {})):
        third = replace(_stage(left, "stribeck"), fitted=_fit(left, [drag, falling]))
        assert small_beside([first, second, third], CRITERIA) == parts
    other = replace(_stage(1000.0, "cogging"), fitted=_fit(1000.0, [drag, cogging]))
    assert small_beside([first, second, other], CRITERIA) == {}


def test_a_part_of_a_form_has_no_rivals() -> None:
    drag, falling = ViscousFriction.typical(), Stribeck.typical()
    stages = [
        _stage(10000.0),
        replace(_stage(2000.0, "viscous_friction"), fitted=_fit(2000.0, [drag])),
        replace(
            _stage(1500.0, "stribeck", [("stribeck", 1500.0), ("play", 1501.0)]), fitted=_fit(1500.0, [drag, falling])
        ),
    ]
    assert rivalling(stages, CRITERIA) == (("stribeck", "play"),)
    assert rivalling(stages, CRITERIA, small_beside(stages, CRITERIA)) == ()


def test_what_surely_closes_less_than_half_is_no_answer_unless_something_else_carries_it() -> None:
    fitted = _fit(100.0, [Cogging.typical()])
    assert closes_too_little(["cogging"], fitted, (0.1, 0.4), 0.5)
    assert closes_too_little(["cogging"], fitted, (-1.0, -1.0), 0.5)
    assert not closes_too_little(["cogging"], fitted, (0.1, 0.6), 0.5)
    assert not closes_too_little(["controller_mismatch", "cogging"], fitted, (0.0, 0.0), 0.5)


SPRING = CableSpring(100.0)


def _over_14_mm(*found: Cogging) -> tuple[Answer, Baseline]:
    """The answer that a table on a spring of 100 N/m has cogging, which it has."""
    machine = replace(MACHINE, effects=(SPRING,))
    moves = [
        amplitude_ladder(machine, (5e-6, 100e-6)),
        strokes(machine, 2e-3, (0.02,)),
        strokes(machine, 14e-3, (0.1,)),
    ]
    records = recorded(machine, [together("short", moves)], (SPRING, *found), seed=2, wrong=0.0)
    floors: Any = SimpleNamespace(floors=lambda made: np.full(2, float(sum(one.position.size for one in made))))
    plain, whole = (nominal_with(machine, effects, records) for effects in ((), found))
    final = fit(whole.candidate, records, paths=whole.paths, iterations=8, walk=whole.walk)
    baseline = Baseline(plain, records, pieces(records, loop_time(machine)), floors)
    scanned = tuple(Proposal(one.name, 1e6, 20.0, effect=one) for one in (Cogging.typical(), HardeningSpring.typical()))
    closure: Any = None
    stages = (Stage(plain, scanned), Stage(final, added="cogging"))
    return Answer(stages, ("cogging",), closure, Outcome.ATTRIBUTED), baseline


@pytest.mark.parametrize(
    ("found", "ambiguous"),
    [
        ((Cogging(1.5, 12e-3, 0.7),), False),  # 1.17 periods, as on a user's axis: the spring leaves a quarter
        ((Cogging(1.5, 25e-3, 0.7),), True),  # half of one
        ((Cogging(1.5, 12e-3, 0.7), Cogging(0.2, 5e-3, 0.1)), True),  # a sum draws any bend
    ],
)
def test_a_sine_of_few_periods_is_ambiguous_where_a_bent_spring_leaves_as_little(
    found: tuple[Cogging, ...], ambiguous: bool
) -> None:
    """A cogging that was found to 0.4 mN over 1.17 periods had been told to be as well a spring that hardens."""
    answer, baseline = _over_14_mm(*found)
    assert not_seen_to_repeat(answer, baseline) == ((("cogging", "hardening_spring"),) if ambiguous else ())
