"""What the README says is what the tool does."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from design.controller import default_controller
from design.deadbeat import Constraints, DesignError, synthesise
from models.machine import load
from studies.validation import validate

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_figures_of_the_table_are_computed_ones() -> None:
    rows = re.findall(r"^\| (.+?) \| ([\d.]+) \w+ \| ([\d.]+) (ms|µm) \|$", README, re.MULTILINE)
    assert len(rows) == 3
    machine = load()
    controller = default_controller(machine)
    without, with_rfm = validate(machine, controller.without_compensation()), validate(machine, controller)
    computed = (
        without.positive()[0].settling_time * 1e3,
        without.worst_dispersion * 1e6,
        with_rfm.worst_dispersion * 1e6,
    )
    for (name, _, here, _), value in zip(rows, computed, strict=True):
        assert float(here) == pytest.approx(value, abs=0.006 if value < 10 else 0.01), name


def test_the_error_that_it_shows_is_the_one_that_is_printed() -> None:
    machine = load()
    with pytest.raises(DesignError) as error:
        synthesise(machine.plant, machine.sample_time, 15e-3, 20e-6, constraints=Constraints(thrust=133.5))
    assert str(error.value).replace("\u00a0", " ") in README


def test_every_study_that_it_lists_is_there_and_every_one_there_is_listed() -> None:
    listed = set(re.findall(r"^\| `(\w+)` \|", README, re.MULTILINE))
    there = {path.parent.name for path in (ROOT / "studies").glob("*/__main__.py")}
    assert listed == there


def test_the_files_that_it_names_exist() -> None:
    for name in re.findall(r"`((?:models|tests|reports/baseline)/[\w/.]+)`|\]\((reports/[\w/.]+)\)", README):
        assert (ROOT / (name[0] or name[1])).exists(), name
