"""The answer in three sentences: where, which, how far; made of results.json's numbers alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from diagnosis.where.sentences import Topic
from models.quantity import listed, show
from studies.wording import effect, fitted

Results = Mapping[str, Any]

UNNAMED: Final = 2  # stages without an effect: as delivered, and re-fitted
MUCH: Final = 0.1  # of the gap that is left for sure without a name, from which on that is said


def sentences(results: Results) -> dict[str, str]:
    """Where, which and how far, each in a sentence or two, and the outcome in a few words."""
    return {
        "outcome": _outcome(results["verdict"]),
        "where": _where(results["where"]),
        "which": _which(results),
        "how_far": _how_far(results["verdict"], results["how_far"]),
    }


def effects_listed(names: Sequence[str], last: str = "and") -> str:
    """Names in words, the last two joined by `last`."""
    return listed([effect(name) for name in names], last)


def _outcome(verdict: Results) -> str:
    alike = f"; in part it looks like {effects_listed(verdict['partly'])}" if verdict["partly"] else ""
    return {
        "attributed": f"Attributed to {effects_listed(verdict['effects'])}",
        "ambiguous": f"Either {effects_listed(_rivals(verdict), 'or')}",
        "none_of_these": f"No effect that was looked for explains it{alike}",
        "nothing_to_explain": "Nothing to explain",
        "parameters": f"Nominal values are off: {effects_listed(verdict['effects'])}",
    }[verdict["outcome"]]


def _rivals(verdict: Results) -> Sequence[str]:
    """The names of which an ambiguous verdict can't tell one from another."""
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
        return "The machine file explains the records as it is: no effect is missing, as far as they can show."
    if outcome == "parameters":
        return (
            f"Nominal values are off, {effects_listed(names)}; re-fitted within their tolerances, no effect is missing."
        )
    if outcome == "none_of_these":
        told = (
            "No effect that was looked for, alone or with others, explains it within its prior range: something else "
            "is at work"
        )
        if verdict["partly"]:
            before, after = (results["how_far"][name]["force_N"] for name in ("gap_refitted", "gap_after"))
            rows = {row["effect"]: row for row in results["which"]}
            shown = [f"{effect(name)}{_parameters(rows.get(name))}" for name in verdict["partly"]]
            told += (
                f". In part it looks like {listed(shown)}: with that, {show(after, 'N', 3)} (rms) of unknown "
                f"force are left of {show(before, 'N', 3)}"
            )
        told += _rough(results["white_force_N"])
        if all(one["replays"] for one in results["where"]["details"]["controller"]):
            return f"{told}."
        return f"{told}; put the log or the controller right first, because what is left may be theirs."
    rows = {row["effect"]: row for row in results["which"]}
    shown = [f"{effect(name)}{_parameters(rows.get(name))}" for name in names]
    if outcome == "ambiguous":
        alike = f"{_others(verdict)}{_rough(results['white_force_N'])}"
        return f"It is {listed(shown)}, or else what these records cannot tell from it: {alike}."
    return f"It is {listed(shown)}{_rough(results['white_force_N'])}."


def _rough(force: Results) -> str:
    if force["taken"] <= force["usual"]:
        return ""
    return (
        f". The drive is rougher than its model: its force scatters by {show(force['taken'], 'N', 2)} from sample to "
        "sample, for which no effect here is a law"
    )


def _others(verdict: Results) -> str:
    """The rivals of those that are in the model."""
    return effects_listed(
        [name for name in _rivals(verdict) if name not in verdict["effects"]] or _rivals(verdict), "or"
    )


def _parameters(row: Results | None) -> str:
    """The fitted values in brackets, the strongest member's first; phases and switches are left to the table."""
    if row is None or not row["parameters"]:
        return ""
    return f" ({'; and '.join(_values(one) for one in (row['parameters'], *row['further_members']))})"


def _values(parameters: Results) -> str:
    return ", ".join(
        f"{effect(name)} {fitted(item, 3, show)}"
        for name, item in sorted(parameters.items())
        if item["role"] not in {"phase", "switch"}
    )


def _how_far(verdict: Results, far: Results) -> str:
    floor = _gap(far["floor"])
    if far["floor_source"] == "repeats":
        floor += ", which is what does not repeat between equal motions"
    if verdict["outcome"] == "nothing_to_explain":
        return (
            f"As delivered the model leaves {_gap(far['gap_as_delivered'])} of position; a table that is exactly the "
            f"model would leave {floor}."
        )
    if verdict["outcome"] == "parameters":
        moved = _from_to(far["gap_as_delivered"], far["gap_refitted"])
        return f"The re-fit takes it {moved}; the floor is {floor}."
    low, high = far["closure_interval"]
    if verdict["outcome"] == "none_of_these" and len(far["stages"]) <= UNNAMED:
        return (
            "No effect takes enough off it to go into the model; the re-fitted model leaves "
            f"{_gap(far['gap_refitted'])} of position, its floor is {floor}."
        )
    moved = _from_to(far["gap_refitted"], far["gap_after"])
    part = verdict["outcome"] == "none_of_these"
    return (
        f"On motions left out {'what goes into the model' if part else 'this'} closes {100 * far['closure']:.0f} % "
        f"({100 * low:.0f} to {100 * high:.0f} %) of what separates the re-fitted model from its floor"
        f"{', which is not the whole answer' if part else ''}: {moved}{_nameless(verdict, far)}; the floor is {floor}."
    )


def _nameless(verdict: Results, far: Results) -> str:
    """What several names surely leave of the gap. One may leave as much where nothing more is missing, so that its
    closure is all that is said; how much a mismatch or late commands explain, no closure tells."""
    names, (low, high) = verdict["effects"], far["closure_interval"]
    if len(names) < 2 or {"controller_mismatch", "timing_jitter"} & set(names) or 1 - high < MUCH:
        return ""
    return f"; {100 * (1 - high):.0f} to {100 * (1 - low):.0f} % of the gap have no name here"


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
