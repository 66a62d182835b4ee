"""Several machines that one set of facts allows: a base machine file and, for each member, the values that differ.

base = "linear_motor_table.toml"
source = "assumed: ..."             of every value that a member changes

[[member]]
"plant.dead_time" = "0.98 ms"
"plant.modes.2.damping" = "0.011"   the second of [[plant.modes]]
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from models.machine import Machine, MachineError, from_table, read_table

DEFAULT: Final = Path(__file__).parent / "machines" / "linear_motor_table_ensemble.toml"


def load_ensemble(path: Path = DEFAULT) -> tuple[Machine, ...]:
    """The machines of an ensemble file, named after the base with the member's number. Raises MachineError."""
    content = read_table(path)
    for key in ("base", "member"):
        if key not in content:
            raise MachineError(f"{path}: {key} is missing; add it (see an ensemble file of this project)")
    if not isinstance(content["member"], list) or not content["member"]:
        raise MachineError(f"{path}: has no members; write [[member]] with the values that differ below")
    base = read_table(path.parent / str(content["base"]))
    source = str(content.get("source", "assumed: no source given"))
    members = []
    for number, changes in enumerate(content["member"], start=1):
        table = copy.deepcopy(base)
        if not isinstance(changes, dict):
            raise MachineError(
                f"{path}: member {number} must be a table; write [[member]] with the values that differ below"
            )
        table["name"] = f"{base.get('name', path.stem)}, member {number}"
        for name, text in changes.items():
            _set(table, name, {"value": text, "source": source}, f"{path}: member {number}")
        members.append(from_table(table, path))
    return tuple(members)


def to_text(base: str, source: str, comment: str, members: list[Mapping[str, Any]]) -> str:
    """The text of an ensemble file; a member maps dotted names to a quantity's text or a list of them."""
    lines = [*(f"# {line}" for line in comment.splitlines()), f'base = "{base}"', f'source = "{source}"']
    for member in members:
        lines += ["", "[[member]]", *(f'"{name}" = {_toml(member[name])}' for name in sorted(member))]
    return "\n".join(lines) + "\n"


def _toml(entry: object) -> str:
    return "[" + ", ".join(f'"{item}"' for item in entry) + "]" if isinstance(entry, list | tuple) else f'"{entry}"'


def _set(table: dict[str, Any], name: str, entry: Mapping[str, Any], where: str) -> None:
    """Puts an entry at a dotted name of nested tables; a number counts the tables of a list from 1."""
    *parents, last = name.split(".")
    place: Any = table
    for parent in parents:
        try:
            place = place[int(parent) - 1 if int(parent) else len(place)] if parent.isdecimal() else place[parent]
        except (KeyError, IndexError, TypeError) as error:
            raise MachineError(f"{where}: {name} is not in the base machine; correct its name") from error
    if not isinstance(place, dict):
        raise MachineError(f"{where}: {name} is not in the base machine; correct its name")
    place[last] = entry
