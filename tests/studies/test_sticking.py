"""What a user reads of a loop that only the sticking friction makes unstable: in the terminal, a report, with code."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from design.validation import sequence
from models.machine import load
from models.machine_file import to_toml
from models.simulation.simulator import simulate
from reports.text import fill
from studies.catalogue import every
from studies.command import CHECK_MISSED, DONE, main
from studies.deadbeat_design.__main__ import STUDY as DEADBEAT
from studies.export.__main__ import STUDY as EXPORT
from studies.export.compute import NEVER
from studies.gap_diagnosis.compute import _sticking
from studies.sticking import QUIET, found_in
from studies.study import Study
from tests.design.machines import far_side


@pytest.fixture(scope="module")
def belt(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The machine file of a table with its scale on the far side of a belt."""
    machine = far_side(load())
    file = tmp_path_factory.mktemp("belt") / "belt.toml"
    control = replace(machine.control, compensator_elements=1)
    file.write_text(to_toml(replace(machine, control=control)), encoding="utf-8")
    return file


def results_of(folder: Path) -> Any:
    return json.loads((folder / "results.json").read_text(encoding="utf-8"))["results"]


def test_a_design_says_why_its_motions_never_settle(belt: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = belt.parent / "design"
    assert main(DEADBEAT, ["--machine", str(belt), "--quick", "--output", str(folder)]) == CHECK_MISSED
    told = capsys.readouterr().out
    page = (folder / "report.html").read_text(encoding="utf-8").replace("\u00a0", " ")
    assert "WARNING, while the friction sticks" in told
    for text in (told, page):
        assert "unstable: against a slope of 2160 N/mm it swings at 33 Hz" in text
        assert "the mode of negative gain at 38 Hz" in text
        assert "judge by records" in text
    assert results_of(folder)["sticking"]["modes_Hz"] == [38.0]


def test_an_export_warns_of_a_controller_under_which_motions_never_settle(
    belt: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = belt.parent / "export"
    given = ["--machine", str(belt), "--quick", "--no-report", "--target", "st", "--output", str(folder)]
    assert main(EXPORT, given) == DONE
    told, page = capsys.readouterr().out, (folder / "README.md").read_text(encoding="utf-8")
    assert NEVER in told
    assert "motions never settle under this controller" in page
    for text in (told, page):
        assert "the mode of negative gain at 38 Hz" in text


@pytest.mark.parametrize("study", ["deadbeat_design", "export"])
def test_the_default_machine_is_not_warned_of(study: str, quick_run: Callable[[str], tuple[Path, int]]) -> None:
    folder, _ = quick_run(study)
    results = results_of(folder)
    assert "sticking" not in results
    assert "while the friction sticks" not in (folder / "report.html").read_text(encoding="utf-8")
    if study == "export":
        assert not results["drive"]["never"]
        assert "never settle under" not in (folder / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("name", ["gap_diagnosis", "identify_machine"])
def test_what_is_told_of_such_a_machine_begins_with_it(name: str, quick_run: Callable[[str], tuple[Path, int]]) -> None:
    """Of a gantry on a rack, files and gaps that the model's own swing had made were told as the axis's."""
    whole = json.loads((quick_run(name)[0] / "results.json").read_text(encoding="utf-8"))
    study = every()[name]
    assert "while the friction sticks" not in _page(study, whole)
    machine = far_side(load())
    found = _sticking(machine, ()) if name == "gap_diagnosis" else found_in(machine)
    whole["results"] |= found
    page = _page(study, whole)
    assert "loop is unstable: against a slope of 2160 N/mm it swings at 33 Hz" in page
    assert ("their noise floor are told from simulations of that loop" in page) == (name == "gap_diagnosis")


def _page(study: Study, whole: dict[str, Any]) -> str:
    report = study.report(whole)
    captions = {figure.name: figure.caption for figure in report.figures}
    filled = fill(report.template, whole, captions, report.filters)
    return " ".join(filled.replace("\\", "").replace("\u00a0", " ").replace("\u2060", "").split())


def test_that_the_axis_itself_is_quiet_is_told_where_its_records_show_it() -> None:
    """A user's axis did not swing, whose model did: its friction damps what sticks, which no page had said."""
    machine, quiet = far_side(load()), load()
    target = sequence(quiet, None, 1)
    record = simulate(quiet, quiet.feedback_only(), target).record
    assert QUIET in found_in(machine, records=[record])["sticking"]["advice"]
    swing = 3e-6 * np.sin(2 * np.pi * 180 * record.sample_time * np.arange(target.size))
    swinging = replace(record, position=record.position + swing)
    for records in ([], [swinging], [record, swinging]):
        assert QUIET not in found_in(machine, records=records)["sticking"]["advice"]
