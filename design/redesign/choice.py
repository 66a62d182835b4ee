"""Which design runs next: the old one stays unless another one is surely better, and comes back where it was worse."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from design.redesign.designs import Design
from design.redesign.outcome import Outcome
from design.redesign.prediction import LEVEL, Interval, Prediction, interval_of
from models.machine import Machine
from models.quantity import show, span

WORSE: Final = 0.05  # relative, from which on a design counts as worse
SURE: Final = 0.8  # least level of the interval of a gain that is called sure; that of fewer than 9 runs is lower
SATURATED: Final = 0.1  # share of the runs in which a new design may ask for more than the rated thrust

MEASURE_UNITS: Final = {"settling": "s", "dispersion": "m"}
CALLED: Final = {"settling": "settling of the slowest motion", "dispersion": "3 sigma"}


@dataclass(frozen=True)
class Chosen:
    """The design to run, and of every other one that was looked at why it was not taken; gains: of the chosen one over
    the old one, in seconds and metres, each with the interval over the machines that the records allow."""

    design: Design
    kept: bool
    reasons: Mapping[str, str]
    gains: Mapping[str, Interval]


def chosen(designs: Sequence[Design], predictions: Sequence[Prediction], machine: Machine) -> Chosen:
    """The design that is surely better than all before it in the list, the old one first.

    Better: the whole interval of its gain, run by run on the same machines, is above 0 in settling or in 3 sigma, at a
    level of SURE or more, and in neither is it worse by more than WORSE in the median, nor do more motions never
    settle; and it does not saturate the drive in more than SATURATED of the runs, or at least in no more than the
    design before it.

    Of two new ones around the same feedback, both surely better than the old one, a record will show one or the other,
    and neither is there yet to be kept: so the later one is also taken where it is better in both on average.
    """
    best, reasons = 0, dict[str, str]()
    for i in range(1, len(designs)):
        why = _why_not(predictions[best], predictions[i], machine)
        on_average = bool(why) and best > 0 and _stands_in(designs, predictions, best, i, machine)
        if why and not on_average:
            reasons[designs[i].name] = f"{why} (against {designs[best].name})"
        else:
            if best > 0:
                how = "better on average" if on_average else "surely better"
                reasons[designs[best].name] = f"{designs[i].name} is {how}"
            best = i
    gains = {name: _gain(predictions[0], predictions[best], name) for name in MEASURE_UNITS}
    return Chosen(designs[best], best == 0, reasons, gains)


def _gain(old: Prediction, new: Prediction, name: str) -> Interval:
    return interval_of(getattr(old, name) - getattr(new, name), LEVEL)


def _why_not(old: Prediction, new: Prediction, machine: Machine) -> str:
    """Why a design does not take the old one's place; empty where it does."""
    if new.saturated > max(old.saturated, SATURATED * new.settling.size):
        return f"it asks for more than the rated thrust in {new.saturated} of {new.settling.size} simulated runs"
    if new.never > old.never:
        return f"more motions never settle, {new.never:g} instead of {old.never:g} in the median"
    for name, unit in MEASURE_UNITS.items():
        before, after = (float(np.median(getattr(one, name))) for one in (old, new))
        if after > before * (1 + WORSE) + least(machine)[name]:
            return f"{CALLED[name]} gets worse, from {show(before, unit, 3)} to {show(after, unit, 3)} in the median"
    gains = {name: _gain(old, new, name) for name in MEASURE_UNITS}
    level = gains["settling"].level
    if level < SURE:
        return f"its gain is not sure: {new.settling.size} simulated runs give an interval of {level:.0%} only"
    if any(gain.low > 0 for gain in gains.values()):
        return ""
    told = " and ".join(
        f"{span(show(gain.low, MEASURE_UNITS[name], 2), show(gain.high, MEASURE_UNITS[name], 2))} of {CALLED[name]}"
        for name, gain in gains.items()
    )
    return f"its gain is not sure: {told}"


def _stands_in(
    designs: Sequence[Design], predictions: Sequence[Prediction], best: int, new: int, machine: Machine
) -> bool:
    """Whether a new design may run in place of another new one: surely better than the old one, too, around the same
    feedback, and better than the other in both quantities on average."""
    if designs[best].controller.feedback != designs[new].controller.feedback:
        return False
    means = [[float(np.mean(getattr(predictions[one], name))) for name in MEASURE_UNITS] for one in (best, new)]
    better = all(after < before for before, after in zip(*means, strict=True))
    return better and not _why_not(predictions[0], predictions[new], machine)


def least(machine: Machine) -> dict[str, float]:
    """What of each quantity the scale's noise and the samples make: a sample [s], three deviations of a reading [m]."""
    return {"settling": machine.sample_time, "dispersion": 3 * machine.scale.reading_deviation}


def worse(before: Outcome, after: Outcome, machine: Machine) -> tuple[str, ...]:
    """In what a record of the new design is worse than one of the old, by more than WORSE and what noise makes;
    empty where it stays (SI). Settling is worse where a larger share of the motions never settles, and no time is
    compared where one does not. Not to be asked of machines of different specifications."""
    found = []
    for name, unit in MEASURE_UNITS.items():
        old, new = float(getattr(before, name)), float(getattr(after, name))
        lost = new > old * (1 + WORSE) + least(machine)[name]
        if name == "settling" and (before.never or after.never):  # however long such motions were watched
            lost = after.never_share > before.never_share
        if lost:
            told = [_told(one, name, unit) for one in (after, before)]
            found.append(f"{CALLED[name]}: {told[0]} instead of {told[1]}")
    return tuple(found)


def _told(found: Outcome, name: str, unit: str) -> str:
    """A quantity of an outcome in its unit; settling that there never was has no time."""
    if name == "settling" and found.never:
        return f"never in {found.never} of {found.motions} motions"
    return show(float(getattr(found, name)), unit, 3)
