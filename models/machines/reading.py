"""From the tables of a TOML file to dataclasses whose fields declare their quantities, with the source of every value.

A value is text with a unit, `"16.5 N"`, or a table `{ value = "16.5 N", source = "paper: II.A", note = "..." }`; a
source begins with one of SOURCES. A value without one counts as assumed. A value that was identified may also hold its
standard deviation, and the record that it is from with the SHA-256 of the record's file:
`{ value = "16.5 N", std = "0.2 N", source = "identified: slow sweep", record = "slow.csv", sha256 = "..." }`.
Beside the deviation stands what it has in common with those of other values, `shares = [[0.6, 0.8]]`: see
`models.machines.provenance.Shares`.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Final, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from models.effects import catalogue
from models.effects.base import Effect
from models.effects.priors import Priors
from models.machines.provenance import SOURCES, MachineError, MissingError, Provenance, Shares
from models.machines.text_file import brief, text_of
from models.quantity import Declaration, QuantityError, check, cut, declaration, is_rotary, parse, rotary

ENTRY: Final = (
    "value",
    "std",
    "shares",
    "source",
    "record",
    "sha256",
    "note",
    "at_limit",
)  # keys of a value that is written as a table
MOST_ERRORS: Final = 1000  # that deviations have in common: more than a file has values
ROUNDED: Final = 1e-6  # by how much shares that are rounded may be more than 1 together
MOST_NAMED: Final = 20  # entries that a message names, where none is near to what stands in the file

Part = TypeVar("Part")


def read_table(path: Path) -> dict[str, Any]:
    """The content of a TOML file. Raises MachineError for a file that can't be read or is not TOML."""
    try:
        return tomllib.loads(text_of(path))
    except OSError as error:
        raise MachineError(f"{path}: can't be read ({error.strerror}); give an existing machine file") from error
    except RecursionError as error:
        raise MachineError(f"{path}: its tables are nested too deeply; a machine file needs four levels") from error
    except ValueError as error:
        raise MachineError(f"{path}: is not valid TOML ({brief(error)}); correct that line") from error


def read(kind: type[Part], table: object, where: str, sources: dict[str, Provenance]) -> Part:
    """An instance of the dataclass `kind` from a TOML table; fields with a `value` declaration are quantities [SI].

    where: the table's dotted name, for messages. sources: takes the Provenance of every value under its dotted name.
    Raises MachineError, a sentence, for what is missing, unknown or impossible.
    """
    if not isinstance(table, dict):
        several = "; tables [[record]] for several files stand in a mapping file, which --mapping gives"
        raise MachineError(
            f"{where}: must be a table; write [{where}] with its values below{several if where == 'record' else ''}"
        )
    fields = {field.name: field for field in dataclasses.fields(kind) if field.name != "sources"}  # type: ignore[arg-type]
    for key in table:
        if key not in fields:
            raise MachineError(f"{join(where, _cut_key(key))}: unknown; {_nearest(key, list(fields))}")
    hints, arguments = get_type_hints(kind), {}
    for name, field in fields.items():
        path = join(where, name)
        if name not in table and field.default is not dataclasses.MISSING:
            continue
        if name not in table:
            raise MissingError(f"{path}: missing; add it{unit_hint(declaration(field))}")
        arguments[name] = _entry(hints[name], declaration(field, table), table[name], path, sources)
    try:
        return kind(**arguments)
    except ValueError as error:
        raise MachineError(f"{where}: {error}") from error


def _entry(
    hint: Any, declared: Declaration | None, entry: object, where: str, sources: dict[str, Provenance]
) -> object:
    if declared is not None:
        return _quantity(hint, declared, entry, where, sources)
    if hint is str:
        return entry
    if isinstance(hint, UnionType):  # an optional part, and here it is
        hint = next(kind for kind in get_args(hint) if kind is not NoneType)
    if hint == tuple[Effect, ...]:
        tables = _tables(catalogue.readable(), entry, where)
        return catalogue.in_order(read(kind, item, path, sources) for kind, path, item in tables)
    if hint is Priors:
        return _priors(entry, where, sources)
    if get_origin(hint) is tuple:
        if not isinstance(entry, list) or not entry:
            raise MachineError(f"{where}: needs one table or more; write [[{where}]] with its values below")
        return tuple(read(get_args(hint)[0], item, f"{where}.{i + 1}", sources) for i, item in enumerate(entry))
    return read(hint, entry, where, sources)


def _tables(known: Mapping[str, type[Effect]], table: object, where: str) -> Iterator[tuple[type[Effect], str, object]]:
    """What stands in [effects.NAME], say, or in [[effects.NAME]] where several are of one name: the effect's class, the
    path of the entry, the entry."""
    if not isinstance(table, dict):
        raise MachineError(f"{where}: must be a table; write [{where}.NAME] with what is stated of the effect below")
    for name, entry in table.items():
        path = join(where, _cut_key(name))
        if name not in known:
            raise MachineError(f"{path}: unknown; {_nearest(name, list(known))}")
        same = entry if isinstance(entry, list) else [entry]
        for i, item in enumerate(same):
            yield known[name], path if len(same) == 1 else f"{path}.{i + 1}", item


def _priors(table: object, where: str, sources: dict[str, Provenance]) -> Priors:
    """The ranges in [priors.NAME], in the catalogue's order, each effect's once."""
    known, stated = catalogue.every(), dict[str, dict[str, tuple[float, ...]]]()
    for kind, path, entry in _tables(known, table, where):
        ranges = _ranges(kind, entry, path, sources)
        if kind.name in stated:
            once = f"{where}.{kind.name}"
            raise MachineError(f"{once}: is given twice; state an effect's ranges once, in [{once}]")
        stated[kind.name] = ranges
    return Priors.of({(name, item): ends for name in known for item, ends in stated.get(name, {}).items()})


def _ranges(
    kind: type[Effect], table: object, where: str, sources: dict[str, Provenance]
) -> dict[str, tuple[float, ...]]:
    """The ranges that a table states of one effect's sizes, in the order of its parameters."""
    if not isinstance(table, dict):
        raise MachineError(f"{where}: must be a table; write [{where}] with its values below")
    declared = catalogue.range_declarations(kind)
    for key in table:
        if key not in declared:
            raise MachineError(f"{join(where, _cut_key(key))}: unknown; {_nearest(key, list(declared))}")
    if not table:
        raise MachineError(f"{where}: must hold a range; give the minimum and maximum of {next(iter(declared))}, say")
    ranges = {}
    for name in (name for name in declared if name in table):
        ends = _quantity(tuple[float, ...], declared[name], table[name], join(where, name), sources)
        assert isinstance(ends, tuple)
        try:
            Priors.of({(kind.name, name): ends})
        except ValueError as error:
            raise MachineError(f"{where.rpartition('.')[0]}.{error}") from error
        ranges[name] = ends
    return ranges


def _quantity(hint: Any, declared: Declaration, entry: object, where: str, sources: dict[str, Provenance]) -> object:
    """The float, the tuple of floats, the int or the word in its place at `where`, its source put into `sources`."""
    text, source = _provenance(entry, where)
    std = entry.get("std") if isinstance(entry, dict) else None
    if std is not None:
        source = dataclasses.replace(source, std=_deviation(std, declared, text, where))
    if isinstance(entry, dict) and "shares" in entry:
        source = dataclasses.replace(source, shares=_shares(entry["shares"], std, where))
    sources[where] = dataclasses.replace(source, rotary=_rotary(text, std, declared, where))
    words = _words(hint)
    if isinstance(text, str) and text in words:
        return text
    if get_origin(hint) is Literal:
        raise MachineError(f"{where}: {cut(text)} is unknown; {_nearest(str(text), list(words))}")
    try:
        if hint is int or words:
            if not isinstance(text, int) or isinstance(text, bool):
                either = "".join(f', or "{word}"' for word in words)
                raise QuantityError(
                    f"{cut(text)} must be a whole number; write one without quotes and unit, such as 2{either}"
                )
            check(_plain_number(text), declared)
            return text
        if hint is float:
            return _number(text, declared)
        if not isinstance(text, list) or not text:
            raise QuantityError(f"{cut(text)} must be a list; write one value for each element, in brackets")
        if declared.most is not None and len(text) > declared.most:
            raise QuantityError(f"{len(text)} numbers are more than {declared.most}; join those that are alike")
        return tuple(_number(item, declared) for item in text)
    except QuantityError as error:
        raise MachineError(f"{where}: {error}{_of_motor(text)}") from error


def _rotary(text: object, std: object, declared: Declaration, where: str) -> bool | None:
    """Whether a value and its standard deviation are in units of a rotary axis; None where none tells."""
    texts = [one for part in (text, std) for one in (part if isinstance(part, list) else [part])]
    kinds = {is_rotary(one, declared.unit) for one in texts} - {None}
    if len(kinds) > 1:
        raise MachineError(f"{where}: mixes {declared.unit} with {rotary(declared.unit)}; give all in the same unit")
    return next(iter(kinds), None)


def _words(hint: Any) -> tuple[str, ...]:
    """The words that may stand in place of a whole number, or alone, as the type of the field says."""
    kinds = get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)
    return tuple(word for kind in kinds if get_origin(kind) is Literal for word in get_args(kind))


def _of_motor(text: object) -> str:
    """Where the force constant of a motor belongs, for a message about a value that is one; empty for any other."""
    for unit in ("N/A", "N/V"):
        with suppress(QuantityError):
            parse(text, unit)
            return (
                f"; a motor's force constant scales the column of a record's command: write [record] with command = "
                f'"NAME [{unit[2:]}] * {" ".join(str(text).split())[:40]}", and give forces here in N'
            )
    return ""


def _plain_number(number: int) -> float:
    """A whole number as a float [1]; an infinite one where it is beyond all floats."""
    try:
        return float(number)
    except OverflowError:
        return math.inf if number > 0 else -math.inf


def _deviation(text: object, declared: Declaration, number: object, where: str) -> float | tuple[float, ...]:
    """The standard deviation of a value in its own unit: one number, or one for each number of a list."""
    spread = Declaration(declared.unit, "standard deviation", above=None, at_least=0, below=None)
    try:
        if not isinstance(text, list):
            return _number(text, spread)
        if not isinstance(number, list) or len(text) != len(number):
            raise QuantityError("must be one text, or a list with one for each number of the value")
        return tuple(_number(item, spread) for item in text)
    except QuantityError as error:
        raise MachineError(f"{where}.std: {error}") from error


def _shares(rows: object, std: object, where: str) -> Shares:
    """What the deviations of a value's numbers have in common with others: a row for each number."""
    needed = len(std) if isinstance(std, list) else 1
    if std is None or not isinstance(rows, list) or len(rows) != needed:
        raise MachineError(f"{where}.shares: needs a std beside it, and a list of one list for each number of that")
    found = []
    for row in rows:
        if not isinstance(row, list) or not all(type(one) in (int, float) for one in row) or len(row) > MOST_ERRORS:
            raise MachineError(f"{where}.shares: {cut(row)} must be a list of numbers; write it like [0.6, 0.8]")
        if not math.hypot(*row) <= 1 + ROUNDED:
            raise MachineError(
                f"{where}.shares: the squares of {cut(row)} are more than 1 together; give shares of one deviation"
            )
        found.append(tuple(float(one) for one in row))
    return tuple(found)


def _number(text: object, declared: Declaration) -> float:
    if declared.unit == "1" and isinstance(text, int | float) and not isinstance(text, bool):
        text = str(text)  # a plain TOML number has no unit, and none is wanted
    number = parse(text, declared.unit)
    check(number, declared)
    return number


def _provenance(entry: object, where: str) -> tuple[object, Provenance]:
    if not isinstance(entry, dict):
        return entry, Provenance("assumed", "no source given")
    for key in entry:
        if key not in ENTRY:
            raise MachineError(f"{where}.{_cut_key(key)}: unknown; {_nearest(key, [*ENTRY])}")
    if "value" not in entry:
        raise MachineError(f'{where}: has no value; write {{ value = "...", source = "..." }}')
    kind, _, detail = str(entry.get("source", "assumed: no source given")).partition(":")
    if kind.strip() not in SOURCES:
        raise MachineError(f"{where}: source {cut(kind.strip())} is unknown; begin it with one of {', '.join(SOURCES)}")
    note, record, sha256 = (str(entry.get(name, "")).strip() for name in ("note", "record", "sha256"))
    at_limit = entry.get("at_limit", False)
    if not isinstance(at_limit, bool):
        raise MachineError(f"{where}.at_limit: must be true or false, without quotes")
    return entry["value"], Provenance(kind.strip(), detail.strip(), note, record, sha256, at_limit=at_limit)


def join(where: str, name: str) -> str:
    """The dotted name of a value in a part of a machine."""
    return f"{where}.{name}" if where else name


def _cut_key(key: str) -> str:
    """A key as a message names it: the start of a long one."""
    return key if len(key) <= 60 and key.isprintable() else cut(key)


def _nearest(key: str, known: list[str]) -> str:
    close = difflib.get_close_matches(key[:60], known, n=1, cutoff=0.5)
    if close:
        return f"did you mean {close[0]!r}?"
    if len(known) <= MOST_NAMED:
        return f"known here: {', '.join(known)}"
    nearest = difflib.get_close_matches(key[:60], known, n=MOST_NAMED, cutoff=0.0)
    return f"of {len(known)} that are known here the nearest are {', '.join(nearest)}"


def unit_hint(declared: Declaration | None) -> str:
    """What a message about a missing value says of it: its meaning, and its SI unit unless that is 1."""
    if declared is None:
        return ""
    return f", {declared.meaning}" + (f", in {declared.unit}" if declared.unit != "1" else "")
