"""The objects of python-control make of signals what the controller makes of them."""

from __future__ import annotations

import control
import numpy as np
import pytest

from design.deployment.transfer_functions import transfer_functions
from models.controller import references
from models.simulation.simulator import simulate
from tests.models.deployment.laws import designed, motions


@pytest.mark.parametrize("kind", ["PID", "filters and anti-windup"])
def test_they_give_the_simulated_controller_s_signals(kind: str) -> None:
    machine, controller = designed(kind)
    controller, target = controller.without_compensation(), 0.3 * motions(machine, 4)
    parts, known = transfer_functions(controller), references(controller, target)
    time = machine.sample_time * np.arange(target.size)

    def response(name: str, signal: np.ndarray) -> np.ndarray:
        return np.asarray(control.forced_response(parts[name], time, signal).outputs).ravel()

    assert response("N_ff", target) == pytest.approx(known.position, abs=1e-15)
    assert response("D_ff", target) == pytest.approx(known.feedforward, abs=1e-7)
    record = simulate(machine, controller, target).record
    assert np.max(np.abs(record.command)) < machine.drive.rated_thrust
    late = np.concatenate([np.zeros(controller.reference_delay), known.position])[: target.size]
    feedback = response("C", late - record.position) + machine.drive.offset
    assert feedback == pytest.approx(record.command - record.feedforward, abs=1e-7)
