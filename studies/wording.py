"""Words and numbers that every report writes alike: the Jinja2 filters of the studies' templates."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

from models.machine import Machine
from models.machines.provenance import Provenance
from models.quantity import show

PROPER: Final = {"stribeck": "Stribeck", "dac": "DAC", "aic": "AIC"}


def filters() -> dict[str, Callable[..., Any]]:
    """The filters by the names that templates use."""
    return {
        "show": quantity,
        "percent": percent,
        "amount": amount,
        "slowest": slowest,
        "length_or_dash": length_or_dash,
        "beyond_records": beyond_records,
        "micrometres": micrometres,
        "words": words,
        "effect": effect,
        "source": source,
    }


def quantity(number: float | None, unit: str, digits: int = 4) -> str:
    """A number (SI) with its unit, which do not come apart at a line's end; None stands for one that is not finite."""
    return "never" if number is None else _unbroken(show(number, unit, digits))


def _unbroken(text: str) -> str:
    """The text with no place at which a line may end: no-break spaces, and a word joiner behind a slash."""
    return text.replace(" ", "\u00a0").replace("/", "/\u2060")


def fitted(item: Mapping[str, Any], digits: int, quantity: Callable[[float, str, int], str] = quantity) -> str:
    """A fitted value with its standard deviation, of which one at the end of its range has none."""
    value = quantity(item["value"], item["unit"], digits)
    if item["std"] == 0:
        return f"{value} at the end of its range"
    return value if item["std"] is None else f"{value} ± {quantity(item['std'], item['unit'], 2)}"


def percent(ratio: float | None) -> str:
    """A relative difference with its sign, in percent."""
    return "–" if ratio is None else f"{100 * ratio:+.1f} %"


def slowest(times: Iterable[float | None]) -> float | None:
    """The largest of the times [s]; None, a motion that never settles, is larger than any."""
    every = list(times)
    return None if None in every else max(time for time in every if time is not None)


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


def micrometres(length: float) -> str:
    """A length [m] in micrometres, without the unit."""
    return f"{round(1e6 * length, 3):g}"


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
    return low if low == high else f"{low} to {high}"


def words(name: str) -> str:
    """A dotted name as words that a table may break: "plant.dead_time" becomes "plant: dead time"."""
    return name.replace(".", ": ", 1).replace(".", " ").replace("_", " ")


def effect(name: str) -> str:
    """The name of an effect or of a nominal parameter in words: "dac_quantisation" becomes "DAC quantisation"."""
    return " ".join(PROPER.get(word, word) for word in name.split("_"))
