"""What a machine file lacks is said all at once, and where a value of another kind belongs."""

from __future__ import annotations

import copy
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from models.machine import DEFAULT, MachineError, from_table, read_table


def refusal(change: Callable[[dict[str, Any]], Any]) -> str:
    """What is said of the default machine file's content after a change."""
    content = copy.deepcopy(read_table(DEFAULT))
    change(content)
    with pytest.raises(MachineError) as error:
        from_table(content, Path("axis.toml"))
    return str(error.value)


def test_all_that_is_missing_is_said_in_one_message() -> None:
    def without_three(content: dict[str, Any]) -> None:
        del content["drive"]["rated_speed"], content["plant"]["modes"][1]["gain"], content["control"]["pid"]

    said = refusal(without_three)
    assert "3 values are missing: drive.rated_speed, plant.modes.2.gain and control.pid; " in said
    assert "python -m studies.new_machine" in said


def test_of_a_missing_table_every_value_that_it_needs_is_said() -> None:
    said = refusal(lambda content: (content.pop("scale"), content["plant"].pop("modes")))
    assert "5 values are missing: scale.resolution, scale.noise, plant.modes.1.gain" in said


def test_an_empty_file_is_told_of_everything_but_what_is_optional() -> None:
    said = refusal(dict.clear)
    for name in ("drive.rated_thrust", "friction.limit", "control.pid", "specification.motions"):
        assert name in said
    for name in ("offset", "presliding", "published", "tolerance.", "anti_windup", "filters", "effects", "name"):
        assert name not in said.replace("specification.tolerance", "")


def test_a_key_that_is_unknown_is_said_before_those_that_are_missing() -> None:
    said = refusal(lambda content: content["drive"].update(rated_trust=content["drive"].pop("rated_thrust")))
    assert "drive.rated_trust: unknown; did you mean 'rated_thrust'?" in said


@pytest.mark.parametrize(("part", "key"), [("plant", "thrust_constant"), ("drive", "rated_thrust")])
@pytest.mark.parametrize(("entry", "unit"), [("42 N/A", "A"), ("4.2e4 mN/A", "A"), ("3 N/V", "V")])
def test_a_force_constant_is_told_where_it_belongs(part: str, key: str, entry: str, unit: str) -> None:
    said = refusal(lambda content: content[part].update({key: entry}))
    assert f'write [record] with command = "NAME [{unit}] * {entry}"' in said


def test_the_line_that_is_proposed_for_a_force_constant_is_accepted() -> None:
    content = copy.deepcopy(read_table(DEFAULT))
    content["record"] = {"command": "NAME [A] * 42 N/A"}
    mapped = from_table(content, Path("axis.toml")).record
    assert mapped is not None
    assert mapped.source("command").factor == 42


def test_another_unit_is_not_taken_for_a_force_constant() -> None:
    assert "[record]" not in refusal(lambda content: content["drive"].update(rated_thrust="42 V/N"))
