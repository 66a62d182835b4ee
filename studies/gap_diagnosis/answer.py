"""The answer in sentences: where, which, how far; made from results.json alone."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from diagnosis.criteria import Criteria
from diagnosis.where.sentences import Topic
from models.quantity import listed, show
from studies.gap_diagnosis import common_factor, how_far, moved_most, stated_effects, unknown_law
from studies.gap_diagnosis.course import is_unsure, marked, unconfirmed
from studies.gap_diagnosis.moved_most import refit_is_most
from studies.gap_diagnosis.no_name import never_the_same, noise_alone, without_a_name, without_a_name_in_short
from studies.gap_diagnosis.stated_effects import moved_values
from studies.gap_diagnosis.too_small import too_small
from studies.gap_diagnosis.values_off import (
    beside_effects,
    is_traded,
    mostly,
    name_of,
    off_by,
    stated_beside,
    told_off,
)
from studies.gap_diagnosis.weights_told import far_off, roughness
from studies.wording import effect, effects_listed, fitted, in_percent

Results = Mapping[str, Any]

MOVED: Final = 3.0  # standard deviations by which the input delay has to move for a sentence
LIMIT: Final = "kept_below_rating_N"
MIN_SHARE_AT_RATING: Final = 0.05  # of a record's samples, from which on it is told first that its drive is at its end
ROUNDING_SHARE: Final = 0.01  # of what a replay leaves: below it a change leaves rounding alone


def sentences(results: Results) -> dict[str, str]:
    """Where, which and how far, each in a sentence or more, and the outcome in a few words."""
    return {
        "outcome": _outcome(results),
        "where": " ".join([_where(results["where"]), *_beyond_a_model(results)]),
        "which": " ".join(_which(results)),
        "how_far": " ".join(how_far.sentences(results)),
    }


def front(results: Results) -> dict[str, str | list[str]]:
    """The same for the first page, beside a figure of the gap: where, which and how far in short, and the rest as
    remarks, a sentence or two each."""
    which, remarks = _which(results), how_far.remarks(results)
    leads = 2 if resembles(results["verdict"]) or unknown_law.is_the_answer(results) else 1
    leads += len(moved_most.sentence(results))
    return {
        "where": " ".join([_where(results["where"]), *_beyond_a_model(results)]),
        "which": " ".join(which[:leads]),
        "how_far": " ".join(how_far.in_short(results)),
        "remarks": [*which[leads:], *remarks],
    }


def _outcome(results: Results) -> str:
    """The outcome in a few words, values that take most of the gap before any name."""
    told, first = _named(results), moved_most.names(results) if moved_most.told_alone(results) else []
    if not first:
        return told
    return f"Nominal values are off: {listed(first)}; besides, {told[0].lower()}{told[1:]}"


def _named(results: Results) -> str:
    verdict = results["verdict"]
    if is_unsure(verdict):
        return f"No name is sure; it looks like {effects_listed(verdict['partly'])}"
    alike = f"; in part it resembles {effects_listed(verdict['partly'])}" if verdict["partly"] else ""
    if unknown_law.is_the_answer(results):
        return f"{unknown_law.in_short(results['learned'])} explains it, which has no name in the catalogue"
    return {
        "attributed": f"Attributed to {effects_listed(verdict['effects'])}{marked(verdict)}",
        "ambiguous": f"Either {_listed_or(_rivals(verdict), results)}",
        "none_of_these": f"{without_a_name_in_short(results)}{alike}",
        "nothing_to_explain": "Nothing to explain",
        "parameters": f"Nominal values are off: {listed(_wrong_values(results))}",
    }[verdict["outcome"]]


def _wrong_values(results: Results) -> list[str]:
    """The names of values that are off, where nothing else is: those that take most of the gap first."""
    before, rows = moved_most.covered(results), {row["name"]: row for row in results["shifts"]}
    names = stated_effects.first(results, results["verdict"]["effects"])
    others = [name_of(rows[name]) if name in rows else name for name in names if name not in before]
    return [*moved_most.names(results), *(effect(name) for name in dict.fromkeys(others))]


def resembles(verdict: Results) -> bool:
    """Whether names are told that explain a part, without being the answer."""
    return bool(verdict["outcome"] == "none_of_these" and verdict["partly"] and not is_unsure(verdict))


def _unsure(results: Results) -> list[str]:
    """What is said of names that are not sure; nothing where they are, or where there are none."""
    verdict = results["verdict"]
    if not is_unsure(verdict):
        return []
    names, reason = effects_listed(verdict["partly"]), results["asked"]["reason"]
    return [f"It looks like {names}, but no independent record has confirmed it: {reason}."]


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


def _beyond_a_model(results: Results) -> list[str]:
    """That the axis swings at rest, that the commands stop below the rated thrust, or that the drive gave all that it
    can for much of a record, where it did: no model of a stable loop does the like."""
    swinging = [f"The axis of {one['name']} {one['swings']}." for one in results["records"] if one.get("swings")]
    kept = [(one["name"], show(one[LIMIT], "N", 4)) for one in results["records"] if one.get(LIMIT)]
    if kept:
        names, limits = listed([name for name, _ in kept]), listed(dict.fromkeys(limit for _, limit in kept))
        swinging.append(
            f"The commands of {names} stop at {limits} either way, below the rated thrust; "
            "where the drive limits them, state that as rated_thrust in [drive], and anti_windup in [control]."
        )
    often = [one for one in results["records"] if one.get("at_rating", 0.0) >= MIN_SHARE_AT_RATING]
    if not often:
        return swinging
    shares = listed([f"{100 * one['at_rating']:.0f} % of {one['name']}" for one in often])
    return [
        *swinging,
        f"The command stands at the rated thrust in {shares}: the axis swings, or more is asked of it than it can do; "
        "see to that first.",
    ]


def _which(results: Results) -> list[str]:
    """The name, or that there is none, and what is to be said of it, in sentences."""
    verdict = results["verdict"]
    outcome, names = verdict["outcome"], verdict["effects"]
    led = outcome == "none_of_these" and not is_unsure(verdict) and not never_the_same(results)
    first = outcome == "parameters" or (led and refit_is_most(results))
    stated = [] if first else stated_effects.told(stated_beside(results))
    beside = [*_elements(results), *stated, *common_factor.told(results.get("common_factor"))]
    if outcome == "nothing_to_explain":
        told = "The machine file explains the records as it is: as far as they can show, no effect is missing."
        return [told, *beside]
    if outcome == "parameters":
        rows = {row["name"]: row for row in results["shifts"]}
        moved, before = stated_beside(results), moved_most.covered(results)
        others = [name for name in names if name not in before | {row["effect"] for row in moved}]
        off = [*moved_values(moved), *(off_by(rows[name]) if name in rows else effect(name) for name in others)]
        off = [*moved_most.among_others(results), *off]
        return [f"Nominal values are off, {listed(off)}; {_beside_values(results['how_far'])}.", *beside]
    if outcome == "none_of_these":
        return [*_nameless(results), *beside]
    rows = {row["effect"]: row for row in results["which"]}
    shown = [f"{effect(name)}{_another_form(verdict, name)}{_parameters(rows.get(name))}" for name in names]
    rough, sure = roughness(results), unconfirmed(results)
    values = moved_most.sentence(results)
    begins = f"Besides these, it is {listed(shown)}" if values else f"It is {listed(shown)}"
    if outcome == "ambiguous":
        told = f"{begins}, or what these records cannot distinguish from it: {_others(results)}."
        delay = _input_delay(results) if "dead_time" in _rivals(verdict) else []
        return [*values, told, *_at_rating(results), *rough, *delay, *sure, *beside]
    curve = results.get("learned")
    by_curve = unknown_law.told(curve) if unknown_law.has_curve(curve) else []
    return [
        *values,
        " ".join([f"{begins}.", *_as_logged(results)]),
        *_at_rating(results),
        *rough,
        *by_curve,
        *_said_beside(results),
        *sure,
        *beside,
    ]


def _beside_values(far: Results) -> str:
    """What is missing beside nominal values that are off: nothing, or a force so slow that innovations do not show it,
    for which no law of the catalogue was found and values may stand in."""
    left, least = (far[name]["force_N"] for name in ("gap_refitted", "floor"))
    if left**2 <= Criteria().min_force_ratio * least**2:
        return "re-fitted, no effect is missing"
    return (
        f"re-fitted, they leave a slow force of {show(left, 'N', 2)} that no effect was found for (the noise floor is "
        f"{show(least, 'N', 2)}): values may stand in for it, and other records be predicted worse than as delivered"
    )


def _nameless(results: Results) -> list[str]:
    """What is said where what is left has no name: what it resembles, and what else it may be."""
    verdict, repeats_never = results["verdict"], never_the_same(results) or noise_alone(results)
    values = moved_most.sentence(results)
    told = _unsure(results) or repeats_never or without_a_name(results)
    if unknown_law.is_the_answer(results):
        return [*values, *unknown_law.told(results["learned"]), *told, *roughness(results)]
    if resembles(verdict):
        before, after = (results["how_far"][name]["force_N"] for name in ("gap_refitted", "gap_after"))
        rows = {row["effect"]: row for row in results["which"]}
        shown = [f"{effect(name)}{_parameters(rows.get(name))}" for name in verdict["partly"]]
        part = (
            f"In part it resembles {listed(shown)}, with which the unknown force "
            f"{'falls' if after < before else 'does not fall: it goes'} from {show(before, 'N', 3)} to "
            f"{show(after, 'N', 3)} (rms)."
        )
        told = [told[0], part, *told[1:]]
    told = [*values, *told, *roughness(results)]
    told += [] if repeats_never else unknown_law.told(results.get("learned"))
    if all(one["replays"] for one in results["where"]["details"]["controller"]):
        return told
    return [*told, "Correct the log or the controller first, because the rest may be due to it."]


def _as_logged(results: Results) -> list[str]:
    """The one change of the log with which every record's commands are reproduced, where a name is of the log."""
    catalogue, replays = results["catalogue"], results["where"]["details"]["controller"]
    of_log = any(catalogue.get(name, {}).get("shown_in") == "log" for name in results["verdict"]["effects"])
    failing = [one for one in replays if not one["replays"]]
    changes = {one["would_fit"] for one in failing}
    least = [one["would_leave_N"] <= min(one["tolerance_N"], ROUNDING_SHARE * one["rms_N"]) for one in failing]
    if not of_log or len(changes) != 1 or None in changes or not all(least):
        return []
    return [f"With {changes.pop()}, the stated controller makes the commands: correct the log, or the file, by that."]


def _at_rating(results: Results) -> list[str]:
    """What named laws of the thrust take at the rated one, where their size is stated at another."""
    named = results["verdict"]["effects"]
    return [
        f"At the rated {show(one['rated_N'], 'N', 4)}, {effect(one['effect'])} takes {in_percent(one['part'])} of the "
        "thrust."
        for one in results.get("at_rating", ())
        if one["effect"] in named
    ]


def _elements(results: Results) -> list[str]:
    """What is said of a friction curve that the records show more finely than the machine file."""
    counts = results.get("friction_elements")
    if not counts:
        return []
    return [
        f"The records show the friction's curve between the {counts['file']} elements of the machine file; it is "
        f"fitted with {counts['fitted']}."
    ]


def _another_form(verdict: Results, name: str) -> str:
    """What is said of a law whose form is not the catalogue's; the values are those of the nearest one."""
    return " in another form than the catalogue's" if verdict["form"].get(name) == "other" else ""


def _said_beside(results: Results) -> list[str]:
    """Which values are off, where they are most of the gap; which way friction is larger, which effects are excluded by
    their sign, and the input delay where it moved; the latter not where values are at their bounds or weights do not
    hold, as the delay then stands in for what the model lacks."""
    verdict = results["verdict"]
    told, way = too_small(results), verdict["direction"]
    if off := mostly(results):
        told.append(told_off(off, results))
    if way and not set(way["effects"]).isdisjoint(verdict["effects"]):
        told.append(
            f"Friction is larger {way['larger']}, by {show(way['difference_N'], 'N', 2)} at "
            f"{show(way['speed_m_per_s'], 'm/s', 2)}; what differs is {way['part']}."
        )
    if verdict["excluded"]:
        told.append(f"Excluded, as its size would have the wrong sign: {effects_listed(verdict['excluded'])}.")
    return told if far_off(results) or results["how_far"]["at_bounds"] else [*told, *_input_delay(results)]


def _input_delay(results: Results) -> list[str]:
    """By how much a thrust acts later than its command, where that is not what the machine file says."""
    delay = results["verdict"]["input_delay"]
    total, std, before = (1e3 * delay[name] for name in ("total_s", "std_s", "delivered_s"))
    if std <= 0 or abs(total - before) <= MOVED * std:
        return []
    digits = max(2, 1 - math.floor(math.log10(std)))  # as many as the deviation has
    now, then = f"{total:.{digits}f} ± {std:.2g} ms", f"{before:.{digits}f} ms"
    return [f"The input delay, the hold included, is {now} instead of {then}{_traded(results)}."]


def _traded(results: Results) -> str:
    """That dead time and lag moved against each other, where they did: records tell their sum."""
    for row in map(beside_effects, results["shifts"]):
        if is_traded(row):
            dead = row["moved"] * max(row["std"])
            sizes = [show(size, row["unit"], 2) for size in (dead, row["delay"] - dead)]
            return f" (dead time and lag moved against each other, by {listed(sizes)})"
    return ""


def _others(results: Results) -> str:
    """The rivals of those that are in the model."""
    rivals = _rivals(results["verdict"])
    return _listed_or([name for name in rivals if name not in results["verdict"]["effects"]] or rivals, results)


def _listed_or(names: Sequence[str], results: Results) -> str:
    """Rivals in words, the last two joined by "or": of effects their names, of nominal values that they are others."""
    nominal = {row["name"] for row in results["shifts"]}
    return listed([f"another {effect(name)}" if name in nominal else effect(name) for name in names], "or")


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
