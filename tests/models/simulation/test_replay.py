"""A replay with an earlier answer known: only what other effects act on is computed again."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np
import pytest

from models.effects.base import Effect, Numbers, Place, U, hook
from models.effects.catalogue import every
from models.effects.parameter import parameter
from models.machine import load
from models.simulation.effect_kernel import ACTING, Replayed, changed, kept, replay
from tests.models.effects.laws import laws
from tests.models.effects.paths import through

FRICTION = load().friction
POINTS = np.cumsum(np.random.default_rng(0).uniform(-3e-6, 3e-6, 300))
PATH = through(POINTS, command=5e6 * POINTS)


def assert_same(one: Replayed, other: Replayed) -> None:
    for field in fields(Replayed):
        assert np.array_equal(getattr(one, field.name), getattr(other, field.name)), field.name


@pytest.mark.parametrize(
    "beside", ["cogging", "directional_friction forgets", "current_loop_lag", "scale_periodic_error"]
)
@pytest.mark.parametrize("name", sorted(laws()))
def test_what_an_effect_leaves_as_it_is_need_not_be_computed_again(name: str, beside: str) -> None:
    before, effect = [laws()[beside]], laws()[name]
    bare = replay(FRICTION, before, PATH, 1e-3)
    now = [*before, effect]
    assert_same(
        replay(FRICTION, now, PATH, 1e-3), replay(FRICTION, now, PATH, 1e-3, known=kept(bare, changed(before, now)))
    )
    assert_same(
        bare, replay(FRICTION, before, PATH, 1e-3, known=kept(replay(FRICTION, now, PATH, 1e-3), changed(now, before)))
    )


def test_only_the_quantities_that_an_effect_touches_are_replayed_anew() -> None:
    assert changed([every()["cogging"].typical()], [every()["cogging"].typical()]) == frozenset()
    assert changed([], [every()["cogging"].typical()]) == {"force"}
    assert changed([], [every()["timing_jitter"].typical()]) == {"thrust"}
    assert changed([every()["play"].typical()], []) == {"friction"}


@hook
def _counting(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:  # noqa: ARG001
    memory[0] += 1.0
    return value + p[0] * memory[0]


@hook
def _counted(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:  # noqa: ARG001
    return value + p[0] * memory[0] * now[U]


@dataclass(frozen=True)
class Both(Effect):
    """Counts in the force what it uses in the friction."""

    name: ClassVar = "both"
    family: ClassVar = "motor"
    equation: ClassVar = "n"
    source: ClassVar = "a test"
    hooks: ClassVar = {Place.FORCE: _counting, Place.FRICTION: _counted}
    size: float = parameter("N", "a call", 0.1, 1.0, "amplitude")

    def memory(self, elements: int) -> int:  # noqa: ARG002
        return 1


@pytest.mark.parametrize("beside", ["cogging", "dac_quantisation", "thrust_ripple"])
def test_an_effect_whose_hooks_share_a_memory_is_computed_as_a_whole(beside: str) -> None:
    before, now = [Both(1e-3)], [Both(1e-3), every()[beside].typical()]
    assert changed(before, now) >= ({"thrust"} if beside == "thrust_ripple" else {"force", "friction"})
    bare = replay(FRICTION, before, PATH, 1e-3)
    assert_same(
        replay(FRICTION, now, PATH, 1e-3), replay(FRICTION, now, PATH, 1e-3, known=kept(bare, changed(before, now)))
    )


def test_what_is_known_is_taken_as_it_is() -> None:
    bare = replay(FRICTION, (), PATH, 1e-3)
    for name in ACTING:
        known = {field: 2.0 * array for field, array in kept(bare, ACTING.keys() - {name}).items()}
        again = replay(FRICTION, (), PATH, 1e-3, known=known)
        for field in fields(Replayed):
            factor = 2.0 if field.name in known else 1.0
            assert np.array_equal(getattr(again, field.name), factor * getattr(bare, field.name))
