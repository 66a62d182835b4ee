"""Least squares of one structure: its slopes, beside what the ends of a single record leave."""

from __future__ import annotations

import numpy as np
import pytest

from models.identification.modal.fitting import jacobian, residual
from models.identification.modal.problem import Lines, Problem, Structure
from models.identification.modal.transfer import Array

LINES, TS = 400, 5e-4
F: Array = np.arange(20.0, 20.0 + LINES) * 0.5 / (LINES * TS)
THETA = {
    Structure(): [0.1, 1.4, 0.3, np.log(90.0), np.log(0.02), -0.2, np.log(240.0), np.log(0.004)],
    Structure(lag=True, drag=True): [0.1, 1.4, 0.4, 0.02, 0.3, np.log(90.0), np.log(0.02)],
    Structure(drag=True, spring=True): [0.1, 1.4, 0.02, 0.3, 0.3, np.log(90.0), np.log(0.02)],
}


def _problem(command: bool, ts: float = TS, settled: float = 0.0) -> Problem:
    """Lines of nothing: the residual is the model alone, less what the ends explain where there is a command."""
    drawn = np.random.default_rng(3).standard_normal((2, LINES))
    spectrum = drawn[0] + 1j * drawn[1] if command else None
    weight = (2 * np.pi * F) ** 2 / np.exp(0.1)
    return Problem(
        (Lines(F, np.zeros(LINES, complex), weight, ts, ts, spectrum, settled),), True, 1 / (2 * np.pi * F[-1]), 0.1
    )


@pytest.mark.parametrize("structure", THETA, ids=lambda one: "+".join(one.parts) or "modes")
@pytest.mark.parametrize("ts", [0.0, TS])
def test_the_slopes_are_those_of_the_residual(structure: Structure, ts: float) -> None:
    theta, problem = np.array(THETA[structure]), _problem(command=False, ts=ts)
    steps = 1e-4 * np.eye(theta.size)
    found = jacobian(theta, structure, problem)
    fourth = np.column_stack([
        (8 * (residual(theta + d, structure, problem) - residual(theta - d, structure, problem))
         - residual(theta + 2 * d, structure, problem) + residual(theta - 2 * d, structure, problem)) / 12e-4
        for d in steps
    ])  # fmt: skip
    assert np.max(np.abs(found - fourth) / np.max(np.abs(fourth), axis=0)) < 1e-3


@pytest.mark.parametrize("structure", THETA, ids=lambda one: "+".join(one.parts) or "modes")
@pytest.mark.parametrize("settled", [0.0, 0.2])
def test_their_gradient_is_that_of_the_cost_beside_the_ends(structure: Structure, settled: float) -> None:
    """Kaufman's slopes leave out what is orthogonal to the residual, so that the gradient is exact."""
    theta, problem = np.array(THETA[structure]), _problem(command=True, settled=settled)

    def cost(moved: Array) -> float:
        left = residual(moved, structure, problem)
        return 0.5 * float(left @ left)

    slopes, left = jacobian(theta, structure, problem), residual(theta, structure, problem)
    found, most = slopes.T @ left, np.linalg.norm(slopes, axis=0) * np.linalg.norm(left)
    steps = 1e-4 * np.eye(theta.size)
    exact = [
        (8 * (cost(theta + d) - cost(theta - d)) - cost(theta + 2 * d) + cost(theta - 2 * d)) / 12e-4 for d in steps
    ]
    assert np.max(np.abs(found - exact) / most) < 2e-4
    assert np.max(np.abs(found) / most) > 2e-2
