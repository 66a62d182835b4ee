"""What the re-fit and the search decide before any effect is named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from diagnosis.model import residual
from diagnosis.model.fit import at_bounds, fit
from diagnosis.model.motions import numbered, pieces
from diagnosis.model.parameters import FURTHER, applied, bounded, parameters
from diagnosis.model.residual import Candidate, columns, look, smooth
from diagnosis.model.start_states import search, static_equilibrium_start
from diagnosis.null import LEAST
from diagnosis.refit import refit_within
from diagnosis.where.sentences import _drive
from diagnosis.which import select as which
from diagnosis.which.random_force import _steady
from diagnosis.which.scan import freed, peaks, scan
from diagnosis.which.select import ANOTHER, FORM, MOST, REST, SECOND, Step, further, search_effects
from models.effects.base import Effect
from models.effects.catalogue import in_order
from models.effects.friction_laws import DirectionalFriction, FrictionDrift, PositionDependentFriction, Stribeck
from models.effects.motor import Cogging, DacQuantisation, ThrustRipple
from models.effects.priors import USUAL, Priors
from models.friction import elements
from models.machine import Tolerance
from models.simulation.effect_kernel import ACTING
from tests.diagnosis.tables import recorded, schedules, short, table

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


def test_a_table_whose_contacts_are_all_much_softer_is_re_fitted() -> None:
    """By more than each contact's own tolerance and three times the level's."""
    friction = MACHINE.friction
    softer = elements(0.78 * np.array(friction.stiffness), np.array(friction.limit), friction.damping)
    records = recorded(replace(MACHINE, friction=softer), PLAN, seed=17, wrong=0.0)
    found = refit_within(MACHINE, records)
    assert np.mean(found.innovations**2) < 1.02
    assert sum(found.candidate.machine.friction.stiffness) == pytest.approx(sum(softer.stiffness), rel=0.02)


def test_a_load_that_was_left_on_the_table_is_re_fitted() -> None:
    """A quarter of its mass, far beyond the tolerance: else what is left of it looks like a ripple of the thrust."""
    rigid, *flexible = MACHINE.plant.modes
    heavy = replace(MACHINE.plant, modes=(replace(rigid, gain=rigid.gain / 1.25), *flexible))
    records = recorded(replace(MACHINE, plant=heavy), PLAN, seed=18, wrong=0.0)
    found = refit_within(MACHINE, records)
    assert np.mean(found.innovations**2) < 1.02
    assert found.candidate.machine.plant.modes[0].gain == pytest.approx(rigid.gain / 1.25, rel=0.005)


def test_what_is_re_fitted_keeps_to_the_tolerance_of_the_machine_file() -> None:
    loose = replace(MACHINE, tolerance=Tolerance(offset=3.0))
    usual, wide = parameters(MACHINE, 1), parameters(loose, 1)
    (at,) = usual.of("amplifier_offset")
    assert [usual.deviation[at], wide.deviation[at], wide.high[at]] == [0.2, 3.0, 9.0]
    rest = np.setdiff1d(np.arange(usual.count), at)
    assert np.array_equal(usual.high[rest], wide.high[rest])
    theta = np.zeros(wide.count)
    theta[at] = 5.0
    assert applied(wide, theta).tolerance == loose.tolerance


def test_an_effect_of_the_machine_files_own_is_no_finding() -> None:
    """Nor is it the second one of two of a name."""
    own, other = Cogging(1.0, 0.03, 0.0), Cogging(2.0, 0.05, 0.0)
    layout = parameters(replace(MACHINE, effects=(own,)), 1)
    both = in_order((own, Stribeck(0.1, 2e-3), other))
    assert Candidate(layout, np.zeros(layout.count), both).found == [Stribeck(0.1, 2e-3), other]


def test_records_beside_each_other_give_what_they_give_one_after_another(monkeypatch: pytest.MonkeyPatch) -> None:
    records, found = recorded(MACHINE, PLAN, seed=13), []
    for cores in (1, 2):
        monkeypatch.setattr("diagnosis.model.parallel.cpu_count", lambda cores=cores: cores)
        candidate = Candidate(layout := parameters(MACHINE, len(records)), static_equilibrium_start(layout, records))
        fitted = fit(candidate, records, iterations=1)
        found.append((fitted.innovations, fitted.slopes, search(fitted, records).theta))
    assert all(np.array_equal(*pair) for pair in zip(*found, strict=True))
    assert found[0][0].size == sum(record.position.size for record in records)


def test_a_drive_that_follows_beyond_its_rating_is_said() -> None:
    said = list(_drive(SimpleNamespace(beyond_rating=158.12)))  # type: ignore[arg-type]
    assert [one.text for one in said] == [
        "The drive followed commands of up to 158 N, more than the rated thrust of the machine file."
    ]
    assert not list(_drive(SimpleNamespace(beyond_rating=None)))  # type: ignore[arg-type]


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


def _fit(cost: float, *names: str, own: int = 0) -> Any:
    effects = tuple(SimpleNamespace(name=name) for name in names)
    candidate = SimpleNamespace(effects=effects, found=[*effects[own:]], shaken=(), rough=False)
    return SimpleNamespace(cost=cost, candidate=candidate, innovations=np.zeros(3))


def _searched(
    monkeypatch: pytest.MonkeyPatch,
    promises: Mapping[int, Mapping[str, float]],
    costs: Mapping[str, float],
    own: Sequence[str] = (),
    opposed: Sequence[str] = (),
) -> Sequence[Sequence[str]]:
    """Names at each stage where so many effects in the model leave these promises, and each addition this cost;
    own: of the machine file; opposed: whose second member takes from the first."""

    def step(fitted: Any, *_: Any) -> Any:
        found = promises.get(len(fitted.candidate.effects), {})
        findings: Any = [
            SimpleNamespace(effect=SimpleNamespace(name=name), held_out=gain) for name, gain in found.items()
        ]
        return Step(fitted, tuple(findings), SimpleNamespace(steady=0.0), SimpleNamespace()), {}  # type: ignore[arg-type]

    def added(fitted: Any, effect: Any, records: Any) -> Any:  # noqa: ARG001
        return _fit(costs[effect.name], *(one.name for one in fitted.candidate.effects), effect.name, own=len(own))

    monkeypatch.setattr(
        which,
        "_opposed",
        lambda fitted, name: name in opposed and [one.name for one in fitted.candidate.effects].count(name) > 1,
    )
    monkeypatch.setattr(which, "_step", step)
    monkeypatch.setattr(which, "_with", added)
    monkeypatch.setattr(which, "started", lambda fitted, _: fitted)
    stages = search_effects(_fit(2000.0, *own, own=len(own)), (), np.zeros(0, np.int64), {}, np.zeros(1))
    return [[effect.name for effect in stage.fitted.candidate.effects] for stage in stages]


def test_an_effect_whose_fit_gains_nothing_makes_room_for_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    promises = {0: {"play": 900.0, "cogging": 200.0}}
    assert _searched(monkeypatch, promises, {"play": 2001.0, "cogging": 1500.0}) == [[], ["cogging"]]


@pytest.mark.parametrize("own", [(), ("viscous_friction",), ("viscous_friction", "cogging", "play")])
def test_three_effects_are_looked_for_whatever_the_machine_file_holds(
    own: Sequence[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(which, "_bent", lambda *_: False)
    found = ["stribeck", "cable_spring", "thrust_ripple", "gain_asymmetry"]
    promises = {len(own) + i: {name: 900.0} for i, name in enumerate(found)}
    costs = {name: 1500.0 - 400.0 * i for i, name in enumerate(found)}
    stages = _searched(monkeypatch, promises, costs, own)
    assert stages == [[*own, *found[:count]] for count in range(MOST + 1)]


def test_the_first_effect_beside_the_machine_files_own_needs_no_more_than_any_first_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    least = 0.5 * (LEAST + SECOND)
    costs = {"cogging": 2000.0 - least}
    assert _searched(monkeypatch, {1: {"cogging": least}}, costs, ["play"]) == [["play"], ["play", "cogging"]]


@pytest.mark.parametrize(("share", "taken"), [(0.5 * ANOTHER, False), (1.5 * ANOTHER, True)])
def test_a_second_effect_at_its_bounds_counts_only_if_it_is_large(
    share: float, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(which, "_bent", lambda *_: True)
    costs = {"play": 1000.0, "cogging": 1000.0 - 1000.0 * share}
    found = _searched(monkeypatch, {0: {"play": 900.0}, 1: {"cogging": 400.0}}, costs)
    assert found == [[], ["play"], *([["play", "cogging"]] if taken else [])]


@pytest.mark.parametrize(
    ("members", "opposed"),  # the first may be the machine file's own
    [
        ([DirectionalFriction(-0.3, 5e-6, 0), DirectionalFriction(0.1, 6e-5, 1)], True),
        ([DirectionalFriction(-0.3, 5e-6, 0), DirectionalFriction(-0.1, 6e-5, 1)], False),
        ([DirectionalFriction(-0.3, 5e-6, 0), Cogging(1.0, 0.03, 0.0), Cogging(0.5, 0.02, 0.0)], False),
        ([DirectionalFriction(-0.3, 5e-6, 0), FrictionDrift(1e-3)], False),  # of different kinds
    ],
)
def test_members_of_one_kind_that_take_from_each_other_are_the_form_of_one(
    members: list[Effect], opposed: bool
) -> None:
    for own in ((), members[:1]):
        layout = parameters(replace(MACHINE, effects=tuple(own)), 1)
        fitted: Any = SimpleNamespace(candidate=Candidate(layout, np.zeros(layout.count), in_order(members)))
        assert any(which._opposed(fitted, effect.name) for effect in members) == opposed


def test_such_a_member_is_put_aside_and_the_search_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(which, "_bent", lambda *_: False)
    promises = {0: {"stribeck": 900.0}, 1: {"stribeck": 500.0, "cogging": 450.0}, 2: {"stribeck": 500.0}}
    costs = {"stribeck": 1000.0, "cogging": 500.0}
    alone = _searched(monkeypatch, promises, costs, opposed=["stribeck"])
    assert alone == [[], ["stribeck"], ["stribeck", "cogging"]]


@pytest.mark.parametrize("range_", [(1e-3, 4e-3), (1.9e-3, 2.1e-3), (1.999e-3, 2.001e-3)])
def test_a_period_is_found_in_however_narrow_a_range(range_: tuple[float, float]) -> None:
    place = np.linspace(0.0, 0.03, 20_000)
    found = peaks([(place, np.sin(2 * np.pi * place / 2e-3))], *range_, padded=8)
    assert found
    assert all(0.999 * range_[0] <= period <= 1.001 * range_[1] for period in found)
    assert min(abs(period / 2e-3 - 1) for period in found) < 0.01


@pytest.mark.parametrize(
    "law",
    [
        Cogging(1.0, 2.345e-3, 1.0),
        ThrustRipple(0.05, 2.345e-3, 1.0),
        PositionDependentFriction(0.1, 1.234e-3, 1.0),
    ],
    ids=lambda law: law.name,
)
def test_a_period_far_below_the_usual_ones_is_found_where_a_machine_states_it(law: Effect) -> None:
    """By a spectrum over the path, as no grid of periods would be near enough."""
    period = "length" if law.name == "position_dependent_friction" else "pitch"
    stated = replace(MACHINE, priors=Priors.of({(law.name, period): (1e-3, 5e-3)}))
    records = recorded(MACHINE, (short(MACHINE),), [law], seed=15)
    nominal = refit_within(stated, records)
    found, _ = scan(nominal, records, freed(nominal, numbered(pieces(records), records)))
    best = found[0].effect
    assert best.name == law.name
    fitted = which._with(nominal, best, records)
    (adopted,) = fitted.candidate.effects
    assert adopted.values()[:2] == pytest.approx(law.values()[:2], rel=0.1)
    assert adopted.values()[1] == pytest.approx(law.values()[1], rel=1e-3)
    assert not at_bounds(adopted, stated.priors)


def test_what_is_known_of_a_scan_tells_the_next_stage_what_its_own_columns_would() -> None:
    """An effect in the model changes the columns of others to second order only."""
    records = recorded(MACHINE, PLAN, [Cogging(1.5, 0.035, 1.0), Stribeck(0.1, 2e-3)], seed=13)
    nominal = refit_within(MACHINE, records)
    segment = numbered(pieces(records), records)
    _, known = scan(nominal, records, freed(nominal, segment))
    first = which._with(nominal, Cogging(1.5, 0.035, 1.0), records)
    own = freed(first, segment)
    plain, reused = (
        {one.effect.name: one.held_out for one in scan(first, records, own, known=k)[0]} for k in ({}, known)
    )
    assert max(plain, key=lambda name: plain[name]) == "stribeck"
    assert reused == pytest.approx(plain, rel=0.05, abs=0.1 * LEAST)


@given(st.floats(0, 1e-4), st.floats(-1, 1))
def test_no_dead_time_goes_below_zero(dead_time: float, share: float) -> None:
    machine = replace(MACHINE, plant=replace(MACHINE.plant, dead_time=dead_time))
    layout = parameters(machine, 1)
    theta = np.where(layout.of("dead_time")[0] == np.arange(layout.count), share * 1e-3, 0.0)
    moved = applied(layout, bounded(layout, theta)).plant.dead_time
    assert 0.0 <= moved <= dead_time + FURTHER * layout.deviation[layout.of("dead_time")][0] * (1 + 1e-12)


def test_what_is_known_of_a_replay_gives_the_columns_that_replaying_it_gives(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beside an effect on the friction, one that leaves it as it is."""
    records = recorded(MACHINE, PLAN, seed=12)
    layout = parameters(MACHINE, len(records))
    candidate = Candidate(layout, static_equilibrium_start(layout, records), (DirectionalFriction(0.05, 2e-6, 0),))
    paths = smooth(candidate, records)
    seen = look(candidate, records, paths)
    trials = [in_order((*candidate.effects, Cogging(1.0, 0.035, 0.3)))]
    known = columns(candidate, trials, records, paths, seen)
    monkeypatch.setattr(residual, "changed", lambda *_: frozenset(ACTING))
    assert np.abs(known).max() > 1.0
    np.testing.assert_allclose(columns(candidate, trials, records, paths, seen), known, atol=1e-9)


def test_a_step_beyond_its_prior_range_is_no_bent_law() -> None:
    """Many steps tell their size; a shape that only its bound keeps is another law."""
    assert not at_bounds(DacQuantisation(0.15, 1), USUAL)
    assert not at_bounds(Cogging(1.0, 0.05, 0.3), USUAL)
    assert at_bounds(Cogging(1.0, 0.09, 0.3), USUAL)
