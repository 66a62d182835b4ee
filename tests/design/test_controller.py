"""The dead-time compensation of an assembled controller: x_T* waits until the table can be there, not a sample more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.controller import default_controller, waiting
from design.linear_response import linear_response
from models.controller import references
from models.friction import elements
from models.machine import Machine, load
from models.simulation.simulator import simulate


def with_dead_time(dead_time: float) -> Machine:
    """The default table with another dead time [s]."""
    machine = load()
    return replace(machine, plant=replace(machine.plant, dead_time=dead_time))


@pytest.mark.parametrize(("dead_time", "samples"), [(0.0, 0), (0.3e-3, 0), (0.85e-3, 1), (1e-3, 2), (1.17e-3, 2)])
def test_the_reference_waits_for_the_plant_s_own_motion(dead_time: float, samples: int) -> None:
    """By the modes' closed form: x(k T_s) of P_l(s) under u_ff is x_T*[k - d], and not x_T* a sample beside it."""
    machine = with_dead_time(dead_time)
    controller, stroke = default_controller(machine), machine.specification.stroke
    assert controller.reference_delay == waiting(machine) == samples
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
