"""The dead-time compensation of an assembled controller: x_T* waits until the table can be there, not a sample more."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from design.controller import advanced, default_controller, paper_controller, reference_delay_samples
from design.deadbeat import DesignError
from design.feasibility import require_pid, require_stable
from design.linear_response import linear_response
from design.validation import validate
from models.controller import Controller, compensator_path, references, to_json
from models.controller import load as load_controller
from models.feedback.forms import NO_FILTERS, Filters
from models.friction import elements
from models.machine import Machine, load
from models.simulation.simulator import simulate
from tests.models.feedback.axis import CASCADE, FILTERS, axis


def with_dead_time(dead_time: float) -> Machine:
    """The default table with another dead time [s]."""
    machine = load()
    return replace(machine, plant=replace(machine.plant, dead_time=dead_time))


@pytest.mark.parametrize(("dead_time", "samples"), [(0.0, 0), (0.3e-3, 0), (0.85e-3, 1), (1e-3, 2), (1.17e-3, 2)])
def test_the_reference_waits_for_the_plant_s_own_motion(dead_time: float, samples: int) -> None:
    """By the modes' closed form: x(k T_s) of P_l(s) under u_ff is x_T*[k - d], and not x_T* a sample beside it."""
    machine = with_dead_time(dead_time)
    controller, stroke = default_controller(machine), machine.specification.stroke
    assert controller.reference_delay == reference_delay_samples(machine) == samples
    n = 60
    known = references(controller, np.full(n, stroke))
    moved = linear_response(machine.plant, known.feedforward, machine.sample_time, np.arange(n) * machine.sample_time)

    def apart(delay: int) -> float:
        waited = np.concatenate([np.zeros(delay), known.position])[:n]
        return float(np.max(np.abs(moved - waited)))

    assert apart(controller.reference_delay) < 1e-9 * stroke
    for other in {max(controller.reference_delay - 1, 0), controller.reference_delay + 1} - {samples}:
        assert apart(other) > 0.01 * stroke


@pytest.mark.parametrize("dead_time", [0.85e-3, 1e-3, 1.17e-3])
def test_without_friction_the_feedback_has_nothing_to_do(dead_time: float) -> None:
    """The thrust of the whole loop is u_ff alone: a reference that waits wrongly makes the PID act."""
    machine = with_dead_time(dead_time)
    free = replace(machine, friction=elements([1e-3], [1e-3]), scale=replace(machine.scale, resolution=0.0))
    controller = default_controller(machine).without_compensation()
    target = np.full(200, machine.specification.stroke)
    record = simulate(free, controller, target).record
    assert np.max(np.abs(record.command - record.feedforward)) < 1e-5 * np.max(np.abs(record.feedforward))


@pytest.mark.parametrize("filters", [NO_FILTERS, FILTERS], ids=["", "filters"])
def test_a_deadbeat_keeps_a_cascade_which_then_has_nothing_to_do_without_friction(filters: Filters) -> None:
    """Though its own reference path, with feedforwards and an unfiltered speed, would act on x_T* itself."""
    cascade = replace(CASCADE, velocity_filter=0.4e-3, velocity_feedforward=0.7, acceleration_feedforward=5.0)
    machine = axis(cascade, filters)
    free = replace(machine, friction=elements([1e-3], [1e-3]), drive=replace(machine.drive, offset=0.0))
    free = replace(free, scale=replace(free.scale, resolution=0.0))
    controller = default_controller(machine).without_compensation()
    assert controller.law is not None
    assert machine.control.law is not None
    for kept, stated in zip(controller.law.feedback_matrices(), machine.control.law.feedback_matrices(), strict=True):
        assert np.array_equal(kept, stated)
    target = np.full(300, machine.specification.stroke)
    record = simulate(free, controller, target).record
    most = np.max(np.abs(record.feedforward))
    assert np.max(np.abs(record.command - record.feedforward)) < 1e-5 * most
    own = simulate(free, replace(controller, law=machine.control.law), target).record
    assert np.max(np.abs(own.command - own.feedforward)) > 0.1 * most


def test_a_design_around_a_pid_refuses_another_feedback_in_a_line() -> None:
    require_pid(load())
    for machine in (axis(), axis(None, FILTERS), axis(None, anti_windup=1e-3)):
        with pytest.raises(
            DesignError, match=r"and this study designs around a plain PID alone; state the PID"
        ) as said:
            require_pid(machine)
        assert machine.control.in_words in str(said.value)
    with pytest.raises(DesignError, match=r"the loop is unstable: with control\.cascade on a mass of 12 kg"):
        require_stable(axis(replace(CASCADE, velocity_gain=1e6)))


@given(st.lists(st.floats(-1, 1), min_size=2, max_size=12), st.integers(0, 3))
def test_a_lead_of_whole_samples_is_a_shift_and_half_a_sample_the_mean(numbers: list[float], lead: int) -> None:
    """By the response to a step: what the path would do before the step is done at its first sample."""
    n_ff = [*numbers, 1.0 - sum(numbers)]
    response, count = np.append(np.cumsum(n_ff), np.ones(lead + 1)), len(n_ff)
    assert np.cumsum(np.array(advanced(n_ff, lead))) == pytest.approx(response[lead : lead + count], abs=1e-12)
    middle = 0.5 * (response[lead : lead + count] + response[lead + 1 : lead + 1 + count])
    assert np.cumsum(np.array(advanced(n_ff, lead + 0.5))) == pytest.approx(middle, abs=1e-12)


@pytest.mark.parametrize("dead_time", [0.0, 0.3e-3, 1e-3, 1.17e-3])
def test_the_compensator_is_led_through_where_the_table_is_while_its_thrust_acts(dead_time: float) -> None:
    """By the modes' closed form: half a sample after the thrust of sample k begins to act, L later than k T_s."""
    machine = with_dead_time(dead_time)
    controller, stroke, n = default_controller(machine), machine.specification.stroke, 60
    target = np.full(n, stroke)
    acting = dead_time + (np.arange(n) + 0.5) * machine.sample_time
    moved = linear_response(machine.plant, references(controller, target).feedforward, machine.sample_time, acting)
    apart = np.max(np.abs(moved - compensator_path(controller, target)))
    assert apart < 0.1 * np.max(np.abs(moved - compensator_path(replace(controller, path_ff=None), target)))


@pytest.mark.parametrize("count", [5, 10])
def test_on_the_nonsmooth_table_the_error_after_the_settling_time_is_smaller_than_along_x_t(count: int) -> None:
    machine = load()
    machine = replace(machine, control=replace(machine.control, compensator_elements=count))
    after = round(machine.specification.settling_time / machine.sample_time)

    def left(controller: Controller) -> float:
        return max(float(np.max(np.abs(one.error[after:]))) for one in validate(machine, controller).achieved)

    assert left(default_controller(machine)) < 0.75 * left(paper_controller(machine))


def test_the_path_is_on_file_and_none_where_it_is_that_of_x_t(tmp_path: Path) -> None:
    file = tmp_path / "controller.json"
    for controller in (default_controller(load()), paper_controller(load())):
        file.write_text(json.dumps(to_json(controller, 20e-6, 20e-3)), encoding="utf-8")
        assert load_controller(file) == controller
    middle = [2e-6, 8e-6, 20e-6]
    older = {key: value for key, value in to_json(controller, 20e-6, 20e-3).items() if key != "compensator_path_ff"}
    file.write_text(json.dumps({**older, "trajectory": {"middle_m": middle}}), encoding="utf-8")
    assert load_controller(file).path_ff == pytest.approx((0.1, 0.3, 0.6))
    old = {key: value for key, value in to_json(controller, 20e-6, 20e-3).items() if key != "compensator_path_ff"}
    file.write_text(json.dumps(old), encoding="utf-8")
    assert load_controller(file) == controller
