"""The whole diagnosis on simulated tables: an effect, two, wrong nominal values, nothing wrong, one without a name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from diagnosis import diagnose as module
from diagnosis.diagnose import (
    ATTRIBUTED,
    NONE,
    NOTHING,
    PARAMETERS,
    Diagnosis,
    _bent,
    _endless,
    _outcome,
    _rivals,
    baseline,
    diagnose,
    to_json,
)
from diagnosis.evidence import evidence, examined
from diagnosis.model.fit import SPIKE, at_bounds, largest
from diagnosis.model.parameters import parameters
from diagnosis.model.residual import Candidate
from diagnosis.where.locate import locate
from diagnosis.where.sentences import Topic, statements
from models.effects.base import Effect, H, Numbers, T, V, X, hook, parameter
from models.effects.friction_laws import FrictionRelaxation, ViscousFriction
from models.effects.motor import Cogging
from models.records.record import Record
from tests.diagnosis.tables import LEAD, recorded, schedules, table

MACHINE = table()
PLAN = schedules(MACHINE)
RELAXATION = FrictionRelaxation(0.15, 0.2, 0)


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("null")


def _found(cache: Path, effects: Sequence[Effect], seed: int, wrong: float = 1.0, **options: object) -> Diagnosis:
    records = recorded(MACHINE, PLAN, effects, seed=seed, wrong=wrong)
    return diagnose(MACHINE, records, cache=cache, **options)  # type: ignore[arg-type]


def test_one_effect_is_named_with_its_size_and_closes_the_gap(cache: Path) -> None:
    found = _found(cache, [ViscousFriction(40.0)], 1)
    assert (found.outcome, found.effects) == (ATTRIBUTED, ("viscous_friction",))
    row = to_json(found)["which"][0]
    drag = row["parameters"]["coefficient"]
    assert abs(drag["value"] - 40.0) < 4 * drag["std"] + 0.02 * 40.0
    assert found.how_far.closure > 0.9
    assert found.how_far.interval[0] <= found.how_far.closure <= found.how_far.interval[1]


def test_two_effects_are_both_named(cache: Path) -> None:
    found = _found(cache, [RELAXATION, Cogging(1.5, 0.035, 1.0)], 2)
    assert found.outcome == ATTRIBUTED
    assert set(found.effects) == {"friction_relaxation", "cogging"}


def test_wrong_nominal_values_are_called_so(cache: Path) -> None:
    found = _found(cache, [], 3)
    assert found.outcome == PARAMETERS
    assert found.how_far.to_json()["gap_refitted"]["force_N"] < found.how_far.to_json()["gap_as_delivered"]["force_N"]


def test_a_dead_time_that_is_far_off_is_no_lag(cache: Path) -> None:
    late = replace(MACHINE, plant=replace(MACHINE.plant, dead_time=MACHINE.plant.dead_time + 8e-5))
    found = diagnose(MACHINE, recorded(late, PLAN, seed=9), cache=cache)
    assert found.outcome == PARAMETERS
    assert "dead_time" in found.effects


def test_nothing_is_found_where_nothing_is_wrong(cache: Path) -> None:
    found = _found(cache, [], 4, wrong=0.0)
    assert found.outcome == NOTHING
    assert found.effects == ()


def test_an_effect_that_may_not_be_used_leaves_a_gap_without_a_name(cache: Path) -> None:
    found = _found(cache, [RELAXATION], 5, disabled=("friction_relaxation",))
    assert found.outcome == NONE
    assert found.effects == ()


@hook
def _struck(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:  # noqa: ARG001
    return value + (p[0] if abs(now[T] - p[1]) < 0.4 * now[H] else 0.0)


@dataclass(frozen=True)
class Glitch(Effect):
    """One reading is off."""

    name: ClassVar = "glitch"
    family: ClassVar = "scale"
    equation: ClassVar = "e"
    source: ClassVar = "a test"
    hooks: ClassVar = {"reading": _struck}
    size: float = parameter("m", "error", 1e-7, 1e-6, "amplitude")
    when: float = parameter("s", "its time", 0.0, 10.0, "shape")


def test_a_single_sample_that_no_noise_makes_is_missed_and_pointed_at(cache: Path) -> None:
    size, when = 5e-7, 1.5
    found = _found(cache, [Glitch(size, LEAD + when)], 7)
    assert (found.outcome, found.effects) == (NONE, ())
    begun = found.baseline
    most = largest(begun.nominal)
    assert most.sample == round(when / MACHINE.sample_time)  # of both records
    assert most.deviations > begun.null.spike >= SPIKE
    seen = locate(begun.nominal, begun.records, begun.pieces, spike=begun.null.spike)
    (said,) = (one.text for one in statements(seen) if one.topic == Topic.SPIKE)
    assert said.startswith("Single samples stand out: the reading at 1.5 s of record ")
    less = locate(begun.nominal, begun.records, begun.pieces, spike=1.01 * most.deviations)
    assert all(one.topic != Topic.SPIKE for one in statements(less))


@hook
def _dragging(value: float, p: Numbers, now: Numbers, memory: Numbers, contact: Numbers) -> float:  # noqa: ARG001
    return value - (p[0] * now[V] if abs(now[X] - p[1]) < p[2] else 0.0)


@dataclass(frozen=True)
class DragInAZone(Effect):
    """A short stretch of the way brakes what moves there."""

    name: ClassVar = "drag_in_a_zone"
    family: ClassVar = "friction"
    equation: ClassVar = "-c v"
    source: ClassVar = "a test"
    hooks: ClassVar = {"force": _dragging}
    coefficient: float = parameter("N s/m", "drag", 1.0, 100.0, "amplitude")
    place: float = parameter("m", "its place", 0.0, 0.1, "shape")
    width: float = parameter("m", "half its width", 1e-4, 1e-2, "shape")


def test_a_law_that_only_a_series_of_another_draws_has_no_name(cache: Path) -> None:
    """Sines of place, one after another, come near to a braking zone; none of them is there."""
    found = _found(cache, [DragInAZone(40.0, 0.03, 0.003)], 8)
    assert (found.outcome, found.effects) == (NONE, ())


def test_a_controller_that_does_not_replay_is_named(cache: Path) -> None:
    records = recorded(MACHINE, PLAN, seed=6)
    pid = MACHINE.control.pid
    other = replace(MACHINE, control=replace(MACHINE.control, pid=replace(pid, kp=1.05 * pid.kp)))
    found = diagnose(other, records, cache=cache)
    assert "controller_mismatch" in found.effects


def test_the_answer_is_the_same_each_time_and_with_the_evidence_beside_it(cache: Path) -> None:
    records: tuple[Record, ...] = recorded(MACHINE, PLAN, [ViscousFriction(40.0)], seed=1)
    found = diagnose(MACHINE, records, cache=cache)
    again, stands = examined(baseline(MACHINE, records, cache=cache))
    assert np.array_equal(found.how_far.interval, again.how_far.interval)
    assert to_json(found) == to_json(again)
    assert stands.to_json() == evidence(found).to_json()


def _stage(cost: float, names: Sequence[str], rivals: Sequence[tuple[str, float]] = ()) -> Any:
    effects = tuple(SimpleNamespace(name=name) for name in names)
    candidate = SimpleNamespace(effects=effects, shaken=(), rough=False)
    return SimpleNamespace(fitted=SimpleNamespace(cost=cost, candidate=candidate), rivals=tuple(rivals))


def test_what_explains_as_much_is_a_rival_unless_it_is_in_the_model_too() -> None:
    first, tried = _stage(9000.0, ()), [("cogging", 1000.0), ("play", 1005.0), ("stribeck", 4000.0)]
    second = _stage(1000.0, ("cogging",), tried)
    assert _rivals([first, second]) == (("cogging", "play"),)
    third = _stage(100.0, ("cogging", "play"), [("play", 100.0)])
    assert _rivals([first, second, third]) == ()


def _with(own: Effect, *effects: Effect, cost: float, promised: float = 0.0) -> Any:
    """A stage of a machine whose file has `own`; promised: what one more cogging would gain."""
    layout = parameters(replace(MACHINE, effects=(own,)), 1)
    candidate = Candidate(layout, np.zeros(layout.count), (own, *effects))
    finding = SimpleNamespace(effect=Cogging.typical(), held_out=promised)
    return SimpleNamespace(fitted=SimpleNamespace(cost=cost, candidate=candidate), findings=(finding,))


def test_an_effect_of_the_machine_files_own_neither_makes_a_series_nor_bends_what_is_found() -> None:
    """At the end of its range, and of the same name as the one that was found."""
    own, found, another = (Cogging(size, pitch, 0.0) for size, pitch in ((9.0, 1.0), (1.0, 0.03), (1.0, 0.04)))
    first, second = _with(own, cost=9000.0), _with(own, found, cost=1000.0, promised=6000.0)
    assert at_bounds(own, MACHINE.priors)
    assert not at_bounds(found, MACHINE.priors)
    assert not _bent([first, second])
    assert _endless([first, second]) == set()
    assert _endless([first, second, _with(own, found, another, cost=900.0, promised=6000.0)]) == {"cogging"}


@pytest.mark.parametrize(
    ("closure", "interval", "excess", "outcome"),
    [
        (0.2, (0.05, 0.7), 0.0, ATTRIBUTED),  # noise hides how much it is
        (0.05, (-0.6, 0.7), 0.0, NONE),  # perhaps it is nothing
        (0.1, (0.05, 0.2), 0.0, NONE),  # surely little
        (0.2, (0.05, 0.7), 5.0, NONE),  # something else is left
        (0.6, (0.5, 0.7), 5.0, ATTRIBUTED),
        (0.6, (-0.05, 0.7), 5.0, NONE),  # much in one place, and perhaps nothing elsewhere
    ],
)
def test_a_name_needs_a_gap_that_surely_shrinks(
    closure: float, interval: tuple[float, float], excess: float, outcome: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_bent", lambda _: False)
    closed: Any = SimpleNamespace(closure=closure, interval=interval, excess=excess)
    assert _outcome([_stage(100.0, ("play",))], ["play"], closed, SPIKE) == outcome


@pytest.mark.parametrize(
    ("closure", "interval", "names", "outcome"),
    [
        (0.69, (0.63, 0.76), ["play", "cogging"], ATTRIBUTED),
        (0.96, (0.49, 1.0), ["play", "cogging"], NONE),  # much, and not surely half
        (0.52, (0.51, 0.53), ["play", "cogging"], ATTRIBUTED),
        (0.72, (0.44, 1.0), ["play", "timing_jitter"], ATTRIBUTED),  # a simulation is late elsewhere
        (0.45, (0.44, 1.0), ["play", "timing_jitter"], NONE),
        (0.45, (0.44, 1.0), ["timing_jitter"], ATTRIBUTED),
    ],
)
def test_several_names_need_half_of_the_gap_for_sure(
    closure: float, interval: tuple[float, float], names: list[str], outcome: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_bent", lambda _: False)
    closed: Any = SimpleNamespace(closure=closure, interval=interval, excess=5.0)
    assert _outcome([_stage(100.0, tuple(names))], names, closed, SPIKE) == outcome
