"""How far the gap shrinks, and what to know of the machine file that is handed over, in sentences; from results.json
alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from diagnosis.handover.files import Content
from diagnosis.handover.overrun import OVERRUN
from models.quantity import listed, show
from studies.gap_diagnosis import unknown_law
from studies.gap_diagnosis.weights_told import far_off, no_floor_told
from studies.wording import effect, effects_listed, in_percent, words

Results = Mapping[str, Any]

LISTED: Final = 3  # values that are listed; improved.toml has all
UNNAMED: Final = 2  # number of stages without an effect: as delivered, and re-fitted
MUCH: Final = 0.1  # share of the gap that surely stays unexplained, from which on the answer says so
# Times the error of settling as delivered, from which on that of the file handed over is told.
MIN_SETTLING_ERROR_RATIO: Final = 1.1
SHORT: Final = 2  # sentences on the gap that a figure of it does not make superfluous
SHIFTED: Final = 0.02  # relative shift of a mode's frequency in a fit to the records alone, from which on it is told
NO_BETTER: Final = 0.9  # of the force as delivered, from which on a fit to one record explains no other


def sentences(results: Results) -> list[str]:
    """How far the gap shrinks, in all measures, and what to know of the file."""
    return [*_gap_closed(results), *remarks(results)]


def in_short(results: Results) -> list[str]:
    """How far it shrinks, without what a figure of all measures shows."""
    return _gap_closed(results)[:SHORT]


def remarks(results: Results) -> list[str]:
    """What to know of the file that is handed over: what it leaves, and why it is not another one."""
    law = [] if unknown_law.is_the_answer(results) else unknown_law.left(results["how_far"])
    told = [*_handed_over(results), *_as_commanded(results), *_modes_kept(results["how_far"]), *_overrun(results)]
    return [*no_floor_told(results["how_far"]), *law, *told]


def _as_commanded(results: Results) -> list[str]:
    """That the file's figures are those under the logged commands, where its own controller makes others."""
    made = all(one["replays"] for one in results["where"]["details"]["controller"])
    if made or results["how_far"]["adopted_file"] == Content.DELIVERED:
        return []
    return [
        "All of this is under the commands as they were logged, which the stated controller does not make: in a "
        "simulation of improved.toml it makes others, until the controller in the file or in the drive is corrected."
    ]


def _modes_kept(far: Results) -> list[str]:
    """That the modes are those that the file knew, where these records alone would have others."""
    moved = far.get("modes_kept", 0.0)
    if moved == 0:
        return []
    before, alone = far.get("frequency_alone_Hz") or (1.0, 1.0)
    shifted = abs(alone / before - 1) > SHIFTED
    where = f" ({show(before, 'Hz')} becomes {show(alone, 'Hz')})" if shifted else ""
    sweep = " If a spring such as a belt or a coupling may have changed, a sweep tells (identify_machine)."
    return [
        f"The vibration modes in improved.toml are as the machine file knows them: a fit to these records alone moves "
        f"one by {moved:,.0f} of its stated deviations{where}, and does not surely leave less than half."
        f"{sweep if shifted else ''}"
    ]


def _overrun(results: Results) -> list[str]:
    """Which values the file knew well and are others now: what changed since, or, in a model that is incomplete, what
    stands in for what it lacks."""
    rows = results.get("overrun")
    if not rows or results["verdict"]["outcome"] == "nothing_to_explain":
        return []
    more = len(rows) - LISTED
    are = "values in improved.toml differ" if len(rows) > 1 else "value in improved.toml differs"
    told = listed([*map(_moved, rows[:LISTED]), *([f"{more} more"] if more > 0 else [])])
    meant = bound_meant(results) if results["how_far"]["at_bounds"] else ""
    incomplete = meant == INCOMPLETE
    incomplete = incomplete or results["verdict"]["outcome"] == "none_of_these"
    if not (far_off(results) or incomplete):
        unsure = ", and these records may not determine all of them" if meant == UNDETERMINED else ""
        return [f"{len(rows)} {are} from the file's by at least {OVERRUN:g} of its stated deviations{unsure}: {told}."]
    return [
        f"{len(rows)} {are} from the file's by at least {OVERRUN:g} of its stated deviations, and may stand in for "
        f"what the model lacks: {told}. Other motions may be predicted worse than with the file as it was."
    ]


def _moved(one: Results) -> str:
    """A value that the file knew well, before and now."""
    before, std, now = (show(one[key], one["unit"], digits) for key, digits in (("before", 4), ("std", 2), ("now", 4)))
    return f"{words(one['name'])} {before} ± {std} before and {now} now"


def _gap_closed(results: Results) -> list[str]:
    """What the re-fit and the effects take off the force, the closure, and from where to where the gap goes."""
    verdict, far = results["verdict"], results["how_far"]
    floor = _gap(far["floor"])
    if far["floor_source"] == "repeats":
        floor += ", the scatter between equal motions"
    if verdict["outcome"] == "nothing_to_explain":
        return [
            f"The model as delivered leaves {_gap(far['gap_as_delivered'])} of position; the noise floor of a complete "
            f"model is {floor}."
        ]
    if verdict["outcome"] == "parameters":
        moved = _from_to(far["gap_as_delivered"], far["gap_refitted"])
        before, least = far["gap_as_delivered"]["force_N"], far["floor"]["force_N"]
        sure = ", no less than what the file leaves as delivered: what is off is sure, and small"
        return [f"The re-fit reduces the gap {moved}; the noise floor is {floor}{sure if before <= least else ''}."]
    if verdict["outcome"] == "none_of_these" and len(far["stages"]) <= UNNAMED:
        return [
            "No effect reduces the gap by enough to go into the model; re-fitting the nominal values takes it "
            f"{_from_to(far['gap_as_delivered'], far['gap_refitted'])}, and the noise floor is {floor}."
        ]
    if len(far["stages"]) <= UNNAMED:
        moved = _from_to(far["gap_as_delivered"], far["gap_refitted"])
        refit = f"re-fitting the nominal values takes the gap {moved}"
        return [f"What is named is not part of improved.toml; {refit}; the noise floor is {floor}."]
    if unknown_law.is_the_answer(results):
        (file,) = (one["on_records"] for one in far["files"] if one["file"] == Content.MEASURED)
        return [
            _parameters_share(far, file, "with the measured law"),
            *unknown_law.left(far),
            f"Over all motions the gap goes {_from_to(far['gap_refitted'], file)}; the noise floor is {floor}.",
        ]
    moved = _from_to(far["gap_refitted"], far["gap_after"])
    return [
        _parameters_share(far, far["gap_after"], "with effects"),
        f"On held-out motions {_closure(results)}{_unexplained(results)}.",
        f"Over all motions the gap goes {moved}; the noise floor is {floor}.",
    ]


def _closure(results: Results) -> str:
    """The share of the gap that the effects close, or why there is none."""
    far, part = results["how_far"], results["verdict"]["outcome"] == "none_of_these"
    (low, high), terms = far["closure_interval"], far["closure_terms"]
    if terms["refitted"] <= terms["floor"]:
        least, left = (show(terms[key], terms["unit"], 2) for key in ("floor", "refitted"))
        return f"the re-fitted model leaves {left}, no more than the noise floor of {least}: {NO_GAP}"
    return (
        f"{'what it resembles' if part else 'this'} closes {100 * far['closure']:.0f} % ({100 * low:.0f} to "
        f"{100 * high:.0f} %) of the gap {MEANT[terms['measure']]}between the re-fitted model and the noise floor"
        f"{', which is not the whole answer and not in improved.toml' if part else ''}"
    )


def _parameters_share(far: Results, last: Results, named: str) -> str:
    """What nominal values take off the force, and what effects or a law do, of which a gap is left, beside the drive's
    own force."""
    delivered, refitted = (far[name]["force_N"] for name in ("gap_as_delivered", "gap_refitted"))
    after = last["force_N"]
    drive = far["drive_rms_N"]
    return (
        f"Of the drive's force of {show(drive, 'N', 3)} (rms), the machine as delivered leaves "
        f"{show(delivered, 'N', 3)} ({_percent(delivered, drive)}), its nominal values re-fitted "
        f"{show(refitted, 'N', 3)} ({_percent(refitted, drive)}), and {named} {show(after, 'N', 3)} "
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
        told.append(f"{' '.join(harms)} {_file_told(far)}")
    elif far["adopted_file"] == Content.SOME:
        told.append(_file_told(far))
    elif any(one["command_late_samples"] for one in results["where"]["details"]["controller"]):
        told.append(
            "The commands were logged at another time than they acted, as happens with a measured torque or current, "
            "so that the fitted dead time is not the machine's. "
            f"{FILES[Content.DELIVERED]}"
        )
    elif any(one.get("mislogged") for one in results["where"]["details"]["controller"]):
        told.append(
            "As the log, or the controller in the file, is not what the file says, nothing that is fitted to it is the "
            f"machine's. {FILES[Content.DELIVERED]}"
        )
    elif results["white_force_N"].get("biased") and far["adopted_file"] in {Content.DELIVERED, Content.OFFSET}:
        told.append(f"The re-fit is not believed. {FILES[far['adopted_file']]}")
    if results.get("at_random"):
        told.append(
            "What shakes at random is in improved.toml as sines as strong as it is, with an arbitrary phase, for "
            "simulations: a new record that is compared with this file will still show the vibration."
        )
    told += _slower(far)
    if far["at_bounds"]:
        values = bounds_told(far["at_bounds"])
        told.append(f"{values[0].upper()}{values[1:]} at the limit of twice the usual range: {bound_meant(results)}.")
    elif far["widened"]:
        told.append(f"Twice the usual room was needed for {bounds_told(far['widened'], verb=False)}.")
    named = results["verdict"]["outcome"] in {"attributed", "ambiguous"}
    return [*told, *_carried_over(far["transfer"], named=named), *elsewhere(far)]


def _file_told(far: Results) -> str:
    """What improved.toml has, and which of the effects it has not, where one of them would do harm."""
    if far["adopted_file"] != Content.SOME:
        return FILES[far["adopted_file"]]
    return f"So improved.toml has the effects but {effects_listed(far['without'])}, without which it does no harm."


def _slower(far: Results) -> list[str]:
    """That the file handed over has a larger error of settling than the machine as delivered, where it has: within
    chance, as it would not be handed over otherwise."""
    files = {one["file"]: one["held_out"]["settling_s"] for one in far["files"]}
    before, after = files[Content.DELIVERED], files[far["adopted_file"]]
    if before is None or after is None or after <= MIN_SETTLING_ERROR_RATIO * before:
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
    refused = apart.get("refused")
    delivered, adopted = files[Content.DELIVERED], files[refused or far["adopted_file"]]
    for i, name in enumerate(apart["records"]):
        before, after = ({key: one[key][i] for key in KEYS} for one in (delivered, adopted))
        larger = [
            MEASURES[KEYS[key]] for key in KEYS if None not in (before[key], after[key]) and after[key] > before[key]
        ]
        ends = f"is larger there in {listed(larger)}" if larger else "shrinks there"
        if refused:
            ends = f"{ends} with {CANDIDATES[refused]}"
        elif far["adopted_file"] == Content.DELIVERED:
            ends = "is that of the machine as delivered"
        told.append(f"On {name}, to which nothing was fitted, the gap {ends}: {_from_to(before, after)}.")
    return [*told, FILES[Content.DELIVERED]] if refused else told


MEANT: Final = {"force": "", "position": "in position (in force it is not sure) "}
INCOMPLETE: Final = "the model is incomplete"
UNDETERMINED: Final = "farther off than that, or not determined by these records"
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
    Content.SOME: "the machine with some of the effects",
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
    """What values at a bound say: those of a single effect that is named, which leaves nothing, of that one alone; and
    where no effect is missing, that they are not known."""
    named = results["verdict"]["effects"] if results["verdict"]["outcome"] in {"attributed", "ambiguous"} else ()
    if len(named) == 1 and {one["part"] for one in results["how_far"]["at_bounds"]} == set(named):
        return "these records do not determine it, or the law has another form"
    if results["verdict"]["outcome"] in {"parameters", "nothing_to_explain"}:
        return UNDETERMINED
    return INCOMPLETE


def _unexplained(results: Results) -> str:
    """The share of the gap that several effects surely leave unexplained. A single effect may leave as much where
    nothing more is missing, and the closure does not measure effects that show in the log only."""
    names, (low, high) = results["verdict"]["effects"], results["how_far"]["closure_interval"]
    logged = any(results["catalogue"][name]["shown_in"] == "log" for name in names)
    terms = results["how_far"]["closure_terms"]
    if terms["refitted"] <= terms["floor"]:  # no closure is told
        return ""
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
