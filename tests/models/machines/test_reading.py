"""How a value and its source are written in a machine file, and read again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from models.machine import MachineError, Provenance, load
from models.machine_file import to_toml
from models.plant import Mode, Plant
from tests.models.test_machine import FOUND, changed


def test_a_source_keeps_its_record_and_deviation_in_a_file(tmp_path: Path) -> None:
    spread = tuple(1e3 * (i + 1) / 3 for i in range(len(load().friction.stiffness)))
    machine = load().with_value("plant.modes.1.gain", 0.05, FOUND)
    machine = machine.with_value("friction.damping", machine.friction.damping, replace(FOUND, note="n", std=spread))
    machine = machine.with_value("scale.noise", 2e-9, replace(FOUND, std=1e-10, shares=((0.6, 0.0, -0.79999999),)))
    machine = machine.with_value("plant.dead_time", 1e-3, replace(FOUND, at_limit=True))
    each = tuple((0.5,) * (i % 3) for i in range(len(spread)))
    machine = machine.with_value("friction.limit", machine.friction.limit, replace(FOUND, std=spread, shares=each))
    path = tmp_path / "machine.toml"
    path.write_text(to_toml(machine), encoding="utf-8")
    again = load(path)
    assert again == machine
    assert again.sources == machine.sources


def test_whole_numbers_of_a_program_have_their_units_in_a_file(tmp_path: Path) -> None:
    plant = Plant(0, 1, modes=(Mode(1, 0, 0), Mode(-1, 100, 0)))
    machine = replace(load(), plant=plant)
    path = tmp_path / "machine.toml"
    path.write_text(to_toml(machine), encoding="utf-8")
    assert load(path) == machine


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ('std = "3 kg"', r"scale\.noise\.std: '3 kg' is in kg"),
        ('std = "-1 nm"', r"scale\.noise\.std: -1 nm must be at least 0"),
        ('std = ["1 nm"]', r"scale\.noise\.std: must be one text, or a list"),
        ('at_limit = "yes"', r"scale\.noise\.at_limit: must be true or false, without quotes"),
        ("shares = [[0.5]]", r"scale\.noise\.shares: needs a std beside it"),
        (
            'std = "1 nm", shares = [[0.5], [0.5]]',
            r"scale\.noise\.shares: needs a std beside it, and a list of one list",
        ),
        ('std = "1 nm", shares = 0.5', r"scale\.noise\.shares: needs a std beside it"),
        ('std = "1 nm", shares = [["a"]]', r"scale\.noise\.shares: \['a'\] must be a list of numbers"),
        ('std = "1 nm", shares = [[true]]', r"scale\.noise\.shares: \[True\] must be a list of numbers"),
        ('std = "1 nm", shares = [[nan]]', r"scale\.noise\.shares: the squares of \[nan\] are more than 1"),
        (
            'std = "1 nm", shares = [[0.8, -0.7]]',
            r"scale\.noise\.shares: the squares of \[0\.8, -0\.7\] are more than 1",
        ),
    ],
)
def test_a_deviation_that_cannot_be_is_said(tmp_path: Path, entry: str, said: str) -> None:
    path = changed(tmp_path, r"noise = \{", f"noise = {{ {entry}, ")
    with pytest.raises(MachineError, match=said):
        load(path)


def test_a_source_in_words_as_earlier_versions_wrote_it_is_kept_as_it_is(tmp_path: Path) -> None:
    words = "record a, b.csv sha256 12ab, std 2e-05 1/kg"
    path = changed(tmp_path, r"noise = \{.*\}", f'noise = {{ value = "1 nm", source = "identified: {words}" }}')
    machine = load(path)
    assert machine.sources["scale.noise"] == Provenance("identified", words)
    path.write_text(to_toml(machine), encoding="utf-8")
    assert load(path).sources == machine.sources
