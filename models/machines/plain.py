"""From a machine's dataclasses to rows of a table of parameters, and to plain numbers for results.json."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from models.effects import catalogue
from models.effects.priors import Priors
from models.machines.provenance import Provenance
from models.machines.reading import join
from models.quantity import Declaration, declaration, json_name


@dataclass(frozen=True)
class Parameter:
    """One value of a machine for a table of parameters; `number` is an SI float, a tuple of them, or a word such as
    "auto" where a file may state one."""

    name: str
    meaning: str
    unit: str
    number: float | tuple[float, ...] | str
    provenance: Provenance


def range_rows(priors: Priors) -> Iterator[tuple[str, tuple[float, ...], Declaration]]:
    """Every range that is stated, as "EFFECT.PARAMETER", least and most [SI], and how it is declared."""
    for (effect, name), ends in priors.items():
        yield f"{effect}.{name}", ends, catalogue.range_declarations(catalogue.every()[effect])[name]


def left_out(part: Any, field: dataclasses.Field[Any], where: str, sources: Mapping[str, Provenance]) -> bool:
    """Whether nothing states this field of a machine's part: it has no source and stands at its default, or it follows
    from other fields, as its part says by `derived`."""
    path = join(where, field.name)
    stated = any(name == path or name.startswith(f"{path}.") for name in sources)
    follows = field.name in getattr(part, "derived", ())
    return follows or (not stated and getattr(part, field.name) == field.default)


def rows_of(part: Any, where: str, sources: Mapping[str, Provenance]) -> Iterator[Parameter]:
    """A row [SI] for every value of a part of a machine, in the order of the declarations."""
    for field in dataclasses.fields(part):
        item, path, declared = getattr(part, field.name), join(where, field.name), declaration(field, part)
        if left_out(part, field, where, sources):
            continue
        if declared is not None:
            provenance = sources.get(path, Provenance("assumed", "set in a program"))
            yield Parameter(path, declared.meaning, declared.unit, item, provenance)
        elif isinstance(item, Priors):
            for name, ends, stated in range_rows(item):
                provenance = sources.get(join(path, name), Provenance("assumed", "set in a program"))
                yield Parameter(join(path, name), stated.meaning, stated.unit, ends, provenance)
        elif dataclasses.is_dataclass(item):
            yield from rows_of(item, path, sources)
        elif field.name == "effects":
            for name, effect in catalogue.named(item).items():
                yield from rows_of(effect, join(path, name), sources)
        elif isinstance(item, tuple):
            for i, member in enumerate(item):
                yield from rows_of(member, f"{path}.{i + 1}", sources)


def plain_of(part: Any) -> object:
    """A part as lists and mappings of SI numbers, units in their names; values that nothing states are left out."""
    if not dataclasses.is_dataclass(part):
        return part
    plain: dict[str, object] = {}
    for field in dataclasses.fields(part):
        item, declared = getattr(part, field.name), declaration(field, part)
        if field.name == "sources" or item is None or (field.name in ("effects", "priors") and not item):
            continue
        if left_out(part, field, "", {}):
            continue
        if isinstance(item, Priors):
            plain[field.name] = _plain_ranges(item)
        elif field.name == "effects":
            plain[field.name] = {name: plain_of(effect) for name, effect in catalogue.named(item).items()}
        elif declared is not None:
            plain[json_name(field.name, declared.unit)] = list(item) if isinstance(item, tuple) else item
        elif isinstance(item, tuple):
            plain[field.name] = [plain_of(member) for member in item]
        else:
            plain[field.name] = plain_of(item)
    return plain


def _plain_ranges(priors: Priors) -> dict[str, dict[str, object]]:
    plain: dict[str, dict[str, object]] = {}
    for name, ends, stated in range_rows(priors):
        effect, _, parameter = name.partition(".")
        plain.setdefault(effect, {})[json_name(parameter, stated.unit)] = list(ends)
    return plain
