"""Draws of the machines that records allow have the fit's covariance, and stay where a file may have them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from design.controller import default_controller
from design.validation import sequence
from diagnosis.handover.posterior import drawn
from diagnosis.model.fit import coordinates
from diagnosis.model.parameters import parameters
from diagnosis.refit import refit
from diagnosis.which.table import covariance_of
from models.effects.friction_laws import ViscousFriction
from models.machine import load
from models.simulation.simulator import simulate

MACHINE = replace(load(), specification=replace(load().specification, interval=0.15))
DRAG = ViscousFriction(60.0)
COUNT = 1500


def test_draws_have_the_covariance_of_the_fit() -> None:
    """The correlations of a value with another are checked with their own: of 1500 draws, to 0.1 at four deviations."""
    noisy = replace(MACHINE, scale=MACHINE.scale.noisy(), effects=(DRAG,))
    record = simulate(noisy, default_controller(MACHINE), sequence(MACHINE, periods=1, lead=100), seed=2).record
    nominal = replace(MACHINE, scale=MACHINE.scale.noisy())
    fitted = refit(parameters(nominal, 1), [record], (DRAG,))
    found = drawn(fitted, None, COUNT, seed=3)
    names = np.array(fitted.candidate.layout.names)
    inner = np.isin(names, ("payload_mass", "dead_time", "friction_level", "amplifier_offset"))
    values = np.array([np.append(one.theta[inner], coordinates(one.effects[0])) for one in found])
    covariance = covariance_of(fitted)
    kept = np.append(np.flatnonzero(inner), names.size)
    wanted = covariance[np.ix_(kept, kept)]
    deviation = np.sqrt(np.diag(wanted))
    np.testing.assert_allclose(np.std(values, axis=0), deviation, rtol=4 / np.sqrt(2 * COUNT))
    middle = np.append(fitted.candidate.theta[inner], coordinates(fitted.candidate.effects[0]))
    np.testing.assert_allclose((np.mean(values, axis=0) - middle) / deviation, 0.0, atol=4 / np.sqrt(COUNT))
    np.testing.assert_allclose(np.corrcoef(values.T), wanted / np.outer(deviation, deviation), atol=4 / np.sqrt(COUNT))
    layout, starts = fitted.candidate.layout, names == "initial_friction_state"
    for one in found:
        assert np.all((layout.low <= one.theta) & (one.theta <= layout.high))
        reach = np.array(layout.machine.friction.limit) * np.exp(one.theta[names == "presliding_limit"])
        assert np.all(np.abs(one.theta[starts]) <= reach * (1 + 1e-12))  # an element begins within its own limit
