"""What a study is asked, as data: each study has one frozen dataclass of `Options`, its fields declared here.

From a declaration follow the option of the command line with its help, the check of a value from Python, and the
conversion of text with a unit to SI. Kept light, as `--help` comes through here: units are read only if there are any.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import numbers
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from models.machine import Machine


class BadInputError(ValueError):
    """Input that a study can't use; the message is one line: what is wrong, where, and what to do."""


@dataclass(frozen=True)
class Option:
    """How a field is asked for: the keywords of `add_argument`, and what of a value is accepted.

    accepted: from the option's name, as messages have it, and a value (text as typed, or SI from Python) to the value
    of the field. Raises BadInputError. file: whether the value names files or folders. unit: of a quantity, in SI.
    reviewable: whether a review of somebody else's results may run the study with another value than the default one,
    as that reaches nothing outside; of a file, whether a review may hand over its content.
    """

    keywords: Mapping[str, Any]
    accepted: Callable[[str, Any], Any]
    positional: bool = False
    file: bool = False
    reviewable: bool = False
    unit: str = ""


def _field(
    initial: Any,
    accepted: Callable[[str, Any], Any],
    /,
    *,
    positional: bool = False,
    file: bool = False,
    unit: str = "",
    reviewable: bool,
    **keywords: Any,
) -> Any:
    option = Option(keywords, accepted, positional, file, reviewable, unit)
    return dataclasses.field(default=initial, metadata={"option": option})


def _named(name: str, option: Option) -> str:
    """The option as it is typed; a field whose name would be a word of Python's own has an underscore behind it."""
    return name.upper() if option.positional else f"--{name.rstrip('_').replace('_', '-')}"


def _read_path(text: str) -> Path:
    if not text.strip():
        raise argparse.ArgumentTypeError("it is empty; give a path")
    return Path(text)


def _path(_: str, value: Any) -> Any:
    """Text as a path; a path, a machine from Python, or None as it is."""
    return Path(value) if isinstance(value, str) else value


def _listed(value: Any, kind: Callable[[Any], Any]) -> tuple[Any, ...]:
    """One item, or several of them, as a tuple."""
    items = [value] if isinstance(value, str | Path) else value
    return tuple(kind(item) for item in items)


def quantity(  # noqa: PLR0913  # each keyword says one thing of an option
    unit: str,
    metavar: str,
    meaning: str,
    *,
    default: float | None = None,
    text: str | None = None,
    above: float | None = None,
    at_least: float | None = None,
    below: float | None = None,
    reviewable: bool = True,
) -> Any:
    """A field in the SI unit `unit` ("1": dimensionless), given as text with a unit or as an SI number.

    `text` is the default as one would type it. above, at_least, below: the range, in SI.
    """

    accepted = _number(unit, meaning, above, at_least, below)
    return _field(default, accepted, unit=unit, reviewable=reviewable, metavar=metavar, help=meaning, default=text)


def quantities(unit: str, metavar: str, meaning: str, *, above: float | None = None, below: float | None = None) -> Any:
    """A field that is a tuple of quantities; the option may be repeated. As `quantity`."""
    one = _number(unit, meaning, above, None, below)

    def accepted(name: str, value: Any) -> tuple[float | None, ...]:
        items = value if isinstance(value, list | tuple) else [value]
        return tuple(one(name, item) for item in items)

    return _field((), accepted, unit=unit, reviewable=True, metavar=metavar, help=meaning, action="append", default=[])


def _number(
    unit: str, meaning: str, above: float | None, at_least: float | None, below: float | None
) -> Callable[[str, Any], float | None]:
    """What checks a value and converts text with a unit to SI; None stays."""

    def accepted(name: str, value: Any) -> float | None:
        if value is None:
            return None
        from models.quantity import Declaration, QuantityError, check, parse

        if isinstance(value, bool) or not isinstance(value, str | numbers.Real):
            raise BadInputError(f"{name}: {value!r} must be a number in {unit}, or text with a unit")
        try:
            number = parse(value, unit) if isinstance(value, str) else float(value)
            if not math.isfinite(number):
                raise QuantityError(f"{value!r} is not a finite number")
            check(number, Declaration(unit, meaning, above, at_least, below))
        except QuantityError as error:
            raise BadInputError(f"{name}: {error}") from error
        return number

    return accepted


def whole(metavar: str, meaning: str, low: int, high: int | None = None, *, default: int | None = None) -> Any:
    """A field that is a whole number [1] from `low` on, or to `high`."""
    read, one = _whole(low, high)

    def accepted(name: str, value: Any) -> int | None:
        return None if value is None and default is None else one(name, value)

    return _field(default, accepted, reviewable=True, metavar=metavar, help=meaning, type=read, default=default)


def wholes(metavar: str, meaning: str, low: int) -> Any:
    """A field that is a tuple of whole numbers [1] from `low` on; the option may be repeated."""
    read, one = _whole(low, None)

    def accepted(name: str, value: Any) -> tuple[int, ...]:
        return tuple(one(name, item) for item in (value if isinstance(value, list | tuple) else [value]))

    return _field((), accepted, reviewable=True, metavar=metavar, help=meaning, action="append", type=read, default=[])


def _whole(low: int, high: int | None) -> tuple[Callable[[str], int], Callable[[str, Any], int]]:
    """What reads a whole number [1] of this range from text, and what checks one that is given from Python."""
    span = f"from {low} on" if high is None else f"from {low} to {high}"

    def within(number: int) -> bool:
        return number >= low and (high is None or number <= high)

    def read(text: str) -> int:
        if not text.isdecimal() or not within(int(text)):
            raise argparse.ArgumentTypeError(f"{text!r} must be a whole number {span}")
        return int(text)

    def accepted(name: str, value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, numbers.Integral) or not within(int(value)):
            raise BadInputError(f"{name}: {value!r} must be a whole number {span}")
        return int(value)

    return read, accepted


def choice(meaning: str, known: Sequence[str]) -> Any:
    """A field that is one of the `known` words; by default the first."""

    def accepted(name: str, value: Any) -> str:
        if value not in known:
            raise BadInputError(f"{name}: {value!r} is unknown; choose one of {', '.join(known)}")
        return str(value)

    return _field(known[0], accepted, reviewable=True, choices=tuple(known), help=meaning, default=known[0])


def known_text(meaning: str, known: Sequence[str], otherwise: str) -> Any:
    """A field that is one of the `known` words, or None; otherwise: what a message says about other words."""

    def accepted(name: str, value: Any) -> str | None:
        if value is not None and value not in known:
            raise BadInputError(f"{name}: {value!r} is unknown; choose one of {', '.join(known)}; {otherwise}")
        return None if value is None else str(value)

    return _field(None, accepted, reviewable=True, metavar="NAME", help=meaning)


def flag(meaning: str, *, reviewable: bool = True) -> Any:
    """A field that is True where the option is given."""

    def accepted(name: str, value: Any) -> bool:
        if not isinstance(value, bool):
            raise BadInputError(f"{name}: {value!r} must be True or False")
        return value

    return _field(False, accepted, reviewable=reviewable, action="store_true", help=meaning)


def text(metavar: str, meaning: str, *, reviewable: bool = False) -> Any:
    """A field that is text, or None; reviewable only where no text can be an address or a path."""
    return _field(None, lambda _, value: value, reviewable=reviewable, metavar=metavar, help=meaning)


def texts(metavar: str, meaning: str, *, reviewable: bool = False) -> Any:
    """A field that is a tuple of texts; the option may be repeated. reviewable: as for `text`."""
    return _repeated(str, metavar, meaning, reviewable=reviewable)


def path(metavar: str, meaning: str, *, reviewable: bool = False) -> Any:
    """A field that is the path of a file or folder, or None; reviewable: of one file whose content says it all."""
    return _field(None, _path, file=True, reviewable=reviewable, metavar=metavar, help=meaning, type=_read_path)


def paths(metavar: str, meaning: str, *, reviewable: bool = False) -> Any:
    """A field that is a tuple of paths: what the command line takes without an option's name; reviewable: as `path`."""
    return _field(
        (),
        lambda _, value: _listed(value, Path),
        positional=True,
        file=True,
        reviewable=reviewable,
        nargs="*",
        type=Path,
        metavar=metavar,
        help=meaning,
    )


def files(metavar: str, meaning: str, *, reviewable: bool = False) -> Any:
    """A field that is a tuple of paths; the option may be repeated. reviewable: as `path`."""
    return _repeated(Path, metavar, meaning, reviewable=reviewable, file=True)


def _repeated(kind: type[str] | type[Path], metavar: str, meaning: str, *, reviewable: bool, file: bool = False) -> Any:
    return _field(
        (),
        lambda _, value: _listed(value, kind),
        file=file,
        reviewable=reviewable,
        metavar=metavar,
        help=meaning,
        action="append",
        type=kind,
        default=[],
    )


def path_list(metavar: str, meaning: str) -> Any:
    """A field that is a tuple of paths, given after the option's name."""
    return _field(
        (),
        lambda _, value: _listed(value, Path),
        file=True,
        reviewable=False,
        nargs="+",
        type=_read_path,
        metavar=metavar,
        help=meaning,
        default=[],
    )


@dataclass(frozen=True, kw_only=True)
class Options:
    """What every study is asked, and the base of what one is asked beyond; quantities in SI.

    Values are checked, and text with a unit is converted, when an instance is made. Raises BadInputError.
    """

    machine: Path | Machine | None = path(
        "FILE", "machine file, or a pack's nominal.json (default: models/machines/linear_motor_table.toml)"
    )
    controller: Path | None = path(
        "FILE", "controller.json to take the PID from (default: the machine's)", reviewable=True
    )
    output: Path | None = path("FOLDER", "where results go (default: reports/out/{study})")
    quick: bool = flag("fewer points, tables, cases or samples, for a smoke test; the report says so")
    seed: int = whole("N", "of all that is random (default: 0)", 0, default=0)
    time_limit: float | None = quantity(
        "s",
        "TIME",
        'begin no work that is expected to take longer, such as "8 h" (default: 4 h)',
        above=0,
        reviewable=False,
    )
    overwrite: bool = flag(
        "replace files in --output that no earlier run of this study wrote, or that were edited since",
        reviewable=False,
    )
    no_report: bool = flag("write no report, only results.json and the like")

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            option: Option = field.metadata["option"]
            given = getattr(self, field.name)
            object.__setattr__(self, field.name, option.accepted(_named(field.name, option), given))
            for item in given if isinstance(given, list | tuple) else [given]:
                if option.unit and isinstance(item, str):
                    self._typed.append((_named(field.name, option), item, option.unit))

    @cached_property
    def _typed(self) -> list[tuple[str, str, str]]:
        """The quantities that were given as text: each option, the text as typed, and the option's SI unit."""
        return []

    def check_units(self, machine: Machine) -> None:
        """Raises BadInputError for a quantity in the units [-] of an axis of another kind than this machine's."""
        from models.quantity import is_rotary

        for name, text, unit in self._typed:
            rotary = is_rotary(text, unit)
            if rotary is not None and rotary != (machine.axis == "rotary"):
                kind = "is linear" if rotary else "is rotary"
                raise BadInputError(
                    f"{name}: {text!r} is not a size of this machine, whose axis {kind}; "
                    f"give it in {machine.unit(unit)}"
                )

    def usual_machine(self) -> Path | None:
        """The machine file that the other options lead to where `machine` is not given; None: the default one."""
        return None


class Parser(argparse.ArgumentParser):
    """argparse, with its complaints as BadInputError: one line, exit status 2."""

    def error(self, message: str) -> NoReturn:
        raise BadInputError(f"{message}; see python -m {self.prog} --help")


def add_options(parser: argparse.ArgumentParser, options: type[Options], study: str) -> None:
    """Adds an option for each field: first those that are the study's alone, then those of all."""
    common = {field.name for field in dataclasses.fields(Options)}
    for field in sorted(dataclasses.fields(options), key=lambda field: field.name in common):
        option: Option = field.metadata["option"]
        keywords = {**option.keywords, "help": option.keywords["help"].replace("{study}", study)}
        if option.positional:
            parser.add_argument(field.name, **keywords)
        else:
            parser.add_argument(_named(field.name, option), dest=field.name, **keywords)
