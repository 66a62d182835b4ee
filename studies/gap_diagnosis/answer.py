"""The answer in three sentences: where, which, how far; made from results.json alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from diagnosis.handover.files import Content
from diagnosis.handover.overrun import OVERRUN
from diagnosis.where.sentences import Topic
from models.quantity import listed, show
from studies.gap_diagnosis import stated_effects, unknown_law
from studies.gap_diagnosis.course import is_unsure, marked, unconfirmed
from studies.gap_diagnosis.no_name import never_the_same, without_a_name, without_a_name_in_short
from studies.gap_diagnosis.too_small import too_small
from studies.gap_diagnosis.values_off import in_percent, mostly, off_by, told_off
from studies.gap_diagnosis.weights_told import far_off, roughness
from studies.wording import effect, fitted, words

Results = Mapping[str, Any]

LISTED: Final = 3  # values that are listed; improved.toml has all
UNNAMED: Final = 2  # number of stages without an effect: as delivered, and re-fitted
MOVED: Final = 3.0  # standard deviations by which the input delay has to move for a sentence
MUCH: Final = 0.1  # share of the gap that surely stays unexplained, from which on the answer says so
SLOWER: Final = 1.1  # times the error of settling as delivered, from which on that of the file handed over is told
NO_BETTER: Final = 0.9  # of the force as delivered, from which on a fit to one record explains no other


def sentences(results: Results) -> dict[str, str]:
    """Where, which and how far, each in a sentence or two, and the outcome in a few words."""
    return {
        "outcome": _outcome(results),
        "where": _where(results["where"]),
        "which": _which(results) + _elements(results) + stated_effects.told(results.get("stated_effects", ())),
        "how_far": _how_far(results),
    }


def effects_listed(names: Sequence[str], last: str = "and") -> str:
    """Names in words, the last two joined by `last`."""
    return listed([effect(name) for name in names], last)


def _outcome(results: Results) -> str:
    verdict = results["verdict"]
    if is_unsure(verdict):
        return f"No name is sure; it looks like {effects_listed(verdict['partly'])}"
    alike = f"; in part it resembles {effects_listed(verdict['partly'])}" if verdict["partly"] else ""
    return {
        "attributed": f"Attributed to {effects_listed(verdict['effects'])}{marked(verdict)}",
        "ambiguous": f"Either {_listed_or(_rivals(verdict), results)}",
        "none_of_these": f"{without_a_name_in_short(results)}{alike}",
        "nothing_to_explain": "Nothing to explain",
        "parameters": f"Nominal values are off: {effects_listed(stated_effects.first(results, verdict['effects']))}",
    }[verdict["outcome"]]


def _unsure(results: Results) -> str:
    """What is said of names that are not sure; empty where they are, or where there are none."""
    verdict = results["verdict"]
    if not is_unsure(verdict):
        return ""
    names, reason = effects_listed(verdict["partly"]), results["asked"]["reason"]
    return f"It looks like {names}, but no independent record has confirmed it: {reason}"


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
        rows = {row["name"]: row for row in results["shifts"]}
        off = listed([off_by(rows[name]) if name in rows else effect(name) for name in names])
        return f"Nominal values are off, {off}; re-fitted within their tolerances, no effect is missing."
    if outcome == "none_of_these":
        repeats_never = never_the_same(results)
        told = _unsure(results) or repeats_never or without_a_name(results)
        if verdict["partly"] and not is_unsure(verdict):
            before, after = (results["how_far"][name]["force_N"] for name in ("gap_refitted", "gap_after"))
            rows = {row["effect"]: row for row in results["which"]}
            shown = [f"{effect(name)}{_parameters(rows.get(name))}" for name in verdict["partly"]]
            told += (
                f". In part it resembles {listed(shown)}, with which the unknown force "
                f"{'falls' if after < before else 'does not fall: it goes'} from {show(before, 'N', 3)} to "
                f"{show(after, 'N', 3)} (rms)"
            )
        learned = "" if repeats_never else unknown_law.told(results.get("learned"))
        told += f"{roughness(results)}.{learned}"
        if all(one["replays"] for one in results["where"]["details"]["controller"]):
            return told
        return f"{told} Correct the log or the controller first, because the rest may be due to it."
    rows = {row["effect"]: row for row in results["which"]}
    shown = [f"{effect(name)}{_another_form(verdict, name)}{_parameters(rows.get(name))}" for name in names]
    if outcome == "ambiguous":
        alike = f"{_others(results)}{roughness(results)}"
        told = f"It is {listed(shown)}, or what these records cannot distinguish from it: {alike}."
        return told + (_input_delay(results) if "dead_time" in _rivals(verdict) else "") + unconfirmed(results)
    curve = results.get("learned")
    by_curve = unknown_law.told(curve) if unknown_law.has_curve(curve) else ""
    return f"It is {listed(shown)}{roughness(results)}.{by_curve}{_said_beside(results)}{unconfirmed(results)}"


def _elements(results: Results) -> str:
    """What is said of a friction curve that the records show more finely than the machine file."""
    counts = results.get("friction_elements")
    if not counts:
        return ""
    return (
        f" The records show the friction's curve between the {counts['file']} elements of the machine file; it is "
        f"fitted with {counts['fitted']}."
    )


def _another_form(verdict: Results, name: str) -> str:
    """What is said of a law whose form is not the catalogue's; the values are those of the nearest one."""
    return " in another form than the catalogue's" if verdict["form"].get(name) == "other" else ""


def _said_beside(results: Results) -> str:
    """Which values are off, where they are most of the gap; which way friction is larger, which effects are excluded by
    their sign, and the input delay where it moved; the latter not where values are at their bounds or weights do not
    hold, as the delay then stands in for what the model lacks."""
    verdict = results["verdict"]
    told, way = too_small(results), verdict["direction"]
    if off := mostly(results):
        told += f" {told_off(off, results)}"
    if way and not set(way["effects"]).isdisjoint(verdict["effects"]):
        told += (
            f" Friction is larger {way['larger']}, by {show(way['difference_N'], 'N', 2)} at "
            f"{show(way['speed_m_per_s'], 'm/s', 2)}; what differs is {way['part']}."
        )
    if verdict["excluded"]:
        told += f" Excluded, as its size would have the wrong sign: {effects_listed(verdict['excluded'])}."
    return told if far_off(results) or results["how_far"]["at_bounds"] else told + _input_delay(results)


def _input_delay(results: Results) -> str:
    """By how much a thrust acts later than its command, where that is not what the machine file says."""
    delay = results["verdict"]["input_delay"]
    total, std, before = (1e3 * delay[name] for name in ("total_s", "std_s", "delivered_s"))
    if std <= 0 or abs(total - before) <= MOVED * std:
        return ""
    digits = max(2, 1 - math.floor(math.log10(std)))  # as many as the deviation has
    now, then = f"{total:.{digits}f} ± {std:.2g} ms", f"{before:.{digits}f} ms"
    return f" The input delay, the hold included, is {now} instead of {then}."


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


def _how_far(results: Results) -> str:
    far = results["how_far"]
    return " ".join([_gap_closed(results), *unknown_law.left(far), *_handed_over(results), *_overrun(results)])


def _overrun(results: Results) -> list[str]:
    """Which values the file knew well and are others now: what changed since, or, in a model that is incomplete, what
    stands in for what it lacks."""
    rows = results.get("overrun")
    if not rows or results["verdict"]["outcome"] == "nothing_to_explain":
        return []
    more = len(rows) - LISTED
    are = "values in improved.toml differ" if len(rows) > 1 else "value in improved.toml differs"
    told = listed([*map(_moved, rows[:LISTED]), *([f"{more} more"] if more > 0 else [])])
    incomplete = results["how_far"]["at_bounds"] and bound_meant(results) == INCOMPLETE
    incomplete = incomplete or results["verdict"]["outcome"] == "none_of_these"
    if not (far_off(results) or incomplete):
        return [f"{len(rows)} {are} from the file's by at least {OVERRUN:g} of its stated deviations: {told}."]
    return [
        f"{len(rows)} {are} from the file's by at least {OVERRUN:g} of its stated deviations, and may stand in for "
        f"what the model lacks: {told}. Other motions may be predicted worse than with the file as it was."
    ]


def _moved(one: Results) -> str:
    """A value that the file knew well, before and now."""
    before, std, now = (show(one[key], one["unit"], digits) for key, digits in (("before", 4), ("std", 2), ("now", 4)))
    return f"{words(one['name'])} {before} ± {std} before and {now} now"


def _gap_closed(results: Results) -> str:
    """From the machine as delivered to the one with effects, and the closure."""
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
        before, least = far["gap_as_delivered"]["force_N"], far["floor"]["force_N"]
        sure = ", no less than what the file leaves as delivered: what is off is sure, and small"
        return f"The re-fit reduces the gap {moved}; the noise floor is {floor}{sure if before <= least else ''}."
    low, high = far["closure_interval"]
    if verdict["outcome"] == "none_of_these" and len(far["stages"]) <= UNNAMED:
        return (
            "No effect reduces the gap by enough to go into the model; re-fitting the nominal values takes it "
            f"{_from_to(far['gap_as_delivered'], far['gap_refitted'])}, and the noise floor is {floor}."
        )
    moved = _from_to(far["gap_refitted"], far["gap_after"])
    part, terms = verdict["outcome"] == "none_of_these", far["closure_terms"]
    closes = (
        f"{'what it resembles' if part else 'this'} closes {100 * far['closure']:.0f} % ({100 * low:.0f} to "
        f"{100 * high:.0f} %) of the gap {MEANT[terms['measure']]}between the re-fitted model and the noise floor"
        f"{', which is not the whole answer and not in improved.toml' if part else ''}"
    )
    if terms["refitted"] <= terms["floor"]:
        least, left = (show(terms[key], terms["unit"], 2) for key in ("floor", "refitted"))
        closes = f"the re-fitted model leaves {left}, no more than the noise floor of {least}: " + NO_GAP
    return (
        f"{_parameters_share(far)} On held-out motions {closes}. Over all motions the gap goes "
        f"{moved}{_unexplained(results)}; the noise floor is {floor}."
    )


def _parameters_share(far: Results) -> str:
    """What nominal values take off the force, and what effects do, beside the drive's own force."""
    delivered, refitted, after = (far[name]["force_N"] for name in ("gap_as_delivered", "gap_refitted", "gap_after"))
    drive = far["drive_rms_N"]
    return (
        f"Of the drive's force of {show(drive, 'N', 3)} (rms), the machine as delivered leaves "
        f"{show(delivered, 'N', 3)} ({_percent(delivered, drive)}), its nominal values re-fitted "
        f"{show(refitted, 'N', 3)} ({_percent(refitted, drive)}), and with effects {show(after, 'N', 3)} "
        f"({_percent(after, drive)})."
    )


def _percent(part: float, whole: float) -> str:
    return in_percent(part / whole) if whole > 0 else "–"


def _handed_over(results: Results) -> list[str]:
    """Why files were not adopted, and which values ran to their bounds; nothing without either."""
    far = results["how_far"]
    told, names = [], list(CANDIDATES)
    richer = names[names.index(far["adopted_file"]) + 1 :]
    harms = [harm_told(harm) for harm in far["harms"] if harm["file"] in richer]
    if harms:
        told.append(f"{' '.join(harms)} {FILES[far['adopted_file']]}")
    elif results["white_force_N"].get("biased") and far["adopted_file"] == Content.DELIVERED:
        told.append(f"The re-fit is not believed. {FILES[Content.DELIVERED]}")
    told += _slower(far)
    if far["at_bounds"]:
        values = bounds_told(far["at_bounds"])
        told.append(f"{values[0].upper()}{values[1:]} at the limit of twice the usual range: {bound_meant(results)}.")
    elif far["widened"]:
        told.append(f"Twice the usual room was needed for {bounds_told(far['widened'], verb=False)}.")
    named = results["verdict"]["outcome"] in {"attributed", "ambiguous"}
    return [*told, *_carried_over(far["transfer"], named=named), *elsewhere(far)]


def _slower(far: Results) -> list[str]:
    """That the file handed over has a larger error of settling than the machine as delivered, where it has: within
    chance, as it would not be handed over otherwise."""
    files = {one["file"]: one["held_out"]["settling_s"] for one in far["files"]}
    before, after = files[Content.DELIVERED], files[far["adopted_file"]]
    if before is None or after is None or after <= SLOWER * before:
        return []
    return [
        f"Of settling, on motions held out, it leaves {show(after, 's', 2)} where the machine as delivered leaves "
        f"{show(before, 's', 2)}; that may be chance, as few motions tell it: try a design of it before it is used."
    ]


def _carried_over(transfer: Results | None, *, named: bool) -> list[str]:
    """What files leave of records that they were not fitted to, and what belongs to single records; named: whether the
    verdict gives names, of which it is said where they explain no other record."""
    if transfer is None:
        return []
    parts = [f"{_gap(one['elsewhere'])} ({one['file']})" for one in transfer["matrices"]]
    told = [f"Fitted to one record and judged on the others, the files leave {listed(parts)}."]
    forces = {one["file"]: one["elsewhere"]["force_N"] for one in transfer["matrices"]}
    if named and forces.get("with effects", 0.0) > NO_BETTER * forces.get("as delivered", math.inf):
        told.append(
            "So what is named does not carry over from one record to another: a law that looks the same on the motions "
            "of one may be the cause; records of other strokes and speeds would tell."
        )
    out = dict.fromkeys(one["part"] for one in transfer["by_record"] if one["kept_out"])
    if out:
        told.append(
            f"The phase of {effects_listed(list(out))} differs from record to record; it is left out of improved.toml."
        )
    return told


def elsewhere(far: Results) -> list[str]:
    """Whether the gap shrinks on each record that nothing was fitted to."""
    apart, told = far["hold_out"], []
    if apart is None:
        return []
    files = {one["file"]: one for one in apart["files"]}
    delivered, adopted = files[Content.DELIVERED], files[far["adopted_file"]]
    for i, name in enumerate(apart["records"]):
        before, after = ({key: one[key][i] for key in KEYS} for one in (delivered, adopted))
        larger = [
            MEASURES[KEYS[key]] for key in KEYS if None not in (before[key], after[key]) and after[key] > before[key]
        ]
        ends = f"is larger there in {listed(larger)}" if larger else "shrinks there"
        if far["adopted_file"] == Content.DELIVERED:
            ends = "is that of the machine as delivered"
        told.append(f"On {name}, to which nothing was fitted, the gap {ends}: {_from_to(before, after)}.")
    return told


MEANT: Final = {"force": "", "position": "in position (in force it is not sure) "}
INCOMPLETE: Final = "the model is incomplete"
NO_GAP: Final = "no closure of that gap can be told"
KEYS: Final = {"force_N": "force", "position_m": "position", "settling_s": "settling"}


FILES: Final = {
    Content.DELIVERED: "So improved.toml is the machine as delivered.",
    Content.OFFSET: "So improved.toml is the machine as delivered with another offset.",
    Content.REFITTED: "So improved.toml has the re-fitted values alone.",
    Content.EFFECTS: "So improved.toml has the effects.",
    Content.MEASURED: "So improved.toml has the measured law.",
}
MEASURES: Final = {"force": "unknown force", "position": "position error", "settling": "error of the settling times"}
CANDIDATES: Final = {
    Content.DELIVERED: "the machine as delivered",
    Content.OFFSET: "the machine with its offset fitted",
    Content.REFITTED: "the re-fitted machine",
    Content.EFFECTS: "the machine with effects",
    Content.MEASURED: "the machine with the measured law",
}


def harm_told(harm: Results, quantity: Callable[[float, str, int], str] = show) -> str:
    """In which measure a file was worse than a simpler one, in one sentence, its numbers as `quantity` writes them."""
    article = "an" if MEASURES[harm["measure"]][0] in "aeiou" else "a"
    before, after = (quantity(harm[name], harm["unit"], 3) for name in ("before", "after"))
    return (
        f"On motions left out of the fit, {CANDIDATES[harm['file']]} leaves {article} {MEASURES[harm['measure']]} of "
        f"{after}, and {CANDIDATES[harm['than']]} one of {before}: the former is therefore not adopted."
    )


def bounds_told(bounds: Sequence[Results], *, verb: bool = True) -> str:
    """The values that ran to their bounds, each named once."""
    names = dict.fromkeys(
        effect(one["name"]) if one["part"] == "nominal" else f"the {effect(one['name'])} of {effect(one['part'])}"
        for one in bounds
    )
    return listed(list(names)) + ((" are" if len(names) > 1 else " is") if verb else "")


def bound_meant(results: Results) -> str:
    """What values at a bound say: those of a single effect that is named, which leaves nothing, of that one alone."""
    named = results["verdict"]["effects"] if results["verdict"]["outcome"] in {"attributed", "ambiguous"} else ()
    if len(named) == 1 and {one["part"] for one in results["how_far"]["at_bounds"]} == set(named):
        return "these records do not determine it, or the law has another form"
    return INCOMPLETE


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
        ("force_N", "N", 3, "unknown force"),
        ("position_m", "m", 3, "position"),
        ("settling_s", "s", 2, "settling"),
    ]
    return ", ".join(
        f"from {show(before[key], unit, digits)} to {show(after[key], unit, digits, like=before[key])} of {what}"
        for key, unit, digits, what in parts
        if key != "settling_s" or None not in (before[key], after[key])
    )


def _gap(gap: Results) -> str:
    return f"{show(gap['force_N'], 'N', 2)} and {show(gap['position_m'], 'm', 2)}"
