"""What is not met is said with its reason, and by leaving that out it is met."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from design.redesign.designs import designed
from design.redesign.prediction import Prediction, predicted
from design.redesign.unmet import unmet
from models.effects.structure import FloorVibration
from models.machine import Machine
from models.machines.parts import Covered
from models.variation import Variation, drawn
from tests.design.machines import far_side
from tests.design.redesign.axes import KNOWN

RUNS = 12


def said(machine: Machine, could_be: list[Machine] | None = None) -> str:
    design = designed(machine, "new")
    return "\n".join(unmet(design, machine, predicted(design, could_be or [machine] * RUNS, seed=1), seed=1))


def test_a_machine_that_is_known_and_can_do_it_leaves_nothing_to_say() -> None:
    assert said(replace(KNOWN, scale=replace(KNOWN.scale, resolution=1e-9, noise=1e-9))) == ""


def test_parameters_that_are_not_known_are_the_reason_where_each_likely_value_would_do() -> None:
    far = drawn(KNOWN, Variation(friction_force=0.5, mass=0.1), RUNS, seed=3)
    assert "it is the uncertainty of the parameters" in said(KNOWN, far)


def test_noise_is_the_reason_where_a_quiet_scale_would_do() -> None:
    noisy = replace(KNOWN, scale=replace(KNOWN.scale, noise=0.3 * KNOWN.specification.tolerance))
    assert "it is the scale's noise" in said(noisy)


def test_an_effect_that_cannot_be_met_is_the_reason_where_the_machine_without_it_would_do() -> None:
    shaken = FloorVibration(amplitude=40.0, frequency=10.0, phase=1.0)
    told = said(replace(KNOWN, effects=(shaken,)))
    assert "floor vibration stays: it follows a time" in told
    assert "it is floor vibration, which cannot be met ahead" in told


def test_a_dead_time_of_its_own_is_told() -> None:
    slow = replace(KNOWN.specification, settling_time=18e-3)
    told = said(replace(KNOWN, specification=slow))
    assert "the table follows it by the dead time of 1.061 ms" in told


def test_what_is_beyond_the_records_is_told() -> None:
    told = said(replace(KNOWN, covered=Covered(force=50.0, speed=1.0)))
    assert "is beyond the records, which cover 50 N" in told


def test_a_mode_through_which_the_friction_does_work_is_the_reason_where_it_makes_the_motions_late() -> None:
    told = said(far_side(KNOWN), [far_side(KNOWN)] * 3)
    assert "while the friction sticks, the model's loop is unstable for the mode of negative gain at 38 Hz" in told
    assert "the feedback's own speed" not in told


def test_one_late_run_of_forty_is_said() -> None:
    """The upper end of the interval is the second latest: one late run of 40 was all of them in time."""
    design = designed(KNOWN, "new")
    settling = np.full(40, 0.5 * KNOWN.specification.settling_time)
    settling[7] = 4 * KNOWN.specification.settling_time
    found = Prediction(settling, np.full(40, KNOWN.specification.tolerance))
    assert found.interval("settling").high < KNOWN.specification.settling_time
    assert "is not met in every run: 1 of 40 are late" in "\n".join(unmet(design, KNOWN, found))
