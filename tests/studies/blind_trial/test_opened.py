"""The truth of a sealed machine, told once it may be: the one that ran, in the project's own form."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest

from models import nominal_file
from studies.blind_trial.sealer.machines import cases
from studies.blind_trial.sealer.opened import main

SEED, CASE = 5, 6


def test_the_truth_is_what_the_nominal_file_is_off_by(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(f"{SEED} {CASE}\n"))
    assert main(["--file", str(tmp_path / "truth.json")]) == 0
    told = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))
    sealed = cases.plan(SEED, CASE, "sealed")
    assert told["label"]["name"] == [part.name for part in sealed.parts]
    for name, content in (("true", told["nominal"]), ("known", sealed.bench.axis.nominal("known"))):
        (tmp_path / f"{name}.json").write_text(json.dumps(content), encoding="utf-8")
    true, known = (nominal_file.load(tmp_path / f"{name}.json") for name in ("true", "known"))
    assert true.plant.mass / known.plant.mass - 1 == pytest.approx(sealed.shift["payload_mass"], rel=1e-9)
    assert true.control == known.control
    assert true.specification.tolerance == pytest.approx(known.specification.tolerance, rel=0.5)


def test_without_numbers_it_tells_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("please\n"))
    assert main(["--file", str(tmp_path / "truth.json")]) == 2
    assert 'must be "SEED CASE"' in capsys.readouterr().err
    assert not (tmp_path / "truth.json").exists()
