"""What the benchmark of the diagnosis says: one row a table, its time against the target, reached or not."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest

from studies.blind_trial.packs import Case
from tests.benchmark import diagnosis
from tests.benchmark.diagnosis import TARGET, Time, diagnosed, times


def test_a_time_beyond_the_target_is_a_miss() -> None:
    assert str(Time("case-001", "single", "attributed", TARGET - 1, 9.0)).endswith("reached")
    assert str(Time("case-001", "single", "attributed", TARGET + 1, 9.0)).endswith("MISSED")


def test_every_table_is_diagnosed_from_nothing_and_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    taken: Iterator[float] = iter((20.0, 10.0, 40.0, 15.0))

    def stand_in(case: Case, place: Path) -> float:
        (place / "out").mkdir(exist_ok=True)
        verdict = {"outcome": f"said of {case.name}"}
        (place / "out" / "results.json").write_text(json.dumps({"results": {"verdict": verdict}}), encoding="utf-8")
        return next(taken)

    monkeypatch.setattr(diagnosis, "diagnosed", stand_in)
    rows = list(times(2, 1, tmp_path, lambda _: None))
    assert [(row.case, row.said, row.first, row.kept) for row in rows] == [
        ("case-01", "said of case-01", 20.0, 10.0),
        ("case-02", "said of case-02", 40.0, 15.0),
    ]


def test_a_command_that_fails_says_why(tmp_path: Path) -> None:
    nothing = tmp_path / "none.csv"
    with pytest.raises(RuntimeError, match=r"none\.csv"):
        diagnosed(Case("case-001", (nothing,), tmp_path / "nominal.json", ()), tmp_path)
