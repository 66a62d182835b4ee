"""Several effects: shares over the orders of addition, and an effect that another makes useless."""

from __future__ import annotations

import itertools
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from diagnosis.answer import form_parts, small_beside
from diagnosis.baseline import Baseline
from diagnosis.criteria import Criteria
from diagnosis.model.fit import Fit, bounds_of, fit
from diagnosis.model.parameters import parameters
from diagnosis.null import Null
from diagnosis.records.motions import pieces
from diagnosis.refit import refit
from diagnosis.which import prune as module
from diagnosis.which.prune import prune, shares
from diagnosis.which.stage import Stage
from models.effects.base import Effect
from models.effects.base import parameters as effect_parameters
from models.effects.catalogue import in_order
from models.effects.friction_laws import Stribeck, ViscousFriction
from models.effects.motor import Cogging
from models.effects.structure import CableSpring
from tests.diagnosis.tables import recorded, schedules, table

NAMES = ("a", "b", "c")


@given(st.lists(st.floats(0.1, 10.0), min_size=3, max_size=3))
def test_where_effects_do_not_meet_a_share_is_the_own_gain(gains: list[float]) -> None:
    own = dict(zip(NAMES, gains, strict=True))
    subsets = [frozenset(n for i, n in enumerate(NAMES) if bits >> i & 1) for bits in range(8)]
    found = shares({subset: 100.0 - sum(own[n] for n in subset) for subset in subsets}, NAMES)
    assert found == pytest.approx({name: gain / sum(gains) for name, gain in own.items()})


def test_two_that_explain_the_same_share_it() -> None:
    costs = {frozenset(): 10.0, frozenset("a"): 4.0, frozenset("b"): 4.0, frozenset("ab"): 4.0}
    assert shares(costs, "ab") == pytest.approx({"a": 0.5, "b": 0.5})


def _with(fitted: Fit, effect: Effect, records: tuple) -> Fit:  # type: ignore[type-arg]
    candidate = replace(fitted.candidate, effects=in_order((*fitted.candidate.effects, effect)))
    return fit(candidate, records, paths=fitted.paths, iterations=4, walk=fitted.walk)


def test_an_effect_that_another_makes_useless_is_taken_out() -> None:
    machine = table()
    records = recorded(machine, schedules(machine), [Cogging(1.5, 0.035, 1.0)], seed=2)
    nominal = refit(parameters(machine, len(records)), records)
    first = _with(nominal, ViscousFriction(30.0), records)
    both = _with(first, Cogging(1.0, 0.035, 0.5), records)
    stages = [Stage(nominal), Stage(first, added="viscous_friction"), Stage(both, added="cogging")]
    nothing = Null({}, tuple((0.0,) * len(records) for _ in range(2)), (4.0, 4.0))
    found = prune(stages, Baseline(nominal, records, pieces(records), nothing))
    assert found.shares == {"cogging": 1.0}
    assert [effect.name for effect in found.stages[-1].fitted.candidate.effects] == ["cogging"]
    assert found.stages[-1].fitted.cost < both.cost + 20.0


@pytest.fixture(scope="module")
def bounded() -> tuple[list[Stage], Baseline]:
    """A table with a cogging and a friction that falls over four times the speeds that are looked for."""
    machine = table()
    (speed,) = (item for item in effect_parameters(Stribeck, machine.priors) if item.name == "speed")
    highest = bounds_of(speed)[1]
    wrong = (Cogging(1.5, 0.035, 1.0), Stribeck(0.1, 4 * highest))
    records = recorded(machine, schedules(machine), wrong, seed=2)
    nominal = refit(parameters(machine, len(records)), records)
    first = _with(nominal, wrong[0], records)
    both = _with(first, Stribeck(0.1, highest / 1.1), records)
    stages = [Stage(nominal), Stage(first, added="cogging"), Stage(both, added="stribeck")]
    nothing = Null({}, tuple((0.0,) * len(records) for _ in range(2)), (4.0, 4.0))
    return stages, Baseline(nominal, records, pieces(records), nothing)


@pytest.mark.parametrize(("least", "kept"), [(0.3, {"cogging"}), (0.0, {"cogging", "stribeck"})])
def test_what_has_run_to_a_bound_has_to_gain_a_good_part_of_what_the_others_do(
    bounded: tuple[list[Stage], Baseline], least: float, kept: set[str]
) -> None:
    """When it was tried it may have been within its range still."""
    stages, baseline = bounded
    first, second = (one.fitted.cost - after.fitted.cost for one, after in itertools.pairwise(stages))
    assert 100 < second < 0.3 * first
    found = prune(stages, replace(baseline, criteria=Criteria(min_gain_at_bound=least, form_error=0.0)))
    assert set(found.shares) == kept


def fake_fits(bound: set[str]) -> dict[frozenset[str], SimpleNamespace]:
    """Costs of which b explains what a does, and more, and runs to a bound with it."""
    costs = {"": 1000.0, "a": 600.0, "b": 525.0, "ab": 520.0}
    return {
        frozenset(names): SimpleNamespace(cost=cost, innovations=np.full(1, cost**0.5), bound=bound & set(names))
        for names, cost in costs.items()
    }


@pytest.mark.parametrize("bound", [set(), {"a"}, {"b"}, {"a", "b"}])
def test_what_is_useless_goes_before_what_runs_to_a_bound(bound: set[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """a gains 5 beside b, less than chance; it may be what drove b to its bound."""
    monkeypatch.setattr(module, "runs_to_bounds", lambda fitted, name: name in fitted.bound)
    monkeypatch.setattr(module, "force_left", lambda _fitted, _records: 1.0)
    baseline: Any = SimpleNamespace(criteria=Criteria(), thresholds={"a": 40.0}, floors=(4.0, 4.0), records=())
    fits: Any = fake_fits(bound)
    assert module._needed(["a", "b"], fits, baseline) == {"b"}


@pytest.mark.parametrize(("least", "kept"), [(0.5, {"a", "b"}), (0.7, {"a"})])
def test_what_takes_off_the_force_may_run_to_a_bound(
    least: float, kept: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a pair of which b gains a fifth of what a does and takes off 0.64 of the force's energy."""
    costs = {"": 1000.0, "a": 500.0, "b": 900.0, "ab": 400.0}
    fits: Any = {
        frozenset(names): SimpleNamespace(
            cost=cost, innovations=np.full(1, cost**0.5), force=0.6 if "b" in names else 1
        )
        for names, cost in costs.items()
    }
    monkeypatch.setattr(module, "runs_to_bounds", lambda _fitted, name: name == "b")
    monkeypatch.setattr(module, "force_left", lambda fitted, _records: fitted.force)
    criteria = Criteria(force_share_of_slow=least)
    baseline: Any = SimpleNamespace(criteria=criteria, thresholds={}, floors=(4.0, 4.0), records=())
    assert module._needed(["a", "b"], fits, baseline) == kept


@pytest.mark.parametrize(("gain", "share"), [(5.0, 0.99), (400.0, 0.5)])
def test_shares_are_of_the_force_where_a_name_is_needed_for_that_alone(
    gain: float, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """b takes the force from 1 to 0.1 N while it gains 5 beside the 400 of a, or as much as a."""
    subsets = [frozenset(), frozenset("a"), frozenset("b"), frozenset("ab")]
    fits: Any = {
        one: SimpleNamespace(
            cost=1000.0 - 400.0 * ("a" in one) - gain * ("b" in one),
            innovations=np.full(1, 20.0),
            force=(0.1 if "b" in one else 1.0) * (0.999 if "a" in one else 1.0),
        )
        for one in subsets
    }
    monkeypatch.setattr(module, "force_left", lambda fitted, _records: fitted.force)
    baseline: Any = SimpleNamespace(criteria=Criteria(), thresholds={}, floors=(4.0, 4.0), records=())
    assert shares(module._costs(frozenset("ab"), fits, baseline), "ab")["b"] == pytest.approx(share, abs=0.02)


@pytest.fixture(scope="module")
def springy() -> tuple[list[Stage], Baseline]:
    """A table with a cogging and a spring; in its stages the spring comes last."""
    machine = table()
    wrong = (Cogging(0.5, 0.035, 1.0), CableSpring(300.0))
    records = recorded(machine, schedules(machine)[1:], wrong, seed=3)
    nominal = refit(parameters(machine, len(records)), records)
    first = _with(nominal, wrong[0], records)
    stages = [
        Stage(nominal),
        Stage(first, added="cogging"),
        Stage(_with(first, wrong[1], records), added="cable_spring"),
    ]
    nothing = Null({}, tuple((0.0,) * len(records) for _ in range(2)), (4.0, 4.0))
    return stages, Baseline(nominal, records, pieces(records), nothing)


@pytest.mark.parametrize(("least", "kept"), [(0.5, {"cogging", "cable_spring"}), (1.1, {"cable_spring"})])
def test_what_takes_off_most_of_the_force_is_needed_whatever_it_gains(
    springy: tuple[list[Stage], Baseline], least: float, kept: set[str]
) -> None:
    """No chi-square is enough here; a share of more than 1 can't be reached."""
    stages, baseline = springy
    criteria = Criteria(min_gain_further=1e9, force_share_of_slow=least)
    assert set(prune(stages, replace(baseline, criteria=criteria)).shares) == kept


@pytest.mark.parametrize(("least", "found"), [(0.5, {"cogging"}), (1.1, {"cogging", "cable_spring"})])
def test_a_spring_beside_a_cogging_is_no_part_of_its_form(
    springy: tuple[list[Stage], Baseline], least: float, found: set[str]
) -> None:
    stages, baseline = springy
    little = Criteria(form_part=1e9, force_share_of_slow=least)  # whatever it gains is little beside the other
    assert set(small_beside(stages, little)) == {"cogging", "cable_spring"}
    assert form_parts(stages, replace(baseline, criteria=little)).keys() == found
