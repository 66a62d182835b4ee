"""The droop of Fig. 2, the friction of Fig. 7b as an observer sees it, and what is called small, by other means."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from design.controller import default_controller
from design.validation import Validation, validate
from models.machine import Machine, load
from models.plant import frequency_response
from studies.response_variation.amplitude import by_amplitude
from studies.response_variation.observer import disturbance, estimated
from studies.response_variation.small_effects import small_effects


@pytest.fixture(scope="module")
def machine() -> Machine:
    table = load()
    return replace(table, specification=replace(table.specification, interval=0.1))


@pytest.fixture(scope="module")
def without(machine: Machine) -> Validation:
    return validate(machine, default_controller(machine).without_compensation())


def test_the_droop_is_that_of_the_simulated_sines_and_needs_friction(machine: Machine) -> None:
    found = by_amplitude(machine)
    assert found["largest_difference"] < 0.04
    droops = [one["droop_Hz"] for one in found["curves"]]
    assert droops == sorted(droops, reverse=True)  # the longer the motion, the later the friction shows
    assert 2 < droops[3] < 10  # at 1 mm, as in Fig. 2
    slow = 2 * math.pi * found["frequency_Hz"][:1]
    lost = found["curves"][3]["magnitude_m_per_N"][0] / abs(frequency_response(machine.plant, slow)[0])
    assert lost < 0.2


def test_the_observer_finds_the_simulated_friction(machine: Machine, without: Validation) -> None:
    found = estimated(without)
    assert found["rms_N"] < 0.05 * machine.friction.coulomb_force
    for one in found["motions"]:
        assert one["steady_estimated_N"] == pytest.approx(one["steady_true_N"], abs=0.3)


def test_a_finer_scale_and_a_higher_cutoff_bring_the_estimate_to_the_truth(machine: Machine) -> None:
    """What is left is the low-pass and the scale's rounding: the inverse itself is exact at the samples' rate."""
    fine = replace(machine, scale=replace(machine.scale, resolution=0.0))
    found = validate(fine, default_controller(fine).without_compensation())

    def rms(cutoff: float) -> float:
        return float(np.sqrt(np.mean((disturbance(found, cutoff) - found.response.friction) ** 2)))

    assert rms(400.0) < 0.5 * rms(150.0)
    assert rms(400.0) < 0.01 * machine.friction.coulomb_force


def test_small_effects_are_small_and_dampers_act(machine: Machine) -> None:
    base, *others = small_effects(machine, default_controller(machine))
    for one in others:
        assert one["reversal_settling_s"] == pytest.approx(base["reversal_settling_s"], rel=0.1), one["name"]
        assert one["dispersion_without_m"] == pytest.approx(base["dispersion_without_m"], rel=0.1), one["name"]
        assert one["dispersion_without_m"] != base["dispersion_without_m"]
