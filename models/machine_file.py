"""Writes a machine as the TOML that `models.machine.load` reads, every value with its source."""

from __future__ import annotations

import dataclasses
import json
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from models.effects import catalogue
from models.effects.priors import Priors
from models.machine import Machine, Provenance, from_table, left_out, range_rows
from models.quantity import AXES, declaration
from models.records.columns import Columns

DIGITS: Final = 8  # of a share: what rounding adds to a deviation is a 10,000th of it


def to_toml(machine: Machine) -> str:
    """The text of a machine file; facts of the hysteresis curve that follow from the elements are left out."""
    derived = machine.sources.get("presliding.coulomb_force", Provenance("derived", "")).kind == "derived"
    lines = [f"name = {_text(machine.name)}"]
    if machine.axis != AXES[0]:
        lines += [f"axis = {_text(machine.axis)}"]
    units = machine.unit
    for field in dataclasses.fields(machine):
        part = getattr(machine, field.name)
        if left_out(machine, field, "", machine.sources):
            continue
        if isinstance(part, Columns):
            lines += ["", f"[{field.name}]", *_columns(part)]
        elif isinstance(part, Priors):
            lines += _ranges(part, machine.sources, units)
        elif dataclasses.is_dataclass(part) and not (field.name == "presliding" and derived):
            lines += _table(part, field.name, machine.sources, units)
    for name, effect in catalogue.named(machine.effects).items():
        head = f"[effects.{name}]" if name == effect.name else f"[[effects.{effect.name}]]"
        lines += _table(effect, f"effects.{name}", machine.sources, units, head)
    return "\n".join(lines) + "\n"


def save(machine: Machine, path: str | Path) -> None:
    """Writes a machine as a file that `load_machine` reads, every value [SI units, as text] with its source.

    Raises OSError where the file can't be written.

    >>> pos.save_machine(machine, folder / "mine.toml")
    >>> pos.load_machine(folder / "mine.toml").plant == machine.plant
    True
    """
    Path(path).write_text(to_toml(machine), encoding="utf-8")


def loaded(machine: Machine, path: Path) -> Machine:
    """The machine as it is read from the file that is written of it; `path` stands in the messages of MachineErrors."""
    return from_table(tomllib.loads(to_toml(machine)), path)


def _table(
    part: Any, where: str, sources: Mapping[str, Provenance], units: Callable[[str], str], head: str | None = None
) -> Iterator[str]:
    yield from ("", head or f"[{where}]")
    inner: list[str] = []
    for field in dataclasses.fields(part):
        item, declared, path = getattr(part, field.name), declaration(field, part), f"{where}.{field.name}"
        if left_out(part, field, where, sources):
            continue
        if declared is not None:
            yield _line(field.name, item, units(declared.unit), path, sources)
        elif isinstance(item, tuple):
            for i, member in enumerate(item):
                inner += _table(member, f"{path}.{i + 1}", sources, units, f"[[{path}]]")
        elif dataclasses.is_dataclass(item):
            inner += _table(item, path, sources, units)
    yield from inner


def _ranges(priors: Priors, sources: Mapping[str, Provenance], units: Callable[[str], str]) -> Iterator[str]:
    """The tables [priors.NAME] with the ranges that a machine states."""
    head = ""
    for name, ends, declared in range_rows(priors):
        effect, _, parameter = name.partition(".")
        if effect != head:
            head = effect
            yield from ("", f"[priors.{effect}]")
        yield _line(parameter, ends, units(declared.unit), f"priors.{name}", sources)


def _line(name: str, item: Any, unit: str, path: str, sources: Mapping[str, Provenance]) -> str:
    """A value that is written as a table."""
    source = sources.get(path, Provenance("assumed", "set in a program"))
    return f"{name} = {{ {', '.join(_entry(item, unit, source))} }}"


def _entry(item: Any, unit: str, source: Provenance) -> Iterator[str]:
    """The keys of a value that is written as a table."""
    yield f"value = {_value(item, unit)}"
    if source.std is not None:
        yield f"std = {_value(source.std, unit)}"
    if source.shares:
        yield f"shares = [{', '.join(map(_shares_of, source.shares))}]"
    yield f"source = {_text(f'{source.kind}: {source.detail}' if source.detail else source.kind)}"
    for name in ("record", "sha256", "note"):
        if text := getattr(source, name):
            yield f"{name} = {_text(text)}"
    if source.at_limit:
        yield "at_limit = true"


def _shares_of(row: Sequence[float]) -> str:
    return f"[{', '.join(f'{one:.{DIGITS}f}'.rstrip('0').rstrip('.') for one in row)}]"


def _columns(columns: Columns) -> Iterator[str]:
    plain = Columns()
    for field in dataclasses.fields(columns):
        entry = getattr(columns, field.name)
        if entry != getattr(plain, field.name):
            yield f"{field.name} = {_text(entry)}"


def _value(item: Any, unit: str) -> str:
    if isinstance(item, tuple):
        return "[" + ", ".join(_value(member, unit) for member in item) + "]"
    if isinstance(item, str):
        return _text(item)
    if unit != "1":
        return _text(f"{float(item)!r} {unit}")
    return str(item) if isinstance(item, int) else repr(float(item))


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)
