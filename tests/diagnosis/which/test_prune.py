"""Several effects: shares over the orders of addition, and an effect that another makes useless."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from diagnosis.baseline import Baseline
from diagnosis.model.fit import Fit, fit
from diagnosis.model.motions import pieces
from diagnosis.model.parameters import parameters
from diagnosis.null import Null
from diagnosis.refit import refit
from diagnosis.which.prune import prune, shares
from diagnosis.which.stage import Stage
from models.effects.base import Effect
from models.effects.catalogue import in_order
from models.effects.friction_laws import ViscousFriction
from models.effects.motor import Cogging
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
