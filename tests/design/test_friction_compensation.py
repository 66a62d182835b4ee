"""The RFM: as many elements as asked for, close to the machine's friction, inner loops included."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from design.friction_compensation import simplify
from models.ensemble import load_ensemble
from models.friction import branch, elements, follow
from models.machine import load

TABLE = load().friction


def test_five_elements_follow_ten() -> None:
    rfm = simplify(TABLE, 5)
    distance = np.linspace(0, 250e-6, 500)
    assert len(rfm.limit) == 5
    assert rfm.coulomb_force == pytest.approx(TABLE.coulomb_force, rel=1e-12)
    assert np.max(np.abs(branch(rfm, distance) - branch(TABLE, distance))) < 0.05 * TABLE.coulomb_force


def test_more_elements_follow_better() -> None:
    distance = np.linspace(0, 250e-6, 500)
    errors = [np.max(np.abs(branch(simplify(TABLE, n), distance) - branch(TABLE, distance))) for n in (1, 2, 5, 20)]
    assert errors == sorted(errors, reverse=True)


def test_the_error_on_inner_loops_is_at_most_that_of_their_branches() -> None:
    """Every history is built of branches (Masing): half of one from rest, and one for each reversal not yet closed.

    So the error of an inner loop is at most that many errors of the branch that the fit has seen.
    """
    corners = ((0, 80), (80, 50), (50, 70), (70, 20), (20, 100))
    path = np.concatenate([np.linspace(a, b, 200) for a, b in corners]) * 1e-6
    open_at_once = 3  # on the way from 70 to 50 um: the reversals at 80, 50 and 70 um
    distance = np.linspace(0, 250e-6, 20000)
    for friction in (TABLE, *(member.friction for member in load_ensemble()[::12])):
        rfm = simplify(friction, 5)
        of_branch = np.max(np.abs(branch(rfm, distance) - branch(friction, distance)))
        of_loops = np.max(np.abs(follow(rfm, path)[0] - follow(friction, path)[0]))
        assert 0 < of_loops <= (0.5 + open_at_once) * of_branch


def test_one_element_and_elements_without_stiffness_are_no_trouble() -> None:
    assert simplify(TABLE, 1).coulomb_force == pytest.approx(TABLE.coulomb_force)
    assert len(simplify(elements([0.0, 1e5], [1e-6, 1e-5]), 3).limit) == 3


@given(
    st.lists(st.tuples(st.floats(1e3, 1e9), st.floats(1e-8, 1e-2), st.floats(0, 1e4)), min_size=1, max_size=60),
)
def test_as_many_elements_as_the_machine_has_are_the_machine_s(table: list[tuple[float, float, float]]) -> None:
    """Their stiffnesses and limits to the last digit; the damping does not act in the RFM."""
    stiffness, limit, damping = zip(*table, strict=True)
    rfm = simplify(elements(stiffness, limit, damping), len(table))
    assert (rfm.stiffness, rfm.limit) == (stiffness, limit)
    assert set(rfm.damping) == {0.0}


def test_elements_without_stiffness_need_not_be_counted() -> None:
    friction = elements([0.0, 1e5, 3e5], [1e-6, 1e-5, 2e-5], [0.0, 10.0, 20.0])
    assert simplify(friction, 2) == elements([1e5, 3e5], [1e-5, 2e-5])
    assert simplify(friction, 3) == elements(friction.stiffness, friction.limit)
