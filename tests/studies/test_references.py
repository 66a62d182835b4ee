"""The references to run on an axis are written beside nothing else, and replace nobody's files."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.experiments.references import FILE_NAMES, axis_references
from models.effects.structure import CableSpring
from models.machine import load
from models.machine_file import save
from models.quantity import parse
from studies.effort import DIAGNOSED, MAX_MEMORY_BYTES, TRANSFERRED
from studies.gap_diagnosis.options import MOST_SAMPLES
from studies.identify_machine.__main__ import main
from studies.identify_machine.references import _room
from studies.new_machine.__main__ import main as new_machine


def test_they_are_written_without_identifying_and_replace_only_themselves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "references"
    asked = ["--write-references", str(folder)]
    assert main(asked) == 0
    assert {one.name for one in folder.iterdir()} == {*FILE_NAMES, "manifest.json"}
    assert (folder / "suite.csv").read_text(encoding="utf-8").startswith("time_s,target_m,reference_m,feedforward_N\n")
    assert main(asked) == 0
    (folder / "strokes.csv").write_text("mine", encoding="utf-8")
    capsys.readouterr()
    assert main(asked) == 2
    assert "strokes.csv in it was not written by" in capsys.readouterr().err
    assert (folder / "strokes.csv").read_text(encoding="utf-8") == "mine"
    assert main([*asked, "record.csv"]) == 2
    assert "leave the records out" in capsys.readouterr().err


def test_the_travels_of_a_rotary_axis_are_angles(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "axis.toml"
    answers = {
        "mass": "0.1 kg m^2", "rated-thrust": "15 N m", "rated-speed": "300 rpm", "sample-time": "400 us",
        "resolution": "0.05 urad", "stroke": "200 urad", "tolerance": "3 urad", "settling-time": "40 ms",
        "friction-force": "0.6 N m", "presliding": "150 urad",
    }  # fmt: skip
    given = [word for name, text in answers.items() for word in (f"--{name}", text)]
    assert new_machine([str(file), *given]) == 0
    capsys.readouterr()
    assert main(["--machine", str(file), "--write-references", str(tmp_path / "run")]) == 0
    extents = [line for line in capsys.readouterr().out.splitlines() if ", from " in line]
    assert len(extents) == 5
    assert all(re.search(r"from .*rad to .*rad, u_ff up to [\d.e-]+ N m$", line) for line in extents)


def test_a_diagnosis_takes_what_is_written_or_says_what_to_give(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Only an axis that takes very many samples to settle has tables that a diagnosis refuses by default."""
    assert MOST_SAMPLES * DIAGNOSED * TRANSFERRED < MAX_MEMORY_BYTES
    machine, file, folder = load(), tmp_path / "axis.toml", ["--write-references", str(tmp_path / "run")]
    for settling, more in ((0.3, False), (1.5, True)):
        wanted = replace(machine.specification, settling_time=settling, interval=2 * settling)
        save(replace(machine, specification=wanted), file)
        assert main(["--machine", str(file), *folder]) == 0
        told = capsys.readouterr().out
        assert ("for a diagnosis of the records of strokes.csv and suite.csv, give --most-samples " in told) == more


def test_where_the_axis_has_to_stand_and_what_a_stated_spring_takes_is_said() -> None:
    """All of a travel of 3 mm is on one side of where the axis stands, and for the way back on the other."""
    machine = load()
    machine = replace(machine, drive=replace(machine.drive, travel=3e-3))
    planned = tuple(axis_references(machine).values())
    said = _room(planned, machine)
    low, high = re.search(r"they reach (-[\d.]+ mm) and ([\d.]+ mm): start each where it has room$", said).groups()  # type: ignore[union-attr]
    ends = [one.given.position - one.given.position[0] for one in planned]
    assert parse(low, "m") == pytest.approx(min(map(min, ends)), rel=1e-2)
    assert parse(high, "m") == pytest.approx(max(map(max, ends)), rel=1e-2)
    held = _room(planned, replace(machine, effects=(CableSpring(15e3),)))
    taken = re.search(r"the stated spring takes up to ([\d.]+ N) beside u_ff$", held)
    assert taken is not None
    assert parse(taken[1], "N") == pytest.approx(15e3 * max(map(np.max, map(np.abs, ends))), rel=1e-2)
