"""The paper's figures as data: the curves of one table, and at each point the range over the whole set."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.validation import Achieved, Validation
from models.friction import Friction, branch, follow
from models.machine import Machine
from models.plant import bode
from models.records.record import feeding_sequence
from studies.response_variation.published import Shown

Array = NDArray[np.float64]

MAX_SHOWN_S: Final = 0.1  # [s] The length of each motion shown, or all of a shorter one.
LEG: Final = 120  # points from one corner of a hysteresis curve to the next
OVERVIEW: Final = (-150, 150, -150)  # corners [um], as in Fig. 3a
INNER: Final = (-150, 150, -150, -40, -100, 20, -30, 80, 40, 60, -150)  # corners [um], loops within loops as in Fig. 4


def range_of(curves: Sequence[Array]) -> dict[str, Array]:
    """{"low", "high"}: least and largest of curves (n,) at each point."""
    return {"low": np.min(curves, axis=0), "high": np.max(curves, axis=0)}


def plants(machine: Machine, members: Sequence[Machine]) -> dict[str, Any]:
    """Fig. 2: P_l, P_e1, P_e2 of the machine, magnitude [m/N] and phase [deg], with their ranges; K_e as published."""
    frequency = np.geomspace(1.0, 200.0, 500)
    facts = machine.presliding
    curves: dict[str, Any] = {"frequency_Hz": frequency}
    for name, slope in {"P_l": 0.0, "P_e1": facts.stiffness_1, "P_e2": facts.stiffness_2}.items():
        own, *others = (bode(one.plant, 2 * math.pi * frequency, slope) for one in (machine, *members))
        magnitude = range_of([one for one, _ in others])
        phase = range_of([np.degrees(one) for _, one in others])
        curves[name] = {
            "magnitude_m_per_N": own[0],
            "magnitude_low_m_per_N": magnitude["low"],
            "magnitude_high_m_per_N": magnitude["high"],
            "phase_deg": np.degrees(own[1]),
            "phase_low_deg": phase["low"],
            "phase_high_deg": phase["high"],
            "stiffness_N_per_m": slope,
        }
    return curves


def hysteresis(central: Shown, tables: Sequence[Shown]) -> dict[str, Any]:
    """Figs. 3a, 3b and 4: the friction of the machine, of its RFM and of the set along three paths."""
    rfm = central.controller.friction_compensation
    assert rfm is not None
    own, others = central.machine.friction, [one.machine.friction for one in tables]
    distance = np.linspace(0, 200e-6, 400)
    climbed = range_of([branch(one, distance) for one in others])
    return {
        "overview": _along(OVERVIEW, own, rfm, others),
        "inner": _along(INNER, own, rfm, others),
        "branch": {
            "distance_m": distance,
            "machine_N": branch(own, distance),
            "rfm_N": branch(rfm, distance),
            "low_N": climbed["low"],
            "high_N": climbed["high"],
        },
        "leg": LEG,
        "elements": len(own.limit),
        "rfm_elements": len(rfm.limit),
    }


def _along(corners: Sequence[float], own: Friction, rfm: Friction, others: Sequence[Friction]) -> dict[str, Any]:
    x = np.concatenate([np.linspace(a, b, LEG) for a, b in pairwise(corners)]) * 1e-6
    before = np.concatenate([[0.0, 1e-3], x])  # the way down to the first corner slips fully
    forces = range_of([follow(one, before)[0][2:] for one in others])
    return {
        "position_m": x,
        "machine_N": follow(own, before)[0][2:],
        "rfm_N": follow(rfm, before)[0][2:],
        "low_N": forces["low"],
        "high_N": forces["high"],
    }


def reference(machine: Machine) -> dict[str, Any]:
    """Fig. 5: the target over one period."""
    wanted = machine.specification
    target = feeding_sequence(wanted.stroke, wanted.motions, wanted.interval, machine.sample_time)
    samples = round(wanted.interval / machine.sample_time)
    return {
        "time_s": np.arange(target[::samples].size + 1) * wanted.interval,
        "target_m": np.append(0.0, target[::samples]),
    }


def responses(central: Validation, others: Sequence[Validation]) -> dict[str, Any]:
    """Figs. 7, 8, 12 and 14: the positive motions of the central table with the range of each over the set."""
    shortest = min(one.motion.stop - one.motion.start for one in central.positive)
    n = min(round(MAX_SHOWN_S / central.response.record.sample_time), shortest)
    motions = [
        _motion(central, one, [(each, each.positive[i]) for each in others], n)
        for i, one in enumerate(central.positive)
    ]
    spread = range_of([one.dispersion[:n] for one in others])
    case: dict[str, Any] = {
        "time_s": np.arange(n) * central.response.record.sample_time,
        "motions": motions,
        "dispersion_m": central.dispersion[:n],
        "dispersion_low_m": spread["low"],
        "dispersion_high_m": spread["high"],
    }
    for kind in ("reversal", "inching"):
        of_kind = [one for one in motions if one["reversal"] is (kind == "reversal")]
        case[f"{kind}_low_m"] = np.min([one.pop("low_m") for one in of_kind], axis=0)
        case[f"{kind}_high_m"] = np.max([one.pop("high_m") for one in of_kind], axis=0)
    return case


def _motion(
    central: Validation, one: Achieved, others: Sequence[tuple[Validation, Achieved]], n: int
) -> dict[str, Any]:
    """A motion of the central table, and the range of the set's: over time, and of the friction over the position."""
    part, motion = slice(one.motion.start, one.motion.start + n), one.motion
    travelled = range_of([_travelled(each, its, n) for each, its in others])
    friction = range_of([_friction(each, its, n) for each, its in others])
    at = np.linspace(motion.origin, motion.target, 81)
    climbed = range_of(
        [
            np.interp(at - motion.origin, np.maximum.accumulate(_travelled(each, its, n)), _friction(each, its, n))
            for each, its in others
        ]
    )
    return {
        "origin_m": motion.origin,
        "target_m": motion.target,
        "reversal": motion.reversal,
        "settling_s": one.settling_time,
        "travelled_m": _travelled(central, one, n),
        "reference_m": central.response.record.reference[part] - motion.origin,
        "friction_N": _friction(central, one, n),
        "low_m": travelled["low"],
        "high_m": travelled["high"],
        "friction_low_N": friction["low"],
        "friction_high_N": friction["high"],
        "at_m": at,
        "at_low_N": climbed["low"],
        "at_high_N": climbed["high"],
    }


def _travelled(validation: Validation, one: Achieved, n: int) -> Array:
    start = one.motion.start
    return np.asarray(validation.response.position[start : start + n] - one.motion.origin)


def _friction(validation: Validation, one: Achieved, n: int) -> Array:
    return np.asarray(validation.response.friction[one.motion.start : one.motion.start + n])
