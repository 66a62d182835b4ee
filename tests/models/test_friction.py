"""The physics of stop elements, as properties: what any rolling friction of eqs. (3)-(8) has to obey."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.friction import Friction, branch, describing_stiffness, elements, fit_elements, follow, half_way
from models.machine import load

TABLE = load().friction
lengths = st.floats(1e-7, 1e-4)
frictions = st.lists(st.tuples(st.floats(1e3, 1e6), lengths), min_size=1, max_size=12).map(
    lambda pairs: elements([k for k, _ in pairs], [x for _, x in pairs])
)
paths = st.lists(st.floats(-2e-4, 2e-4), min_size=1, max_size=30).map(lambda points: np.array([0.0, *points]))


def force_scale(friction: Friction) -> float:
    return friction.coulomb_force


@given(frictions, paths)
def test_the_force_stays_within_the_coulomb_force(friction: Friction, path: np.ndarray) -> None:
    force, _ = follow(friction, path)
    assert np.max(np.abs(force)) <= friction.coulomb_force * (1 + 1e-12)


@given(frictions, lengths)
def test_masings_rule(friction: Friction, amplitude: float) -> None:
    """A branch behind a reversal is the virgin curve, doubled in both directions."""
    points = np.linspace(0, 1, 40)
    virgin, _ = follow(friction, np.concatenate([amplitude * points, [amplitude]]))
    back, _ = follow(friction, np.concatenate([[0.0, amplitude], amplitude - 2 * amplitude * points]))
    assert back[1] - back[2:] == pytest.approx(2 * virgin[:40], abs=1e-12 * force_scale(friction))


@given(frictions, st.floats(1e-6, 1e-4), st.floats(0.05, 0.95))
def test_return_point_memory(friction: Friction, amplitude: float, part: float) -> None:
    """An inner loop closes where it began, and the outer branch goes on as if it had not been."""
    inner = amplitude * (1 - part)
    state = follow(friction, [0.0, amplitude, -amplitude, inner])[1]
    after = follow(friction, [inner, -amplitude * part * 0.9, inner], state)[1]
    assert after == pytest.approx(state, abs=1e-12 * amplitude + 1e-18)


@given(frictions, paths, st.integers(2, 9))
def test_rate_independence(friction: Friction, path: np.ndarray, parts: int) -> None:
    """Only the way counts, not in how many steps it is gone."""
    fine = np.concatenate([np.linspace(a, b, parts, endpoint=False) for a, b in pairwise(path)] + [path[-1:]])
    assert follow(friction, fine)[1] == pytest.approx(follow(friction, path)[1], abs=1e-15)


@given(frictions, lengths)
def test_the_energy_dissipated_in_a_loop(friction: Friction, amplitude: float) -> None:
    """Between -A and A element i slips 2 (A - X_i) each way at K_i X_i: W = 4 sum K_i X_i max(A - X_i, 0)."""
    k, x = np.array(friction.stiffness), np.array(friction.limit)
    expected = float(np.sum(4 * k * x * np.maximum(amplitude - x, 0)))
    corners = np.unique(np.concatenate([[0.0], np.clip(2 * x, 0, 2 * amplitude), [2 * amplitude]]))
    start = follow(friction, [0.0, amplitude, -amplitude])[1]  # the loop is closed after one turn
    path = np.concatenate([-amplitude + corners, amplitude - corners])
    force, _ = follow(friction, path, start)
    work = float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(path)))  # exact: the force is linear between corners
    assert work == pytest.approx(expected, rel=1e-9, abs=1e-9 * friction.coulomb_force * amplitude)


@given(frictions, paths)
def test_a_closed_loop_never_gives_energy(friction: Friction, path: np.ndarray) -> None:
    loop = np.concatenate([path, path[::-1]])
    once = np.concatenate([np.linspace(a, b, 60) for a, b in pairwise(loop)])
    state = follow(friction, once)[1]  # after one turn the state repeats
    force, _ = follow(friction, once, state)
    work = float(np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(once)))
    # The trapezium errs where an element begins to slip within a step; that error is bounded by the step.
    bound = (
        0.5
        * friction.coulomb_force
        * float(np.max(np.abs(np.diff(once)), initial=0.0))
        * 2
        * len(friction.limit)
        * len(loop)
    )
    assert work >= -bound


@given(frictions)
def test_half_way_half_of_the_friction_has_turned_round(friction: Friction) -> None:
    assert branch(friction, [half_way(friction)])[0] == pytest.approx(friction.coulomb_force)


def test_a_branch_is_the_hysteresis_behind_a_reversal_from_full_slip() -> None:
    distance = np.linspace(0, 300e-6, 500)
    force, _ = follow(TABLE, np.concatenate([[0.0, -1e-3], -1e-3 + distance]))
    assert force[2:] - force[1] == pytest.approx(branch(TABLE, distance), abs=1e-9)


def test_elements_are_found_again_from_their_branch() -> None:
    distance = np.linspace(0, 250e-6, 300)
    again = fit_elements(TABLE.limit, distance, branch(TABLE, distance), TABLE.coulomb_force)
    assert again.stiffness == pytest.approx(TABLE.stiffness, rel=1e-6)


def test_a_friction_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match="as many stiffnesses as limits"):
        Friction((1.0,), (1.0, 2.0), (0.0,))
    with pytest.raises(ValueError, match="does not rise"):
        fit_elements([1e-6], [1e-6, 2e-6], [-1.0, -2.0], 1.0)


@pytest.mark.parametrize("over", [1.5, 3.0, 40.0])
def test_the_describing_function_is_that_of_an_elastoplastic_element(over: float) -> None:
    """In closed form (Caughey 1960): theta = acos(1 - 2 / over) is where the element begins to slip."""
    stiffness, limit = 2e6, 1e-6
    theta = math.acos(1 - 2 / over)
    expected = stiffness / math.pi * complex(theta - math.sin(2 * theta) / 2, math.sin(theta) ** 2)
    found = describing_stiffness(Friction((stiffness,), (limit,), (0.0,)), over * limit)
    assert found == pytest.approx(expected, rel=1e-3)


def test_without_slip_it_is_the_spring_and_far_beyond_it_is_coulomb_friction() -> None:
    friction = TABLE
    assert describing_stiffness(friction, 0.5 * min(friction.limit)) == pytest.approx(sum(friction.stiffness))
    far = 1000 * max(friction.limit)
    assert describing_stiffness(friction, far).imag == pytest.approx(
        4 * friction.coulomb_force / (math.pi * far), rel=0.01
    )
