"""Words and numbers that every report writes alike: the Jinja2 filters of the studies' templates."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final

from models.machine import Machine
from models.machines.provenance import Provenance
from models.quantity import listed, show, span
from reports.markup import RAISED
from reports.units import length_unit
from studies.scattered import high_end

EXPONENT: Final = re.compile(r"(?P<digits>\d(?:\.\d+)?)e(?P<sign>[+-]?)0*(?P<power>\d+)")
MAX_DIGITS: Final = 12
"""Digits beyond which nothing is told from its limit."""
PLAIN: Final = 6
"""Powers of ten below this one are written out: 220 for 2.2e+02."""
PROPER: Final = {"stribeck": "Stribeck", "dac": "DAC", "aic": "AIC"}
SEVERAL: Final = 10.0  # from which on a ratio is told as so many times and not in percent [1]


def filters() -> dict[str, Callable[..., Any]]:
    """The filters by the names that templates use."""
    return {
        "show": quantity,
        "percent": percent,
        "signed": signed,
        "checked": checked,
        "several": several,
        "scientific": scientific,
        "beside": beside,
        "rounded": rounded,
        "deviation": deviation,
        "amount": amount,
        "slowest": slowest,
        "settles": settles,
        "all_settle": all_settle,
        "length_or_dash": length_or_dash,
        "beyond_records": beyond_records,
        "from_to": from_to,
        "words": words,
        "span": lambda ends: span(*ends),
        "effect": effect,
        "source": source,
        "high_end": high_end,
    }


def quantity(number: float | None, unit: str, digits: int = 4) -> str:
    """A number (SI) with its unit, which do not come apart at a line's end; None stands for one that is not finite."""
    return "never" if number is None else _unbroken(powers(show(number, unit, digits)))


def beside(number: float, std: float, unit: str) -> str:
    """A number (SI) with its unit, rounded where its standard deviation has its second digit."""
    if not (number and std and math.isfinite(std)):
        return quantity(number, unit, 5)
    places = math.floor(math.log10(abs(number))) - math.floor(math.log10(abs(std)))
    return quantity(number, unit, min(max(places + 2, 1), 6))


def rounded(parameter: Mapping[str, Any]) -> str:
    """An identified parameter's number, or its numbers, each to the digits that its standard deviation leaves."""
    number, std, unit = parameter["number"], parameter["std"], parameter["unit"]
    if std is None or isinstance(number, str):
        return amount(parameter)
    numbers, deviations = (one if isinstance(one, list) else [one] for one in (number, std))
    if len(deviations) != len(numbers):
        return amount(parameter)
    return ", ".join(beside(one, its, unit) for one, its in zip(numbers, deviations, strict=True))


def deviation(parameter: Mapping[str, Any]) -> str:
    """An identified parameter's standard deviation, or those of its numbers; a tolerance, which is one, has none."""
    std, unit = parameter["std"], parameter["unit"]
    if std is None or parameter["name"].startswith("tolerance."):
        return "–"
    return ", ".join(quantity(one, unit, 2) for one in (std if isinstance(std, list) else [std]))


def scientific(number: float, digits: int = 2) -> str:
    """A number without a unit that is far from 1: scientific(2.5e-12) = "2.5 · 10⁻¹²"."""
    return "0" if number == 0 else _unbroken(powers(f"{number:.{digits - 1}e}"))


def powers(text: str) -> str:
    """The numbers of a text with their exponents as a page has them, "7.3 · 10⁷" for 7.3e+07 and "10⁻⁹" for 1e-09."""

    def printed(found: re.Match[str]) -> str:
        if found["sign"] != "-" and int(found["power"]) < PLAIN:
            return f"{float(found[0]):.0f}"
        factor = "" if found["digits"] == "1" else f"{found['digits']} · "
        return f"{factor}10{(found['sign'].strip('+') + found['power']).translate(RAISED)}"

    return EXPONENT.sub(printed, text)


def _unbroken(text: str) -> str:
    """The text with no place at which a line may end: no-break spaces, and a word joiner behind a slash."""
    return text.replace(" ", "\u00a0").replace("/", "/\u2060")


def fitted(item: Mapping[str, Any], digits: int, quantity: Callable[[float, str, int], str] = quantity) -> str:
    """A fitted value with its standard deviation, as far as this has two digits; a value at the end of its range has
    no deviation, nor may one that was not fitted, which has so many digits."""
    value, std, unit = item["value"], item["std"], item["unit"]
    if std == 0:
        return f"{quantity(value, unit, digits)} at the end of its range"
    if std is None:
        return quantity(value, unit, digits)
    told = value != 0 and math.isfinite(std)
    known = 2 + math.floor(math.log10(abs(value))) - math.floor(math.log10(std)) if told else 0
    return f"{quantity(value, unit, min(max(known, 2), MAX_DIGITS))} ± {quantity(std, unit, 2)}"


def percent(ratio: float | None) -> str:
    """A relative difference with its sign, in percent."""
    return "–" if ratio is None else f"{signed(100 * ratio, 1)} %"


def signed(number: float, decimals: int = 2) -> str:
    """A number with its sign, of which one that rounds to nothing has none."""
    text = f"{number:+.{decimals}f}"
    return text[1:] if float(text) == 0 else text


def checked(number: float | None, limit: float, unit: str, digits: int = 4) -> str:
    """A check's value, with as many more digits as tell it from its limit: "2.202" beside 2.2, which it exceeds."""
    while number is not None and number != limit and digits < MAX_DIGITS:
        if quantity(number, unit, digits) != quantity(limit, unit, digits):
            break
        digits += 1
    return quantity(number, unit, digits)


def several(count: int, one: str, more: str = "") -> str:
    """A number of things with their name: "1 table", "3 tables"."""
    return f"{count}\u00a0{one if count == 1 else more or one + 's'}"


def slowest(times: Iterable[float | None]) -> float | None:
    """The largest of the times [s]; None, a motion that never settles, is larger than any."""
    every = list(times)
    return None if None in every else max(time for time in every if time is not None)


def settles(time: float | None, digits: int = 4) -> str:
    """That a motion settles in a time [s]; None and infinity are the time of one that never does."""
    return "never settles" if time is None or math.isinf(time) else f"settles in {quantity(time, 's', digits)}"


def all_settle(slowest: float | None, digits: int = 4) -> str:
    """That motions settle in the time of the slowest [s], or that not all do (None)."""
    if slowest is None or math.isinf(slowest):
        return "some motions never settle"
    return f"every motion settles in {quantity(slowest, 's', digits)}"


def in_percent(ratio: float) -> str:
    """A ratio [1] in percent, as long as that is easily read."""
    return f"{float(f'{100 * ratio:.2g}'):g} %" if abs(ratio) < SEVERAL else f"{ratio:.0f} times"


def length_or_dash(length: float | None) -> str:
    """A length [m] to two digits; None, for which there is none, is a dash."""
    return "–" if length is None else quantity(length, "m", 2)


def cited(machine: Machine, name: str) -> str:
    """Where a value of the machine comes from, as the source of a check against it: "paper: II.D".

    What was given was given to whoever wrote the machine file, not to the study at hand, which may have an option of
    the same name.
    """
    said = machine.sources.get(name, Provenance("assumed", "set in a program"))
    text = f"{said.kind}: {said.detail}" if said.detail else said.kind
    return f"machine file, {text}" if said.kind == "given" else text


def beyond_records(one: Mapping[str, Any]) -> str:
    """What a design needs beyond the records that the machine is from, a row of `excess_to_json`."""
    needed, covered = (show(one[name], one["unit"], 3) for name in ("needed", "covered"))
    return f"{needed} of {one['what']}, beyond the {covered} that the machine's records reach: extrapolated"


def from_to(origin: float, target: float) -> str:
    """A motion between two positions [m], in the unit that a figure's axis would have: "20 → 40 µm"."""
    count, unit = length_unit(max(abs(origin), abs(target)))
    return _unbroken(f"{_plain(count * origin)} → {_plain(count * target)} {unit}")


def _plain(number: float) -> str:
    return f"{round(number, 3):.10g}"


def amount(parameter: Mapping[str, Any]) -> str:
    """A parameter's number, or its numbers, with the unit."""
    number, unit = parameter["number"], parameter["unit"]
    if isinstance(number, str):
        return number
    if not isinstance(number, list):
        return quantity(number, unit, 6)
    if len(set(number)) == 1:
        return f"{quantity(number[0], unit, 6)} (each of {len(number)})"
    return ", ".join(quantity(item, unit, 6) for item in number)


def source(parameter: Mapping[str, Any]) -> str:
    """Where a parameter's value is from, with the record and the standard deviation where it was identified."""
    said, unit = parameter["provenance"], parameter["unit"]
    text = f"{said['kind']}: {said['detail']}" if said["detail"] else said["kind"]
    if said["record"]:
        text += f", record {said['record']}" + (f" (SHA-256 {said['sha256'][:12]}…)" if said["sha256"] else "")
    if said["std"] is not None:
        text += f", standard deviation {_deviation(said['std'], unit)}"
    return text


def _deviation(std: float | list[float], unit: str) -> str:
    """A standard deviation, or the range of several."""
    if not isinstance(std, list):
        return quantity(std, unit, 2)
    low, high = quantity(min(std), unit, 2), quantity(max(std), unit, 2)
    return span(low, high)


def words(name: str) -> str:
    """A dotted name as words that a table may break: "plant.dead_time" becomes "plant: dead time"."""
    return name.replace(".", ": ", 1).replace(".", " ").replace("_", " ")


def effect(name: str) -> str:
    """The name of an effect or of a nominal parameter in words: "dac_quantisation" becomes "DAC quantisation"."""
    return " ".join(PROPER.get(word, word) for word in name.split("_"))


def effects_listed(names: Sequence[str], last: str = "and") -> str:
    """Such names in words, the last two joined by `last`."""
    return listed([effect(name) for name in names], last)
