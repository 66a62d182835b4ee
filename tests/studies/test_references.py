"""The references to run on an axis are written beside nothing else, and replace nobody's files."""

from __future__ import annotations

from pathlib import Path

import pytest

from diagnosis.experiments.references import NAMES
from studies.identify_machine.__main__ import main


def test_they_are_written_without_identifying_and_replace_only_themselves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "references"
    asked = ["--write-references", str(folder)]
    assert main(asked) == 0
    assert {one.name for one in folder.iterdir()} == {*NAMES, "manifest.json"}
    assert (folder / "suite.csv").read_text(encoding="utf-8").startswith("time_s,target_m,reference_m,feedforward_N\n")
    assert main(asked) == 0
    (folder / "strokes.csv").write_text("mine", encoding="utf-8")
    capsys.readouterr()
    assert main(asked) == 2
    assert "strokes.csv in it was not written by" in capsys.readouterr().err
    assert (folder / "strokes.csv").read_text(encoding="utf-8") == "mine"
    assert main([*asked, "record.csv"]) == 2
    assert "leave the records out" in capsys.readouterr().err
