"""What a machine file lacks, all at once: whoever writes one should not learn of its keys one by one."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from types import NoneType, UnionType
from typing import Any, Final, get_args, get_origin, get_type_hints

from models.machines.provenance import MachineError
from models.machines.reading import join, unit_hint
from models.quantity import declaration, listed

STARTER: Final = "python -m studies.new_machine"
MODES: Final = "plant.modes"  # of which a file states the rigid body at least, though a plant of a program may wait
FEEDBACKS: Final = ("pid", "cascade")  # of [control], of which a file states one


def missing(kind: type[Any], table: Mapping[str, Any], where: str = "") -> Iterator[tuple[str, str]]:
    """The dotted name of every value that the dataclass `kind` needs and a TOML table lacks, and what it means with
    its SI unit, as a message has it; of a table that is missing as a whole, of every value that it needs."""
    hints = get_type_hints(kind)
    for field in dataclasses.fields(kind):
        path, entry = join(where, field.name), table.get(field.name)
        needed = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if entry is None and (needed or path == MODES):
            part = _part(hints[field.name])
            if part is None:
                yield path, unit_hint(declaration(field))
            else:
                yield from missing(part[0], {}, path + part[1])
        elif isinstance(entry, dict | list) and (part := _part(hints[field.name])) is not None:
            items = entry if isinstance(entry, list) else [entry]
            for i, item in enumerate(items):
                if isinstance(item, dict):
                    yield from missing(part[0], item, f"{path}.{i + 1}" if part[1] else path)
    if where == "control" and not any(name in table for name in FEEDBACKS):
        yield "control.pid", ", or control.cascade"


def said(lacking: Sequence[tuple[str, str]]) -> str:
    """The message about what is missing (no unit [-]): in full for one value, by their names for several."""
    if len(lacking) == 1:
        return f"{lacking[0][0]}: missing; add it{lacking[0][1]}"
    return (
        f"{len(lacking)} values are missing: {listed(name for name, _ in lacking)}; add them, or begin with the "
        f"commented file that {STARTER} writes"
    )


def complete(error: MachineError, kind: type[Any], table: Mapping[str, Any]) -> MachineError:
    """The error about one missing value [-] as one about all that are missing of `kind` in the table."""
    lacking = [*missing(kind, table)]
    return MachineError(said(lacking)) if len(lacking) > 1 else error


def _part(hint: Any) -> tuple[type[Any], str] | None:
    """The dataclass of a part of a machine and what stands behind its name, where it is one of several of its kind;
    None for a quantity, text and effects."""
    if isinstance(hint, UnionType):
        hint = next(kind for kind in get_args(hint) if kind is not NoneType)
    several = ".1" if get_origin(hint) is tuple else ""
    kind = get_args(hint)[0] if several else hint
    stated = dataclasses.is_dataclass(kind) and any(map(declaration, dataclasses.fields(kind)))
    return (kind, several) if stated or _holds_parts(kind) else None


def _holds_parts(kind: Any) -> bool:
    """Whether a dataclass holds parts alone, as [control.filters] does."""
    return dataclasses.is_dataclass(kind) and any(_part(hint) for hint in get_type_hints(kind).values())
