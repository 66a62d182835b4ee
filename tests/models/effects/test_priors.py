"""The sizes that a machine file states of effects, in place of their usual ones."""

from __future__ import annotations

import pickle
import re
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.model.fit import OF_PERIOD, at_bounds, fineness
from models.effects.base import parameters
from models.effects.catalogue import SIZES, every, looked_for, ranged, sizes
from models.effects.friction_laws import Stribeck
from models.effects.motor import Cogging
from models.effects.scale import ScalePeriodicError
from models.machine import MachineError, load, to_json
from models.machine import parameters as values
from models.machine_file import to_toml
from models.records.record import Record
from tests.models.effects.test_catalogue import machine_file

SCREW = """
[priors.cogging]
pitch = { value = ["1 mm", "10 mm"], source = "datasheet: a lead of 10 mm" }

[priors.velocity_strengthening]
rise = [0.01, 0.4]

[priors.directional_friction]
asymmetry = ["0.05", "0.4"]

[effects.cogging]
amplitude = "1 N"
pitch = "5 mm"
phase = 0.5
"""


def ranges(kind: type) -> dict[str, tuple[float, float]]:
    return {item.name: (item.low, item.high) for item in parameters(kind)}


def test_stated_sizes_replace_the_usual_ones(tmp_path: Path) -> None:
    kinds = load(machine_file(tmp_path, SCREW)).kinds
    assert ranges(kinds["cogging"]) == ranges(Cogging) | {"pitch": (1e-3, 1e-2)}
    assert kinds["cogging"].typical().values()[1] == pytest.approx(10**-2.5)
    assert ranges(kinds["directional_friction"])["asymmetry"] == (-0.4, 0.4)  # of either sign, as ever
    assert kinds["stribeck"] is every()["stribeck"]


def test_stated_sizes_add_an_effect_that_is_not_looked_for_by_default(tmp_path: Path) -> None:
    assert "velocity_strengthening" not in load().kinds
    kinds = load(machine_file(tmp_path, SCREW)).kinds
    assert list(kinds) == list(every())
    assert ranges(kinds["velocity_strengthening"])["rise"] == (0.01, 0.4)


def test_the_machines_own_effects_have_them_too(tmp_path: Path) -> None:
    machine = load(machine_file(tmp_path, SCREW))
    (own,) = machine.effects
    assert type(own) is machine.kinds["cogging"]
    assert own.values().tolist() == [1.0, 5e-3, 0.5]


def test_a_stated_period_is_told_by_the_travel(tmp_path: Path) -> None:
    """The last of 50 periods is moved by a part of one."""
    (own,) = load(machine_file(tmp_path, SCREW)).effects
    still = np.zeros(100)
    moved = Record(1e-3, still, still, still, still, np.linspace(0.0, 0.25, 100))
    assert fineness(own, [moved]) == pytest.approx(OF_PERIOD * 5e-3 / 0.25)
    assert fineness(Cogging(1.0, 5e-3, 0.0), [moved]) == 0
    for short in (1e-5, 0.0):  # through less than one period the usual step will do
        assert fineness(own, [replace(moved, position=np.linspace(0.0, short, 100))]) == OF_PERIOD
    assert not load(machine_file(tmp_path, SCREW)).kinds["velocity_strengthening"].period_stated
    assert fineness(ScalePeriodicError(1e-8, 2e-5, 0.0), [moved]) == ScalePeriodicError.fine


def test_a_stated_period_at_its_bound_is_bent(tmp_path: Path) -> None:
    kind = load(machine_file(tmp_path, SCREW)).kinds["cogging"]
    assert at_bounds(kind(1.0, 1.5e-2, 0.0))  # type: ignore[call-arg]
    assert not at_bounds(kind(1.0, 5e-3, 0.0))  # type: ignore[call-arg]


def test_an_effect_that_is_put_in_has_them(tmp_path: Path) -> None:
    machine = load(machine_file(tmp_path, SCREW))
    changed = replace(machine, effects=(Cogging(2.0, 3e-3, 0.0), Stribeck(0.1, 2e-3)))
    assert [type(one) for one in changed.effects] == [machine.kinds["cogging"], Stribeck]


def test_another_process_can_have_the_machine(tmp_path: Path) -> None:
    machine, packed = load(machine_file(tmp_path, SCREW)), tmp_path / "machine.pickle"
    packed.write_bytes(pickle.dumps(machine))
    again = pickle.loads(packed.read_bytes())
    assert again == machine
    assert type(again.effects[0]) is machine.kinds["cogging"]
    there = f"import pickle; print(pickle.load(open({str(packed)!r}, 'rb')).effects[0].pitch)"
    asked = subprocess.run([sys.executable, "-c", there], capture_output=True, text=True, check=True)
    assert asked.stdout.strip() == "0.005"


def test_the_same_sizes_make_the_same_class(tmp_path: Path) -> None:
    """Or an effect of one load would not equal that of another."""
    first, second = (load(machine_file(tmp_path, SCREW)) for _ in range(2))
    assert first == second
    assert first.kinds["cogging"] is second.kinds["cogging"]
    assert hash(first.effects) == hash(second.effects)


def test_a_file_keeps_them_with_their_sources(tmp_path: Path) -> None:
    machine = load(machine_file(tmp_path, SCREW))
    again = tmp_path / "again.toml"
    again.write_text(to_toml(machine), encoding="utf-8")
    assert load(again) == machine
    assert load(again).sources == machine.sources
    assert to_json(machine)["priors"] == {
        "velocity_strengthening": {"rise": [0.01, 0.4]},
        "directional_friction": {"asymmetry": [0.05, 0.4]},
        "cogging": {"pitch_m": [1e-3, 1e-2]},
    }
    assert "priors" not in to_json(load())
    rows = {row.name: row for row in values(machine) if row.name.startswith("priors.")}
    assert rows["priors.cogging.pitch"].number == (1e-3, 1e-2)
    assert rows["priors.cogging.pitch"].provenance.detail == "a lead of 10 mm"
    assert rows["priors.velocity_strengthening.rise"].provenance.kind == "assumed"
    assert len(rows) == 3


@pytest.mark.parametrize("name", every())
def test_every_effect_can_have_its_usual_sizes_stated(name: str) -> None:
    """Which leave the ranges as they are; no phase and no switch has a size."""
    kind = every()[name]
    usual = {item.name: (item.typical**2 / item.high, item.high) for item in parameters(kind) if item.role in SIZES}
    assert {field.name for field in fields(sizes(kind))} == set(usual)
    stated = ranged(kind, sizes(kind)(**usual))
    assert stated is not kind
    for ours, theirs in zip(parameters(stated), parameters(kind), strict=True):
        assert (ours.name, ours.unit, ours.role) == (theirs.name, theirs.unit, theirs.role)
        assert [ours.low, ours.high, ours.typical] == pytest.approx([theirs.low, theirs.high, theirs.typical])
    assert (stated.equation, stated.hooks, stated.fine) == (kind.equation, kind.hooks, kind.fine)
    assert kind.typical().strength() == abs(stated.typical().strength())
    assert ranged(kind, None) is kind


def test_without_any_the_usual_effects_are_looked_for() -> None:
    assert list(load().kinds.items()) == list(looked_for().items())
    assert all(kind.usual for kind in looked_for().values())


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('[priors.coging]\npitch = ["1 mm", "10 mm"]', "priors.coging: unknown; did you mean 'cogging'?"),
        ('[priors.cogging]\npich = ["1 mm", "10 mm"]', "priors.cogging.pich: unknown; did you mean 'pitch'?"),
        ('[priors.cogging]\nphase = ["0.1", "3"]', "priors.cogging.phase: unknown"),
        ('[priors.cogging]\npitch = ["10 mm", "1 mm"]', "priors.cogging: pitch: is no range; give"),
        ('[priors.cogging]\npitch = ["0 mm", "1 mm"]', "priors.cogging: pitch: is no range; give"),
        ('[priors.cogging]\npitch = ["1 mm", "2 mm", "3 mm"]', "priors.cogging: pitch: is no range; give"),
        ('[priors.cogging]\npitch = "1 mm"', "priors.cogging.pitch: '1 mm' is no list"),
        (
            '[priors.cogging]\npitch = ["1 N", "2 N"]',
            "priors.cogging.pitch: '1 N' is in N, but this is a quantity in m",
        ),
        ("[priors.directional_friction]\nasymmetry = [0.1, 1.5]", "asymmetry: 1.5 must be below 1"),
        ("[priors.cogging]", "priors.cogging: has no range; give the least and the most of amplitude, say"),
        ("[priors]\ncogging = 3", "priors.cogging: is no table; write [priors.cogging] with its values below"),
        ("priors = 3", "priors: is no table; write [priors.NAME]"),
        (
            '[[priors.cogging]]\npitch = ["1 mm", "2 mm"]\n[[priors.cogging]]\npitch = ["1 mm", "2 mm"]',
            "priors.cogging: stands there twice; state an effect's sizes once, in [priors.cogging]",
        ),
    ],
)
def test_every_mistake_gets_its_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    path = machine_file(tmp_path, "")
    plain = path.read_text(encoding="utf-8")
    path.write_text(f"{text}\n{plain}" if text.startswith("priors") else f"{plain}\n{text}\n", encoding="utf-8")
    with pytest.raises(MachineError, match=re.escape(sentence)):
        load(path)
