"""The answer in three sentences: where, which, how far; made from results.json alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from diagnosis.where.sentences import Topic
from models.quantity import listed, show
from studies.wording import effect, fitted

Results = Mapping[str, Any]

UNNAMED: Final = 2  # number of stages without an effect: as delivered, and re-fitted
MUCH: Final = 0.1  # share of the gap that surely stays unexplained, from which on the answer says so


def sentences(results: Results) -> dict[str, str]:
    """Where, which and how far, each in a sentence or two, and the outcome in a few words."""
    return {
        "outcome": _outcome(results["verdict"]),
        "where": _where(results["where"]),
        "which": _which(results),
        "how_far": _how_far(results),
    }


def effects_listed(names: Sequence[str], last: str = "and") -> str:
    """Names in words, the last two joined by `last`."""
    return listed([effect(name) for name in names], last)


def _outcome(verdict: Results) -> str:
    alike = f"; in part it resembles {effects_listed(verdict['partly'])}" if verdict["partly"] else ""
    return {
        "attributed": f"Attributed to {effects_listed(verdict['effects'])}",
        "ambiguous": f"Either {effects_listed(_rivals(verdict), 'or')}",
        "none_of_these": f"No effect of the catalogue explains it{alike}",
        "nothing_to_explain": "Nothing to explain",
        "parameters": f"Nominal values are off: {effects_listed(verdict['effects'])}",
    }[verdict["outcome"]]


def _rivals(verdict: Results) -> Sequence[str]:
    """The effects that an ambiguous verdict cannot distinguish."""
    return list(verdict["equivalent"][0]) if verdict["equivalent"] else list(verdict["effects"])


def _where(where: Results) -> str:
    """The record that the controller does not replay, the size of the force, and on what it depends or else where it
    lies."""
    stated = list(zip(where["topics"], where["statements"], strict=True))

    def on(topic: Topic) -> list[str]:
        return [text for about, text in stated if about == topic]

    rest = [text for about, text in stated if about not in {Topic.CONTROLLER, Topic.UNCHECKED, Topic.SIZE}]
    return " ".join([*on(Topic.CONTROLLER)[:1], *on(Topic.SIZE), *(on(Topic.COORDINATE) or rest)[:1]])


def _which(results: Results) -> str:
    verdict = results["verdict"]
    outcome, names = verdict["outcome"], verdict["effects"]
    if outcome == "nothing_to_explain":
        return "The machine file explains the records as it is: as far as they can show, no effect is missing."
    if outcome == "parameters":
        return (
            f"Nominal values are off, {effects_listed(names)}; re-fitted within their tolerances, no effect is missing."
        )
    if outcome == "none_of_these":
        told = (
            "No effect of the catalogue, alone or with others, explains it within its prior range: the cause is out of "
            "catalogue"
        )
        if verdict["partly"]:
            before, after = (results["how_far"][name]["force_N"] for name in ("gap_refitted", "gap_after"))
            rows = {row["effect"]: row for row in results["which"]}
            shown = [f"{effect(name)}{_parameters(rows.get(name))}" for name in verdict["partly"]]
            told += (
                f". In part it resembles {listed(shown)}, with which the unknown force falls from "
                f"{show(before, 'N', 3)} to {show(after, 'N', 3)} (rms)"
            )
        told += _rough(results["white_force_N"])
        if all(one["replays"] for one in results["where"]["details"]["controller"]):
            return f"{told}."
        return f"{told}. Correct the log or the controller first, because the rest may be due to it."
    rows = {row["effect"]: row for row in results["which"]}
    shown = [f"{effect(name)}{_parameters(rows.get(name))}" for name in names]
    if outcome == "ambiguous":
        alike = f"{_others(verdict)}{_rough(results['white_force_N'])}"
        return f"It is {listed(shown)}, or what these records cannot distinguish from it: {alike}."
    return f"It is {listed(shown)}{_rough(results['white_force_N'])}."


def _rough(force: Results) -> str:
    if force["taken"] <= force["usual"]:
        return ""
    return (
        f". The drive is rougher than its model: its force scatters by {show(force['taken'], 'N', 2)} from sample to "
        "sample, which no effect of the catalogue describes"
    )


def _others(verdict: Results) -> str:
    """The rivals of those that are in the model."""
    return effects_listed(
        [name for name in _rivals(verdict) if name not in verdict["effects"]] or _rivals(verdict), "or"
    )


def _parameters(row: Results | None) -> str:
    """The fitted values in brackets, those of the strongest member first; phases and switches stand in the table."""
    if row is None or not row["parameters"]:
        return ""
    return f" ({'; and '.join(_values(one) for one in (row['parameters'], *row['further_members']))})"


def _values(parameters: Results) -> str:
    return ", ".join(
        f"{effect(name)} {fitted(item, 3, show)}"
        for name, item in sorted(parameters.items())
        if item["role"] not in {"phase", "switch"}
    )


def _how_far(results: Results) -> str:
    verdict, far = results["verdict"], results["how_far"]
    floor = _gap(far["floor"])
    if far["floor_source"] == "repeats":
        floor += ", the scatter between equal motions"
    if verdict["outcome"] == "nothing_to_explain":
        return (
            f"The model as delivered leaves {_gap(far['gap_as_delivered'])} of position; the noise floor of a complete "
            f"model is {floor}."
        )
    if verdict["outcome"] == "parameters":
        moved = _from_to(far["gap_as_delivered"], far["gap_refitted"])
        return f"The re-fit reduces the gap {moved}; the noise floor is {floor}."
    low, high = far["closure_interval"]
    if verdict["outcome"] == "none_of_these" and len(far["stages"]) <= UNNAMED:
        return (
            "No effect reduces the gap by enough to go into the model; the re-fitted model leaves "
            f"{_gap(far['gap_refitted'])} of position, and the noise floor is {floor}."
        )
    moved = _from_to(far["gap_refitted"], far["gap_after"])
    part = verdict["outcome"] == "none_of_these"
    return (
        f"On held-out motions {'what goes into the model' if part else 'this'} closes {100 * far['closure']:.0f} % "
        f"({100 * low:.0f} to {100 * high:.0f} %) of the gap between the re-fitted model and the noise floor"
        f"{', which is not the whole answer' if part else ''}: {moved}{_unexplained(results)}; the noise floor is "
        f"{floor}."
    )


def _unexplained(results: Results) -> str:
    """The share of the gap that several effects surely leave unexplained. A single effect may leave as much where
    nothing more is missing, and the closure does not measure effects that show in the log only."""
    names, (low, high) = results["verdict"]["effects"], results["how_far"]["closure_interval"]
    logged = any(results["catalogue"][name]["shown_in"] == "log" for name in names)
    if len(names) < 2 or logged or 1 - high < MUCH:
        return ""
    return f"; {100 * (1 - high):.0f} to {100 * (1 - low):.0f} % of the gap remain unexplained"


def _from_to(before: Results, after: Results) -> str:
    """The gap before and after; in settling times where the records have motions that settle."""
    parts = [
        f"from {show(before['force_N'], 'N', 3)} to {show(after['force_N'], 'N', 3)} of unknown force",
        f"from {show(before['position_m'], 'm', 3)} to {show(after['position_m'], 'm', 2)} of position",
    ]
    if None not in (before["settling_s"], after["settling_s"]):
        parts.append(f"from {show(before['settling_s'], 's', 2)} to {show(after['settling_s'], 's', 2)} of settling")
    return ", ".join(parts)


def _gap(gap: Results) -> str:
    return f"{show(gap['force_N'], 'N', 2)} and {show(gap['position_m'], 'm', 2)}"
