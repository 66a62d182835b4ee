"""Runs with a dither and a past: what they share, what they do not, and a settling time that hangs on nanometres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.controller import default_controller
from design.judging.scatter import dither_of, margin_of, scatter
from design.validation import Validation, validate
from models.controller import PID
from models.machine import Machine, load, with_pid


@pytest.fixture(scope="module")
def machine() -> Machine:
    table = load()
    return replace(table, specification=replace(table.specification, interval=0.2))


def test_the_dither_is_a_nanometre_on_the_papers_table_and_scales_with_any_other(machine: Machine) -> None:
    assert dither_of(machine) == pytest.approx(1e-9)
    fine = replace(machine, scale=replace(machine.scale, resolution=0.0))
    assert dither_of(fine) == pytest.approx(1e-9)  # 1/2000 of the tolerance
    tight = replace(fine, specification=replace(machine.specification, tolerance=2e-8))
    assert dither_of(tight) == pytest.approx(1e-11)


def test_runs_differ_from_each_other_and_are_the_same_for_the_same_seed(machine: Machine) -> None:
    controller = default_controller(machine)
    one, same, other = (scatter(machine, controller, 3, seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(one.dispersion, same.dispersion)
    assert len({*one.dispersion, *other.dispersion}) == 6
    assert np.max(one.slowest) <= machine.specification.settling_time


def test_a_past_that_the_compensator_knows_costs_nothing(machine: Machine) -> None:
    """With the machine's own elements, led along each past, the motions are as good as from the virgin state."""
    law = replace(default_controller(machine), friction_compensation=machine.friction)
    virgin = validate(machine, law, periods=2)
    found = scatter(machine, law, 4, 0)
    assert np.max(found.slowest) == virgin.slowest.settling_time
    assert np.max(found.dispersion) < virgin.worst_dispersion + machine.scale.resolution


def test_a_settling_time_that_hangs_on_nanometres_says_so() -> None:
    """The PID of the largest gain that |S| <= 3 allows: 1 % more integral gain settles a swing earlier."""

    machine = load()

    def reversal(part: float) -> Validation:
        pid = PID(1.58298157e6, part * 2.86295700e8, 1.49033755e4, 2.76612616e-4)
        law = default_controller(machine).without_compensation().with_feedback(pid)
        return validate(with_pid(machine, pid, "test"), law, periods=4)

    found = reversal(1.0)
    margin = margin_of(found, reversal=True)
    assert found.reversal.settling_time == pytest.approx(27e-3)
    assert margin.less == pytest.approx(38e-9, abs=15e-9)
    assert margin.earlier == pytest.approx(reversal(1.01).reversal.settling_time) == pytest.approx(20.5e-3)
