"""What is said of nominal values that are off, and whether they are most of what separates model and records."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from models.quantity import listed, show
from studies.gap_diagnosis import moved_most
from studies.gap_diagnosis.moved_most import refit_is_most
from studies.gap_diagnosis.stated_effects import moved_values
from studies.wording import effect, in_percent

Results = Mapping[str, Any]

SHIFTED: Final = 2.0  # deviations of its tolerance, from which on a value counts as off
TRADED: Final = 0.5  # of a dead time's move, below which that of the whole delay is a trade with a lag


def off_by(row: Results) -> str:
    """By how much a nominal value was off: of several of its kind, the one that moved the most, and of contacts what
    all of them come to; of a dead time that a lag makes up for, the whole delay."""
    size = row["moved"] * max(row["std"])
    if is_traded(row):
        return f"input delay by {show(row['delay'], row['unit'], 2)} in all"
    told = in_percent(math.expm1(size)) if row["unit"] == "1" else show(size, row["unit"], 2)  # relative: logarithms
    if row.get("in_all") is not None:
        whole = f"{effect(row['name'])} by {in_percent(row['in_all'])}"
        more = row["values"] > 1 and abs(math.expm1(size)) > abs(row["in_all"])
        return f"{whole} in all (single contacts by up to {told})" if more else whole
    return f"{effect(row['name'])} by {'up to ' if row['values'] > 1 else ''}{told}"


def mostly(results: Results) -> list[Results]:
    """The values that are off, where they and nothing else are most of the gap to the noise floor, in force; else none.

    Contacts stand in for each other, so that they count by what all of them come to. A re-fit without effects bends
    values to make up for them, so that where some are named, or a law is learned, those are told that are off beside.
    Those that take most of the gap are told before them.
    """
    if not refit_is_most(results):
        return []
    before = moved_most.covered(results)
    return [row for row in map(beside_effects, results["shifts"]) if _is_off(row) and row["name"] not in before]


def stated_mostly(results: Results) -> Sequence[Results]:
    """The values of effects that the file states that are off, where re-fitted values alone close most of the gap."""
    return stated_beside(results) if refit_is_most(results) else ()


def stated_beside(results: Results) -> Sequence[Results]:
    """The values of effects that the file states that are off, but for those that take most of the gap."""
    before = moved_most.covered(results)
    return [row for row in results.get("stated_effects", ()) if row["effect"] not in before]


def is_traded(row: Results) -> bool:
    """Whether a dead time was moved against a lag, so that the whole delay moved by far less."""
    size, delay = row["moved"] * max(row["std"]), row.get("delay")
    return delay is not None and abs(delay) < TRADED * abs(size)


def beside_effects(row: Results) -> Results:
    """The row by the fit with effects, where there is one that counts."""
    if row.get("beside") is None:
        return row
    return {**row, "moved": row["beside"], "in_all": row["in_all_beside"], "delay": row.get("delay_beside")}


def _is_off(row: Results) -> bool:
    if is_traded(row):
        return bool(abs(row["delay"]) > SHIFTED * max(row["std"]))
    if row.get("in_all") is not None:
        return bool(abs(row["in_all"]) > SHIFTED * max(row["std"]))
    return bool(abs(row["moved"]) > SHIFTED)


def told_off(rows: Sequence[Results], results: Results, stated: Sequence[Results] = ()) -> str:
    """A sentence on them, and on the values of `stated` effects, with what the re-fit leaves [N]; on those that take
    most of the gap first, where no effect or law is told after them."""
    beside = any(row.get("beside") is not None for row in rows)
    first = moved_most.among_others(results)
    off = listed([*first, *moved_values(stated), *(off_by(row) for row in rows)])
    far = results["how_far"]
    before, after, floor = (
        show(far[name]["force_N"], "N", 3) for name in ("gap_as_delivered", "gap_refitted", "floor")
    )
    if beside:
        return f"Nominal values are off, too, {off}."
    none_left = far["gap_refitted"]["force_N"] < far["floor"]["force_N"]
    least = f"no more than the noise floor of {floor}" if none_left else f"beside a noise floor of {floor}"
    told = f"Nominal values are off, {off}; re-fitted, they reduce the unknown force from {before} to {after}, {least}."
    lacks = results["verdict"]["outcome"] == "none_of_these" and not none_left and len(rows) + len(first) > 1
    return f"{told} Some of them may stand in for what the model lacks." if lacks else told


def values_in_short(results: Results) -> str:
    """The names of the values that are off, where they alone are most of the gap; else nothing."""
    rows = [*(row["effect"] for row in stated_mostly(results)), *map(name_of, mostly(results))]
    return listed([*moved_most.names(results), *(effect(name) for name in dict.fromkeys(rows))])


def name_of(row: Results) -> str:
    """The name of a value that is off; of a dead time that a lag makes up for, that of the whole delay."""
    return "input_delay" if is_traded(row) else str(row["name"])
