"""Names of columns as logs write them, with a unit behind the name, and what a mapping may call them."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Sequence
from functools import cache
from typing import Final

from models.quantity import QuantityError, parse

_BRACKETS: Final = re.compile(r"(?P<name>.*\S)\s*(?:\[(?P<unit>[^\[\]]*)\]|\((?P<round>[^()\d][^()]*)\))")
_SLASH: Final = re.compile(r"(?P<name>.*[^\s/])\s*/\s*(?P<unit>[^\s/]+(?:/[^\s/]+)?)|(?P<one>.*\S)\s+in\s+(?P<of>\S+)")
_SUFFIX: Final = re.compile(r"(?P<name>.+)_(?P<unit>[^\W\d_]+)")
# Units that a name may end in behind an underscore. Those of SI need no conversion, and "u_m" may well be a measured
# command; amperes and volts are among them because a current becomes a force only by its factor.
_SUFFIXES: Final = {"mm", "um", "µm", "nm", "ms", "us", "µs", "ns", "kHz", "mN", "kN", "A", "mA", "V", "mV"}
_PLAIN: Final = _SUFFIXES | {"m", "s", "N", "Hz"}
_COUNTED: Final = {
    "-",
    "%",
    "inc",
    "incr",
    "increments",
    "inkr",
    "inkremente",
    "cnt",
    "count",
    "counts",
    "digit",
    "digits",
}
MAX_HEADER_CHARS: Final = 200  # characters of a header in which a unit is looked for
_CLOCKS: Final = {"time", "zeit", "temps", "t", "timestamp"}


def unit_in(header: str) -> tuple[str, str]:
    """(name, unit) of a header such as "Zeit [ms]", "Position (mm)", "Force/N", "pos_um"; the unit is "" for none.

    Whatever stands in brackets is a unit, known or not; behind "/", "in" and "_" only a known one is.
    """
    if len(header) > MAX_HEADER_CHARS:
        return header, ""
    if match := _BRACKETS.fullmatch(header):
        return match["name"], _one_sign(match["unit"] if match["unit"] is not None else match["round"])
    if match := _SLASH.fullmatch(header):
        name, unit = match["name"] or match["one"], _one_sign(match["unit"] or match["of"])
        if is_known(unit):
            return name, unit
    if (match := _SUFFIX.fullmatch(header)) and _one_sign(match["unit"]) in _SUFFIXES:
        return header, _one_sign(match["unit"])
    return header, ""


def other_names(header: str) -> tuple[str, ...]:
    """What a column may be called besides its whole header: its name without the unit, the likeliest first."""
    name = unit_in(header)[0]
    match = _SUFFIX.fullmatch(header) if len(header) <= MAX_HEADER_CHARS else None
    short = (match["name"],) if match and _one_sign(match["unit"]) in _PLAIN else ()
    return tuple(one for one in (name, *short) if one != header)


def are_units(cells: Sequence[str]) -> bool:
    """Whether the cells of a line are the columns' units: "[ms]", "(mm)", "N", "-", at least one of them known."""
    filled = [cell for cell in cells if cell]
    bare = [bare_unit(cell) for cell in filled]
    known = [is_known(unit) for unit in bare]
    return any(known) and all(
        good or unit != cell or unit.lower() in _COUNTED for good, unit, cell in zip(known, bare, filled, strict=True)
    )


def bare_unit(cell: str) -> str:
    """A unit without its brackets."""
    match = re.fullmatch(r"\[([^\[\]]*)\]|\(([^()]*)\)", cell)
    return _one_sign((match[1] or match[2] or "") if match else cell)


@cache
def is_known(unit: str) -> bool:
    """Whether a text is a unit."""
    if not unit or len(unit) > 30 or unit.lower() in _COUNTED:
        return False
    for dimension in ("m", "s", "N", "Hz", "m/N", "A", "V", "m/s", "m/s^2"):
        try:
            parse(f"1 {unit}", dimension)
        except QuantityError:
            continue
        return True
    return False


def is_clock(name: str) -> bool:
    """Whether a column of this name holds times."""
    return unit_in(name)[0].strip().lower() in _CLOCKS


def told_apart(names: Sequence[str]) -> list[str]:
    """The names, of which those that occur more than once are numbered: "x (1)", "x (2)"."""
    often, seen, found = Counter(names), Counter[str](), []
    for name in names:
        seen[name] += 1
        found.append(f"{name} ({seen[name]})" if often[name] > 1 and name else name)
    return found


def as_wanted(headers: Sequence[str], wanted: Collection[str] | None) -> list[str]:
    """What to call the columns: as they are asked for, by the whole header or without its unit; else without it.

    A name that another column has, or would have as well, is nobody's other name.
    """
    others = [other_names(header) for header in headers]
    claims = Counter([*headers, *(name for names in others for name in set(names))])
    found = []
    for header, names in zip(headers, others, strict=True):
        free = [name for name in names if claims[name] == 1]
        asked = next((name for name in (header, *free) if wanted is not None and name in wanted), None)
        stripped = unit_in(header)[0]
        found.append(asked or (stripped if stripped in free else header))
    return found


def _one_sign(unit: str) -> str:
    """The unit with one of the two signs that look like a µ."""
    return unit.strip().replace("μ", "µ")
