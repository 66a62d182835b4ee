"""The draft of an effect: a module that the catalogue loads, and that simulates as the table does."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import models.effects
from models.effects.catalogue import every
from models.effects.measured import Measured
from models.machine import load
from models.simulation.simulator import simulate
from studies.command import BAD_INPUT, to_text
from studies.gap_diagnosis.__main__ import main
from studies.gap_diagnosis.draft import draft, require_draftable, written
from studies.options import BadInputError
from tests.models.effects.test_catalogue import machine_file
from tests.models.simulation.test_simulator import TARGET, controlled
from tests.studies.gap_diagnosis.test_unknown_law import LEARNED

OVER_PATH: Mapping[str, Any] = {
    **LEARNED,
    "coordinate": "path",
    "symmetry": "directional",
    "knots": [0.0, 4e-6, 2e-5],
    "values": [0.5, -1.0, 0.25],
    "slow_m_per_s": 0.0,
    "turn_m": 3e-7,
}
TABLE = Measured("path", (0.0, 4e-6, 2e-5), (0.5, -1.0, 0.25), "directional", turn=3e-7)


def test_the_draft_is_an_effect_of_the_catalogue_that_simulates_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "stiction_dip.py").write_text(draft(OVER_PATH, "stiction_dip", ["moves.csv"]), encoding="utf-8")
    monkeypatch.setattr(models.effects, "__path__", [*models.effects.__path__, str(tmp_path)])
    try:
        kind = every()["stiction_dip"]
        assert kind.kind().parity == "odd"
        machine = load(machine_file(tmp_path, '[effects.stiction_dip]\nfactor = "1"\n'))
        assert machine.effects == (kind.typical(),)
        controller = controlled(machine)
        drafted, nominal = simulate(machine, controller, TARGET), simulate(load(), controller, TARGET)
        tabled = simulate(replace(machine, effects=(TABLE,)), controller, TARGET)
        assert np.array_equal(drafted.position, tabled.position)
        assert np.array_equal(drafted.record.command, tabled.record.command)
        assert np.max(np.abs(drafted.record.command - nominal.record.command)) > 0.1
        assert np.array_equal(kind.typical().off().values()[-3:], [0.0, 0.0, 0.0])
    finally:
        sys.modules.pop("models.effects.stiction_dip", None)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("My Law.py", "cannot be a file of models/effects"),
        ("law.txt", "cannot be a file of models/effects"),
        ("cogging.py", "an effect is called 'cogging' already"),
        ("measured.py", "an effect is called 'measured' already"),
        ("nowhere/law.py", "does not exist; create it"),
        ("there.py", "there.py exists; give another name, or --overwrite"),
    ],
)
def test_what_cannot_become_a_draft_is_refused_before_the_work(
    name: str, sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "there.py").write_text("mine", encoding="utf-8")
    assert main(["--draft-effect", str(tmp_path / name), "--output", str(tmp_path / "out")]) == BAD_INPUT
    (error,) = capsys.readouterr().err.splitlines()
    assert sentence in error
    assert not (tmp_path / "out").exists()


def test_an_existing_file_makes_way_if_asked(tmp_path: Path) -> None:
    (tmp_path / "there.py").write_text("mine", encoding="utf-8")
    require_draftable(tmp_path / "there.py", overwrite=True)
    with pytest.raises(BadInputError):
        require_draftable(tmp_path / "there.py", overwrite=False)


@pytest.mark.parametrize(
    ("learned", "why"), [(None, "need no law"), ({"adopted": False, "reason": "too few"}, "too f")]
)
def test_without_a_law_there_is_no_draft(learned: Any, why: str, tmp_path: Path) -> None:
    content: dict[str, Any] = {"results": {"learned": learned, "records": [{"name": "moves.csv"}]}}
    (tmp_path / "results.json").write_text(to_text(content), encoding="utf-8")
    assert why in written(tmp_path / "law.py", tmp_path)
    assert not (tmp_path / "law.py").exists()
    content["results"]["learned"] = OVER_PATH
    (tmp_path / "results.json").write_text(to_text(content), encoding="utf-8")
    assert written(tmp_path / "law.py", tmp_path) == f"draft:   {tmp_path / 'law.py'}"
    assert "learned it from moves.csv" in (tmp_path / "law.py").read_text(encoding="utf-8")
