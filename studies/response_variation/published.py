"""Every published number on the paper's table, beside the model's."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from design.controller import reference_delay_samples
from design.validation import Validation
from models.controller import Controller
from models.friction import branch
from models.machine import Machine, parameters
from models.plant import state_space
from models.quantity import show
from studies.response_variation.mechanism import slopes_met

# How the model comes to a published number: the search of the set fits it, the set has it by construction, or neither.
FITTED, CONSTRUCTED, PREDICTED = "fitted", "by construction", "predicted"


@dataclass(frozen=True)
class Shown:
    """A machine and its response to the sequence of Fig. 5, without and with friction compensation."""

    machine: Machine
    controller: Controller
    without: Validation
    with_rfm: Validation


def outcomes(validation: Validation) -> dict[str, float]:
    """Settling [s] of the reversal and of the slowest inching motion, and 3 sigma [m] after the settling time."""
    return {
        "reversal_settling_s": validation.reversal.settling_time,
        "inching_settling_s": max(one.settling_time for one in validation.inching),
        "dispersion_m": validation.worst_dispersion,
    }


def rows(central: Shown, tables: Sequence[Shown]) -> list[dict[str, Any]]:
    """One row per number: name, section, unit, paper, here, range of the set, relative difference.

    outcome: whether the set must meet it; the others are printed as "about" or as bounds, or are outside the
    model. how: whether the search fits it, the model has it by construction, or predicts it.
    """
    facts, published = central.machine.presliding, central.machine.published
    assert published is not None
    plant = central.machine.plant
    stand, load = (plant.modes[i] for i in plant.flexible)
    wanted, control = central.machine.specification, central.machine.control
    after = f"3 sigma after {show(wanted.settling_time, 's')}"
    ratio = published.dispersion_with / published.dispersion_without
    listed: tuple[tuple[str, str, str, float, Callable[[Shown], float], str], ...] = (
        (
            "Coulomb friction",
            "II.A",
            "N",
            facts.coulomb_force,
            lambda one: one.machine.friction.coulomb_force,
            CONSTRUCTED,
        ),
        ("first vibration mode", "II.B", "Hz", stand.frequency, lambda one: _frequency(one, 0), CONSTRUCTED),
        ("second vibration mode", "II.B", "Hz", load.frequency, lambda one: _frequency(one, 1), CONSTRUCTED),
        ("slope of Region 1", "II.C", "N/m", facts.stiffness_1, lambda one: _slopes(one)[0], CONSTRUCTED),
        ("slope of Region 2", "II.C", "N/m", facts.stiffness_2, lambda one: _slopes(one)[1], CONSTRUCTED),
        (
            "presliding region (about)",
            "II.C",
            "m",
            facts.extent,
            lambda one: max(one.machine.friction.limit),
            PREDICTED,
        ),
        ("end of Region 1 (about)", "II.C", "m", facts.boundary, _knee, PREDICTED),
        ("settling of the reference", "III.A", "s", wanted.reference_settling_time, _reference, CONSTRUCTED),
        (
            "dead-time compensation, in samples",
            "III.A",
            "1",
            control.reference_delay,
            lambda one: reference_delay_samples(one.machine),
            CONSTRUCTED,
        ),
        (
            "settling of the reversal, without compensation",
            "III.B",
            "s",
            published.reversal_settling_time,
            lambda one: outcomes(one.without)["reversal_settling_s"],
            FITTED,
        ),
        (
            "slope met by the reversal (almost)",
            "IV.A",
            "N/m",
            facts.stiffness_1,
            lambda one: slopes_met(one.without)[0],
            PREDICTED,
        ),
        (
            "slope met by the first inching motion (almost)",
            "IV.A",
            "N/m",
            facts.stiffness_2,
            lambda one: slopes_met(one.without)[1],
            PREDICTED,
        ),
        (
            "slope met by the last inching motion (almost)",
            "IV.A",
            "N/m",
            facts.stiffness_2,
            lambda one: slopes_met(one.without)[-1],
            PREDICTED,
        ),
        (
            f"{after}, without compensation",
            "V.B",
            "m",
            published.dispersion_without,
            lambda one: outcomes(one.without)["dispersion_m"],
            FITTED,
        ),
        (
            f"{after}, with compensation",
            "V.B",
            "m",
            published.dispersion_with,
            lambda one: outcomes(one.with_rfm)["dispersion_m"],
            PREDICTED,
        ),
        (
            "settling of the reversal, with compensation (at most)",
            "V.B",
            "s",
            wanted.settling_time,
            lambda one: outcomes(one.with_rfm)["reversal_settling_s"],
            PREDICTED,
        ),
        ("3 sigma with over without compensation", "VI", "1", ratio, _ratio, PREDICTED),
    )
    return [_row(*entry, central, tables) for entry in listed]


def taken_over(machine: Machine) -> list[dict[str, Any]]:
    """Published values that the model adopts as printed: meaning, unit, number and section of each."""
    compared = ("presliding", "published", "plant", "control.reference_delay", "specification.reference_settling_time")
    return [
        {"meaning": one.meaning, "unit": one.unit, "number": one.number, "section": one.provenance.detail}
        for one in parameters(machine)
        if one.provenance.kind == "paper" and not one.name.startswith(compared)
    ]


def _row(
    name: str,
    section: str,
    unit: str,
    paper: float,
    measure: Callable[[Shown], float],
    how: str,
    central: Shown,
    tables: Sequence[Shown],
) -> dict[str, Any]:
    here, over = measure(central), [measure(one) for one in tables]
    return {
        "name": name,
        "section": section,
        "unit": unit,
        "paper": paper,
        "here": here,
        "low": min(over),
        "high": max(over),
        "difference": here / paper - 1,
        "outcome": how != PREDICTED,
        "how": how,
    }


def _frequency(shown: Shown, index: int) -> float:
    """Natural frequency [Hz] of a vibration mode: of the poles of P_l as simulated, the rigid body's left out."""
    poles = np.linalg.eigvals(np.asarray(state_space(shown.machine.plant).A))
    found = np.unique(np.round(np.abs(poles[np.abs(poles) > 1]), 6)) / (2 * np.pi)
    return float(found[index])


def _slopes(shown: Shown) -> tuple[float, float]:
    facts, friction = shown.machine.presliding, shown.machine.friction
    end = 2 * max(friction.limit)
    climbed = branch(friction, [facts.boundary, end])
    return float(climbed[0]) / facts.boundary, float(climbed[1] - climbed[0]) / (end - facts.boundary)


def _knee(shown: Shown) -> float:
    """The distance [m] behind a reversal at which the local slope falls below the mean of the two published slopes."""
    facts = shown.machine.presliding
    distance = np.linspace(0, 3 * facts.boundary, 3001)
    slope = np.gradient(branch(shown.machine.friction, distance), distance)
    return float(distance[np.argmax(slope < 0.5 * (facts.stiffness_1 + facts.stiffness_2))])


def _reference(shown: Shown) -> float:
    """The time [s] from which on x_T* is on the target, to a millionth of the stroke."""
    travelled = np.cumsum(shown.controller.n_ff)
    return float((np.flatnonzero(np.abs(travelled - 1) > 1e-6)[-1] + 1) * shown.controller.sample_time)


def _ratio(shown: Shown) -> float:
    return outcomes(shown.with_rfm)["dispersion_m"] / outcomes(shown.without)["dispersion_m"]
