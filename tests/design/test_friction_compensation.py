"""The RFM: as many elements as asked for, close to the machine's friction, inner loops included."""

from __future__ import annotations

import numpy as np
import pytest

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
