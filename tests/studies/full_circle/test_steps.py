"""A step is made again for exactly what it was made from."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from studies.full_circle.steps import Steps, program, sources
from studies.manifest import ROOT


def test_a_step_is_reused_for_the_same_and_made_again_for_anything_else(tmp_path: Path) -> None:
    made = list[Any]()

    def work() -> dict[str, int]:
        made.append(None)
        return {"count": len(made)}

    def step(program: str, **used: Any) -> tuple[Any, bool]:
        return Steps(tmp_path, program).done("one", used, work)

    assert step("p", records={"a.csv": "1"}) == ({"count": 1}, False)
    assert step("p", records={"a.csv": "1"}) == ({"count": 1}, True)
    assert step("p", records={"a.csv": "2"}) == ({"count": 2}, False)
    assert step("p", records={"a.csv": "2", "b.csv": "3"}) == ({"count": 3}, False)
    assert step("q", records={"a.csv": "2", "b.csv": "3"}) == ({"count": 4}, False)
    (tmp_path / "one.json").write_text("[]", encoding="utf-8")
    assert step("q", records={"a.csv": "2", "b.csv": "3"}) == ({"count": 5}, False)
    assert len(made) == 5


def test_a_step_follows_from_what_its_answer_is_made_by_and_not_from_how_it_is_shown(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    names = {file.relative_to(ROOT).as_posix() for file in sources()}
    made = {"diagnosis/diagnose.py", "models/machines/linear_motor_table.toml", "studies/gap_diagnosis/compute.py"}
    assert names >= made | {"studies/gap_diagnosis/answer.py", "studies/wording.py", "studies/full_circle/asked.py"}
    assert not {name for name in names if name.endswith(("/report.py", "/figures.py", "/report.md"))}
    before = program()
    monkeypatch.setattr("studies.full_circle.steps.lock_hash", lambda: "other versions")
    assert program() != before
