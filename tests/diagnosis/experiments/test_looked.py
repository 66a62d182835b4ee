"""Looks at records that came one after another: each is tested on what came after it, and names count by that."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.baseline import refit_and_null
from diagnosis.experiments import looked as module
from diagnosis.experiments.active import Settings
from diagnosis.experiments.e_process import EProcess
from diagnosis.experiments.look import Found
from diagnosis.experiments.looked import earlier_looks, standing, with_last
from diagnosis.experiments.policy import CHANCE
from diagnosis.experiments.schedules import strokes
from diagnosis.verdict import Outcome
from models.effects.friction_laws import ViscousFriction
from models.machine import load
from tests.diagnosis.tables import recorded, table

SURE = -np.log(CHANCE)


def test_drag_is_confirmed_by_a_new_record_that_has_it_and_not_by_one_without(null_cache: Path) -> None:
    """The look names it on the first record; the evidence is that of the second alone."""
    machine, moves = table(), (strokes(table(), 10e-3, (0.1,), passes=2),)
    (first,) = recorded(machine, moves, [ViscousFriction(40.0)], seed=1, wrong=0.0)
    earlier = earlier_looks(machine, (first,), (1,), Settings(cache=null_cache), begun=EProcess())
    assert earlier.found[0].names == ("viscous_friction",)
    assert earlier.processes == (EProcess(),)
    for effects, sure in (([ViscousFriction(40.0)], True), ([], False)):
        (second,) = recorded(machine, moves, effects, seed=2, wrong=0.0)
        _, process = with_last(earlier, refit_and_null(machine, (first, second), cache=null_cache))
        assert process.is_confirmed("viscous_friction", CHANCE) is sure


def test_each_look_is_at_the_records_that_there_were_and_is_tested_on_those_since(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Records are numbers here, and a baseline is the records that it is of."""
    seen: list[tuple[Any, Any]] = []

    def tested(before: Any, now: Any, process: EProcess) -> EProcess:
        seen.append((before.baseline, now))
        return process.after(10.0, {"play": 10.0})

    found = Found(Outcome.NOTHING, (), (), {})
    monkeypatch.setattr(module, "refit_and_null", lambda _machine, records, **_: records)
    monkeypatch.setattr(module, "look", lambda baseline, **_: SimpleNamespace(found=found, baseline=baseline))
    monkeypatch.setattr(module, "tested", tested)
    begun, records = EProcess(3.0), (1, 2, 3, 4)
    earlier = earlier_looks(load(), records, (1, 3), Settings(), begun=begun)  # type: ignore[arg-type]
    processes = with_last(earlier, records)  # type: ignore[arg-type]
    assert seen == [((1,), (1, 2, 3)), ((1, 2, 3), records)]
    assert [one.any > before.any for before, one in pairwise(processes)] == [True, True]
    assert processes[0] == begun


def test_a_name_counts_from_the_first_look_on_or_once_it_was_confirmed() -> None:
    """Also where later records make it less sure: the chance is that of ever being sure."""
    sure, less = EProcess(SURE, {"play": SURE}), EProcess(SURE, {"play": 0.0, "cogging": SURE - 0.1})
    assert standing(("play", "cogging", "stribeck"), ("stribeck",), (EProcess(), sure, less)) == ("play", "stribeck")
    assert standing(("play",), (), (EProcess(), less)) == ()
