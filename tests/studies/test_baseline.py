"""The quick runs on the default machine, beside those kept in reports/baseline: a change of a result is seen."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from studies.catalogue import every
from studies.command import to_text
from tests.studies.baseline import FOLDER, kept

LARGEST = 10_000  # bytes of a study's baseline, so that a person reads what changed in it


def test_every_study_has_a_baseline() -> None:
    assert {path.parent.name for path in FOLDER.glob("*/results.json")} == set(every())


@pytest.mark.parametrize("name", sorted(every()))
def test_a_baseline_holds_only_what_is_compared(name: str) -> None:
    text = (FOLDER / name / "results.json").read_text(encoding="utf-8")
    assert text == to_text(kept(json.loads(text)))
    assert len(text) < LARGEST


@pytest.mark.parametrize("name", sorted(every()))
def test_checks_and_machine_are_those_of_the_baseline(name: str, quick_run: Callable[[str], tuple[Path, int]]) -> None:
    """Within a hundredth: a rounding of the scale may fall otherwise on another processor, an outcome may not. What is
    four powers of ten below its limit may be rounding alone."""
    kept = json.loads((FOLDER / name / "results.json").read_text(encoding="utf-8"))
    folder, _ = quick_run(name)
    now = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    assert now["machine"] == kept["machine"], "run make baseline if the default machine was meant to change"
    assert [check["name"] for check in now["checks"]] == [check["name"] for check in kept["checks"]]
    for check, before in zip(now["checks"], kept["checks"], strict=True):
        assert check["holds"] == before["holds"], check["name"]
        if before["value"] is not None and abs(before["value"]) > 1e-4 * abs(before["limit"]):
            assert check["value"] == pytest.approx(before["value"], rel=0.01), check["name"]
