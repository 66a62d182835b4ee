"""Spoiled machine files: no traceback, no hang, no design that is wrong. `make fuzz` tries twenty times as many."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from models.machine import DEFAULT
from tests.studies.fuzz import HungError, at_most, fuzz, outcome

MUTANTS = 500


def test_five_hundred_spoiled_machine_files_are_refused_in_a_line_or_designed_for() -> None:
    outcomes, wrong = fuzz(MUTANTS, seed=0)
    assert wrong == []
    assert outcomes["designed"] > MUTANTS / 10  # the mutants are not all refused at the door
    assert outcomes["refused at loading"] > MUTANTS / 3


def test_a_hang_and_a_traceback_would_be_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(HungError), at_most(0.05):
        sum(1 for _ in itertools.count())
    monkeypatch.setattr("tests.studies.fuzz.load", lambda _path: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        outcome(DEFAULT.read_text(encoding="utf-8"), tmp_path)
