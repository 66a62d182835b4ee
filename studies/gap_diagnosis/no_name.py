"""What is said where what is left of the records has no name."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

from models.quantity import listed, show
from studies.gap_diagnosis import moved_most
from studies.gap_diagnosis.values_off import (
    SHIFTED,
    mostly,
    off_by,
    stated_mostly,
    told_off,
    values_in_short,
)
from studies.gap_diagnosis.weights_told import is_no_floor
from studies.wording import effect, in_percent

Results = Mapping[str, Any]

# Times the noise floor, up to which noise that is a little larger may be all that is left.
MAX_NOISE_ONLY_RATIO: Final = 1.5
MAX_UNTOLD_EXCESS: Final = 0.02  # above the noise floor, up to which what is left is no more than that
AT_FLOOR: Final = (0.5, 1.1)  # of the noise floor, where a force is that; a floor far above it is of something else


def without_a_name_in_short(results: Results) -> str:
    """The outcome without a name, in a few words: nominal values first where they are most of the gap."""
    names = values_in_short(results) if results["verdict"]["outcome"] == "none_of_these" else ""
    what = f"Nominal values are off: {names}; what" if names else "What"
    if noise := _noise_of(results):
        return f"{what} is left is noise of {noise}"
    if not names and (more := _hardly_more(results)):
        return f"What is left is {more}, and has no name"
    return f"{what} is left has no name" if names else "No effect of the catalogue explains it"


def without_a_name(results: Results) -> list[str]:
    """What is said where no effect explains what is left, after the values that are off where they are most of it; in
    sentences."""
    off, stated = mostly(results), stated_mostly(results)
    first = moved_most.among_others(results)
    some = off or stated or first
    begins, rest = (f"{told_off(off, results, stated)} No", "what is left") if some else ("No", "it")
    told = [
        f"{begins} effect of the catalogue, alone or with others, explains {rest} within its prior range: "
        f"{_beyond_the_catalogue(results)}."
    ]
    if untried := [effect(name) for name in results.get("not_looked_for", ())]:
        told.append(f"Not tried, as the machine file has no [priors.NAME] for it: {listed(untried)}.")
    return told


def noise_alone(results: Results) -> list[str]:
    """What is said where a white force is all that the re-fitted model leaves; nothing elsewhere."""
    noise = _noise_of(results)
    if not noise:
        return []
    off, share = mostly(results), max(results["white_force_N"]["alone"]) / results["how_far"]["drive_rms_N"]
    stated = stated_mostly(results)
    told = [told_off(off, results, stated)] if off or stated or moved_most.among_others(results) else []
    return [
        *told,
        f"What is left is what a force that scatters by {noise} from sample to sample would leave, "
        f"{in_percent(share)} of the drive's (rms): alike at all times, so that it is noise of the drive or steps of "
        "its converter that the machine file does not have, and no sign of another effect; smaller ones are hidden "
        "by it.",
    ]


def _noise_of(results: Results) -> str:
    """The white force [N] that is all that is left of the roughest record; nothing where there is none."""
    alone = results["white_force_N"].get("alone")
    return show(max(alone), "N", 2) if alone else ""


def never_the_same(results: Results) -> list[str]:
    """What is said where the re-fitted model leaves what does not repeat between equal motions, and nothing resembles
    it; nothing elsewhere."""
    if results["verdict"]["partly"] or results["how_far"]["floor_source"] != "repeats":
        return []
    far = results["how_far"]
    low, high = (part * far["floor"]["force_N"] for part in AT_FLOOR)
    if not low <= far["gap_refitted"]["force_N"] <= high:
        return []
    before = moved_most.covered(results)
    rest = [row for row in results["shifts"] if abs(row["moved"]) > SHIFTED and row["name"] not in before]
    off = [*moved_most.among_others(results), *(off_by(row) for row in rest)]
    wrong = f"Nominal values are off, {listed(off)}. " if off else ""
    return [
        f"{wrong}What is left of the re-fitted model differs every time a motion is repeated, so that no "
        "effect of the catalogue is seen to be missing."
    ]


def _beyond_the_catalogue(results: Results) -> str:
    """What else the cause may be, where no effect explains the gap."""
    told = "the cause is not in the catalogue"
    if more := _hardly_more(results):
        told = f"it is {more}, and may be noise of the drive or the scale that the machine file has smaller, or {told}"
    if results.get("friction_elements"):
        told += ", or is what so few elements leave of the friction's curve"
    if ends := [effect(one["name"]) for one in results["how_far"]["at_bounds"] if one["part"] == "nominal"]:
        told += (
            f", or is a value of the file that is farther off than its range goes ({listed(list(dict.fromkeys(ends)))})"
        )
    if unseen := _not_seen(results):
        told += f", or is {listed(unseen, 'or')}, which equal motions that are repeated would show"
    return told


def _hardly_more(results: Results) -> str:
    """How far what is left is beyond the noise floor, in force or in position, where neither is far beyond; nothing
    where one is, where the floor is that of motions that repeat, which has all noise in it, or where it resembles an
    effect or a law. Enough samples tell a tenth more noise from what the file states, and no law from it."""
    far, learned = results["how_far"], results.get("learned")
    if results.get("sticking") or is_no_floor(far):  # which is of a simulation that swings by itself
        return ""
    if results["verdict"]["partly"] or far["floor_source"] == "repeats" or (learned and learned["adopted"]):
        return ""
    ratios = [far["gap_refitted"][key] / far["floor"][key] for key in ("force_N", "position_m") if far["floor"][key]]
    if not ratios or max(ratios) >= MAX_NOISE_ONLY_RATIO:
        return ""
    more = max(ratios) - 1
    return f"{in_percent(more)} above the noise floor" if more > MAX_UNTOLD_EXCESS else "no more than the noise floor"


def _not_seen(results: Results) -> list[str]:
    """Effects of the log, such as late commands, of which these records show no size at all, in words; none where the
    log has one of several samples, which is said elsewhere."""
    if any(one.get("every", 1) > 1 for one in results["where"]["details"]["controller"]):
        return []
    limits = {row["effect"]: row["limit"] for row in results["confusability"]["limits"]}
    logged = [name for name, entry in results["catalogue"].items() if entry["shown_in"] == "log"]
    return [effect(name) for name in logged if name in limits and not (limits[name] or math.inf) < math.inf]
