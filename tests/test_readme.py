"""What the README says is what the tool does."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path

import pytest

from design.controller import default_controller
from design.deadbeat import Constraints, DesignError, synthesise
from design.validation import validate
from diagnosis.criteria import SEEDS
from models.machine import load

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
GUIDE = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "reports" / "guide").glob("*.md")}


def test_the_figures_of_the_table_are_computed_ones() -> None:
    row = r"^\| (.+?) \| (?:within )?([\d.]+) \w+ \| ([\d.]+) (ms|µm) \| (?:fitted|predicted) \|$"
    rows = re.findall(row, README, re.MULTILINE)
    assert len(rows) == 4
    machine = load()
    controller = default_controller(machine)
    without, with_rfm = validate(machine, controller.without_compensation()), validate(machine, controller)
    computed = (
        without.reversal.settling_time * 1e3,
        without.worst_dispersion * 1e6,
        with_rfm.reversal.settling_time * 1e3,
        with_rfm.worst_dispersion * 1e6,
    )
    for (name, _, here, _), value in zip(rows, computed, strict=True):
        assert float(here) == pytest.approx(value, abs=0.006 if value < 10 else 0.01), name


def test_the_trial_that_it_quotes_is_the_one_that_is_kept() -> None:
    """Every figure with its target, those that miss it too; and the kept run is one of a clean source tree."""
    folder = ROOT / "reports" / "trial"
    kept = json.loads((folder / "results.json").read_text(encoding="utf-8"))
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["outputs"]["results.json"] == hashlib.sha256((folder / "results.json").read_bytes()).hexdigest()
    assert kept["results"]["cases"] >= 300
    assert f"{kept['results']['cases']} cases of seed {kept['results']['seed']}" in README
    assert kept["results"]["seed"] not in SEEDS  # its probabilities were not read off its own cases
    rows = re.findall(r"^\| ([^|`]+) \| ([^|]+) \| ([≤≥] [^|]+) \| (holds|MISSED) \|$", README, re.MULTILINE)
    told = {name: (value, target, verdict) for name, value, target, verdict in rows}
    guards = 4
    assert all(check["holds"] for check in kept["checks"][:guards])
    assert len(told) == len(kept["checks"]) - guards
    for check in kept["checks"][guards:]:
        unit = "" if check["unit"] == "1" else f" {check['unit']}"
        sense = {"<=": "≤", ">=": "≥"}[check["sense"]]
        verdict = "holds" if check["holds"] else "MISSED"
        assert told[check["name"]] == (
            f"{check['value']:.3g}{unit}" if check["value"] < 1000 else f"{check['value']:.0f}{unit}",
            f"{sense} {check['limit']:g}{unit}",
            verdict,
        )


def test_the_error_that_it_shows_is_the_one_that_is_printed() -> None:
    machine = load()
    with pytest.raises(DesignError) as error:
        synthesise(machine.plant, machine.sample_time, 15e-3, 20e-6, constraints=Constraints(thrust=133.5))
    assert str(error.value).replace("\u00a0", " ") in README


def test_every_study_that_it_lists_is_there_and_every_one_there_is_listed() -> None:
    listed = set(re.findall(r"^\| `(\w+)` \|", README, re.MULTILINE))
    there = {path.parent.name for path in (ROOT / "studies").glob("*/__main__.py")}
    assert listed == there


def test_its_layout_names_every_room_of_a_library_and_no_other() -> None:
    layout = README.partition("## Layout\n")[2].partition("\n## ")[0]
    for library in ("models", "design", "diagnosis"):
        row = re.search(rf"^ +{library}/ .*\n +(.*)$", layout, re.MULTILINE)
        assert row is not None, library
        rooms = {f"{path.parent.name}/" for path in (ROOT / library).glob("*/__init__.py")}
        assert set(row[1].split()) == rooms


def test_the_files_that_it_names_exist() -> None:
    for text in (README, *GUIDE.values()):
        for name in re.findall(r"`((?:models|tests|reports/baseline)/[\w/.]+)`|\]\((reports/[\w/.]+)\)", text):
            assert (ROOT / (name[0] or name[1])).exists(), name


def test_it_leads_to_every_page_of_the_guide_and_is_read_in_minutes() -> None:
    assert set(re.findall(r"\]\(reports/guide/(\w+\.md)\)", README)) == set(GUIDE)
    assert len(README.split()) < 3500  # a guide page holds the rest


def test_tables_that_a_page_of_the_guide_repeats_are_the_same() -> None:
    """A trial's figures stand in the README and on the page that tells their story."""
    rows = {
        row
        for row in README.splitlines()
        if row.startswith("| ") and any(word in row for word in ("missed |", "met |", "holds |"))
    }
    there = {row for row in GUIDE["trials.md"].splitlines() if row.startswith("| ")}
    assert len(rows) >= 18
    assert rows <= there
