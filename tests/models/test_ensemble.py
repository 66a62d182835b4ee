"""The ensemble file: a base machine and what differs in its members."""

from __future__ import annotations

from pathlib import Path

import pytest

from models.ensemble import DEFAULT, load_ensemble, to_text
from models.machine import DEFAULT as MACHINE
from models.machine import MachineError, load


def test_the_default_machine_is_one_of_the_sixty() -> None:
    machine, members = load(), load_ensemble()
    assert len(members) >= 50
    assert any(
        (one.plant, one.friction, one.control) == (machine.plant, machine.friction, machine.control) for one in members
    )
    assert len({(one.plant, one.friction, one.control.pid) for one in members}) == len(members)


def test_members_differ_only_where_the_file_says(tmp_path: Path) -> None:
    (tmp_path / "base.toml").write_text(MACHINE.read_text(encoding="utf-8"), encoding="utf-8")
    text = to_text(
        "base.toml", "assumed: a test", "two tables", [{"plant.dead_time": "0.9 ms"}, {"plant.modes.2.damping": "0.5"}]
    )
    (tmp_path / "set.toml").write_text(text, encoding="utf-8")
    first, second = load_ensemble(tmp_path / "set.toml")
    assert first.plant.dead_time == 0.9e-3
    assert first.friction == load().friction
    assert first.sources["plant.dead_time"].detail == "a test"
    assert second.plant.modes[1].damping == 0.5
    assert second.plant.dead_time == load().plant.dead_time
    assert first.name.endswith("member 1")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("member = []", "base is missing"),
        (f'base = "{MACHINE}"\n[[member]]\n"plant.modes.9.gain" = "1 1/kg"', "not in the base machine"),
        (f'base = "{MACHINE}"\n[[member]]\n"plant.dead_tim" = "1 ms"', "did you mean 'dead_time'"),
        (f'base = "{MACHINE}"\n[[member]]\n"plant.dead_time" = "1 kg"', "is in kg"),
    ],
)
def test_a_mistake_is_said(tmp_path: Path, content: str, says: str) -> None:
    path = tmp_path / "set.toml"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(MachineError, match=says):
        load_ensemble(path)
    assert DEFAULT.is_file()
