"""By how much nominal values were moved: by the re-fit, beside effects and in the file that is handed over."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from diagnosis.baseline import Baseline
from diagnosis.diagnose import NAMED, Diagnosis
from diagnosis.handover.files import Content
from diagnosis.handover.moved_most import START
from diagnosis.model.parameters import Parameters, bounded, moved, parameters, priors
from diagnosis.model.residual import Candidate
from diagnosis.refit import CALLED


def shifts(found: Diagnosis) -> list[dict[str, Any]]:
    """By how many standard deviations of its tolerance each kind of nominal value was moved at most, without the
    friction's initial state: by the re-fit alone, in the file that is handed over, and beside effects where there are
    some; and the usual bound. What counts as moved is less by what the re-fit moves where nothing is wrong."""
    usual = found.baseline.nominal.candidate.layout
    refitted, adopted = found.how_far.handover.named(Content.REFITTED), found.how_far.handover.adopted
    beside = _less_bias(beside_effects(found), found.baseline)
    fits = [file.finished.fitted.candidate for file in (refitted, adopted) if file is not None and file.finished]
    refit = _less_bias(fits[0], found.baseline)
    known, rows = {one.name: one for one in priors(usual)}, []
    for name in dict.fromkeys(fits[0].layout.names):
        if name != START:
            away = [_away(name, one) for one in fits]
            most = [float(one[abs(one).argmax()]) for one in away]
            in_file = most[-1] if adopted.finished else 0.0
            bound = float((usual.high / _tolerances(usual))[usual.of(name)].max())
            row = {"name": name, "moved": _most_moved(name, refit), "by_fit": most[0], "in_file": in_file}
            row |= {"values": int(away[0].size), "bound": bound}
            prior = known[name]
            told = {"unit": prior.unit, "std": list(prior.deviations), "origin": prior.origin}
            row |= {"beside": _most_moved(name, beside), "in_all_beside": _of_all_contacts(name, beside)}
            row |= {"delay": _whole_delay(name, refit), "delay_beside": _whole_delay(name, beside)}
            rows.append({**row, **told, "in_all": _of_all_contacts(name, refit)})
    return rows


def beside_effects(found: Diagnosis) -> Candidate | None:
    """The candidate with the effects that are named, or with the law that is handed over; None without either."""
    handover = found.how_far.handover
    if found.outcome in NAMED:
        return found.told.candidate
    fitted = handover.adopted.finished
    return fitted.candidate if fitted is not None and handover.adopted.name == Content.MEASURED else None


def _less_bias(fitted: Candidate | None, baseline: Baseline) -> Candidate | None:
    """The candidate with its values where they would be but for what the re-fit moves where nothing is wrong."""
    if fitted is None or not baseline.biased:
        return fitted
    layout, theta = fitted.layout, fitted.theta.copy()
    own = np.flatnonzero(np.array(layout.names) != START)
    bias = zip(own, baseline.null.bias() * _tolerances(layout)[own], strict=True)
    for place, off in bias:
        theta[place] -= off if CALLED.get(layout.names[place], layout.names[place]) in baseline.biased else 0.0
    return replace(fitted, theta=bounded(layout, theta))


def _most_moved(name: str, fitted: Candidate | None) -> float | None:
    """By how many standard deviations of its tolerance [1] the value of this kind that moved the most was moved."""
    if fitted is None:
        return None
    away = _away(name, fitted)
    return float(away[abs(away).argmax()])


def _away(name: str, fitted: Candidate) -> NDArray[np.float64]:
    """By how many standard deviations of their tolerance [1] the values of this kind were moved."""
    layout = fitted.layout
    away = moved(layout, fitted.theta) * layout.deviation / _tolerances(layout)
    return np.asarray(away[layout.of(name)])


def _tolerances(layout: Parameters) -> NDArray[np.float64]:
    """Those of a layout's values [SI; 1 for logarithms], of which a fit may have others, as of an offset far off."""
    return parameters(layout.machine, layout.records).deviation


def _whole_delay(name: str, fitted: Candidate | None) -> float | None:
    """By how much dead time and lags together were moved [s]; None for other values."""
    if fitted is None or name != "dead_time":
        return None
    before, after = fitted.nominal, fitted.machine
    lag = sum(one.input_delay() for one in fitted.effects) - sum(one.input_delay() for one in before.effects)
    return after.plant.dead_time - before.plant.dead_time + lag


def _of_all_contacts(name: str, fitted: Candidate | None) -> float | None:
    """By what part of itself [1] the force of all contacts where they slip (the friction's level), their stiffness
    together or their mean displacement at slip was moved; None for other values. That of a single contact, which the
    others nearly make up for, is hardly known."""
    if fitted is None or name not in {"friction_level", "presliding_stiffness", "presliding_limit"}:
        return None
    layout, friction = fitted.layout, fitted.layout.machine.friction
    level, stiffer, longer = (
        fitted.theta[layout.of(one)] for one in ("friction_level", "presliding_stiffness", "presliding_limit")
    )
    stiffness = np.array(friction.stiffness)
    force = stiffness * friction.limit
    if name == "presliding_limit":
        return float(np.average(np.expm1(longer), weights=force))
    if name == "presliding_stiffness":
        return float(np.average(np.expm1(level + stiffer), weights=stiffness))
    return float(np.average(np.expm1(level + stiffer + longer), weights=force))
