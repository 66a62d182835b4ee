"""Text with a unit to an SI float and back; the only place that knows units as text.

A physical field of a dataclass is declared with `value(unit, ...)`. From that declaration follow the reading of machine
files, the names in results.json and the parameter tables of the reports, so that a unit is written down once.

A rotary axis has the same numbers in other units: its position in rad stands where a table's stands in m, its
torque in N m for the force in N, its moment of inertia in kg m^2 for the mass in kg. `parse` takes either; `is_rotary`
tells which one a text has, so that whoever knows the axis refuses the other.
"""

from __future__ import annotations

import dataclasses
import math
import re
import reprlib
from collections.abc import Iterable, Mapping
from decimal import Decimal, InvalidOperation
from functools import cache
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    import pint

ROUNDING: Final = 1e-9  # of a limit: a number that is beyond it by less keeps to it
AXES: Final = ("linear", "rotary")
ROTARY: Final = {"m": "rad", "N": "N m", "kg": "kg m^2"}  # what a rotary axis has in place of these units
_ROTARY_TEXT: Final = {**ROTARY, "kg": "kg m²"}  # as a text has it
_NUMBER: Final = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?(?:nan|inf)\w*)\s*(.*)", re.IGNORECASE)
_PREFIXES: Final = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
# Powers of (kg, m, s, A, rad) and the power of ten to SI of the units that machine files are full of.
_USUAL: Final[dict[str, tuple[int, ...]]] = {
    "1": (0, 0, 0, 0, 0, 0),
    "kg": (1, 0, 0, 0, 0, 0), "g": (1, 0, 0, 0, 0, -3),
    "m": (0, 1, 0, 0, 0, 0), "mm": (0, 1, 0, 0, 0, -3), "um": (0, 1, 0, 0, 0, -6), "µm": (0, 1, 0, 0, 0, -6),
    "nm": (0, 1, 0, 0, 0, -9), "m^2": (0, 2, 0, 0, 0, 0),
    "s": (0, 0, 1, 0, 0, 0), "ms": (0, 0, 1, 0, 0, -3), "us": (0, 0, 1, 0, 0, -6), "µs": (0, 0, 1, 0, 0, -6),
    "Hz": (0, 0, -1, 0, 0, 0), "kHz": (0, 0, -1, 0, 0, 3),
    "N": (1, 1, -2, 0, 0, 0), "mN": (1, 1, -2, 0, 0, -3), "kN": (1, 1, -2, 0, 0, 3),
    "W": (1, 2, -3, 0, 0, 0), "kW": (1, 2, -3, 0, 0, 3),
    "V": (1, 2, -3, -1, 0, 0), "A": (0, 0, 0, 1, 0, 0),
    "rad": (0, 0, 0, 0, 1, 0),
}  # fmt: skip
_SPACE: Final = "[ \u00a0]"
_FACTOR: Final = rf"(?:[GMkmµun]?(?:m|N|s|Hz|A|V|W|rad)|kg(?!{_SPACE}m))(?![\w²³^]|\\\^|\\?-\w)"
_FACTORS: Final = rf"{_FACTOR}(?:{_SPACE}{_FACTOR})*"
# Markdown has a backslash before each sign that could be markup, and mathematics may end where a unit begins.
_BELOW: Final = rf"\\?/\u2060?(?:\\?\({_FACTORS}\\?\)|{_FACTOR})"
_WHOLE: Final = rf"{_FACTORS}(?:{_BELOW})?"
# A unit behind a number, or in square brackets behind words, as at a figure's axis, or alone.
_UNIT_IN_TEXT: Final = rf"(?:{_WHOLE}|1{_BELOW})"
_IN_TEXT: Final = re.compile(
    rf"(?<=[\d⁰¹²³⁴⁵⁶⁷⁸⁹$]{_SPACE}){_UNIT_IN_TEXT}|(?:(?<=\s\[)|(?<=\s\\\[)|(?<=^\[)){_UNIT_IN_TEXT}(?=\\?\])"
)
_WORD: Final = re.compile(r"(?<!newton )\b(nano|micro|milli)?metre(s?)\b|\bnewton(s?)\b(?! metre)")
_UNIT_ALONE: Final = rf"{_WHOLE}|1{_BELOW}|1"
_IN_CELL: Final = re.compile(rf"(?<=\| )(?:{_UNIT_ALONE})(?:\\?[,;] (?:{_UNIT_ALONE}))*(?= \|$)", re.MULTILINE)
_PRODUCT: Final = r"[^\s/()]+(?: [^\s/()]+)*"
_TORQUE: Final = re.compile(r"\b([GMkcmµun]?N)([cm]?m)\b")  # "Nm" and "mNm", as the tools of drives write them
_UNIT: Final = re.compile(rf"({_PRODUCT})(?:/(?:\(({_PRODUCT})\)|([^\s/()]+)))?")


class QuantityError(ValueError):
    """A text that does not hold such a quantity; the message is one sentence that says what to write instead."""


@dataclasses.dataclass(frozen=True)
class Declaration:
    """What a physical field is: its SI unit, what it means, and the range it must lie in (SI, ends as named).

    because: why the range ends where it does, to stand behind "must be at most 100 m: "; may be empty. most: how many
    numbers a list may hold. unit_by: another field of the same part, and by what stands there the unit [-].
    """

    unit: str
    meaning: str
    above: float | None = None
    at_least: float | None = None
    below: float | None = None
    at_most: float | None = None
    because: str = ""
    most: int | None = None
    unit_by: tuple[str, Mapping[str, str]] | None = None


def value(  # noqa: PLR0913  # every limit that a quantity may have
    unit: str,
    meaning: str,
    *,
    above: float | None = None,
    at_least: float | None = None,
    below: float | None = None,
    at_most: float | None = None,
    because: str = "",
    most: int | None = None,
    unit_by: tuple[str, Mapping[str, str]] | None = None,
    **field_options: Any,
) -> Any:
    """A dataclass field (a float, or a tuple of them) in the SI unit `unit`; "1" is dimensionless.

    above, at_least, below, at_most, because, most, unit_by: see `Declaration`.
    """
    declaration = Declaration(unit, meaning, above, at_least, below, at_most, because, most, unit_by)
    return dataclasses.field(metadata={"declaration": declaration}, **field_options)


def declaration(field: dataclasses.Field[Any], part: object = None) -> Declaration | None:
    """The declaration that `value` attached to a field, or None for a field that is not a physical quantity.

    part: what has the field, or the table that it is read from, for a unit that another field decides [-].
    """
    found = field.metadata.get("declaration")
    if not isinstance(found, Declaration) or found.unit_by is None or part is None:
        return found if isinstance(found, Declaration) else None
    name, units = found.unit_by
    decides = part.get(name) if isinstance(part, Mapping) else getattr(part, name)
    word = decides.get("value") if isinstance(decides, Mapping) else decides
    return dataclasses.replace(found, unit=units.get(word, found.unit) if isinstance(word, str) else found.unit)


def parse(text: object, unit: str) -> float:
    """The number of `unit`s in `text`, in SI where `unit` is: parse("800 N/mm", "N/m") = 8e5; correctly rounded.

    Of a rotary axis the number of `rotary(unit)`: parse("0.5 N m/rad", "N/m") = 0.5.
    Raises QuantityError for a missing or unknown unit, another dimension, or a value that is not finite.
    """
    if not isinstance(text, str):
        raise QuantityError(f"{cut(text)} has no unit; write it as text with one, such as {_example(unit)!r}")
    match = _NUMBER.fullmatch(text)
    if match is None:
        raise QuantityError(f"{cut(text)} must be a number with a unit; write it like {_example(unit)!r}")
    number, unit_text = match.groups()
    magnitude = _finite(number, text)
    if not unit_text and unit != "1":
        raise QuantityError(f"{cut(text)} has no unit; write it like {_example(unit)!r}")
    try:
        number_in_unit = float(magnitude * _factor(unit_text.strip() or "1", unit))
    except QuantityError as error:
        raise QuantityError(f"{cut(text)} {error}") from error
    except ArithmeticError as error:
        raise QuantityError(f"{cut(text)} is too large for a number") from error
    if not math.isfinite(number_in_unit):
        raise QuantityError(f"{cut(text)} is not a finite number")
    return number_in_unit


def rotary(unit: str) -> str:
    """The unit [-] that a rotary axis has in place of one: rotary("N/m") = "N m/rad"; the same one for others."""
    product, slash, below = unit.partition("/")
    parts = [_each_rotary(part.strip("()")) for part in (product, below)]
    return parts[0] + (f"/({parts[1]})" if slash and " " in parts[1] else slash + parts[1])


def _each_rotary(product: str) -> str:
    """The factors of a product of units, each as a rotary axis has it."""
    return " ".join(re.sub(r"^[A-Za-z]+", lambda name: ROTARY.get(name[0], name[0]), one) for one in product.split())


def turned(text: str) -> str:
    """The text with the units [-] of a rotary axis: turned("20 µm at 3 N") = "20 µrad at 3 N m".

    For texts that are written for every axis, and for Markdown made of them. A unit that only a rotary axis has stays:
    torques are "N m" already, and no force is multiplied by a length anywhere else.
    """
    cells = _IN_CELL.sub(lambda cell: re.sub(_UNIT_ALONE, lambda found: _turned(found[0]), cell[0]), text)
    words = _WORD.sub(_turned_word, re.sub(r"\b(payload|[Mm]oving) mass\b", r"\1 inertia", cells))
    return _IN_TEXT.sub(lambda found: _turned(found[0]), words.replace("[N$^2$", "[(N m)$^2$"))


def turned_but_quoted(text: str) -> str:
    """`turned` of a message, but not what it quotes of somebody's files or command line, between apostrophes."""
    parts = re.split(r"((?<!\w)'[^']*')", text)
    return "".join(part if i % 2 else turned(part) for i, part in enumerate(parts))


def _turned_word(found: re.Match[str]) -> str:
    """The name of a unit in words as a rotary axis has it."""
    if "metre" in found[0]:
        return f"{found[1] or ''}radian{found[2]}"
    return f"newton metre{found[3]}"


def _turned(unit: str) -> str:
    """A unit of a text as a rotary axis has it; its spaces, what keeps a line from ending behind a slash, and the
    backslashes of Markdown are kept."""
    above, slash, below = unit.partition("/")
    if "rad" in unit or re.search(rf"N{_SPACE}m\b", above):
        return unit
    mark = "\\" * above.endswith("\\")
    space = "\u00a0" if "\u00a0" in unit or "\u2060" in unit else " "
    parts = [_each_turned(part.strip("()\u2060\\"), space) for part in (above, below)]
    joiner = "\u2060" if "\u2060" in unit else ""
    behind = f"{mark}({parts[1]}{mark})" if space in parts[1] else parts[1]
    return parts[0] + (mark + slash + joiner + behind) * bool(slash)


def _each_turned(product: str, space: str) -> str:
    """The factors of a product of units, prefixes kept, each as a rotary axis has it."""
    factors = [
        re.sub(r"^kg$|[mN]$", lambda name: _ROTARY_TEXT[name[0]], factor) for factor in re.split(_SPACE, product)
    ]
    return space.join(factors).replace(" ", space)


def is_rotary(text: object, unit: str) -> bool | None:
    """Whether a text that `parse` takes for `unit` is in the units [-] of a rotary axis; None where these are the
    same, and where the text has no unit."""
    match = _NUMBER.fullmatch(text) if isinstance(text, str) else None
    if match is None or rotary(unit) == unit or not match[2].strip():
        return None
    try:
        return _is_rotary(match[2].strip(), unit)
    except QuantityError:
        return None


def check(number: float, declared: Declaration) -> None:
    """Raises QuantityError if `number` (SI) lies outside the declared range."""
    for wrong, must_be, bound in (
        (declared.above is not None and not number > declared.above, "above", declared.above),
        (declared.at_least is not None and not number >= declared.at_least, "at least", declared.at_least),
        (declared.below is not None and not number < declared.below, "below", declared.below),
        (declared.at_most is not None and not number <= declared.at_most, "at most", declared.at_most),
    ):
        if wrong and bound is not None:
            why = f": {declared.because}" if declared.because and bound != 0 else ""
            raise QuantityError(f"{show(number, declared.unit)} must be {must_be} {show(bound, declared.unit)}{why}")


def nearest(number: float, declared: Declaration) -> float:
    """The number (SI) nearest to this one within the declared range."""
    if declared.above is not None:
        number = max(number, math.nextafter(declared.above, math.inf))
    if declared.at_least is not None:
        number = max(number, declared.at_least)
    if declared.below is not None:
        number = min(number, math.nextafter(declared.below, -math.inf))
    return float(number if declared.at_most is None else min(number, declared.at_most))


def cut(text: object, most: int = 80) -> str:
    """`repr` of what somebody wrote, for a message of one line: at most `most` characters, the middle left out."""
    shown = repr(text) if isinstance(text, str) else reprlib.repr(text)
    return shown if len(shown) <= most else f"{shown[: most - 20]} ... {shown[-15:]}"


def keeps_to(number: float, limit: float) -> bool:
    """Whether a number is at most a limit, but for the rounding of whole samples and steps [any unit]."""
    return bool(number <= limit + ROUNDING * abs(limit))


def listed(words: Iterable[str], last: str = "and") -> str:
    """Words as one reads them out, the last two joined by `last`: "a", "a and b", "a, b and c"; no unit [-]."""
    *before, end = [*words] or [""]
    return f"{', '.join(before)} {last} {end}" if before else end


def show(number: float, unit: str, digits: int = 4, *, like: float | None = None) -> str:
    """`number` (SI, in `unit`) for a reader, with a prefix where the unit takes one: show(2e-5, "m") = "20 µm". An
    infinite time is that of what never happens: show(math.inf, "s") = "never". A force or a torque has a prefix
    where it is below a thousandth: show(2.1e-5, "N") = "21 µN". like: a number (SI) to which it is compared, whose
    prefix it takes: show(9e-7, "m", like=2e-6) = "0.9 µm"."""
    if unit == "s" and number == math.inf:
        return "never"
    if unit == "1":
        return f"{number:.{digits}g}"
    size = abs(number if like is None or not math.isfinite(like) else like)
    if unit == "N/m" and size >= 1e3:
        return f"{_plain(number / 1e3, digits)} N/mm"
    prefixed = unit in {"m", "m/s", "s", "Hz", "W", "rad", "rad/s"} or (unit in {"N", "N m"} and size < 1e-3)
    if prefixed and size != 0 and math.isfinite(size):
        size = float(f"{size:.{digits}g}")  # 999.96 nm are 1 µm to three digits
        scale, prefix = next(((s, p) for s, p in _PREFIXES if size >= 0.9999999 * s), _PREFIXES[-1])
        return f"{_plain(number / scale, digits)} {prefix}{unit}"
    return f"{_plain(number, digits)} {unit.replace('^2', '²')}"


def span(low: str, high: str) -> str:
    """The ends of a range as they are told, once where they read alike: "1 s to 2 s", "1 s"; no unit [-]."""
    return low if low == high else f"{low} to {high}"


def json_name(name: str, unit: str) -> str:
    """The field's name in results.json, with its unit: json_name("kp", "N/m") = "kp_N_per_m"."""
    suffix = unit.replace(" ", "").replace("(", "").replace(")", "")
    if suffix == "1":
        return name
    return f"{name}_" + (f"per_{suffix[2:]}" if suffix.startswith("1/") else suffix.replace("/", "_per_"))


def _plain(number: float, digits: int) -> str:
    """Rounded to `digits` significant digits; without an exponent where a reader would write none."""
    text = f"{number:.{digits}g}"
    return f"{float(text):.0f}" if "e+" in text and abs(number) < 1e6 else text


def _finite(number: str, text: str) -> Decimal:
    try:
        magnitude = Decimal(number)
    except InvalidOperation:
        magnitude = Decimal("nan")
    if not magnitude.is_finite():
        raise QuantityError(f"{cut(text)} is not a finite number")
    return magnitude


@cache
def _registry() -> pint.UnitRegistry[Any]:
    import pint  # noqa: PLC0415  # takes half a second to be ready, and the usual units need no more than _USUAL

    # Decimal, so that "20 um" is the float nearest to 2e-5 and not 1.9999999999999998e-05.
    return pint.UnitRegistry(non_int_type=Decimal)


@cache
def _factor(unit_text: str, unit: str) -> Decimal:
    """How many `unit`s one `unit_text` is. The QuantityError says what is wrong with `unit_text`."""
    given, wanted = _usual(unit_text), _usual(unit)
    if given and wanted and given[:-1] == wanted[:-1] and not given[-2]:
        return Decimal(1).scaleb(given[-1] - wanted[-1])
    return _factor_of_any(unit_text, rotary(unit) if _is_rotary(unit_text, unit) else unit, unit)


@cache
def _is_rotary(unit_text: str, unit: str) -> bool:
    """Whether a unit is of the same dimension as the one that a rotary axis has in place of `unit`, angles
    counted as one. Raises QuantityError for an unknown unit."""
    if rotary(unit) == unit:
        return False
    given, wanted = _usual(unit_text), _usual(rotary(unit))
    return given[:-1] == wanted[:-1] if given and wanted else _is_any_rotary(unit_text, unit)


def _is_any_rotary(unit_text: str, unit: str) -> bool:
    """`_is_rotary` by the registry of units, which knows them all."""
    given, wanted = _quantity(unit_text, unit), _quantity(rotary(unit), unit)
    return given.dimensionality == wanted.dimensionality and _angles(given) == _angles(wanted)


def _quantity(unit_text: str, unit: str) -> Any:
    """One of a unit, by the registry of units. Raises QuantityError for an unknown one; unit: an example for it."""
    registry = _registry()
    text = _TORQUE.sub(r"(\1 \2)", unit_text.replace("kg m2", "kg m^2"))
    try:
        return registry.Quantity(Decimal(1), registry.parse_units(text))
    except Exception as error:  # pint lets its parser's and Python's tokenizer's errors through, of many types
        raise QuantityError(f"has an unknown unit {cut(unit_text)}; write it like {_example(unit)!r}") from error


def _angles(quantity: Any) -> float:
    """The power [-] in which a quantity holds angles, which count as numbers in its dimension."""
    units = quantity._units.items()
    return float(sum(power * _registry().get_root_units(str(one))[1]._units.get("radian", 0) for one, power in units))


def _usual(text: str) -> tuple[int, ...] | None:
    """The powers of a unit that is a product of those in _USUAL, or a ratio of two: "N/(m s)"; None for any other."""
    match = _UNIT.fullmatch(text)
    if match is None:
        return None
    over, product, single = match.groups("")
    factors = [(name, 1) for name in over.split()] + [(name, -1) for name in (product or single).split()]
    if not all(name in _USUAL for name, _ in factors):
        return None
    return tuple(sum(sign * _USUAL[name][i] for name, sign in factors) for i in range(6))


def _factor_of_any(unit_text: str, wanted: str, unit: str) -> Decimal:
    """`_factor` by the registry of units, which knows them all; wanted: `unit`, or what a rotary axis has."""
    import pint  # noqa: PLC0415  # as in _registry

    given = _quantity(unit_text, unit)
    if wanted == unit and _angles(given):
        raise QuantityError(f"is in an angle; {_instead_of_an_angle(unit)}")
    try:
        return Decimal(given.to("" if wanted == "1" else wanted).magnitude)
    except (pint.PintError, TypeError, ArithmeticError) as error:  # offsets and logarithms of units are none here
        expected = "a plain number" if unit == "1" else f"a quantity in {unit}"
        raise QuantityError(
            f"is in {cut(unit_text)[1:-1]}, but this is {expected}, such as {_example(unit)!r}"
        ) from error


def _instead_of_an_angle(unit: str) -> str:
    """What to write where an angle was given for a quantity in `unit`."""
    if rotary(unit) != unit:
        return f"for a rotary axis, write it in {rotary(unit)}"
    return "give frequencies in Hz and damping as a ratio"


def _example(unit: str) -> str:
    return {"1": "0.02", "m": "20 um", "s": "20 ms", "N/m": "800 N/mm", "1/kg": "0.02 1/kg"}.get(unit, f"1.5 {unit}")
